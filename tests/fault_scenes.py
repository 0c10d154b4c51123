"""Scenes and plans of the fault table: what a camera pixel sees, as functions of its position.

A scene is a function of the camera position, not an array. A camera that moves by a part of a
pixel, or a pixel that averages over its area, is therefore computed without interpolation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fringeworks import PatternPlan, propose
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

SIZE = (480, 640)
"""Rows and columns of the camera."""

FINE = 3
"""Samples per camera pixel and axis of a fine view."""

MARGIN = 2
"""Pixels around the image that a fine view also covers, so that the camera can move."""

Look = Callable[[np.ndarray, np.ndarray, int], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Seen:
    """What every camera pixel sees of a scene."""

    x: np.ndarray
    """Projector coordinate of the surface, px, whether it is lit or not."""
    albedo: np.ndarray
    """Reflected share of the light, with the shading."""
    lit: np.ndarray
    """Whether the projector's light reaches the surface."""

    @property
    def truth(self) -> np.ndarray:
        """Projector coordinate, NaN where the projector does not light the surface."""
        return np.where(self.lit, self.x, np.nan)


@lru_cache(maxsize=48)
def see(scene: str, width: int, shift: tuple[float, float] = (0.0, 0.0)) -> Seen:
    """A scene from a camera that is displaced by ``shift`` = (columns, rows), px."""
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    x, albedo, lit = SCENES[scene](u + shift[0], v + shift[1], width)
    inside = (x > -0.5) & (x < width - 0.5)
    return Seen(x, albedo.astype(np.float32), lit & inside)


