"""Features with known deviations under noise: one cloud of side-by-side areas for each tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import fringeworks as fw
from fringeworks.evaluate import Area, Datum, PartTolerance, ToleranceZone
from fringeworks.rig.pinhole import rotation

SIDE = 40
"""Pixels along each side of an area."""
NOISE_MM = 0.01
HALF_MM = 20.0
"""Half the length of a feature."""


@dataclass(frozen=True)
class Case:
    """A tolerance, and the true points (h, w, 3) of its areas."""

    tolerance: PartTolerance
    points: dict[str, np.ndarray]
    datums: dict[str, Datum]
    model: fw.evaluate.PartModel | None = None

    def recipe(self, risk=0.05):
        areas = {
            name: Area(box=(SIDE * k, 0, SIDE * k + SIDE - 1, SIDE - 1))
            for k, name in enumerate(self.points)
        }
        return fw.Recipe(
            areas=areas,
            tolerances=(self.tolerance,),
            datums=self.datums,
            model=self.model,
            risk=risk,
        )

    def cloud(self, rng, noise=NOISE_MM):
        """The areas side by side, moved by noise along the rays."""
        true = np.concatenate(list(self.points.values()), axis=1)
        ray = true / np.linalg.norm(true, axis=-1, keepdims=True)
        xyz = true + (noise * rng.normal(size=true.shape[:2]))[..., None] * ray
        sigma = np.full(true.shape[:2], max(noise, 1e-9), np.float32)
        reason = np.zeros(true.shape[:2], np.uint8)
        return fw.PointCloud(xyz.astype(np.float32), sigma, sigma, reason)


def grid():
    v, u = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j]
    return u, v


def wavy(rng, u, v):
    """A smooth form of range 1: a bow, waves, a dent, or a mixture."""
    kind = rng.integers(4)
    a, b, c, d = rng.uniform(0, 6, 4)
    if kind == 0:
        p, q, r = rng.normal(size=3)
        f = p * u * u + q * u * v + r * v * v
    elif kind == 1:
        f = np.cos(rng.uniform(2, 7) * u + a) * np.cos(rng.uniform(1, 4) * v + b)
    elif kind == 2:
        x, y = rng.uniform(-0.7, 0.7, 2)
        f = np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / rng.uniform(0.2, 0.4) ** 2)
    else:
        f = (
            np.cos(3 * u + a)
            + 0.6 * np.cos(4 * v + b)
            + 0.4 * np.cos(3 * u - 3 * v + c) * np.cos(d)
        )
    return f / np.ptp(f)


def turned(points, rng, size):
    """The points turned about their mean by a small random rotation, rad."""
    middle = points.reshape(-1, 3).mean(axis=0)
    return (points - middle) @ rotation(size * rng.normal(size=3)).T + middle


def plane(rng, size=0.0, centre=(0.0, 0.0, 500.0), normal=(0.0, 0.0, -1.0), tilt=0.0):
    """A plane of 40 × 40 mm with a wavy form of a range, mm."""
    u, v = grid()
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    x = np.cross(n, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    f = size * wavy(rng, u, v)
    flat = HALF_MM * (u[..., None] * x + v[..., None] * y) + f[..., None] * n
    return turned(flat + np.asarray(centre, float), rng, tilt)


def cylinder(
    rng, size=0.0, centre=(0.0, 0.0, 510.0), axis=(1.0, 0.0, 0.0), radius=15.0, tilt=0.0, bend=0.0
):
    """The 140° of a cylinder that the camera sees, with a wavy form, its axis bent by a sag, mm."""
    u, v = grid()
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    out = np.array([0.0, 0.0, -1.0]) - (-a[2]) * a
    out /= np.linalg.norm(out)
    side = np.cross(a, out)
    turn = np.radians(70.0) * v[..., None]
    n = np.cos(turn) * out + np.sin(turn) * side
    r = radius + size * wavy(rng, u, v)
    sag = bend * (1 - u[..., None] ** 2) * side
    points = HALF_MM * u[..., None] * a + r[..., None] * n + sag
    return turned(points + np.asarray(centre, float), rng, tilt)


def ball(rng, size=0.0, centre=(0.0, 0.0, 510.0), radius=15.0):
    u, v = grid()
    across = 0.8 * np.stack((u, v), -1) / np.sqrt(2.0)
    z = -np.sqrt(1.0 - np.sum(across**2, -1))
    n = np.concatenate((across, z[..., None]), -1)
    r = radius + size * wavy(rng, u, v)
    return r[..., None] * n + np.asarray(centre, float)


def beside(rng, size, z):
    """A place that is moved at random across an axis along x."""
    y, dz = size * rng.normal(size=2)
    return (0.0, y, z + dz)


def random_size(rng):
    return NOISE_MM * rng.uniform(3.0, 15.0)


A = {"A": Datum(("a",))}
AB = {"A": Datum(("a",)), "B": Datum(("b",)), "C": Datum(("c",))}
# The smallest zone of an arc hardly holds its axis; least squares does.
SHAFT = {"A": Datum(("a",), "cylinder", "least-squares")}


def zone(quantity, areas=("part",), high=1.0, **options):
    return PartTolerance("t", quantity, areas, None, high, zone=ToleranceZone(**options))


def frame_planes(rng, form=0.005):
    """Three planes at right angles, all seen: normals along the edges of a cube on its corner."""
    R = rotation(np.array([0.9553 * np.sqrt(0.5), -0.9553 * np.sqrt(0.5), 0.0]))
    normals = -R.T
    names = ("a", "b", "c")
    found = {}
    for name, n, shift in zip(names, normals, ((0, 0), (60, 0), (-60, 10)), strict=True):
        centre = np.array([*shift, 500.0])
        found[name] = plane(rng, form, centre, n if n[2] < 0 else -n)
    return found


def case(quantity, rng, size=None):
    """A tolerance and its features, drawn at random."""
    s = random_size(rng) if size is None else size
    small, tilt = 0.3 * s, s / 40.0
    datum = plane(rng, small, (60.0, 0.0, 505.0))
    shaft = cylinder(rng, small, (60.0, 0.0, 515.0))
    if quantity == "iso_straightness":
        return Case(zone(quantity, direction=(1, 0, 0)), {"part": plane(rng, s)}, {})
    if quantity == "iso_flatness":
        return Case(zone(quantity), {"part": plane(rng, s, tilt=0.02)}, {})
    if quantity in ("iso_roundness", "iso_cylindricity"):
        return Case(zone(quantity, body="cylinder"), {"part": cylinder(rng, s, tilt=0.02)}, {})
    if quantity == "iso_parallelism":
        return Case(
            zone(quantity, datums=("A",)), {"part": plane(rng, s, tilt=tilt), "a": datum}, A
        )
    if quantity == "iso_perpendicularity":
        part = plane(rng, s, normal=(1.0, 0.0, -1.0), tilt=tilt)
        datum = plane(rng, small, (60.0, 0.0, 505.0), (-1.0, 0.0, -1.0))
        return Case(zone(quantity, datums=("A",)), {"part": part, "a": datum}, A)
    if quantity == "iso_angularity":
        part = plane(rng, s, normal=(1.0, 0.0, -np.sqrt(3.0)), tilt=tilt)
        return Case(zone(quantity, datums=("A",), angle_deg=30.0), {"part": part, "a": datum}, A)
    if quantity in SYSTEMS:
        return _to_a_system(quantity, rng, s)
    if quantity == "iso_position":
        planes = frame_planes(rng, small)
        part = ball(rng, small, rng.normal(0, 0.5 * s, 3) + np.array([0.0, 0.0, 510.0]))
        return Case(
            zone(quantity, body="sphere", datums=("A", "B", "C"), at_mm=_in_frame(planes)),
            {"part": part, **planes},
            AB,
        )
    if quantity == "iso_concentricity":
        part = ball(rng, small, rng.normal(0, 0.5 * s, 3) + np.array([0.0, 0.0, 510.0]))
        other = ball(rng, small, (0.0, 0.0, 510.0), 25.0)
        datums = {"A": Datum(("a",), "sphere", "least-squares")}
        return Case(
            zone(quantity, body="sphere", datums=("A",)), {"part": part, "a": other}, datums
        )
    if quantity == "iso_coaxiality":
        part = cylinder(rng, small, beside(rng, 0.4 * s, 515.0), tilt=tilt)
        return Case(
            zone(quantity, body="cylinder", datums=("A",)), {"part": part, "a": shaft}, SHAFT
        )
    if quantity == "iso_symmetry":
        sides = {
            name: plane(rng, small, (x + 0.5 * s * rng.normal(), 0.0, 500.0), (n, 0.0, -1.0), tilt)
            for name, x, n in (("one", -6.0, 1.0), ("two", 6.0, 1.0))
        }
        both = {
            name: plane(rng, small, (x, 0.0, 500.0), (n, 0.0, -1.0))
            for name, x, n in (("a", -9.0, 1.0), ("b", 9.0, 1.0))
        }
        datums = {"A": Datum(("a", "b"), "median", "least-squares")}
        areas = ("one", "two")
        return Case(zone(quantity, areas, datums=("A",)), {**sides, **both}, datums)
    if quantity in ("iso_circular_run_out", "iso_total_run_out"):
        part = cylinder(rng, s, beside(rng, 0.3 * s, 515.0), tilt=tilt)
        return Case(
            zone(quantity, body="cylinder", datums=("A",)), {"part": part, "a": shaft}, SHAFT
        )
    raise KeyError(quantity)


PIPE_MM = (540.0, 40.0)
"""Distance of the axis of the model of profiles, which runs along x, and its radius."""


def pipe_model():
    """The 80° of a pipe that face the camera, as triangles of 0.25° (a sagitta of 0.1 µm)."""
    far, radius = PIPE_MM
    turn = np.radians(np.linspace(-40.0, 40.0, 321))
    ends = np.array([-30.0, 30.0])
    x, t = np.meshgrid(ends, turn, indexing="ij")
    corners = np.stack((x, radius * np.sin(t), far - radius * np.cos(t)), axis=-1).reshape(-1, 3)
    k, n = np.arange(320), 321
    one, other = np.stack((k, k + 1, k + n), -1), np.stack((k + 1, k + n + 1, k + n), -1)
    mesh = fw.TriangleMesh(corners, np.concatenate((one, other)).astype(np.uint32))
    return fw.evaluate.PartModel(mesh, fw.evaluate.KnownPose(np.eye(4)), 2.0)


def profile_case(quantity, rng, **options):
    """A pipe with a wavy form that lies a little beside its model."""
    far, radius = PIPE_MM
    u, v = grid()
    t = np.radians(30.0) * v
    r = radius + random_size(rng) * wavy(rng, u, v)
    points = np.stack((HALF_MM * u, r * np.sin(t), far - r * np.cos(t)), axis=-1)
    moved = turned(points, rng, 5e-4) + 0.03 * rng.normal(size=3)
    return Case(zone(quantity, **options), {"part": moved}, {}, pipe_model())


def _to_a_system(name, rng, s):
    """Orientation to two or three planes: across the other two, 30° off one, or an axis."""
    planes = frame_planes(rng, 0.3 * s)
    a, b, c = (outwards(planes[name]) for name in "abc")
    quantity = name.removesuffix("_system")
    if name == "iso_parallelism_system":
        # An axis that is parallel to A and across B, so that B locks it.
        part = cylinder(rng, 0.3 * s, (0.0, 60.0, 515.0), b, tilt=s / 40.0)
        return Case(
            zone(quantity, body="cylinder", datums=("A", "B")), {"part": part, **planes}, AB
        )
    normal, options = c, {}
    if name == "iso_angularity_system":
        normal, options = np.sqrt(0.75) * a + 0.5 * b, {"angle_deg": 30.0}
    part = plane(rng, s, (0.0, 60.0, 500.0), normal, tilt=s / 40.0)
    del planes["c"]
    two = {name: AB[name] for name in "AB"}
    return Case(zone(quantity, datums=("A", "B"), **options), {"part": part, **planes}, two)


def outwards(points):
    """Normal of least squares of a plane, towards the camera."""
    xyz = points.reshape(-1, 3)
    n = np.linalg.svd(xyz - xyz.mean(axis=0), full_matrices=False)[2][2]
    return n if n[2] < 0 else -n


def _in_frame(planes):
    """Exact place of the ball's middle in the frame of perfect planes."""
    normals = []
    for name in ("a", "b", "c"):
        xyz = planes[name].reshape(-1, 3)
        n = np.linalg.svd(xyz - xyz.mean(axis=0))[2][2]
        normals.append((n if n[2] < 0 else -n, xyz.mean(axis=0)))
    z = normals[0][0]
    x = normals[1][0] - (normals[1][0] @ z) * z
    x /= np.linalg.norm(x)
    away = [n @ (np.array([0.0, 0.0, 510.0]) - p) for n, p in normals]
    y = np.cross(z, x)
    return (float(away[1]), float(away[2] * np.sign(y @ normals[2][0])), float(away[0]))


SYSTEMS = ("iso_parallelism_system", "iso_perpendicularity_system", "iso_angularity_system")
"""Orientations to more than one datum."""
BODIES = (
    "iso_straightness",
    "iso_flatness",
    "iso_roundness",
    "iso_cylindricity",
    "iso_parallelism",
    "iso_perpendicularity",
    "iso_angularity",
    "iso_position",
    "iso_concentricity",
    "iso_coaxiality",
    "iso_symmetry",
    "iso_circular_run_out",
    "iso_total_run_out",
    *SYSTEMS,
)
"""Characteristics that the bodies here show; profiles need a model."""
