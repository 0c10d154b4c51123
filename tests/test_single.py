"""Single frames: the plain fringes of the background replace the reference."""

from __future__ import annotations

import contextlib
import dataclasses
from functools import cache

import numpy as np
import pytest

from fringeworks import InputError, Pair, analyse, methods, reconstruct
from fringeworks.files import read_capture, write_pair
from fringeworks.pair.prepared import prepare
from tests.conftest import scene, true_displacement
from tests.shared import shared
from tests.two_frames import Bench, dome


def single(**changes):
    settings = {"size": 240, "fringes": 15, "height_mm": 30.0, **changes}
    both = scene("parabola", **settings)
    return dataclasses.replace(both, reference=None), true_displacement(both)


@cache
def prepared_single(axis):
    """A single frame with the background's fringes, which all methods share."""
    pair, truth = single(axis=axis)
    return prepare(pair), truth


@pytest.mark.parametrize("method", list(methods()))
@pytest.mark.parametrize("axis", ["x", "y"])
def test_every_method_measures_a_single_frame(method, axis):
    pair, truth = prepared_single(axis)
    result = analyse(pair, method)
    error = result.displacement_px - truth
    assert np.isnan(error).mean() < 0.03
    assert np.nanmean(np.abs(error)) < 0.5


def test_background_may_be_given():
    pair, truth = single(noise=1.0, bits=8, seed=1)
    background = np.abs(truth) < 0.01
    measured = analyse(dataclasses.replace(pair, background=background), "fourier")
    assert np.nanmean(np.abs(measured.displacement_px - truth)) < 0.3
    with pytest.raises(InputError, match="background: expected shape"):
        analyse(dataclasses.replace(pair, background=background[1:]), "fourier")
    with pytest.raises(InputError, match="background: expected fringes over"):
        analyse(dataclasses.replace(pair, background=np.zeros_like(background)), "fourier")


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("body", ["parabola", "cube", "cylinder", "sphere"])
def test_sigma_covers_what_one_frame_does_not_tell(body, given):
    both = scene(body, size=300, fringes=20, height_mm=60.0, noise=1.0, bits=8, seed=1)
    background = both.truth_mm == 0.0 if given else None
    found = reconstruct(dataclasses.replace(both, reference=None, background=background), "fourier")
    z = (found.surface.values - both.truth_mm) / found.surface.sigma
    assert np.mean(np.abs(z) < 2.0) > 0.93
    assert np.mean(np.abs(z) > 5.0) < 0.01
    assert np.mean(np.abs(z[both.truth_mm == 0.0]) < 2.0) > 0.93


@pytest.mark.parametrize(
    ("body", "message"),
    [("step", "and another with"), ("tilt", "one plane all over"), ("plane", "one plane all over")],
)
def test_a_background_that_nothing_tells_is_refused(body, message):
    both = scene(body, size=300, fringes=20, height_mm=60.0, noise=1.0, bits=8, seed=1)
    with pytest.raises(InputError, match=f"{message}.*give the pixels that show"):
        analyse(dataclasses.replace(both, reference=None), "fourier")


def test_a_body_that_fills_the_frame_is_no_background():
    y, x = np.mgrid[:240, :300].astype(float)
    bowl = 2e-3 * ((x - 150) ** 2 + (y - 120) ** 2)
    frame = 100 + 80 * np.cos(2 * np.pi * x / 12.0 + 0.3 * bowl)
    with pytest.raises(InputError, match="expected the fringes of one plane along"):
        analyse(Pair(None, frame), "fourier")


def test_a_plane_in_perspective_is_flat():
    """Fringes on a plane in perspective widen across the frame; the projective phase follows."""
    y, x = np.mgrid[:240, :300].astype(float)
    phase = 2 * np.pi * (x / 14.0 + 0.002 * y) / (1 + 6e-4 * x - 2e-4 * y)
    bump = 3.0 * np.exp(-((x - 150) ** 2 + (y - 120) ** 2) / 1500)
    frame = 100 + 80 * np.cos(phase - bump)
    measured = analyse(Pair(None, frame), "fourier")
    away = (np.hypot(x - 150, y - 120) > 90) & (x > 20) & (x < 280)
    assert np.nanmax(np.abs(measured.phase_rad[away])) < 0.15
    assert measured.phase_rad[120, 150] == pytest.approx(3.0, abs=0.4)


