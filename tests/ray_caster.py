"""Photographs by a second simulator: rays through parts of pixels, blurred where they are cast.

The package's own simulator samples a scene once in each pixel, and blurs these samples. This one
casts several rays in each pixel, blurs their light with a Gaussian, and collects it over the
pixels, so that rims, creases and steep slopes are mixed as in a camera. Its lenses, bodies and
shadows are its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

import fringeworks as fw

LIGHT = 190.0
"""Counts of a white surface at the usual distance that faces the projector."""


@dataclass(frozen=True)
class Ball:
    """A sphere."""

    centre_mm: tuple[float, float, float]
    radius_mm: float
    albedo: float = 0.8

    def hit(self, start, ways):
        along, size = _roots(start - np.array(self.centre_mm), ways, self.radius_mm)
        return np.where(size >= 0, along - np.sqrt(np.maximum(size, 0.0)), np.inf)

    def look(self, points):
        out = (points - np.array(self.centre_mm)) / self.radius_mm
        return out, np.full(points.shape[:-1], self.albedo)


@dataclass(frozen=True)
class Tube:
    """A cylinder without ends."""

    point_mm: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius_mm: float
    albedo: float = 0.8

    def hit(self, start, ways):
        across = np.eye(3) - np.outer(self._axis, self._axis)
        flat = ways @ across
        size = np.linalg.norm(flat, axis=-1, keepdims=True)
        along, root = _roots(
            (start - np.array(self.point_mm)) @ across, flat / size, self.radius_mm
        )
        t = (along - np.sqrt(np.maximum(root, 0.0))) / size[..., 0]
        return np.where(root >= 0, t, np.inf)

    def look(self, points):
        off = points - np.array(self.point_mm)
        out = off - (off @ self._axis)[..., None] * self._axis
        return out / self.radius_mm, np.full(points.shape[:-1], self.albedo)

    @property
    def _axis(self):
        axis = np.array(self.axis, float)
        return axis / np.linalg.norm(axis)


@dataclass(frozen=True, eq=False)
class Sheet:
    """A plane without end: the x and y axes of its pose."""

    pose: np.ndarray
    albedo: float = 0.7

    def hit(self, start, ways):
        normal = self.pose[:3, 2]
        t = ((self.pose[:3, 3] - start) @ normal) / (ways @ normal)
        return np.where(t > 0, t, np.inf)

    def look(self, points):
        facing = -self.pose[:3, 2] if self.pose[2, 2] > 0 else self.pose[:3, 2]
        normal = np.broadcast_to(facing, points.shape)
        return normal, np.full(points.shape[:-1], self.albedo)


def _roots(off, ways, radius):
    along = -np.sum(off * ways, axis=-1)
    return along, along**2 - np.sum(off * off, axis=-1) + radius**2


def _distort(device, at):
    k1, k2, p1, p2, k3 = device.distortion
    x, y = at[..., 0], at[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ),
        axis=-1,
    )


def _rays(device, pixels):
    wanted = (pixels - np.array(device.principal_px)) / np.array(device.focal_px)
    at = wanted
    for _ in range(12):
        at = at + wanted - _distort(device, at)
    ways = np.concatenate((at, np.ones((*at.shape[:-1], 1))), axis=-1)
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


class Photographs:
    """What a rig sees of some bodies: light and projector coordinates of all rays."""

    def __init__(self, rig: fw.Rig, bodies, *, over: int = 3, margin_px: int = 5):
        self.rig, self.over, self.margin = rig, over, margin_px
        h, w = rig.camera.shape
        y, x = (
            (np.arange((n + 2 * margin_px) * over) + 0.5) / over - 0.5 - margin_px for n in (h, w)
        )
        ways = _rays(rig.camera, np.stack(np.meshgrid(x, y), axis=-1))
        eye = np.zeros(3)
        t = np.stack([body.hit(eye, ways) for body in bodies])
        first = np.argmin(t, axis=0)
        depth = np.take_along_axis(t, first[None], axis=0)[0]
        points = np.where(np.isfinite(depth), depth, 1e6)[..., None] * ways
        normal, albedo = np.zeros_like(points), np.zeros(depth.shape)
        for k, body in enumerate(bodies):
            mine = (first == k) & np.isfinite(depth)
            normal[mine], albedo[mine] = body.look(points[mine])
        R, shift = rig.T_projector_camera[:3, :3], rig.T_projector_camera[:3, 3]
        lamp = -R.T @ shift
        beam = points - lamp
        far = np.linalg.norm(beam, axis=-1)
        beam /= far[..., None]
        lit = np.isfinite(depth)
        for body in bodies:
            lit &= body.hit(lamp, beam) > far * (1 - 1e-5) - 1e-3
        seen = points @ R.T + shift
        at = _distort(rig.projector, seen[..., :2] / seen[..., 2:])
        self.projected = at * np.array(rig.projector.focal_px) + np.array(
            rig.projector.principal_px
        )
        size = np.array([rig.projector.width_px, rig.projector.height_px])
        lit &= ((self.projected > -0.5) & (self.projected < size - 0.5)).all(axis=-1)
        usual = float(np.median(far[lit]))
        facing = np.maximum(-np.sum(normal * beam, axis=-1), 0.0)
        shade = np.where(lit, albedo * facing * (usual / far) ** 2, 0.0)
        self.light, self.ambient = LIGHT * shade, 3.0 * albedo

    def _seen(self, light, blur_px):
        if blur_px:
            light = scipy.ndimage.gaussian_filter(
                light.astype(np.float32), blur_px * self.over, mode="nearest", truncate=4.0
            )
        n = self.over
        h, w = (s // n for s in light.shape)
        light = light.reshape(h, n, w, n).mean(axis=(1, 3))
        return light[self.margin : -self.margin, self.margin : -self.margin].astype(float)

    def stack(self, plan, *, blur_px, defocus_px=0.6, noise=1.0, seed=0, levels=1):
        """Frames of a plan of fringes without gamma, 8 bit; ``blur_px`` without the pixels' own.
        With more ``levels`` for each count, 16 bit."""
        rng = np.random.default_rng(seed)
        even = self._seen(self.ambient, blur_px)
        flat = self._seen(self.light, blur_px)
        frames = []
        for block in plan.blocks:
            u = self.projected[..., "xy".index(block.axis)]
            wave = 2 * np.pi / block.period_px
            fade = np.exp(-0.5 * (wave * defocus_px) ** 2)
            cosine = self._seen(self.light * np.cos(wave * u), blur_px) * fade
            sine = self._seen(self.light * np.sin(wave * u), blur_px) * fade
            for shift in block.shifts_rad:
                fringes = flat + np.cos(shift) * cosine + np.sin(shift) * sine
                clean = even + 3.0 + 0.5 * fringes
                frames.append(clean + noise * rng.standard_normal(clean.shape))
        counts = np.clip(np.rint(np.multiply(frames, levels)), 0, 256 * levels - 1)
        return fw.Stack(counts.astype(np.uint8 if levels == 1 else np.uint16), plan)
