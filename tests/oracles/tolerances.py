"""Geometrical tolerances from their definitions, by general solvers on the points themselves."""

from __future__ import annotations

import numpy as np
import scipy


def value(case):
    """The value of a case of ``tests.tolerance_bodies``, of its points without noise."""
    quantity, zone = case.tolerance.quantity, case.tolerance.zone
    if len(zone.datums) == 2:
        quantity += "_system"
    return VALUES[quantity](case.points, zone)


def smallest_zone(distances, start):
    """The values that make the range of distances(values) smallest, by sequential quadratics."""
    start = np.asarray(start, float)
    first = distances(start)
    middle = 0.5 * (first.max() + first.min())
    far = np.abs(first - middle)
    kept = far > (0.4 * far.max() if far.size > 100 else -1.0)

    def sides(x):
        away = distances(x[2:])[kept]
        return np.concatenate((x[1] - away, away - x[0]))

    low, high = first.min(), first.max()
    solved = scipy.optimize.minimize(
        lambda x: x[1] - x[0],
        np.concatenate(([low, high], start)),
        jac=lambda _: np.concatenate(([-1.0, 1.0], np.zeros(len(start)))),
        constraints={"type": "ineq", "fun": sides},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-10},
    )
    return solved.x[2:]


def flat(points):
    """Plane of the smallest zone by a linear programme: its normal to the camera."""
    xyz = points.reshape(-1, 3)
    middle = xyz.mean(axis=0)
    x, y, n = np.linalg.svd(xyz - middle, full_matrices=False)[2]
    n = n if n[2] < 0 else -n
    for _ in range(3):
        a = np.column_stack(((xyz - middle) @ x, (xyz - middle) @ y))
        h = (xyz - middle) @ n
        ones = np.ones((len(h), 1))
        solved = scipy.optimize.linprog(
            [0, 0, -1, 1],
            A_ub=np.block([[-a, 0 * ones, -ones], [a, ones, 0 * ones]]),
            b_ub=np.concatenate((-h, h)),
            bounds=[(None, None)] * 4,
        ).x
        n = n - solved[0] * x - solved[1] * y
        n /= np.linalg.norm(n)
        x = x - (x @ n) * n
        x /= np.linalg.norm(x)
        y = np.cross(n, x)
    return n


def flatness(points, _zone):
    return np.ptp(points["part"].reshape(-1, 3) @ flat(points["part"]))


def straightness(points, _zone):
    widest = 0.0
    n = flat(points["part"])
    for line in points["part"]:
        along, h = (line - line[0]) @ (line[-1] - line[0]), line @ n
        along = along / np.abs(along).max()
        solved = scipy.optimize.minimize_scalar(
            lambda s, along=along, h=h: np.ptp(h - s * along), bounds=(-1, 1), method="bounded",
            options={"xatol": 1e-9},
        )  # fmt: skip
        widest = max(widest, solved.fun)
    return widest


def radial(values, xyz, middle, axis):
    """Distances from an axis that is moved across and tilted by four values."""
    x, y = np.linalg.svd(axis[None])[2][1:]
    way = axis + values[2] * x + values[3] * y
    way /= np.linalg.norm(way)
    away = xyz - middle - values[0] * x - values[1] * y
    return np.linalg.norm(away - np.outer(away @ way, way), axis=1), way


def least_squares_axis(points):
    """Point and direction of the cylinder of least squares of a grid that runs along its axis."""
    xyz = points.reshape(-1, 3)
    axis = (points[:, -1] - points[:, 0]).mean(axis=0)
    axis /= np.linalg.norm(axis)
    out = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    middle = xyz.mean(axis=0) + 12.0 * out / np.linalg.norm(out)

    def off(q):
        return radial(q[:4], xyz, middle, axis)[0] - q[4]

    q = scipy.optimize.least_squares(off, [0, 0, 0, 0, 15.0], xtol=1e-14, ftol=1e-14).x
    x, y = np.linalg.svd(axis[None])[2][1:]
    return middle + q[0] * x + q[1] * y, radial(q[:4], xyz, middle, axis)[1]


def zone_axis(points):
    """The same of the cylinder of the smallest zone, and its width."""
    middle, axis = least_squares_axis(points)
    xyz = points.reshape(-1, 3)

    def away(values):  # tilts in mm over the length
        return radial(values / [1, 1, 20, 20], xyz, middle, axis)[0]

    q = smallest_zone(away, np.zeros(4))
    x, y = np.linalg.svd(axis[None])[2][1:]
    width = np.ptp(away(q))
    return middle + q[0] * x + q[1] * y, radial(q / [1, 1, 20, 20], xyz, middle, axis)[1], width


