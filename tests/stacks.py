"""Simulated stacks of a camera that sees every projector pixel as one camera pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks import PatternPlan
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps


def multi(
    counts: Sequence[float], steps: int | Sequence[int], size=(960, 60), axis="x"
) -> PatternPlan:
    """A plan with several sets of fringes, given by their numbers of fringes."""
    length = size[0] if axis == "x" else size[1]
    each = [steps] * len(counts) if isinstance(steps, int) else steps
    sets = [PhaseSteps(axis, length / v, equal_steps(n)) for v, n in zip(counts, each, strict=True)]
    return PatternPlan(*size, tuple(sets))


def take(
    plan: PatternPlan,
    *,
    noise: float = 2.0,
    gain: float = 0.0,
    albedo: float | np.ndarray = 1.0,
    a: float = 127.5,
    b: float = 100.0,
    seed: int = 0,
    at: tuple[np.ndarray, np.ndarray] | None = None,
    kind=np.uint8,
) -> np.ndarray:
    """Frames (n, h, w) of albedo · (A + B · pattern) with noise; integers are rounded and clipped."""
    rng = np.random.default_rng(seed)
    # Patterns change along one axis: one row or column of a whole picture says it all.
    y, x = np.ogrid[: plan.height_px, : plan.width_px] if at is None else at
    shape = np.broadcast_shapes(x.shape, y.shape)
    frames = []
    for block in plan.blocks:
        down = isinstance(block, PhaseSteps | GrayCode) and block.axis == "y"
        for k in range(block.frames):
            light = albedo * (a + b * (2.0 * block.values((y if down else x) * 1.0, k) - 1.0))
            seen = np.broadcast_to(light, shape)
            if noise or gain:
                seen = light + np.sqrt(noise**2 + gain * light) * rng.standard_normal(shape)
            if np.dtype(kind).kind == "u":
                seen = np.clip(np.rint(seen), 0, np.iinfo(kind).max)
            frames.append(seen.astype(kind))
    return np.stack(frames)


def guarded(step: float = 16.0, steps: int = 4, size=(960, 60), *, inverse=False, white_black=True):
    """A plan of fringes and Gray code with cells of half a period."""
    blocks = [
        PhaseSteps("x", 2.0 * step, equal_steps(steps)),
        GrayCode("x", step, size[0], inverse),
    ]
    return PatternPlan(
        *size, (*blocks, *([Uniform("white"), Uniform("black")] if white_black else []))
    )
