"""Three steps in the colours of a picture: crosstalk is measured and removed, and σ holds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns.encode import grey_pictures
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.simulate import (
    Bayer,
    Optics,
    bust,
    look,
    photograph,
    photograph_moving,
    standard_rig,
)
from fringeworks.stack import unmix
from tests.commands import run

SIZE = (400, 300)
SHAPE = (120, 160)
ROWS, COLUMNS = np.mgrid[: SHAPE[0], : SHAPE[1]]
COLUMN = COLUMNS * 2.0 + 30.0 + 9.0 * np.exp(-((COLUMNS - 80) ** 2 + (ROWS - 60) ** 2) / 900)
ROW = ROWS * 1.9 + 20.0 + 0.03 * COLUMNS
CROSSTALK = np.array([[1.0, 0.2, 0.03], [0.08, 1.0, 0.12], [0.05, 0.15, 1.0]])
"""Share of each colour's light in the channels: rows are channels."""


def sets(axis, *periods):
    return tuple(PhaseSteps(axis, p, equal_steps(3)) for p in periods)


PLAN = PatternPlan(*SIZE, sets("x", 20.0, 100.0, 400.0), colours=True)


def paint(seed, *, patches=False):
    """Albedo of the three colours, (3, h, w), smooth or in patches."""
    rng = np.random.default_rng(seed)
    field = ndimage.gaussian_filter(rng.standard_normal((3, *SHAPE)), (0, 9, 9))
    field /= field.std()
    if patches:
        field = np.where(field > 0.0, 1.0, -1.0)
    return 0.65 + 0.3 * np.tanh(field)


def photographs(plan, seed=0, *, gamma=1.0, patches=False, noise=1.5, full=8000.0, wheel=None):
    """Photographs of a painted bump, with noise of the camera and of the light."""
    rng = np.random.default_rng(1000 + seed)
    albedo = paint(seed, patches=patches)
    # Paint changes crosstalk, too: each colour has its own albedo.
    light = 0.75 * CROSSTALK[:, :, None, None] * (0.7 * albedo[None] + 0.3 * albedo[:, None])
    out = []
    for k, picture in enumerate(fw.encode(plan)):
        at = np.clip(np.stack((ROW, COLUMN)), 0, None)
        sent = (picture / 255.0) ** gamma
        sent = sent if wheel is None else sent * wheel(k)
        v = np.stack([ndimage.map_coordinates(sent[..., d], at, order=1) for d in range(3)])
        counts = 8.0 + 180.0 * np.einsum("cdhw,dhw->hwc", light, v)
        counts += np.sqrt(noise**2 + 210.0 / full * counts) * rng.standard_normal(counts.shape)
        out.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return out


def errors_of(found, truth=COLUMN):
    return found.coordinate_px - truth, found.sigma_px


def assert_honest(found, truth=COLUMN, measured=0.9):
    error, sigma = errors_of(found, truth)
    known = np.isfinite(error)
    assert known.mean() > measured
    assert np.count_nonzero(np.abs(error[known]) > 0.5 * min(found.periods_px)) == 0
    ratio = np.abs(error[known]) / sigma[known]
    assert 0.65 < np.mean(ratio < 1.0) < 0.75
    assert np.mean(ratio < 2.0) > 0.93


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("patches", [False, True])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_sigma_holds_on_painted_parts(gamma, patches, seed):
    plan = replace(PLAN, gamma=gamma)
    stack = unmix(photographs(plan, seed, gamma=gamma, patches=patches), plan)
    assert_honest(fw.decode(stack).x)
    assert any("20 % of green in red" in note or "of green in red" in note for note in stack.notes)


def test_crosstalk_that_is_not_removed_is_in_sigma():
    """Without their solid ones, the same pictures are measured as well as they can be: regions of
    the finest fringes tell the orders, and σ contains what the channels share."""
    pictures = photographs(PLAN, 2)
    frames = [p[..., d] for p in pictures[:3] for d in range(3)]
    mixed = fw.decode(frames, replace(PLAN, colours=False))
    error = np.abs(errors_of(mixed.x)[0])
    assert np.nanmax(error) < 5.0
    assert np.mean((error < 2.0 * mixed.x.sigma_px)[np.isfinite(error)]) > 0.9
    assert {"disagreement", "correlated noise"} <= {finding.kind for finding in mixed.warnings}
    found = fw.decode(unmix(pictures, PLAN)).x
    assert np.nanstd(errors_of(found)[0]) < 0.25
    assert np.nanmedian(mixed.x.sigma_px) > 3.0 * np.nanmedian(found.sigma_px)


def test_both_axes_and_gray_code():
    plan = PatternPlan(
        *SIZE,
        (
            *sets("x", 20.0, 100.0, 400.0),
            *sets("y", 20.0),
            GrayCode("y", 10.0, 300),
            Uniform("unused"),
        ),
        colours=True,
    )
    assert plan.frames == 18
    assert plan.pictures == 10
    found = fw.decode(unmix(photographs(plan, 3), plan))
    assert_honest(found.x)
    assert_honest(found.y, ROW)


