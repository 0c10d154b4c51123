"""The measured surface of a feature: freed of the noise of pixels, with its errors as parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.evaluate.area_points import PATCHES, AreaPoints
from fringeworks.evaluate.quantities import PARALLEL_SINE, AreaDeviation
from fringeworks.evaluate.shares import Share, Shares
from fringeworks.evaluate.tolerances.association import associate
from fringeworks.evaluate.tolerances.bodies import Body, Kind, everything, twists
from fringeworks.evaluate.tolerances.limits import BINS, all_over, limiting, with_all
from fringeworks.evaluate.tolerances.neighbours import Neighbours, neighbours
from fringeworks.evaluate.tolerances.outliers import outliers
from fringeworks.evaluate.tolerances.settled import OnModel, Settled, measured_at, settled
from fringeworks.evaluate.tolerances.smooth import Smooth, smooth
from fringeworks.evaluate.tolerances.unsure import Changes, Unsure, drawn
from fringeworks.rig.point_errors import root_of
from fringeworks.surface.form import DISCARDED, fit_form
from fringeworks.types import FloatMap, InputError

BLOCKS = 128
"""Blocks along each side of an area, whose points are averaged before the fit: four to the finest
interval of a spline."""
MOST_POINTS = 20_000
"""Number of points from which they are averaged in blocks: fewer cost little."""
RESTING_POINTS = 1_000
"""Points that tell where a surface rests on its model, before those that limit it are chosen."""
MEDIAN_POINTS = 2_000
"""Points of a median surface: 45 along each side."""
LINES = 21
"""Largest number of lines of a feature that is judged by lines."""
LINE_POINTS = 50
"""Points of such a line: five for the finest lobe that a spline of 16 intervals holds."""
LEAST_LINE_POINTS = 10
"""Points that a line needs to count."""
NEAR = 1.5
"""Distance from the next pixel, in mean distances of pixels, up to which a place is measured."""
OPPOSITE = 0.75
"""Distance from the next pixel, in distances of pixels, up to which a point has an opposite one:
half the diagonal of a pixel."""
FLAT = 1e-6
"""Width of an area over its length below which its points lie on a line, to rounding."""
DEGREE = 3
"""Degree of the polynomial through errors of the calibration, which are known in cells: a change
over a third of the area."""
AtRest = Callable[[NDArray[np.intp], FloatMap], FloatMap]
"""Distances of some points (m,) from their model after the motion that suits them, from those at
the measured place, (m,), mm."""


@dataclass(frozen=True)
class Skin:
    """Points of a feature on its body of least squares, and their distances from it."""

    body: Body
    foot: FloatMap
    """Points on the body, (m, 3), mm."""
    normal: FloatMap
    """Outwards at each, (m, 3); of planes towards the camera."""
    distance: FloatMap
    """Distance of the surface from the body at each, (m,), mm."""
    unsure: tuple[Unsure, ...]
    """What noise leaves unknown of the distances: their sum."""
    parts: FloatMap
    """Parts of the errors that all areas have in common, of the calibration and the blur, (m, k),
    mm."""
    sources: Shares
    """What each of these parts comes from, (k,)."""
    own: FloatMap
    """Parts of the errors of this area alone, (m, j), mm."""
    weight: FloatMap
    """Number of pixels that a point stands for in a fit of least squares, (m,)."""
    line: FloatMap
    """Number of each point's line, (m,); all 0 without lines."""
    across: FloatMap | None = None
    """Normal of the planes that the lines lie in, (3,); None without lines."""
    model: OnModel | None = None
    """The model that the points may move on; None for bodies and for points that stay in place."""

    @property
    def lined(self) -> bool:
        """Whether the feature is judged by lines."""
        return self.across is not None

    @cached_property
    def lines(self) -> list[NDArray[np.intp]]:
        """Indices of the points of each line."""
        return [np.flatnonzero(self.line == k) for k in np.unique(self.line)]

    @cached_property
    def bases(self) -> list[FloatMap]:
        """What motions and the size of the body do to each line, as orthonormal columns."""
        found = []
        for at in self.lines:
            pivot = self.foot[at].mean(axis=0)
            scale = float(np.ptp(self.foot[at], axis=0).max()) or 1.0
            slopes = twists(self.foot[at], self.normal[at], pivot, scale)
            slopes = np.column_stack((slopes, np.ones(len(at))))
            u, size, _ = np.linalg.svd(slopes, full_matrices=False)
            found.append(u[:, size > FLAT * size[0]])
        return found

    @property
    def motions(self) -> FloatMap:
        """Motions of the points that their tolerance leaves free: all, or those within the plane of
        a line, (6, f)."""
        if self.across is None:
            return everything()
        free = np.zeros((6, 3))
        free[:3, 0] = self.across
        free[3:, 1:] = np.linalg.svd(self.across[None])[2][1:].T
        return free

    @cached_property
    def settled(self) -> list[Settled]:
        """The points of each line after the motion that suits them best on the model."""
        assert self.model is not None
        points, free = self.points(), self.motions
        starts = [measured_at(points[at], self.model) for at in self.lines]
        return [settled(one, free, self.model) for one in starts]

    def points(self, change: FloatMap | float = 0.0) -> FloatMap:
        """Return the points of the surface, its distances changed, (m, 3), mm."""
        return np.asarray(self.foot + (self.distance + change)[:, None] * self.normal)

    @property
    def resolved(self) -> bool:
        """Whether a spline describes the surface; its points stand for themselves otherwise."""
        return all(one.likely is not None for one in self.unsure)

    def noise(self, random: np.random.Generator) -> Changes:
        """Draw changes of the distances by noise."""
        return drawn(self.unsure, random)


