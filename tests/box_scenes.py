"""Photographs of boxes and wires before a wall, by a ray caster of its own.

Several rays per pixel, pinhole camera and projector, cast shadows, a Gaussian blur of the camera,
square pixels and shot noise. It shares nothing with the package's simulator.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

OVER, MARGIN, RIM = 4, 6, 6
"""Rays per pixel along rows and columns; margin that blur reaches into; rim that does not count."""
SHAPE = (150, 220)
WIDTH = 912
BASE_MM, FAR_MM, FOCAL_PX = 120.0, 600.0, 900.0
NEAR_PX = 3.0


def turned(angles):
    turn = np.eye(3)
    for (i, j), angle in zip(((0, 1), (0, 2), (1, 2)), angles, strict=True):
        part = np.eye(3)
        part[i, i] = part[j, j] = np.cos(angle)
        part[i, j], part[j, i] = -np.sin(angle), np.sin(angle)
        turn = turn @ part
    return turn


class Box:
    def __init__(self, centre, half, turn, albedo):
        self.centre, self.half = np.array(centre, float), np.array(half, float)
        self.turn, self.albedo = turn, albedo

    def hit(self, start, ways):
        """Distances, normals, and the number of the face."""
        start, ways = (start - self.centre) @ self.turn, ways @ self.turn
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (-self.half - start) / ways, (self.half - start) / ways
        near = np.minimum(*ends)
        first, last, axis = near.max(-1), np.maximum(*ends).min(-1), near.argmax(-1)
        sign = -np.sign(np.take_along_axis(ways, axis[..., None], -1)[..., 0])
        hit = (first < last) & (first > 1e-6)
        normal = self.turn.T[axis] * sign[..., None]
        return np.where(hit, first, np.inf), normal, 2 * axis + (sign > 0)


class Wire:
    def __init__(self, point, axis, radius, albedo):
        self.point, self.radius, self.albedo = np.array(point), radius, albedo
        self.axis = np.array(axis) / np.linalg.norm(axis)

    def hit(self, start, ways):
        off = start - self.point
        off = off - (off @ self.axis) * self.axis
        across = ways - (ways @ self.axis)[..., None] * self.axis
        a, b = np.sum(across**2, -1), across @ off
        root = b * b - a * (off @ off - self.radius**2)
        with np.errstate(invalid="ignore"):
            along = np.where(root > 0, (-b - np.sqrt(root)) / a, np.inf)
        normal = (off + np.where(root > 0, along, 0)[..., None] * across) / self.radius
        return along, normal, np.zeros(along.shape, int)


def bodies(kind, seed):
    """A wall, and boxes before it: large ones, low ones, many small ones; or wires."""
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    wall = Box((0, 0, 1120), (3000, 3000, 500), turned((0, rng.uniform(-0.15, 0.15), 0)), 0.7)
    found = [wall]
    for _ in range({"boxes": 6, "steps": 5, "clutter": 25, "wires": 6}[kind]):
        x, y = rng.uniform(-70, 70), rng.uniform(-50, 50)
        if kind == "wires":
            axis = (rng.normal(), rng.normal(), 0.1 * rng.normal())
            found.append(Wire((x, y, rng.uniform(520, 595)), axis, rng.uniform(0.8, 3.0), 0.7))
        elif kind == "steps":
            half = (rng.uniform(6, 20), rng.uniform(6, 30), 12)
            place = (x, y, rng.uniform(585, 625))
            found.append(Box(place, half, turned(rng.uniform(-0.08, 0.08, 3)), 0.7))
        else:
            place, half = (x, y, rng.uniform(540, 600)), rng.uniform(8, 30, 3)
            turn = turned(rng.uniform(-0.3, 0.3, 3) * (3, 1, 1))
            found.append(Box(place, half, turn, rng.uniform(0.5, 0.9)))
    return found


class Photographs:
    """What the camera sees: projector column, light and face of every ray."""

    def __init__(self, kind, seed):
        scene = bodies(kind, seed)
        y, x = ((np.arange((n + 2 * MARGIN) * OVER) + 0.5) / OVER - 0.5 - MARGIN for n in SHAPE)
        x, y = np.meshgrid((x - SHAPE[1] / 2) / FOCAL_PX, (y - SHAPE[0] / 2) / FOCAL_PX)
        ways = np.stack([x, y, np.ones_like(x)], -1)
        far, face = np.full(x.shape, np.inf), np.full(x.shape, -1)
        normal, albedo = np.zeros(ways.shape), np.zeros(x.shape)
        for k, body in enumerate(scene):
            t, n, part = body.hit(np.zeros(3), ways)
            nearer = t < far
            far[nearer], normal[nearer] = t[nearer], n[nearer]
            face[nearer], albedo[nearer] = (10 * k + part)[nearer], body.albedo
        lamp = np.array([-BASE_MM, 0.0, 0.0])
        beam = far[..., None] * ways - lamp
        long = np.linalg.norm(beam, axis=-1)
        rays = beam / long[..., None]
        lit = np.all([body.hit(lamp, rays)[0] > long - 0.02 for body in scene], axis=0)
        seen = beam @ turned((0, np.arctan2(BASE_MM, FAR_MM), 0)).T
        self.column = 1.5 * FOCAL_PX * seen[..., 0] / seen[..., 2] + WIDTH / 2
        facing = np.clip(-np.sum(normal * rays, -1), 0, None)
        self.light = np.where(lit, albedo * facing * (FAR_MM / long) ** 2, 0.0)
        self.albedo, self.face = albedo, np.where(lit, face, -1)

    @staticmethod
    def inner(values):
        """Rays of every pixel, (h, w, 16)."""
        edge, (h, w) = MARGIN * OVER, SHAPE
        blocks = values[edge:-edge, edge:-edge].reshape(h, OVER, w, OVER)
        return blocks.transpose(0, 2, 1, 3).reshape(h, w, -1)

    def blurred(self, light, blur_px):
        return self.inner(gaussian_filter(light.astype(np.float32), blur_px * OVER)).mean(-1)

    def stack(self, plan, blur_px, noise, seed):
        rng, frames = np.random.default_rng([seed, 5]), []
        offs = np.linspace(-1.5, 1.5, 11)
        weights = np.exp(-0.5 * (offs / 0.6) ** 2)
        for block in plan.blocks:
            for k in range(block.frames):
                shown = [
                    np.broadcast_to(block.values(self.column + d, k), self.light.shape)
                    for d in offs
                ]
                pattern = np.tensordot(weights / weights.sum(), shown, 1)
                counts = 4.0 + 190.0 * self.blurred(
                    self.light * pattern + 0.04 * self.albedo, blur_px
                )
                counts += np.sqrt(noise**2 + 0.02 * counts) * rng.standard_normal(SHAPE)
                frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
        return np.stack(frames)

    def scores(self, found, blur_px):
        """|error| and σ of the pixels that see one face, most of whose light is from it: within
        3 px of an edge, and the others; and the share of these pixels that is measured."""
        face, column = self.inner(self.face), self.inner(self.column).mean(-1)
        whole = (face >= 0).all(-1) & (face.min(-1) == face.max(-1))
        whole &= self._own_share(np.where(whole, face[..., 0], -1), blur_px) > 0.5
        whole[:RIM] = whole[-RIM:] = whole[:, :RIM] = whole[:, -RIM:] = False
        change = np.zeros(self.face.shape, bool)
        change[1:] |= self.face[1:] != self.face[:-1]
        change[:, 1:] |= self.face[:, 1:] != self.face[:, :-1]
        near = distance_transform_edt(~self.inner(change).any(-1)) <= NEAR_PX
        known = whole & np.isfinite(found.coordinate_px)
        off, sigma = np.abs(found.coordinate_px - column), found.sigma_px
        parts = [(off[known & m], sigma[known & m]) for m in (near, ~near)]
        return *parts, known.sum() / whole.sum()

    def _own_share(self, face, blur_px):
        total, share = self.blurred(self.light, blur_px), np.zeros(face.shape)
        for k in np.unique(face[face >= 0]):
            own = self.blurred(np.where(self.face == k, self.light, 0.0), blur_px)
            share[face == k] = (own / np.maximum(total, 1e-9))[face == k]
        return share