def test_files_of_a_plan_and_of_its_photographs(tmp_path):
    written = fw.files.write_patterns(tmp_path / "pictures", PLAN)
    names = [path.name for path in written]
    assert names[3:] == ["3-red.png", "4-green.png", "5-blue.png", "6-black.png"]
    assert fw.files.read_plan(tmp_path / "pictures" / "plan.toml") == PLAN
    pictures = photographs(PLAN, 4)
    fw.files.write_stack(tmp_path / "shots", pictures, PLAN)
    found = fw.decode(tmp_path / "shots")
    assert found.x == fw.decode(unmix(pictures, PLAN)).x
    np.save(tmp_path / "all.npy", np.stack(pictures))
    assert fw.decode(fw.files.read_stack(tmp_path / "all.npy", PLAN)).x == found.x
    assert "crosstalk of the colours" in run("decode", tmp_path / "shots").stdout


def test_16_bit_and_floats():
    pictures = photographs(PLAN, 5)
    deep = fw.decode(unmix([p.astype(np.uint16) * 257 for p in pictures], PLAN)).x
    shares = fw.decode(unmix([p.astype(np.float32) / 255 for p in pictures], PLAN)).x
    assert_honest(deep)
    assert_honest(shares)


def test_the_colour_of_the_scene():
    colour = unmix(photographs(PLAN, 6), PLAN).colour
    albedo = paint(6)
    mixed = np.einsum("cd,hwcd->hwc", CROSSTALK, np.stack([0.7 * albedo + 0.3 * a for a in albedo]).transpose(2, 3, 0, 1))  # fmt: skip
    off = colour - 135.0 * mixed
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.5
    assert off.std() < 9.0


def test_a_colour_wheel_is_named_or_removed():
    def turning(change):
        return lambda k: 1.0 + change * np.sin(np.array([1.0, 2.3, 4.1]) + 2.4 * k)

    with pytest.raises(fw.FramesContradictPlan, match="colour wheel and an exposure"):
        unmix(photographs(PLAN, 7, wheel=turning(0.3)), PLAN)
    rows = np.arange(SHAPE[0])[:, None, None]
    bands = [
        np.clip(
            np.rint(p * (1.0 + 0.1 * np.sin(rows / 12.0 + np.arange(3) * 2.1 + 1.7 * k))), 0, 255
        )
        for k, p in enumerate(photographs(PLAN, 7))
    ]
    with pytest.raises(fw.FramesContradictPlan, match="colour wheel and an exposure"):
        unmix([p.astype(np.uint8) for p in bands], PLAN)
    stack = unmix(photographs(PLAN, 7, wheel=turning(0.03)), PLAN)
    assert_honest(fw.decode(stack).x)


def test_gamma_that_is_not_compensated_is_named():
    with pytest.raises(fw.FramesContradictPlan, match="gamma of camera or projector"):
        unmix(photographs(PLAN, 8, gamma=2.2), PLAN)


def test_pictures_that_cannot_be_unmixed_are_refused():
    pictures = photographs(PLAN, 9)
    grey = [np.repeat(p[..., 1:2], 3, axis=2) for p in pictures]
    rng = np.random.default_rng(0)
    noisy = [np.clip(p + rng.integers(-2, 3, p.shape), 0, 255).astype(np.uint8) for p in grey]
    cases = [
        (grey, "three equal channels"),
        (noisy, "a grey camera"),
        (pictures[:-1], "the plan has 7, the last four solid"),
        ([p[..., 0] for p in pictures], r"expected colours, \(h, w, 3\)"),
        ([*pictures[:-1], pictures[-1][:50]], "picture black: expected uint8"),
        ([p.astype(np.int32) for p in pictures], "got int32"),
    ]
    for given, words in cases:
        with pytest.raises(fw.InputError, match=words):
            unmix(given, PLAN)
    with pytest.raises(fw.InputError, match="colours = true"):
        unmix(pictures, replace(PLAN, colours=False))


def test_saturated_channels_are_not_measured():
    bright = [
        np.clip(2.0 * p.astype(float), 0, 255).astype(np.uint8) for p in photographs(PLAN, 10)
    ]
    found = fw.decode(unmix(bright, PLAN)).x
    clipped = (np.stack(bright) == 255).any(axis=(0, 3))
    assert 0.02 < clipped.mean() < 0.9
    fine = (np.stack([bright[0], *bright[3:]]) == 255).any(axis=(0, 3))
    assert np.isnan(found.coordinate_px[fine]).all()
    assert (found.reason[fine & ~clipped] == 0).sum() == 0