@dataclass(frozen=True)
class Lines:
    """The lines that a feature is judged by."""

    run: Literal["along", "across", "around"]
    """Along the chart's first direction, across it, or as circles around a point of a plane."""
    direction: FloatMap | None = None
    """Of the lines on a plane or free form, (3,)."""
    centre: FloatMap | None = None
    """Of the circles, (3,)."""


@dataclass(frozen=True)
class Chart:
    """Places on a body as two coordinates, mm, and the lines of a feature in them."""

    body: Body
    first: FloatMap
    """Along a plane's lines, along an axis, or across a sphere, (3,)."""
    middle: FloatMap
    """Mean normal, (3,)."""
    exact: bool
    """Whether the body itself, not a model beside it, is what distances are measured from."""

    def places(self, points: FloatMap) -> FloatMap:
        """Return the coordinates of points, (n, 2), mm."""
        body, away = self.body, points - self.body.point
        second = np.cross(self.middle, self.first)
        if body.kind == "plane":
            return np.column_stack((away @ self.first, away @ second))
        if body.kind == "cylinder":
            turn = np.arctan2(away @ second, away @ self.middle)
            return np.column_stack((away @ self.first, body.radius * turn))
        across = np.column_stack((away @ self.first, away @ second))
        size = np.linalg.norm(across, axis=1)
        turn = np.arctan2(size, away @ self.middle)
        return np.asarray(across * (body.radius * turn / np.maximum(size, 1e-30))[:, None])

    def feet(self, places: FloatMap) -> FloatMap:
        """Return the points of the body at coordinates of a plane or cylinder, (m, 3), mm."""
        body = self.body
        second = np.cross(self.middle, self.first)
        base = body.point + places[:, :1] * self.first
        if body.kind == "plane":
            return np.asarray(base + places[:, 1:] * second)
        turn = places[:, 1] / body.radius
        out = np.outer(np.cos(turn), self.middle) + np.outer(np.sin(turn), second)
        return np.asarray(base + body.radius * out)


def skin(part: AreaPoints, kind: Kind, lines: Lines | None = None, *, evenly: bool = False) -> Skin:
    """Return the surface of a feature.

    Parameters
    ----------
    part : AreaPoints
    kind : "plane", "cylinder" or "sphere"
    lines : Lines, optional
        The lines that it is judged by; all of its surface otherwise.
    evenly : bool
        Take points all over the surface, for a share of them; those that can limit a zone
        otherwise.

    Raises
    ------
    InputError for an area that does not show the body, and lines that it does not hold.
    """
    body = body_of(part, kind)
    normals = body.normals(part.points)
    chart = chart_of(body, normals.mean(axis=0), lines)
    return _skin(part, chart, normals, body.distances(part.points), lines, evenly=evenly)


