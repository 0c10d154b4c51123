"""A camera that moves while the frames are taken: the motion is named first, and nothing else is
taken for it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.types.finding import MOVING

WIDTH, HEIGHT, SHAPE, FINE = 512, 320, (90, 280), 3
PATHS = {
    "steadily": lambda t: t,
    "ever faster": lambda t: t**2,
    "ever slower": lambda t: 2.0 * t - t**2,
}


def steps(period, count, axis="x", turn=0.0, sign=1):
    return PhaseSteps(axis, period, equal_steps(count, start_rad=turn, sign=sign))


def gray(axis="x", inverse=False):
    return GrayCode(axis, 8.0, WIDTH if axis == "x" else HEIGHT, inverse=inverse)


PLANS = {
    "three steps, code": (steps(16.0, 3), gray()),
    "four steps, pairs": (steps(16.0, 4), gray(inverse=True)),
    "four steps, light, code": (Uniform("white"), Uniform("black"), steps(16.0, 4), gray()),
    "beats": (steps(16.0, 4), steps(18.0, 4), steps(21.0, 4)),
    "both axes": (steps(16.0, 3), gray(), steps(16.0, 3, "y"), gray("y")),
}


def plan_of(*blocks):
    return PatternPlan(WIDTH, HEIGHT, blocks)


def photographed(plan, seed, speed_px=(0.0, 0.0), path="steadily", bump=None):
    """Frames of a painted wall with a ball before it; ``speed_px`` is the mean speed of the image
    along columns and rows, camera px from frame to frame. ``bump`` is a frame and the distance by
    which the image moves along columns before it."""
    rng = np.random.default_rng(seed)
    v, u = (np.mgrid[: SHAPE[0] * FINE, : SHAPE[1] * FINE] + 0.5) / FINE - 0.5
    u, v = u - SHAPE[1] / 2, v - SHAPE[0] / 2
    ball = 1.0 - ((u - rng.uniform(-70, 70)) / 50.0) ** 2 - (v / 38.0) ** 2
    depth = rng.uniform(-0.1, 0.1) * u + 18.0 * np.sqrt(np.clip(ball, 0.0, None))
    columns = WIDTH / 2 + 1.7 * u + rng.choice([-0.5, 0.5]) * depth
    rows = HEIGHT / 2 + 1.8 * v + 0.02 * u
    paint = 0.7 + 0.2 * np.sign(np.sin(u / 13.0 + 1.0) * np.cos(v / 17.0))
    places = PATHS[path](np.linspace(0.0, 1.0, plan.frames)) * (plan.frames - 1)
    frames = []
    for block in plan.blocks:
        axis = getattr(block, "axis", "x")
        at, length = (columns, WIDTH) if axis == "x" else (rows, HEIGHT)
        for k in range(block.frames):
            pixels = np.arange(float(length))
            light = np.interp(at, pixels, block.values(pixels, k), left=0.0, right=0.0)
            counts = 3.0 + paint * (6.0 + 170.0 * light)
            moved = [FINE * speed * places[len(frames)] for speed in speed_px[::-1]]
            if bump is not None and len(frames) >= bump[0]:
                moved[1] += FINE * bump[1]
            counts = ndimage.shift(counts, moved, order=1, mode="nearest")
            seen = ndimage.gaussian_filter(counts, 0.6 * FINE)
            seen = seen.reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
            seen = seen + rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return frames


def told(frames, plan):
    """The refusal, or the warnings."""
    try:
        found = fw.decode(frames, plan).findings
    except fw.InputError as error:
        return str(error)
    return " | ".join(f"{one.kind}: {one.text}" for one in found if one.rank)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", PLANS)
def test_motion_is_named_first(name, path):
    plan, seed = plan_of(*PLANS[name]), 40 + len(name) + len(path)
    speed = (0.45, 0.3) if len(plan.axes) > 1 else (-0.45, 0.0)
    said = told(photographed(plan, seed, speed, path), plan)
    first = said.split("; besides")[0].split(", or the ")[0]
    assert "the camera or the scene moved" in first, said


@pytest.mark.parametrize("name", PLANS)
def test_fast_motion_is_refused(name):
    """1 px per frame: whole fringes were wrong at 8 to 9 of 10 pixels, at a σ of 0.1 to 1.2 px."""
    plan = plan_of(*PLANS[name])
    for path in PATHS:
        said = told(photographed(plan, 61, (1.0, 0.5), path), plan)
        assert said.startswith(("frames: the camera or the scene", MOVING)), said


@pytest.mark.parametrize("name", [name for name in PLANS if name != "beats"])
def test_slow_motion_is_measured(name):
    """0.1 px per frame: a warning at most, and coordinates of the time of the fringes. Of sets
    alone, fringe orders need all at one place."""
    plan = plan_of(*PLANS[name])
    found = fw.decode(photographed(plan, 62, (0.1, 0.0)), plan).x
    still = fw.decode(photographed(plan, 62), plan).x
    # A pixel sees what it would see at rest from 0.1 px times the number of frames away.
    fringes = [
        k
        for first, block in plan.placed
        for k in range(first, first + block.frames)
        if isinstance(block, PhaseSteps) and block.axis == "x"
    ]
    u = np.arange(SHAPE[1]) - 0.1 * np.mean(fringes)
    expected = np.stack([np.interp(u, np.arange(SHAPE[1]), row) for row in still.coordinate_px])
    off = np.abs(found.coordinate_px - expected)
    off = off[np.isfinite(off)]
    assert off.size > 0.5 * found.coordinate_px.size
    assert np.mean(off < 4.0) > 0.99


@pytest.mark.parametrize("name", PLANS)
def test_a_scene_at_rest_does_not_move(name):
    plan = plan_of(*PLANS[name])
    for seed in (63, 64):
        assert not told(photographed(plan, seed), plan)


@pytest.mark.parametrize("name", ["three steps, code", "beats", "both axes"])
@pytest.mark.parametrize(("turn", "sign"), [(0.5 * np.pi, 1), (np.pi, -1)])
def test_other_steps_are_no_motion(name, turn, sign):
    shown = [
        steps(b.period_px, b.frames, b.axis, turn, sign) if isinstance(b, PhaseSteps) else b
        for b in PLANS[name]
    ]
    said = told(photographed(plan_of(*shown), 65), plan_of(*PLANS[name]))
    first = said.split(", or ")[0]
    assert "sign or start" in first, said
    assert "moved" not in first


@pytest.mark.parametrize(
    ("name", "before", "px"),
    [
        ("three steps, code", 1, 8.0),
        ("four steps, light, code", 3, 12.0),
        ("beats", 1, 5.0),
        ("beats", 2, 8.0),
    ],
)
def test_a_bump_between_two_blocks_is_refused_with_its_size(name, before, px):
    """A camera that moved by nearly a fringe between fringes and code: orders were wrong at 97 % of
    the pixels, at a σ of 2.7 px; sets were said to have other steps."""
    plan = plan_of(*PLANS[name])
    first, _ = plan.placed[before]
    said = told(photographed(plan, 66, bump=(first, px)), plan)
    start = "frames: the camera or the scene moved by about "
    assert said.startswith(start), said
    assert abs(float(said[len(start) :].split(" px")[0]) - px) < 0.15 * px, said
    assert f"before {plan.labels()[first]}" in said
