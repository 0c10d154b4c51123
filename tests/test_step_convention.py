"""Sign and start of phase steps: the borders of a Gray code tell them."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

ROTATED = [(s, k) for s in (1, -1) for k in range(4) if (s, k) != (1, 0)]


def plan_of(shifts, cell, *, period=32.0, width=640, light="uniform"):
    code = GrayCode("x", cell, width, inverse=light == "inverse")
    uniform = (Uniform("white"), Uniform("black")) if light == "uniform" else ()
    return fw.PatternPlan(width, 200, (PhaseSteps("x", period, tuple(shifts)), code, *uniform))


def photographed(plan, *, seed=0, columns=640, blur=0.0, noise=1.5, tilt=0.0, turned=False):
    """Frames of a plane that the camera sees with other pixels than the projector's."""
    rng = np.random.default_rng(seed)
    rows = np.arange(150)[:, None]
    at = np.linspace(5.0, plan.width_px - 6.0, columns)[None] + tilt * (rows - 75.0)
    at = np.clip(at[:, ::-1] if turned else at, 0, plan.width_px - 1)
    frames = []
    for picture in fw.encode(plan):
        line = picture[0].astype(float)
        if blur > 0:
            reach = np.arange(-int(4 * blur), int(4 * blur) + 1)
            kernel = np.exp(-0.5 * (reach / blur) ** 2)
            line = np.convolve(
                np.pad(line, len(reach) // 2, "edge"), kernel / kernel.sum(), "valid"
            )
        seen = 30.0 + 0.6 * np.interp(at, np.arange(plan.width_px), line)
        frames.append(np.clip(seen + rng.normal(0, noise, seen.shape), 0, 255).astype(np.uint8))
    return frames


def refusal(frames, plan):
    """What decoding refuses frames with; nothing where it does not."""
    try:
        fw.decode(frames, plan)
    except fw.InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("light", ["uniform", "inverse", "fringes"])
@pytest.mark.parametrize("cell", [8.0, 16.0, 32.0])
def test_right_steps_are_kept(cell, light):
    for seed, columns, blur, turned in (
        (0, 640, 0.0, False),
        (1, 300, 1.5, True),
        (2, 900, 3.0, False),
    ):
        plan = plan_of(equal_steps(4), cell, light=light)
        frames = photographed(plan, seed=seed, columns=columns, blur=blur, turned=turned, tilt=0.3)
        fw.decode(frames, plan)


@pytest.mark.parametrize("cell", [16.0, 32.0])
@pytest.mark.parametrize(("sign", "start"), ROTATED)
def test_other_steps_are_refused_with_those_that_fit(sign, start, cell):
    projected = sign * np.asarray(equal_steps(4)) + start * np.pi / 2
    plan = plan_of(equal_steps(4), cell)
    frames = photographed(plan_of(projected, cell), seed=start, columns=500, blur=1.0, tilt=0.2)
    with pytest.raises(fw.FramesContradictPlan, match="steps that fit the frames") as error:
        fw.decode(frames, plan)
    fitting = str(error.value).split("on: ")[1].replace("°", "")
    found = np.radians([float(d) for d in fitting.split(", ")])
    off = np.angle(np.exp(1j * (found - projected)))
    assert np.abs(np.degrees(off)).max() < 8
    right = fw.decode(frames, plan_of(found, cell)).x
    assert np.mean(right.reason == fw.Reason.OK) > 0.8


@pytest.mark.parametrize("steps", [3, 5, 8])
def test_the_sign_is_found_with_any_number_of_steps(steps):
    plan = plan_of(equal_steps(steps), 32.0)
    back = plan_of(-np.asarray(equal_steps(steps)), 32.0)
    fw.decode(photographed(plan, seed=steps), plan)
    with pytest.raises(fw.FramesContradictPlan, match="runs against the Gray code"):
        fw.decode(photographed(back, seed=steps), plan)


@pytest.mark.long
def test_right_steps_are_kept_in_many_captures():
    """Periods, cells, pixels, blur, noise and tilt by chance: none is refused for its steps."""
    rng = np.random.default_rng(5)
    for _ in range(300):
        period = float(rng.uniform(12, 60))
        plan = plan_of(
            equal_steps(int(rng.integers(3, 9))), period * float(rng.choice([0.5, 1.0])), period=period,
            light=str(rng.choice(["uniform", "inverse", "fringes"])),
        )  # fmt: skip
        frames = photographed(
            plan, seed=int(rng.integers(1 << 30)), columns=int(rng.integers(250, 1000)),
            blur=float(rng.uniform(0, 3)), noise=float(rng.uniform(0.3, 4)), tilt=float(rng.uniform(-1, 1)),
        )  # fmt: skip
        assert "steps that fit" not in refusal(frames, plan)