@pytest.mark.parametrize(
    ("blocks", "options", "words"),
    [
        ((*sets("x", 20.0, 400.0), Uniform("white")), {}, "three frames for each colour picture"),
        ((PhaseSteps("x", 400.0, equal_steps(6)),), {}, "three equal steps in the colours"),
        ((GrayCode("x", 10.0, 400, True),), {}, "sets of three"),
        (
            (Uniform("white"), *sets("x", 400.0), Uniform("white"), Uniform("black")),
            {},
            "of one pict",
        ),
        (sets("x", 400.0), {"bits": 10}, "expected 8 bit"),
    ],
)
def test_plans_that_do_not_fit_into_colours(blocks, options, words):
    with pytest.raises(fw.InputError, match=words):
        PatternPlan(*SIZE, blocks, colours=True, **options)


def test_what_shows_or_takes_grey_pictures_says_so(tmp_path):
    with pytest.raises(fw.InputError, match="expected grey pictures here, got colours"):
        next(grey_pictures(PLAN))
    with pytest.raises(fw.InputError, match="takes all three"):
        fw.files.write_stack(tmp_path / "s", photographs(PLAN, 11), PLAN)
        fw.files.read_stack(tmp_path / "s", channels="g")


def test_proposals_in_colours(tmp_path):
    found = fw.propose(1920, 1080, 8, colours=True)
    assert all(p.plan.colours and p.plan.pictures <= 8 for p in found)
    grey = fw.propose(1920, 1080, 12)[0]
    assert found[0].sigma_px < 2.0 * grey.sigma_px
    both = fw.propose(1920, 1080, 10, axes=("x", "y"), colours=True)[0]
    assert both.plan.pictures <= 10
    with pytest.raises(fw.InputError, match="expected 5 pictures or more"):
        fw.propose(1920, 1080, 4, colours=True)
    out = tmp_path / "plan.toml"
    size = ("--projector-size", "1920x1080", "--frames", "8")
    run("plan", *size, "--colours", "--out", out)
    assert fw.files.read_plan(out) == found[0].plan
    assert math.isclose(found[0].sigma_px, fw.propose(1920, 1080, 8, colours=True)[0].sigma_px)


@pytest.mark.parametrize("painted", [False, True])
@pytest.mark.parametrize("options", [{}, {"gamma": 2.2}, {"bits": 12}, {"jpeg": 95}], ids=str)
def test_photographs_of_the_virtual_rig(tmp_path, painted, options):
    """A bust, bare and painted, by a camera of three sensors."""
    rig = standard_rig(scale=0.2)
    size = (rig.projector.width_px, rig.projector.height_px)
    gamma = options.get("gamma", 1.0)
    plan = PatternPlan(*size, sets("x", 18.0, 94.0, size[0]), gamma=gamma, colours=True)
    view = look(rig, bust())
    rows, columns = np.indices(view.albedo.shape)
    waves = [0.6 + 0.35 * np.sin(columns / 17 + 2 * k) * np.cos(rows / 23 - k) for k in range(3)]
    colours = np.stack(waves, axis=-1) if painted else None
    optics = Optics(exposure=0.85, noise=1.0, gain=0.03, seed=31, **options)
    taken = list(photograph(view, plan, optics, paint=colours))
    assert len(taken) == plan.pictures
    found = fw.decode(fw.files.write_stack(tmp_path / "shots", taken, plan)).x
    error = (found.coordinate_px - view.projector_px[..., 0])[view.lit]
    ratio = np.abs(error / found.sigma_px[view.lit])
    ok = np.isfinite(error)
    assert ok.mean() > 0.7
    assert 0.66 < np.mean(ratio[ok] < 1.0) < 0.78
    assert np.mean(ratio[ok] < 2.0) > 0.94
    assert np.mean(np.abs(error[ok]) > 6.0) < 1e-4


def test_simulations_that_make_no_sense_are_refused():
    rig = standard_rig(scale=0.1)
    view = look(rig, bust())
    size = (rig.projector.width_px, rig.projector.height_px)
    plan = PatternPlan(*size, sets("x", 18.0, 94.0), colours=True)
    grey = replace(plan, colours=False)
    with pytest.raises(fw.InputError, match="bayer: expected None for a plan with colours"):
        next(photograph(view, plan, Optics(bayer=Bayer())))
    with pytest.raises(fw.InputError, match="paint: expected shape"):
        next(photograph(view, plan, paint=np.ones((4, 4, 3))))
    with pytest.raises(fw.InputError, match="paint: expected a plan with colours"):
        next(photograph(view, grey, paint=np.ones((*view.albedo.shape, 3))))
    with pytest.raises(fw.InputError, match="filters: expected three rows of three shares"):
        Optics(filters=((1.0, 0.0, 0.1), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    with pytest.raises(fw.InputError, match="expected grey pictures here, got colours"):
        next(photograph_moving([view], plan))