@shared
def in_perspective():
    """An object frame of a ray-caster, the true displacement and the lit pixels."""
    one = Bench(shape=(160, 220), beside=200.0, projector_height=450.0, roll=4.0, period=11.0)
    _, frame, truth, lit = one.pair(dome(26.0, 9.0))
    return frame, truth, lit


@pytest.mark.parametrize("given", [False, True])
def test_sigma_covers_the_plane_in_perspective(given):
    frame, truth, lit = in_perspective()
    background = lit & (np.abs(truth) < 1e-3)
    found = analyse(Pair(None, frame, background=background if given else None), "fourier")
    error = np.abs(found.displacement_px - truth)
    assert np.nanmedian(error[background]) < 0.008
    for part in (background, lit & ~background):
        assert np.nanmean(error[part] < 2.0 * found.sigma_px[part]) > 0.9


LENS = 0.01
"""Displacement of the frame's edge by a lens, as a share of half its width."""


@pytest.mark.parametrize("seen", ["around", "on one side"])
def test_a_given_background_may_be_bent_by_a_lens(seen):
    y, x = np.mgrid[:160, :220].astype(float)
    u, v = (x - 110) / 110, (y - 80) / 110
    place = x + LENS * 110 * u * (u * u + v * v)
    phase = 2 * np.pi * (place / 12.0 + 0.002 * y) / (1 + 6e-4 * x - 2e-4 * y)
    bump = 2.0 * np.exp(-((x - 130) ** 2 + (y - 80) ** 2) / 500)
    noise = np.random.default_rng(2).standard_normal(x.shape)
    frame = np.rint(100 + 80 * np.cos(phase - bump) + noise)
    background = (bump < 1e-4) if seen == "around" else x < 70
    found = analyse(Pair(None, frame, background=background), "fourier")
    inner = np.s_[8:-8, 12:-12]
    error = np.abs(found.phase_rad - bump)[inner]
    sigma = found.sigma_px[inner] * 2 * np.pi / found.period_px
    assert np.nanmean(error < 2.0 * sigma) > 0.9
    if seen == "around":
        assert np.nanmedian(error) < 0.02
        assert np.nanmedian(sigma) < 0.03


def test_notes_and_files(tmp_path):
    pair, _ = single()
    write_pair(tmp_path / "one", pair)
    assert not (tmp_path / "one" / "reference.tif").exists()
    again = read_capture(tmp_path / "one")
    assert again.reference is None
    result = reconstruct(again, "fourier")
    assert any("no reference frame" in note for note in result.notes)
    assert result.surface.unit == "mm"


def test_frames_without_fringes_are_refused():
    with pytest.raises(InputError, match="object frame: expected fringes"):
        analyse(Pair(None, np.random.default_rng(0).random((100, 100))), "fourier")


@cache
def narrow(shape, seed):
    """A narrow frame, ready for every method, or None where its background is refused."""
    t = np.indices(shape)[int(shape[0] < shape[1])]
    noise = np.random.default_rng(seed).standard_normal(shape)
    frame = 100 + 50 * np.cos(2 * np.pi * (t - 1.3) / 6.0) + 0.5 * noise
    with contextlib.suppress(InputError):
        return prepare(Pair(None, frame))


@pytest.mark.parametrize("shape", [(1, 200), (200, 1), (3, 64), (16, 16)])
@pytest.mark.parametrize("method", list(methods()))
def test_narrow_frames_are_measured_or_refused(shape, method):
    for seed in range(5):
        if (pair := narrow(shape, seed)) is None:
            continue
        try:
            measured = analyse(pair, method)
        except InputError:
            continue
        assert measured.displacement_px.shape == shape
