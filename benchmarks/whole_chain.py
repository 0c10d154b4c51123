"""From boards to quantities: random rigs by the second simulator, and errors over stated σ.

``python -m benchmarks.whole_chain [--first 0] [--rigs 40]``, from the root of the source tree: 40 s
for each rig. Boards with errors of print and bow are photographed and calibrated from; balls, a
cylinder and two planes are then measured with the rig that was found.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from typing import Any

import numpy as np

import fringeworks as fw
from fringeworks.evaluate.area_points import AreaPoints, area_points
from fringeworks.evaluate.budget import budget_of
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.rig.pinhole import look_at, project, rotation
from fringeworks.simulate.standard import board_poses, fringe_plan, standard_rig
from fringeworks.types import Pinhole
from tests.ray_caster import Ball, Photographs, Sheet, Tube, _rays

KIND = "chessboard:11x8:12"
BOARD = fw.rig.parse_board(KIND)
BLURS_PX = (0.3, 0.5, 0.7, 0.9, 1.2)
MARGIN_SQUARES = 1.5
ONE_SIDED = 1.645
"""Guard band of a risk of 5 %, in σ: a part just out of its limit passes by an error beyond it."""


class Patch(Sheet):
    """A plane that ends: the x and y axes of its pose, and half its sides."""

    half_mm = (28.0, 28.0)

    def _inside(self, points: Any) -> Any:
        x, y = ((points - self.pose[:3, 3]) @ self.pose[:3, k] for k in (0, 1))
        return (np.abs(x) < self.half_mm[0]) & (np.abs(y) < self.half_mm[1])

    def hit(self, start: Any, ways: Any) -> Any:
        t = super().hit(start, ways)
        points = start + np.where(np.isfinite(t), t, 0.0)[..., None] * ways
        return np.where(self._inside(points), t, np.inf)


class Print:
    """A chessboard that is bowed, and printed with smooth errors that are no scale or shear."""

    def __init__(self, pose: Any, waves: Any, bow_mm: Any) -> None:
        self.pose, self.waves, self.bow_mm = pose, waves, bow_mm
        self.grid, self.pitch = np.array(BOARD.grid), BOARD.pitch_mm
        corners = np.stack(np.meshgrid(*map(np.arange, self.grid)), axis=-1).reshape(-1, 2)
        places = np.column_stack((corners * self.pitch, np.ones(len(corners))))
        self.affine = np.linalg.lstsq(places, self._waves(*places[:, :2].T), rcond=None)[0]

    def _waves(self, x: Any, y: Any) -> Any:
        a, u, v = self.waves, x / 40, y / 40
        first = a[0] * np.sin(u + a[6]) + a[1] * np.sin(v + a[7]) + a[2] * u * v / 4
        second = a[3] * np.sin(u + a[8]) + a[4] * np.sin(v + a[9]) + a[5] * u * v / 4
        return np.stack((first, second), axis=-1)

    def _place(self, points: Any) -> tuple[Any, Any]:
        off = points - self.pose[:3, 3]
        return off @ self.pose[:3, 0], off @ self.pose[:3, 1]

    def hit(self, start: Any, ways: Any) -> Any:
        normal = self.pose[:3, 2]
        far, along = (self.pose[:3, 3] - start) @ normal, ways @ normal
        t, middle = far / along, 0.5 * (self.grid - 1) * self.pitch
        for _ in range(3):
            x, y = self._place(start + t[..., None] * ways)
            u, v = (x - middle[0]) / 60, (y - middle[1]) / 60
            b = self.bow_mm
            t = (far + b[0] * (u * u - 0.5) + b[1] * (v * v - 0.5) + b[2] * u * v) / along
        x, y = self._place(start + t[..., None] * ways)
        m = MARGIN_SQUARES * self.pitch
        last = (self.grid - 1) * self.pitch
        on = (x > -m) & (y > -m) & (x < last[0] + m) & (y < last[1] + m) & (t > 0)
        return np.where(on, t, np.inf)

    def look(self, points: Any) -> tuple[Any, Any]:
        x, y = self._place(points)
        off = self._waves(x, y) - np.stack((x, y, np.ones_like(x)), axis=-1) @ self.affine
        i, j = (np.floor((p - off[..., k]) / self.pitch) for k, p in enumerate((x, y)))
        squares = (i >= -1) & (i < self.grid[0]) & (j >= -1) & (j < self.grid[1])
        normal = self.pose[:3, 2] * (-1.0 if self.pose[2, 2] > 0 else 1.0)
        dark = squares & ((i + j) % 2 == 0)
        return np.broadcast_to(normal, points.shape), np.where(dark, 0.1, 0.85)


def pose_of(rng: Any, most_deg: float, place: Any) -> Any:
    T = np.eye(4)
    T[:3, :3] = rotation(np.array([*np.deg2rad(rng.uniform(-most_deg, most_deg, 2)), 0.0]))
    T[:3, 3] = place
    return T


def random_rig(rng: Any) -> fw.Rig:
    """A rig of 12 to 48° with lenses of its own."""
    base = standard_rig(scale=0.4)

    def device(like: Pinhole, low: float, high: float) -> Pinhole:
        focal = like.focal_px[0] * rng.uniform(low, high)
        middle = np.array([like.width_px, like.height_px]) * (0.5 + rng.uniform(-0.02, 0.02, 2))
        lens = (rng.uniform(-0.12, 0.08), rng.uniform(-0.05, 0.05), *rng.uniform(-1e-3, 1e-3, 2))
        return Pinhole(
            like.width_px,
            like.height_px,
            (focal, focal * rng.uniform(0.998, 1.002)),
            (float(middle[0]), float(middle[1])),
            (*lens, 0.0),
        )

    angle = np.deg2rad(rng.uniform(12, 48)) * rng.choice([-1, 1])
    at = 500.0 * np.array([np.sin(angle), rng.uniform(-0.08, 0.08), 1.0 - np.cos(angle)])
    T = look_at(at, np.array([0.0, 0.0, 500.0]))
    return fw.Rig(device(base.camera, 0.95, 1.1), device(base.projector, 0.85, 1.0), T)


def calibrated(true: fw.Rig, rng: Any, light: dict[str, Any]) -> fw.Rig:
    size = rng.uniform(0.0, 0.06)
    waves = np.concatenate((rng.normal(0.0, size / 1.5, 6), rng.uniform(0.0, 6.0, 4)))
    bow = rng.uniform(-1.0, 1.0, 3) * rng.uniform(0.0, 0.3)
    poses = board_poses(BOARD, int(rng.integers(8, 15)), seed=int(rng.integers(1e6)))
    plan = fringe_plan(true, both=True)
    stacks = [
        (f"pose{k}", Photographs(true, [Print(T, waves, bow)], over=3).stack(plan, seed=k, **light))
        for k, T in enumerate(poses)
    ]
    return fw.calibrate(stacks, KIND).rig


def outline(true: fw.Rig, points: Any) -> fw.evaluate.Area:
    return fw.evaluate.Area(polygon=tuple(map(tuple, project(true.camera, points).tolist())))


def disc(true: fw.Rig, ball: Ball) -> fw.evaluate.Area:
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    rim = np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=-1)
    return outline(true, np.array(ball.centre_mm) + 0.9 * ball.radius_mm * rim)


def strip(true: fw.Rig, tube: Tube) -> fw.evaluate.Area:
    along = np.array(tube.axis) / np.linalg.norm(tube.axis)
    across = np.cross(along, [0.0, 0.0, 1.0])
    across *= 0.9 * tube.radius_mm / np.linalg.norm(across)
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return outline(true, [28.0 * s * along + t * across + tube.point_mm for s, t in corners])


def square(true: fw.Rig, T: Any) -> fw.evaluate.Area:
    corners = ((-24, -24), (24, -24), (24, 24), (-24, 24))
    return outline(true, [T[:3, 3] + a * T[:3, 0] + b * T[:3, 1] for a, b in corners])


def middle(true: fw.Rig, cloud: fw.PointCloud, area: fw.evaluate.Area, T: Any) -> Any:
    """Mean of the points of a plane that the measured pixels of an area see."""
    rows, columns = np.nonzero(area.pixels(cloud.shape) & (cloud.reason == 0))
    ways = _rays(true.camera, np.stack((columns, rows), axis=-1).astype(float))
    return np.mean(ways * ((T[:3, 3] @ T[:3, 2]) / (ways @ T[:3, 2]))[:, None], axis=0)


def scores(seed: int) -> dict[str, list[tuple[float, float]]]:
    """Errors of the quantities of one rig: over stated σ, and over the U of their budgets."""
    rng = np.random.default_rng([7, seed])
    true = random_rig(rng)
    light = {"blur_px": float(rng.choice(BLURS_PX)), "noise": float(rng.uniform(0.5, 2.0))}
    rig = calibrated(true, rng, light)
    plan = fringe_plan(true, both=bool(rng.integers(2)))
    wall = Sheet(pose_of(rng, 8.0, (0.0, 0.0, 575.0)))
    balls = [
        Ball((side + rng.uniform(-4, 4), rng.uniform(-8, 8), 505.0), rng.uniform(16, 26))
        for side in (-36.0, 36.0)
    ]
    tube = Tube((0.0, 0.0, 510.0), (rng.uniform(0.8, 1.0), *rng.uniform(-0.4, 0.4, 2)), 20.0)
    tilts = [pose_of(rng, 15.0, (side, 0.0, rng.uniform(495, 520))) for side in (-35.0, 35.0)]
    low = pose_of(rng, 12.0, (-35.0, 0.0, 505.0))
    high = low.copy()
    high[:3, 3] += 70.0 * low[:3, 0] - rng.uniform(2.0, 15.0) * low[:3, 2]
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)

    def see(
        bodies: list[Any], areas: list[fw.evaluate.Area], seed: int
    ) -> tuple[fw.PointCloud, list[AreaPoints]]:
        stack = Photographs(true, bodies, over=3).stack(plan, seed=seed, **light)
        cloud = fw.measure(stack, rig).points
        return cloud, [area_points(cloud, area, rig) for area in areas]

    def put(kind: str, truth: float, *areas: AreaPoints) -> None:
        quantity = MEASURED[kind](*areas)
        error = quantity.value - truth
        expanded = budget_of(quantity, areas).expanded
        found[kind].append((float(error / quantity.sigma), float(error / expanded)))

    _, seen = see([*balls, wall], [disc(true, ball) for ball in balls], 100)
    for ball, area in zip(balls, seen, strict=True):
        put("sphere_diameter", 2.0 * ball.radius_mm, area)
    apart = np.subtract(balls[0].centre_mm, balls[1].centre_mm)
    put("sphere_spacing", float(np.linalg.norm(apart)), *seen)
    put("cylinder_diameter", 2.0 * tube.radius_mm, *see([tube, wall], [strip(true, tube)], 101)[1])
    _, seen = see([*map(Patch, tilts), wall], [square(true, T) for T in tilts], 102)
    for area in seen:
        put("flatness", 0.0, area)
    cosine = abs(tilts[0][:3, 2] @ tilts[1][:3, 2])
    put("angle", float(np.rad2deg(np.arccos(cosine))), *seen)
    cloud, seen = see([Patch(low), Patch(high), wall], [square(true, low), square(true, high)], 103)
    put("step_height", float((low[:3, 3] - high[:3, 3]) @ low[:3, 2]), *seen[::-1])
    ends = [middle(true, cloud, square(true, T), T) for T in (low, high)]
    put("distance", float(np.linalg.norm(ends[1] - ends[0])), *seen)
    return found


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--first", type=int, default=0, help="first seed")
    options.add_argument("--rigs", type=int, default=40, help="number of rigs")
    given = options.parse_args()
    all_of_them: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for seed in range(given.first, given.first + given.rigs):
        try:
            found = scores(seed)
        except fw.InputError as problem:
            print(f"{seed}: refused: {problem}", flush=True)
            continue
        print(f"{seed}:", {k: [round(z, 1) for z, _ in v] for k, v in found.items()}, flush=True)
        for kind, values in found.items():
            all_of_them[kind] += values
    for kind, values in all_of_them.items():
        z, of_expanded = np.array(values).T
        print(
            f"{kind}: {len(z)}, rms {np.sqrt(np.mean(z**2)):.2f}, mean {z.mean():+.2f}, largest "
            f"{np.abs(z).max():.2f}, within 2 σ {np.mean(np.abs(z) < 2):.0%}, within U "
            f"{np.mean(np.abs(of_expanded) < 1):.0%}; wrong accepts at an "
            f"upper and a lower limit, risk 5 %: {np.mean(z < -ONE_SIDED):.0%}, "
            f"{np.mean(z > ONE_SIDED):.0%}"
        )


if __name__ == "__main__":
    main()
