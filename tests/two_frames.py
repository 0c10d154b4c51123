"""A ray-caster for two frames that shares no code with the package's simulator.

A pinhole camera looks at a plane and at bodies on it, which a pinhole projector lights. Every pixel
is the mean over ``SUB`` × ``SUB`` rays. The camera may move between the frames, and the pattern may
drift. The truth is the displacement against a reference that the moved camera would have seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

SUB = 3
"""Rays per pixel along each axis."""
STEPS = 13
"""Steps of the search of a ray's point on a surface."""
Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Height in mm at places x, y on the plane, mm."""


def flat(x, y):
    """The plane of the reference."""
    return np.zeros(np.broadcast(x, y).shape)


def turn(axis: int, degrees: float) -> np.ndarray:
    """Rotation about an axis."""
    a = np.radians(degrees)
    i, j = [k for k in range(3) if k != axis]
    found = np.eye(3)
    found[i, i] = found[j, j] = np.cos(a)
    found[i, j], found[j, i] = -np.sin(a), np.sin(a)
    return found


@dataclass
class Device:
    """A pinhole whose rows of ``axes`` are its x, y and view axes, in mm over the plane z = 0."""

    at: np.ndarray
    axes: np.ndarray
    focal: float
    middle: tuple[float, float]

    def rays(self, x, y):
        """Direction of the rays of pixels."""
        own = np.stack(
            [
                (x - self.middle[0]) / self.focal,
                (y - self.middle[1]) / self.focal,
                np.ones_like(x),
            ]
        )
        return np.tensordot(self.axes.T, own, 1)

    def sees(self, points):
        """Pixel of points (3, …)."""
        own = np.tensordot(self.axes, points - self.at.reshape(3, *[1] * (points.ndim - 1)), 1)
        return self.focal * own[:2] / own[2] + np.array(self.middle).reshape(
            2, *[1] * (points.ndim - 1)
        )


def looking(at, target, focal, middle, roll=0.0) -> Device:
    """A device at a place that looks at another one."""
    at, target = np.asarray(at, float), np.asarray(target, float)
    view = (target - at) / np.linalg.norm(target - at)
    x = np.cross([0.0, 1.0, 0.0], view)
    x = x / np.linalg.norm(x)
    if x[0] < 0:
        x = -x
    y = np.cross(view, x)
    return Device(at, turn(2, roll) @ np.stack([x, y, view]), focal, middle)


@dataclass
class Bench:
    """A camera above a plane, and a projector beside it."""

    shape: tuple[int, int] = (240, 320)
    period: float = 14.0
    """Mean period of the fringes in the camera, px."""
    roll: float = 0.0
    """Angle of the projector about its axis, degrees."""
    beside: float = 250.0
    """Distance of the projector from the camera, mm."""
    projector_height: float = 600.0
    contrast: float = 0.7
    """Modulation of the fringes over their mean."""
    light: float = 110.0
    """Mean brightness of the plane, counts."""
    noise: float = 1.0
    """Noise, counts, beside that of rounding."""
    blur: float = 0.5
    """Gaussian blur of the camera, px."""
    move: tuple[float, float] = (0.0, 0.0)
    """Movement of the image by that of the camera between the frames, px."""
    camera_turn: float = 0.0
    """Turn of the camera about its axis between the frames, degrees."""
    drift: float = 0.0
    """Drift of the pattern, periods."""
    ambient: float = 0.1
    seed: int = 1
    paint: Surface | None = None
    """Albedo at places on the plane; the same in both frames."""
    camera: Device = field(init=False)

    def __post_init__(self):
        h, w = self.shape
        self.middle = ((w - 1) / 2, (h - 1) / 2)
        self.height = 600.0
        self.focal = 2.5 * w
        self.camera = looking((0, 0, self.height), (0, 0, 0), self.focal, self.middle)
        self.projector = looking(
            (self.beside, 0, self.projector_height), (0, 0, 0), 1000.0, (0.0, 0.0), self.roll
        )
        x = np.array([-10.0, 10.0])
        points = self.meet(self.camera, flat, x + self.middle[0], x * 0)
        along = self.projector.sees(points)[0]
        per_px = abs(along[1] - along[0]) / 20 / abs(np.cos(np.radians(self.roll)))
        self.pitch = self.period * per_px
        """Period in the projector."""

    def moved(self) -> Device:
        """The camera of the object frame."""
        mm = self.height / self.focal
        axes = turn(2, self.camera_turn) @ self.camera.axes
        shift = axes.T @ np.array([self.move[0] * mm, self.move[1] * mm, 0.0])
        return Device(self.camera.at - shift, axes, self.focal, self.middle)

    def meet(self, camera, surface, x, y):
        """Points of a surface that rays of pixels meet, from above."""
        rays = camera.rays(np.asarray(x, float), np.asarray(y, float))
        origin = camera.at.reshape(3, *[1] * (rays.ndim - 1))
        z = np.zeros(rays.shape[1:])
        top = np.zeros_like(z)
        # March from the top to the first point below the surface, then bisect.
        high, low = np.full_like(z, 60.0), np.full_like(z, np.nan)
        for level in np.linspace(60.0, -20.0, 41):
            at = origin + (level - origin[2]) / rays[2] * rays
            below = np.isnan(low) & (surface(at[0], at[1]) >= level)
            low[below] = level
            high[np.isnan(low)] = level
        low = np.where(np.isnan(low), -20.0, low)
        for _ in range(STEPS):
            z = 0.5 * (low + high)
            at = origin + (z - origin[2]) / rays[2] * rays
            below = surface(at[0], at[1]) >= z
            low, high = np.where(below, z, low), np.where(below, high, z)
        return origin + (0.5 * (low + high) - origin[2]) / rays[2] * rays + 0 * top

    def coordinate(self, camera, surface, x, y):
        """Phase of the projector at pixels, in periods, and the points that they see."""
        points = self.meet(camera, surface, x, y)
        return self.projector.sees(points)[0] / self.pitch, points

    def lit(self, surface, points):
        """Whether the projector sees the points."""
        toward = self.projector.at.reshape(3, *[1] * (points.ndim - 1)) - points
        clear = np.ones(points.shape[1:], bool)
        reach = 60.0 / np.maximum(toward[2], 1e-9)
        for share in np.linspace(0.01, 1, 40):
            at = points + share * reach * toward
            clear &= surface(at[0], at[1]) <= at[2] + 1e-6
        return clear

    def frame(self, camera, surface, drift, seed, albedo=None):
        """A photograph, uint8."""
        h, w = self.shape
        steps = (np.arange(SUB) + 0.5) / SUB - 0.5
        y = (np.arange(h)[:, None] + steps).ravel()
        x = (np.arange(w)[:, None] + steps).ravel()
        xx, yy = np.meshgrid(x, y)
        phase, points = self.coordinate(camera, surface, xx, yy)
        light = 1 + self.contrast * np.cos(2 * np.pi * (phase + drift))
        light = np.where(self.lit(surface, points), light, 0.0)
        light = light * (1 - self.ambient) + self.ambient
        if self.paint is not None:
            light = light * self.paint(points[0], points[1])
        if albedo is not None:
            light = light * albedo(points)
        light = ndimage.gaussian_filter(light * self.light, self.blur * SUB, mode="nearest")
        counts = light.reshape(h, SUB, w, SUB).mean(axis=(1, 3))
        rng = np.random.default_rng(seed)
        counts = counts + self.noise * rng.standard_normal(counts.shape)
        return np.clip(np.rint(counts), 0, 255).astype(np.uint8)

    def pair(self, surface: Surface, albedo=None):
        """Reference, object, true displacement along x (px) and lit pixels."""
        reference = self.frame(self.camera, flat, 0.0, self.seed)
        object_ = self.frame(self.moved(), surface, self.drift, self.seed + 1000, albedo)
        return reference, object_, *self.truth(surface)

    def truth(self, surface: Surface):
        """The displacement without the camera's movement and the drift, px, and lit pixels."""
        h, w = self.shape
        yy, xx = np.mgrid[:h, :w].astype(float)
        wide = np.arange(-w, 2 * w, 0.5)
        moved = self.moved()
        phase, points = self.coordinate(moved, surface, xx, yy)
        u = np.empty(self.shape)
        for row in range(h):
            known, _ = self.coordinate(moved, flat, wide, np.full_like(wide, row))
            order = np.argsort(known)
            u[row] = xx[row] - np.interp(phase[row], known[order], wide[order])
        return u, self.lit(surface, points)


def dome(radius=45.0, height=12.0, x=0.0, y=0.0) -> Surface:
    """A paraboloid."""
    return lambda a, b: height * np.maximum(0.0, 1 - ((a - x) ** 2 + (b - y) ** 2) / radius**2)


def box(half=35.0, height=12.0) -> Surface:
    """A square block."""
    return lambda a, b: np.where(np.maximum(abs(a), abs(b)) < half, height, 0.0)


def cap(radius=300.0, height=20.0) -> Surface:
    """A body that fills the frame."""
    return lambda a, b: height * (1 - (a**2 + b**2) / radius**2)