def cylindricity(points, _zone):
    return zone_axis(points["part"])[2]


def circle(section, middle, axis):
    """Coordinates of a section across an axis, (n, 2)."""
    x, y = np.linalg.svd(axis[None])[2][1:]
    return np.column_stack(((section - middle) @ x, (section - middle) @ y))


def roundness(points, _zone):
    middle, axis = least_squares_axis(points["part"])
    widest = 0.0
    for k in range(points["part"].shape[1]):
        at = circle(points["part"][:, k], middle, axis)

        def away(c, at=at):
            return np.linalg.norm(at - c, axis=1)

        solved = scipy.optimize.minimize(
            lambda c, away=away: np.ptp(away(c)), smallest_zone(away, np.zeros(2)),
            method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10, "maxiter": 4000},
        )  # fmt: skip
        widest = max(widest, solved.fun)
    return widest


def parallelism(points, _zone):
    return np.ptp(points["part"].reshape(-1, 3) @ flat(points["a"]))


def inclined(points, angle):
    """Range along the best normal at an angle, rad, from that of the datum."""
    n, m = flat(points["a"]), flat(points["part"])
    x = m - (m @ n) * n
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    xyz = points["part"].reshape(-1, 3)

    def width(turn):
        way = np.cos(angle) * n + np.sin(angle) * (np.cos(turn) * x + np.sin(turn) * y)
        return np.ptp(xyz @ way)

    return scipy.optimize.minimize_scalar(
        width, bounds=(-0.1, 0.1), method="bounded", options={"xatol": 1e-10}
    ).fun


def perpendicularity(points, _zone):
    return inclined(points, 0.5 * np.pi)


def angularity(points, zone):
    return inclined(points, np.radians(zone.angle_deg))


def centre(points):
    """Centre of the sphere of least squares."""
    xyz = points.reshape(-1, 3)
    start = np.append(xyz.mean(axis=0) + np.array([0, 0, 10.0]), 15.0)
    return scipy.optimize.least_squares(
        lambda q: np.linalg.norm(xyz - q[:3], axis=1) - q[3], start, xtol=1e-14, ftol=1e-14
    ).x[:3]


def frame(points):
    """Axes of the frame of two planes: the normal of the first one, and that of the narrowest zone
    of the second one across it."""
    b = points["b"].reshape(-1, 3)
    z, start = flat(points["a"]), flat(points["b"])
    u = start - (start @ z) * z
    u /= np.linalg.norm(u)
    v = np.cross(z, u)

    def way(turn):
        return np.cos(turn) * u + np.sin(turn) * v

    solved = scipy.optimize.minimize_scalar(
        lambda t: np.ptp(b @ way(t)), bounds=(-0.1, 0.1), method="bounded",
        options={"xatol": 1e-11},
    )  # fmt: skip
    x = way(solved.x)
    return x, np.cross(z, x), z


def perpendicularity_system(points, _zone):
    return np.ptp(points["part"].reshape(-1, 3) @ frame(points)[1])


def angularity_system(points, zone):
    x, _, z = frame(points)
    turn = np.radians(zone.angle_deg)
    return np.ptp(points["part"].reshape(-1, 3) @ (np.cos(turn) * z + np.sin(turn) * x))


def centres(points):
    """Centres of the circles of least squares of the sections of a cylinder, (k, 3)."""
    own, way = least_squares_axis(points)
    x, y = np.linalg.svd(way[None])[2][1:]
    found = []
    for k in range(points.shape[1]):
        section = points[:, k]
        at = circle(section, own, way)
        c = scipy.optimize.least_squares(
            lambda q, at=at: np.linalg.norm(at - q[:2], axis=1) - q[2], [0, 0, 15.0], xtol=1e-14
        ).x
        found.append(own + ((section - own) @ way).mean() * way + c[0] * x + c[1] * y)
    return np.array(found)


def parallelism_system(points, _zone):
    """The axis keeps the direction of x: the smallest circle around its places across it."""
    _, y, z = frame(points)
    places = centres(points["part"]) @ np.column_stack((y, z))
    middle = places.mean(axis=0)
    solved = scipy.optimize.minimize(
        lambda c: np.linalg.norm(places - middle - c, axis=1).max(), np.zeros(2),
        method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-11, "maxiter": 4000},
    )  # fmt: skip
    return 2.0 * solved.fun


