"""Pictures of one bit: their means are grey levels, and σ holds what is left of the dots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files import read_plan, write_patterns
from fringeworks.files.images import read_frame
from fringeworks.patterns.binary import diffused, packed
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import InputError


def mixed(bits=1):
    blocks = (
        PhaseSteps("x", 17.3, equal_steps(5)),
        PhaseSteps("y", 130.0, equal_steps(4)),
        GrayCode("x", 8.0, 160),
        Uniform("white"),
        Uniform("black"),
    )
    return PatternPlan(160, 120, blocks, bits=bits)


def test_lines_have_the_means_of_their_grey_levels():
    shares = np.random.default_rng(1).uniform(0, 1, 400)
    lines = diffused(shares, 777)
    assert set(np.unique(lines)) == {0, 1}
    sums = np.cumsum(lines, axis=0) - np.arange(1, 778)[:, None] * shares
    assert np.abs(sums).max() < 1.0


def test_a_plan_of_one_bit_is_drawn_along_its_fringes():
    grey = list(fw.encode(mixed(8)))
    for k, (picture, wanted) in enumerate(zip(fw.encode(mixed()), grey, strict=True)):
        assert picture.dtype == np.uint8
        assert picture.max() <= 1
        axis = 1 if 5 <= k < 9 else 0
        np.testing.assert_allclose(
            picture.mean(axis=axis), wanted.mean(axis=axis) / 255, atol=1 / 120 + 1 / 500
        )
        if k >= 9:
            # Codes, white and black have no grey levels.
            np.testing.assert_array_equal(picture, wanted // 255)


def test_it_is_stored_as_black_and_white(tmp_path):
    written = write_patterns(tmp_path / "p", mixed())
    assert read_plan(tmp_path / "p" / "plan.toml") == mixed()
    for path, picture in zip(written, fw.encode(mixed()), strict=True):
        np.testing.assert_array_equal(read_frame(path)[0], 255 * picture)


def test_what_has_no_meaning_is_refused():
    for changed in ({"gamma": 2.2}, {"dither": True}):
        with pytest.raises(
            InputError, match="expected gamma 1 and no dither for pictures of 1 bit"
        ):
            replace(mixed(), **changed)


def test_planes_hold_the_pictures():
    rng = np.random.default_rng(2)
    for bits, count in ((1, 24), (8, 3), (8, 2)):
        pictures = [rng.integers(0, 2**bits, (5, 7)) for _ in range(count)]
        words = packed(pictures, bits)
        for k, picture in enumerate(pictures):
            np.testing.assert_array_equal(words >> (k * bits) & 2**bits - 1, picture)


@pytest.mark.statistical
@pytest.mark.parametrize("defocus_px", [1.2, 2.0, 3.0])
def test_sigma_holds_what_the_dots_leave(defocus_px):
    """Blurred by 1.2 px and more, errors of coordinates are within σ; there is no bias."""
    rig = standard_rig(scale=0.4)
    view = look(rig, bust())
    plan = replace(fringe_plan(rig, both=False), bits=1)
    truth = np.where(view.lit, view.projector_px[..., 0], np.nan)
    errors, deviations = [], []
    for seed in (11, 12):
        optics = Optics(defocus_px=defocus_px, noise=0.5, exposure=0.9, seed=seed)
        decoded = fw.decode(list(photograph(view, plan, optics)), plan).x
        error = decoded.coordinate_px - truth
        good = np.abs(error) < 1
        errors.append(error[good])
        deviations.append(np.abs(error[good] / decoded.sigma_px[good]))
    error, z = np.concatenate(errors), np.concatenate(deviations)
    assert np.abs(np.mean(error)) < 0.01
    assert np.sqrt(np.mean(error**2)) < 0.09
    assert 0.6 < np.mean(z < 1) < 0.9
    assert np.mean(z < 2) > 0.92