@lru_cache(maxsize=4)
def see_fine(scene: str, width: int) -> Seen:
    """A scene at 3 × 3 samples per pixel, with a margin of 2 px."""
    rows, columns = ((np.arange(FINE * (n + 2 * MARGIN)) - FINE // 2) / FINE - MARGIN for n in SIZE)
    u, v = np.meshgrid(columns, rows)
    x, albedo, lit = SCENES[scene](u, v, width)
    inside = (x > -0.5) & (x < width - 0.5)
    return Seen(x, albedo.astype(np.float32), lit & inside)


def pixels(fine: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Means of a fine view over the pixels of a camera displaced by (columns, rows), up to 2 px."""
    for axis, offset in ((0, shift[1]), (1, shift[0])):
        start = FINE * (MARGIN + np.clip(offset, -MARGIN, MARGIN - 0.01))
        first, part = int(start), start - int(start)
        weights = ((1.0 - part) / FINE, 1.0 / FINE, 1.0 / FINE, part / FINE)
        wide = np.moveaxis(fine, axis, 0)
        stop = FINE * SIZE[axis]
        parts = [w * wide[first + k :][:stop:FINE] for k, w in enumerate(weights)]
        fine = np.moveaxis(sum(parts[1:], parts[0]), 0, axis)
    return fine


def _wall(u: np.ndarray, v: np.ndarray, width: int) -> np.ndarray:
    """Coordinates on a wall, slightly curved, from beyond the first to beyond the last column."""
    across = u / 639.0
    return (
        width * (across * 1.03 - 0.015)
        + 0.02 * width * (v / 480.0 - 0.5)
        + 0.006 * width * np.sin(5.0 * across)
    )


def _texture(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Printed texture, 0.3 … 1: waves of 90, 23 and 6 px."""
    waves = (
        np.sin(u / 14.0 + 0.4) * np.cos(v / 17.0)
        + 0.6 * np.sin(u / 3.7 + v / 4.9)
        + 0.3 * np.cos(u / 1.1 - v / 1.3)
    )
    return 0.65 + 0.18 * waves


def plane(u: np.ndarray, v: np.ndarray, width: int) -> tuple[np.ndarray, ...]:
    """A textured wall whose albedo falls from 1 to 0.05 from top to bottom."""
    albedo = _texture(u, v) * np.exp(-2.6 * np.clip(v / 480.0, 0, 1))
    return _wall(u, v, width), albedo, np.ones(u.shape, bool)


def bust(u: np.ndarray, v: np.ndarray, width: int) -> tuple[np.ndarray, ...]:
    """A rounded body in front of a wall, with its shadow, dark patches and a printed chequerboard."""
    jump = (0.06 + 0.02 * (v - 260.0) / 185.0) * width  # 40 to 80 px at the rim
    across, down = (u - 300.0) / 140.0, (v - 260.0) / 185.0
    radius = across**2 + down**2
    body = radius < 1.0
    # The projector sees the body over wall columns that the camera sees further right.
    behind = u - jump * 639.0 / (1.03 * width)
    shadow = ~body & (((behind - 300.0) / 140.0) ** 2 + down**2 < 1.0)
    nose = 0.015 * width * np.exp(-(((u - 290.0) / 25.0) ** 2) - ((v - 250.0) / 40.0) ** 2)
    form = jump + 0.05 * width * (1.0 - radius) + nose
    x = _wall(u, v, width) + np.where(body, form, 0.0)
    albedo = _texture(u, v) * np.where(body, 1.0 - 0.45 * np.clip(radius, 0, 1), 0.9)
    chequer = (np.floor(u / 12.0) + np.floor(v / 12.0)) % 2
    albedo = np.where((u > 480) & (v > 60) & (v < 200), 0.12 + 0.8 * chequer, albedo)
    hair = body & (down < -0.55)
    albedo = np.where(hair, 0.05 + 0.1 * albedo, albedo)
    strip = (u > 20) & (u < 120) & (v > 300)
    fading = 0.04 + 0.3 * np.clip((u - 20.0) / 100.0, 0, 1) * _texture(u, v)
    return x, np.where(strip, fading, albedo), ~shadow


def steps(u: np.ndarray, v: np.ndarray, width: int) -> tuple[np.ndarray, ...]:
    """Boards at different depths, with jumps of 3 to 130 px, thin wires and a dark board."""
    jumps = np.array([0.0, 0.003, 0.012, 0.004, 0.04, 0.125, 0.02, 0.06]) * width
    board = (np.clip(u, 0, 639) // 80).astype(int)
    row = (np.clip(v, 0, 479) // 120).astype(int)
    depth = jumps[(board + 3 * row) % 8]
    wire = (np.abs(u - 200.0 - 0.2 * v) < 1.5) | (np.abs(u - 500.0 + 0.1 * v) < 2.5)
    x = 0.98 * _wall(u, v, width) - 0.02 * width + np.where(wire, 0.09 * width, depth)
    albedo = np.where((board + row) % 5 == 2, 0.07, 0.8) * (0.6 + 0.4 * _texture(u, v))
    return x, albedo, np.ones(u.shape, bool)


SCENES: dict[str, Look] = {"bust": bust, "plane": plane, "steps": steps}


def _sets(width: int, counts: tuple[int, ...], steps: tuple[int, ...]) -> PatternPlan:
    pairs = zip(counts, steps, strict=True)
    return PatternPlan(
        width, 768, tuple(PhaseSteps("x", width / c, equal_steps(n)) for c, n in pairs)
    )


def _gray(steps: int, *, inverse: bool = False, ends: bool = False) -> PatternPlan:
    """Fringes of 16 px and Gray cells of half a period."""
    blocks = (PhaseSteps("x", 16.0, equal_steps(steps)), GrayCode("x", 8.0, 1024, inverse))
    uniform = (Uniform("white"), Uniform("black")) if ends else ()
    return PatternPlan(1024, 768, (*blocks, *uniform))


@lru_cache(maxsize=1)
def plans() -> dict[str, PatternPlan]:
    """The ten plans of the table by name."""
    coprime = tuple(
        PhaseSteps("x", p, equal_steps(n)) for p, n in ((16.0, 6), (17.0, 3), (19.0, 3))
    )
    return {
        "hierarchical-4": _sets(1024, (1, 8, 64), (4, 4, 4)),
        "hierarchical-3": _sets(1024, (1, 8, 64), (3, 3, 3)),
        "heterodyne-4": _sets(1024, (70, 64, 59), (4, 4, 4)),
        "heterodyne-3": _sets(1024, (64, 56, 49), (3, 3, 3)),
        "number-theoretic": PatternPlan(1280, 768, coprime),
        "gray-3": _gray(3),
        "gray-4": _gray(4),
        "gray-8-white-black": _gray(8, ends=True),
        "gray-4-inverse": _gray(4, inverse=True),
        "proposed-12": propose(1024, 768, 12, noise=2.0, modulation=40.0)[0].plan,
    }