def median_skin(one: AreaPoints, other: AreaPoints) -> Skin:
    """Return the median surface of two planes that face each other: of each pair of opposite points
    the middle (ISO 17450-3).

    Raises
    ------
    InputError for areas that do not lie opposite to each other.
    """
    bodies = [body_of(part, "plane") for part in (one, other)]
    directions = [body.direction for body in bodies]
    alike = 1.0 if directions[0] @ directions[1] > 0 else -1.0
    n = directions[0] + alike * directions[1]
    n = n / np.linalg.norm(n)
    # Which points limit a median surface depends on both sides: all count, or evenly many.
    inner = np.flatnonzero(one.inner)
    first = _plane_skin(one, bodies[0], one.points[inner[:: -(-len(inner) // MEDIAN_POINTS)]])
    tall = (first.foot - bodies[1].point) @ directions[1] / (n @ directions[1])
    opposite = first.foot - tall[:, None] * n
    second = _plane_skin(other, bodies[1], opposite)
    chart = chart_of(bodies[1], directions[1], None)
    hull = scipy.spatial.Delaunay(chart.places(other.points[other.inner]))
    seen = np.linalg.norm(second.foot - opposite, axis=1) < OPPOSITE * _pitch(other.points)
    seen &= hull.find_simplex(chart.places(opposite)) >= 0
    if np.count_nonzero(seen) < LEAST_LINE_POINTS:
        raise InputError("median: expected two areas that face each other, got ones side by side")
    shares = [0.5 * side.normal @ n for side in (first, second)]
    sides = list(zip((first, second), shares, strict=True))
    unsure = [one.scaled(share).at(seen) for side, share in sides for one in side.unsure]
    parts = sum(share[:, None] * side.parts for side, share in sides)
    own = np.column_stack([share[:, None] * side.own for side, share in sides])
    foot = 0.5 * (first.foot + opposite)
    return Skin(
        Body("plane", foot[seen].mean(axis=0), n),
        foot[seen],
        np.broadcast_to(n, foot[seen].shape),
        sum(share * side.distance for side, share in sides)[seen],
        tuple(unsure),
        np.asarray(parts)[seen],
        first.sources,
        own[seen],
        first.weight[seen],
        first.line[seen],
    )


def _plane_skin(part: AreaPoints, body: Body, at: FloatMap) -> Skin:
    """The surface of a plane at points near it."""
    normals, distance = body.normals(part.points), body.distances(part.points)
    return _skin(part, chart_of(body, body.direction, None), normals, distance, None, at)


def _pitch(points: FloatMap) -> float:
    """Distance of neighbouring points of a plane, about, mm."""
    spread = np.linalg.svd(np.cov(points.T), compute_uv=False)[:2]
    return float(np.sqrt(12.0 * np.sqrt(spread[0] * spread[1]) / len(points)))


def skin_of_model(part: AreaDeviation, lines: Lines | None = None, *, free: bool = False) -> Skin:
    """Return the surface of an area, measured from its model; ``free`` if it may move on it."""
    middle = part.outwards.mean(axis=0)
    flat = Body("plane", part.middle, middle / np.linalg.norm(middle))
    chart = chart_of(flat, flat.direction, lines, exact=False)

    def at_rest(some: NDArray[np.intp], distance: FloatMap) -> FloatMap:
        away = distance - part.distance[some]
        points = part.points[some] + away[:, None] * part.outwards[some]
        start = measured_at(points[:: -(-len(points) // RESTING_POINTS)], part.on_model)
        rest = settled(start, everything(), part.on_model)
        moved = (points - start.points[0]) @ rest.turn.T + rest.points[0]
        return part.on_model(moved)[0]

    rest = at_rest if free and lines is None else None
    found = _skin(part, chart, part.outwards, part.distance, lines, rest=rest)
    # What is left of the alignment's errors moves all points together.
    pixel = scipy.spatial.cKDTree(part.points).query(found.foot)[1]
    pose = part.by_pose[pixel] @ root_of(part.pose_covariance)
    sources = (*found.sources, *pose.shape[1] * (Share("alignment", 1.0),))
    model = part.on_model if free else None
    parts = np.column_stack((found.parts, pose))
    return replace(found, parts=parts, sources=sources, model=model)


def _skin(
    part: AreaPoints,
    chart: Chart,
    normals: FloatMap,
    distance: FloatMap,
    lines: Lines | None,
    points: FloatMap | None = None,
    *,
    evenly: bool = False,
    rest: AtRest | None = None,
) -> Skin:
    places = chart.places(part.points)
    inner = np.flatnonzero(part.inner)
    low = places[inner].min(axis=0)
    span = np.maximum(np.ptp(places[inner], axis=0), np.finfo(float).tiny)
    unit = (places - low) / span
    sigma = _noise_along(part, normals)
    fitted, kept = _fitted(unit, distance, sigma, inner, _moves(part.points, normals), part)
    feet = part.points - distance[:, None] * normals
    at = unit if points is None else (chart.places(points) - low) / span
    number: FloatMap = np.zeros(len(at))
    weight: FloatMap
    if lines is not None or points is not None:
        if lines is not None:
            at, number = _on_lines(chart, lines, places[kept], low, span)
        own = lines is not None and not fitted.resolved
        pixel = kept[scipy.spatial.cKDTree(unit[kept]).query(at)[1]]
        if own and chart.exact:
            at, pixel = _through_pixels(at, number, unit, kept, pixel, lines)
        if lines is not None and (own or not chart.exact):
            at = at if chart.exact else unit[pixel]  # a model has feet at pixels alone
            number, pixel, at = _at_pixels(number, pixel, at)
        # Beside edges no spline describes the surface: its pixels stand for themselves.
        unsure = Unsure(sigma[pixel]) if own else Unsure(fitted.design(at), fitted.likely)
        value = distance[pixel] if own else fitted.at(at)
        weight = np.ones(len(at))
    elif fitted.resolved:
        pixel, weight = _chosen(chart, unit, fitted.at(unit), kept, rest, evenly=evenly)
        at, number = unit[pixel], number[pixel]
        unsure, value = Unsure(fitted.design(at), fitted.likely), fitted.at(at)
    else:
        pixel = kept[:: -(-len(kept) // MOST_POINTS)]
        at, value, number, weight = unit[pixel], distance[pixel], number[pixel], np.ones(len(pixel))
        unsure = Unsure(sigma[pixel])
    normal, foot = normals[pixel], feet[pixel]
    if lines is not None and chart.exact:
        foot = chart.feet(low + span * at)
        normal = chart.body.normals(foot)
    plane = None if lines is None else _across(chart, lines)
    common = _parts(part, unit, normals, kept, at, pixel)
    return Skin(chart.body, foot, normal, value, (unsure,), *common, weight, number, plane)


def _through_pixels(
    at: FloatMap,
    number: FloatMap,
    unit: FloatMap,
    kept: NDArray[np.intp],
    pixel: NDArray[np.intp],
    lines: Lines | None,
) -> tuple[FloatMap, NDArray[np.intp]]:
    """Lines moved across their direction to the middle of the pixels near each, and those pixels;
    circles stay where they are.

    Between two columns of pixels, a line would have pixels of both by turns, and a step from one
    column to the next would count as a form of the line. Along it, its points are those of the
    pixels: another place has another distance from a body that is off the centre.
    """
    if lines is None or lines.run == "around":
        return at, pixel
    moved, across = at.copy(), int(lines.run == "along")
    for line in np.unique(number):
        own = number == line
        moved[own, across] = np.median(unit[pixel[own], across])
    pixel = kept[scipy.spatial.cKDTree(unit[kept]).query(moved)[1]]
    moved[:, 1 - across] = unit[pixel, 1 - across]
    return moved, pixel


def _at_pixels(
    number: FloatMap, pixel: NDArray[np.intp], at: FloatMap
) -> tuple[FloatMap, NDArray[np.intp], FloatMap]:
    """Each pixel of each line once."""
    once = np.unique(np.stack((number, pixel)), axis=1, return_index=True)[1]
    return number[once], pixel[once], at[once]


def _across(chart: Chart, lines: Lines) -> FloatMap:
    """Normal of the planes that lines lie in, (3,)."""
    return chart.first if lines.run == "across" else np.cross(chart.middle, chart.first)


def _chosen(
    chart: Chart,
    unit: FloatMap,
    value: FloatMap,
    kept: NDArray[np.intp],
    rest: AtRest | None,
    *,
    evenly: bool,
) -> tuple[NDArray[np.intp], FloatMap]:
    """Points that stand for a surface, and the number of pixels that each stands for in means."""
    if evenly:
        return all_over(kept)
    if rest is not None:
        kept = kept[:: -(-len(kept) // MOST_POINTS)]
        value[kept] = rest(kept, value[kept])
    pixel, weight = limiting(unit, value, kept)
    return (pixel, weight) if chart.body.kind == "plane" else with_all(pixel, all_over(kept))


def _noise_along(part: AreaPoints, normals: FloatMap) -> FloatMap:
    """Standard deviation of points along their normals by noise; all of it where none is known."""
    sigma = part.noise if part.noise.any() else part.sigma
    return np.asarray(np.abs(np.einsum("nc,nc->n", part.by_value, normals)) * sigma)


def _moves(points: FloatMap, normals: FloatMap) -> FloatMap:
    """What motions and the size of a body do to distances of points, (n, 7), mm per mm."""
    pivot = points.mean(axis=0)
    scale = float(np.ptp(points, axis=0).max()) or 1.0
    return np.column_stack((twists(points, normals, pivot, scale), np.ones(len(points))))


def _fitted(
    unit: FloatMap,
    distance: FloatMap,
    sigma: FloatMap,
    inner: NDArray[np.intp],
    moves: FloatMap,
    part: AreaPoints,
) -> tuple[Smooth, NDArray[np.intp]]:
    """The smooth surface, and the points that it goes through: all but outliers."""
    variance = sigma**2 if sigma[inner].all() else np.ones(len(sigma))
    columns = np.column_stack((unit, distance, moves))
    stated = bool(part.noise.all())
    shared = _shared(part, distance, sigma, inner) if stated else None

    def fit(kept: NDArray[np.intp]) -> Smooth:
        means, left = _blocks(columns[kept], variance[kept])
        pixel = part.pixel[kept] if part.pixel is not None and len(means) == len(kept) else None
        return smooth(
            means[:, :2],
            means[:, 2],
            left,
            stated=stated,
            moves=means[:, 3:],
            shared=shared,
            pixel=pixel,
        )

    def left_by(one: Smooth) -> FloatMap:
        return np.asarray((distance[inner] - one.at(unit[inner])) / np.sqrt(variance[inner]))

    found = fit(inner)
    wrong, together = outliers(unit[inner], left_by(found), lambda kept: left_by(fit(inner[kept])))
    if 0 < wrong.mean() <= DISCARDED:
        inner = inner[~wrong]
        found = fit(inner)
    return (replace(found, resolved=False) if together else found), inner


def _shared(
    part: AreaPoints, distance: FloatMap, sigma: FloatMap, inner: NDArray[np.intp]
) -> Neighbours | None:
    """The noise that neighbouring pixels share, where it can be told from form."""
    if part.pixel is None:
        return None
    return neighbours(part.pixel[inner], distance[inner], sigma[inner])


def _blocks(columns: FloatMap, variance: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Weighted means of many points in blocks of the unit square, whose places are the first two
    columns, and the variances of the means."""
    if len(columns) <= MOST_POINTS:
        return columns, variance
    row, column = np.minimum((columns[:, :2] * BLOCKS).astype(int), BLOCKS - 1).T
    block = np.unique(row * BLOCKS + column, return_inverse=True)[1].ravel()
    weight = 1.0 / variance
    total = np.bincount(block, weight)
    means = [np.bincount(block, weight * one) / total for one in columns.T]
    return np.stack(means, axis=-1), 1.0 / total


def _on_lines(
    chart: Chart, lines: Lines, places: FloatMap, low: FloatMap, span: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Places of the lines in the unit square, and the number of each one's line."""
    grid = np.linspace(0.0, 1.0, LINES), np.linspace(0.0, 1.0, LINE_POINTS)
    across, along = (v.ravel() for v in np.meshgrid(*grid, indexing="ij"))
    number = np.repeat(np.arange(float(LINES)), LINE_POINTS)
    if lines.run == "around":
        assert lines.centre is not None
        centre = chart.places(lines.centre[None])[0]
        far = np.linalg.norm(places - centre, axis=1)
        radius = far.min() + across * (far.max() - far.min())
        turn = 2.0 * np.pi * along
        circles = centre + radius[:, None] * np.stack((np.cos(turn), np.sin(turn)), axis=-1)
        at = (circles - low) / span
    else:
        both = (across, along) if lines.run == "across" else (along, across)
        at = np.stack(both, axis=-1)
    area = _occupied(places, low, span)
    near = NEAR * np.sqrt(area / len(places))
    seen = scipy.spatial.cKDTree(places).query(low + span * at)[0] <= near
    counts = np.bincount(number[seen].astype(int), minlength=LINES)
    seen &= counts[number.astype(int)] >= LEAST_LINE_POINTS
    if not seen.any():
        raise InputError(
            f"zone: expected lines of {LEAST_LINE_POINTS} points or more in the area, got none"
        )
    return at[seen], number[seen]


def _occupied(places: FloatMap, low: FloatMap, span: FloatMap) -> float:
    """Area that the points cover, mm²: that of the bins that hold any."""
    row, column = np.minimum((places - low) / span * BINS, BINS - 1).astype(int).T
    return len(np.unique(row * BINS + column)) / BINS**2 * float(span[0] * span[1])


def _parts(
    part: AreaPoints,
    unit: FloatMap,
    normals: FloatMap,
    kept: NDArray[np.intp],
    at: FloatMap,
    pixel: NDArray[np.intp],
) -> tuple[FloatMap, Shares, FloatMap]:
    """Common errors of points, of the blur, of the scale and of the calibration, with the source of
    each, and those of the area's patches."""
    along = np.einsum("nc,nc->n", part.by_value, normals)
    size = np.einsum("nc,nc->n", part.points - part.still, normals)[pixel, None]
    scales = [size * one.sigma for one in part.scales]
    blur = np.column_stack(((along * part.blur)[pixel, None], *scales))
    sources = (Share("blur", 1.0), *part.scales)
    if part.by_rig is None:
        patches = np.eye(PATCHES**2)[part.patch[pixel]]
        return blur, sources, (along * part.common)[pixel, None] * patches
    some = kept[:: -(-len(kept) // (BINS * BINS))]
    errors = np.einsum("nc,nck->nk", normals[some], part.by_rig[part.cell[some]])
    smooth_errors = _powers(at) @ np.linalg.lstsq(_powers(unit[some]), errors, rcond=None)[0]
    sources = (*sources, *errors.shape[1] * (Share("calibration", 1.0),))
    return np.column_stack((blur, smooth_errors)), sources, np.zeros((len(pixel), 0))


def _powers(unit: FloatMap) -> FloatMap:
    x, y = 2.0 * unit.T - 1.0
    return np.stack([x**i * y**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], -1)


def chart_of(body: Body, middle: FloatMap, lines: Lines | None, *, exact: bool = True) -> Chart:
    """Return the chart of a body, its first direction along the lines or the axis."""
    if body.kind == "plane":
        middle = body.direction
    first = body.direction if body.kind == "cylinder" else None
    if lines is not None and lines.direction is not None and first is None:
        first = lines.direction
    if first is None:
        first = np.eye(3)[int(np.argmin(np.abs(middle)))]
    if body.kind == "cylinder":
        middle = middle - (middle @ first) * first
    else:
        first = first - (first @ middle) * middle / (middle @ middle)
    size = float(np.linalg.norm(first))
    if not size > PARALLEL_SINE:
        raise InputError("zone: expected a direction of lines in the surface, got its normal")
    return Chart(body, first / size, middle / np.linalg.norm(middle), exact)


def body_of(part: AreaPoints, kind: Kind) -> Body:
    """Return the body of least squares of an area; a plane's normal points to the camera.

    All points count: a dent is a deviation of the feature, and no other surface.
    """
    return part.once(f"body {kind}", lambda one: _body_of(one, kind))


def _body_of(part: AreaPoints, kind: Kind) -> Body:
    points = part.points[part.inner]
    if kind == "plane":
        middle = points.mean(axis=0)
        _, size, turn = np.linalg.svd(points - middle, full_matrices=False)
        if not size[1] > FLAT * size[0]:
            raise InputError("zone: expected points of a surface, got points on a line")
        return Body(kind, middle, turn[2] if turn[2] @ part.up > 0 else -turn[2])
    some = points[:: -(-len(points) // MOST_POINTS)]
    found = fit_form(some, "sphere" if kind == "sphere" else "cylinder").parameters
    radius = float(np.asarray(found["radius_mm"]))
    if kind == "sphere":
        start = Body(kind, np.asarray(found["centre_mm"]), np.array([0.0, 0.0, 1.0]), radius)
    else:
        start = Body(kind, np.asarray(found["point_mm"]), np.asarray(found["axis"]), radius)
    body = associate(start, some, everything(), "least-squares")
    middle = body.point
    if kind == "cylinder":
        middle = middle + body.along(part.middle[None])[0] * body.direction
    return replace(body, point=middle, hollow=bool((part.middle - middle) @ part.up < 0))