def position(points, zone):
    a, b, c = (points[name].reshape(-1, 3) for name in ("a", "b", "c"))
    x, _, z = frame(points)
    y = np.cross(z, x)
    side = np.sign(y @ flat(points["c"]))
    # Datum planes touch the material from outside, on the side of the camera.
    origin = np.array([(b @ x).max(), side * (side * (c @ y)).max(), (a @ z).max()])
    place = np.array([x, y, z]) @ centre(points["part"]) - origin
    return 2.0 * np.linalg.norm(place - zone.at_mm)


def concentricity(points, _zone):
    return 2.0 * np.linalg.norm(centre(points["part"]) - centre(points["a"]))


def coaxiality(points, _zone):
    middle, axis = least_squares_axis(points["a"])
    widest = 0.0
    for place in centres(points["part"]) - middle:
        widest = max(widest, np.linalg.norm(place - (place @ axis) * axis))
    return 2.0 * widest


def median(one, other):
    """Middles of two planes that face alike, where they are opposite to each other."""
    n = sum(flat(points) for points in (one, other))
    n /= np.linalg.norm(n)
    x, y = np.linalg.svd(n[None])[2][1:]
    a, b = (np.column_stack([p.reshape(-1, 3) @ w for w in (x, y, n)]) for p in (one, other))
    h = scipy.interpolate.griddata(b[:, :2], b[:, 2], a[:, :2], method="cubic")
    ok = np.isfinite(h)
    return a[ok, :1] * x + a[ok, 1:2] * y + 0.5 * (a[ok, 2] + h[ok])[:, None] * n


def symmetry(points, _zone):
    datum = median(points["a"], points["b"])
    middle = datum.mean(axis=0)
    n = np.linalg.svd(datum - middle, full_matrices=False)[2][2]
    return 2.0 * np.abs((median(points["one"], points["two"]) - middle) @ n).max()


def run_outs(points):
    """Distances of the points from the datum axis, in the grid of the part."""
    middle, axis = least_squares_axis(points["a"])
    away = points["part"] - middle
    return np.linalg.norm(away - (away @ axis)[..., None] * axis, axis=-1)


def circular_run_out(points, _zone):
    return np.ptp(run_outs(points), axis=0).max()


def total_run_out(points, _zone):
    return np.ptp(run_outs(points))


def off_pipe(xyz, far, radius, motion):
    """Distances of points from a pipe along x, after a motion of the points about their mean."""
    middle = xyz.mean(axis=0)
    turn = scipy.spatial.transform.Rotation.from_rotvec(motion[:3] / 20.0)
    at = turn.apply(xyz - middle) + middle + motion[3:]
    return np.hypot(at[:, 1], at[:, 2] - far) - radius


def least_largest(away, start):
    """The smallest largest size of away(motion), by sequential quadratics."""
    solved = scipy.optimize.minimize(
        lambda x: x[0],
        np.concatenate(([np.abs(away(start)).max()], start)),
        jac=lambda x: np.concatenate(([1.0], np.zeros(len(x) - 1))),
        constraints={
            "type": "ineq",
            "fun": lambda x: np.concatenate((x[0] - away(x[1:]), x[0] + away(x[1:]))),
        },
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-11},
    )
    return solved.x[0]


def surface_profile(points, pipe, *, located):
    """Profile of a surface whose model is a pipe: without datums, the points may move."""
    xyz = points["part"].reshape(-1, 3)
    if located:
        return 2.0 * np.abs(off_pipe(xyz, *pipe, np.zeros(6))).max()
    # A pipe does not tell turns about its axis from shifts across it, nor shifts along it.
    return 2.0 * least_largest(
        lambda m: off_pipe(xyz, *pipe, np.array([0.0, m[0], m[1], 0.0, m[2], m[3]])), np.zeros(4)
    )


def line_profile(points, pipe):
    """Profile of the sections across a pipe, each of which may move in its plane."""
    far, radius = pipe
    widest = 0.0
    for k in range(points["part"].shape[1]):
        at = points["part"][:, k, 1:] - np.array([0.0, far])
        moved = least_largest(lambda c, at=at: np.linalg.norm(at - c, axis=1) - radius, np.zeros(2))
        widest = max(widest, 2.0 * moved)
    return widest


VALUES = {
    f"iso_{function.__name__}": function
    for function in (
        straightness, flatness, roundness, cylindricity, parallelism, perpendicularity, angularity, position,
        concentricity, coaxiality, symmetry, circular_run_out, total_run_out, parallelism_system,
        perpendicularity_system, angularity_system,
    )
}  # fmt: skip
