"""What comes after measuring: parts judged, bodies fitted, clouds written, rigs calibrated."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import scipy

import fringeworks as fw
from benchmarks.harness import Result, compared, in_turn, peak_mb, work
from fringeworks.evaluate import Area, KnownPose, PartTolerance
from fringeworks.evaluate.inspect import judge_part
from fringeworks.rig import parse_board
from fringeworks.rig.pinhole import rotation
from fringeworks.simulate import fringe_plan, look, photograph, standard_rig
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, board_poses
from fringeworks.surface.closest import MeshDistance, sampled
from fringeworks.surface.form import fit_form
from fringeworks.types import PointCloud, Points, Recipe, TriangleMesh

SHAPE = (1500, 1950)
"""Rows and columns of the part, 2.9 megapixels."""
PITCH_MM = 0.1
"""Distance of its points."""
NOISE_MM = 0.005
"""Standard deviation of its points."""
POSES = 12
"""Poses of a board that a rig is calibrated from."""
BOARD = "chessboard:11x8:12"


def alone(work: str, ours: Callable[[], Any], *, limit_seconds: float, repeats: int = 3) -> Result:
    """A row without a peer."""
    (seconds,), _ = in_turn(ours, repeats=repeats)
    return Result(
        work=work,
        peer="none",
        peer_version="",
        ours_seconds=statistics.median(seconds),
        limit_seconds=limit_seconds,
        peak_mb=peak_mb(ours),
    )


def part() -> tuple[PointCloud, Recipe]:
    """Two planes, two balls and a rod before a camera, and nine tolerances."""
    y, x = PITCH_MM * np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = np.full(SHAPE, 500.0)
    areas: dict[str, Area] = {}

    def box(name: str, left: int, top: int, width: int, height: int) -> tuple[slice, slice]:
        areas[name] = Area(box=(left, top, left + width - 1, top + height - 1))
        return slice(top, top + height), slice(left, left + width)

    at = box("base", 0, 0, 700, 1500)
    z[at] += 0.010 * x[at]
    at = box("top", 700, 0, 300, 1500)
    z[at] += 0.012 * x[at] - 10.0
    for name, top in (("ball", 15), ("second", 515)):
        at = box(name, 1050, top, 430, 430)
        across = (x[at] - x[at].mean()) ** 2 + (y[at] - y[at].mean()) ** 2
        z[at] = 510.0 - np.sqrt(32.0**2 - across)
    at = box("rod", 1500, 0, 440, 1000)
    z[at] = 510.0 - np.sqrt(30.0**2 - (x[at] - x[at].mean()) ** 2)
    z += np.random.default_rng(0).normal(0.0, NOISE_MM, SHAPE)
    noise = np.full(SHAPE, NOISE_MM, np.float32)
    cloud = PointCloud(
        xyz_mm=np.stack((x, y, z), axis=-1).astype(np.float32),
        sigma_mm=2.0 * noise,
        noise_mm=noise,
        reason=np.zeros(SHAPE, np.uint8),
    )
    wanted = {
        "flatness": ("base",),
        "parallelism": ("top", "base"),
        "step_height": ("top", "base"),
        "angle": ("top", "base"),
        "sphere_diameter": ("ball",),
        "sphere_spacing": ("ball", "second"),
        "cylinder_diameter": ("rod",),
        "roundness": ("rod",),
        "volume": ("top", "base"),
    }
    tolerances = tuple(
        PartTolerance(name, name, names, 0.0, 1.0)  # type: ignore[arg-type]
        for name, names in wanted.items()
    )
    return cloud, Recipe(areas=areas, tolerances=tolerances)


@work
def judging() -> list[Result]:
    """Nine quantities of a part."""
    cloud, recipe = part()
    checks = judge_part(cloud, recipe)
    assert not any(np.isnan(check.value) for check in checks)
    name = "inspect, 9 quantities of a measured part, 2.9 MP"
    return [alone(name, lambda: judge_part(cloud, recipe), limit_seconds=1.0)]


def plane_points(count: int, rng: np.random.Generator) -> Any:
    return np.column_stack((rng.uniform(-50, 50, (count, 2)), 500 + rng.normal(0, 0.01, count)))


def sphere_points(count: int, rng: np.random.Generator) -> Any:
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    away[:, 2] = -np.abs(away[:, 2])
    return away * (25 + rng.normal(0, 0.01, count))[:, None] + [3, 4, 500]


def plain_plane(points: Any) -> Any:
    """Least squares of a plane, without a thought of outliers."""
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]


def plain_sphere(points: Any) -> Any:
    """Least squares of a sphere, without a thought of outliers."""
    points = points - points.mean(axis=0)

    def away(q: Any) -> Any:
        return np.linalg.norm(points - q[:3], axis=1)

    return scipy.optimize.least_squares(
        lambda q: away(q) - q[3],
        np.array([0.0, 0.0, 25.0, 25.0]),
        jac=lambda q: np.column_stack(((q[:3] - points) / away(q)[:, None], -np.ones(len(points)))),
    ).x


@work
def bodies() -> list[Result]:
    """Bodies fitted to points of which a tenth lie elsewhere, beside fits that know of none."""
    rng = np.random.default_rng(1)
    found = []
    for body, made, plain, count in (
        ("plane", plane_points, plain_plane, 200_000),
        ("sphere", sphere_points, plain_sphere, 200),
        ("sphere", sphere_points, plain_sphere, 2_000),
        ("sphere", sphere_points, plain_sphere, 200_000),
    ):
        points = made(count, rng)
        wrong = rng.choice(count, count // 10, replace=False)
        points[wrong, 2] += rng.uniform(-15.0, 15.0, len(wrong))
        found.append(
            compared(
                f"fit of a {body} with outliers, {count:,} points",
                "SciPy and NumPy, least squares alone",
                scipy.__version__,
                lambda points=points, body=body: fit_form(points, body),
                lambda points=points, plain=plain: plain(points),
                limit_ratio=0.5,
            )
        )
    return found


def cylinder_points(count: int, rng: np.random.Generator) -> Any:
    turn, along = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(-40.0, 40.0, count)
    radius = 15.0 + rng.normal(0, 0.01, count)
    upright = np.column_stack((radius * np.cos(turn), along, radius * np.sin(turn)))
    return upright @ rotation(np.array([0.6, 0.0, 0.0])).T + [1, 2, 500]


@work
def cylinders() -> list[Result]:
    """Cylinders through points of which a tenth lie elsewhere."""
    rng = np.random.default_rng(2)
    found = []
    for count, most_seconds in ((200, 0.015), (2_000, 0.03), (200_000, 0.6)):
        points = cylinder_points(count, rng)
        wrong = rng.choice(count, count // 10, replace=False)
        points[wrong, 2] += rng.uniform(-15.0, 15.0, len(wrong))
        name = f"fit of a cylinder with outliers, {count:,} points"
        call = partial(fit_form, points, "cylinder")
        found.append(alone(name, call, limit_seconds=most_seconds))
    return found


def bumpy_ball(sides: int) -> TriangleMesh:
    """A closed body of 2 · sides² triangles, about 80 mm across."""
    polar, turn = np.pi * np.arange(1, sides) / sides, 2.0 * np.pi * np.arange(sides) / sides
    t, p = np.meshgrid(polar, turn, indexing="ij")
    r = 40.0 * (1.0 + 0.05 * np.sin(3 * p) * np.sin(t) ** 3 + 0.03 * np.cos(5 * t))
    around = np.stack((np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)), axis=-1)
    vertices = np.concatenate(
        ((r[..., None] * around).reshape(-1, 3), [[0, 0, 41.2], [0, 0, -38.8]])
    )
    k = np.arange(sides)
    beside, last = (k + 1) % sides, sides * (sides - 2)
    a, d = (sides * k[: sides - 2, None] + one for one in (k, beside))
    quads = [
        np.stack(one, axis=-1).reshape(-1, 3)
        for one in ((a, a + sides, d + sides), (a, d + sides, d))
    ]
    top, bottom = (np.full(sides, len(vertices) - 2 + end) for end in (0, 1))
    caps = [np.column_stack((top, k, beside)), np.column_stack((last + k, bottom, last + beside))]
    return TriangleMesh(vertices, np.concatenate((*quads, *caps)).astype(np.uint32))


def scanned(mesh: TriangleMesh, count: int) -> Points:
    """Points of a body from all sides, with noise."""
    rng = np.random.default_rng(3)
    places, normals = sampled(MeshDistance(mesh), count, rng)
    places += rng.normal(0.0, NOISE_MM, count)[:, None] * normals
    noise = np.full(count, NOISE_MM)
    return Points(places, 2.0 * noise, noise, normals=normals)


@work
def whole_bodies() -> list[Result]:
    """A body from all sides against its model of half a million triangles, and its closed mesh."""
    model = bumpy_ball(500)
    points = scanned(model, 465_000)
    known = KnownPose(np.eye(4))
    against = f"deviation of 465,000 points from {len(model.faces):,} triangles"
    closed = "closed mesh of 465,000 points, cells of 0.4 mm"
    return [
        alone(against, lambda: fw.deviation(points, model, align=known), limit_seconds=2.0),
        alone(closed, lambda: fw.views.closed_mesh(points, cell_mm=0.4), limit_seconds=3.0),
    ]


@work
def archives() -> list[Result]:
    """A cloud in one archive, beside NumPy's own compression."""
    cloud, _ = part()
    with TemporaryDirectory() as folder:
        ours, theirs = Path(folder) / "ours.npz", Path(folder) / "theirs.npz"
        names = ("xyz_mm", "sigma_mm", "noise_mm", "reason")
        arrays = {name: getattr(cloud, name) for name in names}

        def same(own: bool) -> float:
            """Size of the file, MB, whose arrays are those of the cloud."""
            path = ours if own else theirs
            with np.load(path, allow_pickle=False) as found:
                assert all(found[n].tobytes() == arrays[n].tobytes() for n in names)
            return path.stat().st_size / 1e6

        row = compared(
            "cloud of 2.9 MP to NPZ (errors: size in MB)",
            "numpy.savez_compressed",
            np.__version__,
            lambda: fw.files.write_points(ours, cloud),
            lambda: np.savez_compressed(theirs, **arrays),
            accuracy=same,
            limit_seconds=0.9,
        )
    return [row]


@work
def calibration() -> list[Result]:
    """A rig from twelve poses of a board, 24 frames of 1280 × 1024 px each, read from disk."""
    rig, board = standard_rig(), parse_board(BOARD)
    plan = fringe_plan(rig)
    with TemporaryDirectory() as folder:
        for k, pose in enumerate(board_poses(board, POSES)):
            frames = photograph(look(rig, [board_body(board, pose)]), plan, Optics(seed=k))
            fw.files.write_stack(Path(folder) / f"{k:02d}", frames, plan)
        name = "calibration, 12 poses of 24 frames, 1280 x 1024"
        return [alone(name, lambda: fw.calibrate(folder, BOARD), limit_seconds=10.0, repeats=1)]
