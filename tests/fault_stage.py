"""The stage of the fault table: a scene under a plan's patterns, and the camera that sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from fringeworks import PatternPlan
from fringeworks.patterns import PhaseSteps
from tests.fault_scenes import Seen, see

EXPOSURE = 200.0
"""Counts of a white surface under full light."""
BLACK = 5.0
"""Black level of the camera, counts; far enough from zero for a noise of 1 count."""
AMBIENT = 0.08
"""Ambient light as a share of the projector's full light."""
LEAK = 0.03
"""Light of a projector's black, as a share of its white; a contrast of 33 in a room."""
NOISE = 1.0
"""Noise of the camera in every fault that says nothing else, counts."""
JUMP_PX = 1.0
"""Change of slope between three pixels in a row from which on there is a depth step, px.

It stays below 0.03 px on the smooth surfaces; the smallest step of the scenes is 3 px.
"""
REACH = 5
"""Pixels across that the light of one pixel comes from: its area and a lens blur of 0.5 px rms."""
LENS_PX = 0.5
"""Blur of the camera's lens in views that move or mix, px rms; that of a sharp lens."""
SLACK_PX = 3.0
"""Distance from either side that counts as right at a depth step, px.

A coordinate changes by up to 3 px over a pixel, and the parts of a pixel are not told apart.
"""


@dataclass(frozen=True)
class Shot:
    """Frames of a capture with the coordinates that a decoder should find."""

    frames: np.ndarray
    """(n, h, w) counts."""
    truth: np.ndarray
    """(k, h, w) px: every coordinate that is right; at depth steps both sides are. NaN: none is."""
    slack: np.ndarray | float = 0.0
    """Distance from the truth that counts as none, px or (h, w) px."""
    any_offset: bool = False
    """Whether a common offset of all coordinates is no error of the decoder.

    A constant error of all shifts cannot be told from a projector that is displaced by as much.
    """


@dataclass(frozen=True)
class Stage:
    """A scene under the patterns of a plan."""

    scene: str
    plan: PatternPlan

    @cached_property
    def seen(self) -> Seen:
        """The scene from a camera at rest."""
        return self.at((0.0, 0.0))

    @cached_property
    def direct(self) -> np.ndarray:
        """Reflected light of the projector, (n, h, w), 0…1. Not to be changed."""
        return np.stack([self.reflect(i) for i in range(self.plan.frames)])

    @cached_property
    def ambient(self) -> np.ndarray:
        """Reflected ambient light, (h, w)."""
        return AMBIENT * self.seen.albedo

    @cached_property
    def weights(self) -> np.ndarray:
        """Information of every frame about the coordinate, (n,), with the sum 1."""
        each = np.concatenate(
            [
                np.full(b.frames, b.period_px**-2.0 if isinstance(b, PhaseSteps) else 0.0)
                for b in self.plan.blocks
            ]
        )
        return each / each.sum()

    @property
    def finest_px(self) -> float:
        """The shortest period, projector px."""
        return min(b.period_px for b in self.plan.blocks if isinstance(b, PhaseSteps))

    @property
    def modulation(self) -> np.ndarray:
        """Modulation of the fringes without a fault, (h, w), counts; 0 where no light falls."""
        return 0.5 * EXPOSURE * (1.0 - LEAK) * self.seen.albedo * self.seen.lit

    def at(self, shift: tuple[float, float]) -> Seen:
        """The scene from a displaced camera."""
        return see(self.scene, self.plan.width_px, shift)

    def pattern(self, i: int, x: np.ndarray) -> np.ndarray:
        """Light that frame ``i`` sends to projector columns, LEAK … 1."""
        for first, block in self.plan.placed:
            if first <= i < first + block.frames:
                return LEAK + (1.0 - LEAK) * block.values(x, i - first)
        raise IndexError(i)

    def is_phase(self, i: int) -> bool:
        """Whether frame ``i`` shows fringes."""
        return bool(self.weights[i] > 0)

    def reflect(
        self, i: int, seen: Seen | None = None, pattern: Callable | None = None
    ) -> np.ndarray:
        """Reflected light of frame ``i``, (h, w)."""
        seen = seen or self.seen
        light = (pattern or self.pattern)(i, seen.x)
        return (seen.albedo * seen.lit * light).astype(np.float32)

    def each(self, pattern: Callable) -> np.ndarray:
        """Reflected light of all frames under changed patterns, plus the ambient light."""
        frames = [self.reflect(i, pattern=pattern) for i in range(self.plan.frames)]
        return np.stack(frames) + self.ambient

    def shot(self, frames: np.ndarray, *, any_offset: bool = False) -> Shot:
        """A shot of a scene at rest."""
        return Shot(frames, self.seen.truth[None], any_offset=any_offset)


def expose(
    light: np.ndarray,
    rng: np.random.Generator,
    *,
    noise: float = NOISE,
    gain: float = 0.0,
    exposure: float = EXPOSURE,
    black: float = BLACK,
) -> np.ndarray:
    """Frames of an 8-bit camera; ``gain`` is the shot noise's variance per count."""
    counts = np.asarray(exposure * light, np.float32)
    if noise or gain:
        normal = rng.standard_normal(counts.shape, dtype=np.float32)
        counts = counts + normal * (np.sqrt(noise**2 + gain * counts) if gain else noise)
    return np.clip(np.rint(counts + black), 0, 255).astype(np.uint8)


def depth_steps(x: np.ndarray) -> np.ndarray:
    """Pixels that depth steps or the borders of shadows (NaN) may send light to."""
    filled = np.where(np.isfinite(x), x, -1e3)
    jump = np.zeros(x.shape, bool)
    for axis in (0, 1):
        bend = np.diff(filled, 2, axis=axis, prepend=0.0, append=0.0)
        jump |= np.abs(bend) > JUMP_PX
    jump[[0, -1], :] = False
    jump[:, [0, -1]] = False
    return ndimage.maximum_filter(jump, REACH)


def at_edges(frames: np.ndarray, x: np.ndarray) -> Shot:
    """A shot of pixels that mix light: at depth steps and shadows, both sides are right."""
    edge = depth_steps(x)
    truth = [x]
    for size in (3, REACH):
        low = ndimage.minimum_filter(np.where(np.isfinite(x), x, np.inf), size)
        high = ndimage.maximum_filter(np.where(np.isfinite(x), x, -np.inf), size)
        truth += [np.where(edge, low, x), np.where(edge, high, x)]
    return Shot(frames, np.stack(truth), np.where(edge, SLACK_PX, 0.0))
