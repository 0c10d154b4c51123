"""Fringe orders from a rig and a range of depths, for coordinates that repeat (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.rig.ray_depth import axis_length, inverse_depth, projector_by_parameters
from fringeworks.types import (
    Axis,
    BoolMap,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    InputError,
    Pixels,
    Reason,
    Rig,
    RigMismatch,
    found_before,
    region_of,
    sealed,
)

ROOM_SIGMAS = 5.0
"""Standard deviations by which both ends of an interval of coordinates are widened: of the decoded
coordinate and of the rig's calibration. Normal errors exceed five in one of two million pixels."""
NODES = (33, 41)
"""Rows and columns of nodes over the camera's frame between which the ends of the intervals are
interpolated by cubic splines, to better than 0.01 px for the lenses of the standard rig."""
MOST_OUTSIDE = 0.5
"""Share of the measured pixels outside the range from which on the range is probably wrong: a range
is meant to hold the part, and the background beside it takes less than half of most frames."""
PLACES_QUANTILE = 1e-3
"""Quantile of the depths outside the range from which, to its complement, they are told: a wrong
fringe order here and there does not widen them."""
PLACES = 10_000
"""Pixels outside the range whose depth is computed, at most: quantiles of more are no sharper."""
UNITS_MM = {"cm": 10.0, "inches": 25.4, "m": 1000.0}
"""Units in which a range is given by mistake, in mm."""
MOST_AMBIGUOUS = 0.5
"""Share of the frame that sees the projector's light in which a period must exceed the interval, at
least. A range that leaves less is refused: it is a mistake, and its error says how long it may be.
"""
RUNS_ON_SHARE = 0.25
"""Largest change of a repeating coordinate between neighbours of one surface, in periods: half of
the change at which a period more or less is as near."""
MOST_RUNNING_ON = 4
"""Largest number of pairs of neighbours that continue past an end of the range by chance. In 20
captures of ten simulated scenes, none do with a range that holds the scene; with ranges 40 and
90 mm off, 76 of 80 captures have 9 to 12 000."""
LIMIT_STEPS = 40
"""Halvings of the interval in which the longest range is searched: to 1e-9 of its length."""
FARTHEST = 100.0
"""The longest range is searched up to this multiple of the near depth. Beyond it, coordinates
hardly change."""


@dataclass(frozen=True)
class Interval:
    """Coordinates along one axis that a range of depths allows, per pixel or per node."""

    middle: FloatMap
    """Middle of the interval, px."""
    half: FloatMap
    """Half its length, px; negative where the projector lights no point of the range."""
    variance: FloatMap
    """Variance of the coordinate of a known point by the rig's calibration, px²."""

    @property
    def reach(self) -> FloatMap:
        """Half the length of the interval with room for the calibration alone, px."""
        return self.half + ROOM_SIGMAS * np.sqrt(self.variance)


def node_pixels(rig: Rig) -> FloatMap:
    """Camera pixels of the nodes, (n, 2)."""
    h, w = rig.camera.shape
    v, u = np.meshgrid(
        np.linspace(0, h - 1, NODES[0]), np.linspace(0, w - 1, NODES[1]), indexing="ij"
    )
    return np.stack((u.ravel(), v.ravel()), axis=-1)


def coordinates_at(rig: Rig, pixels: FloatMap, z_mm: float, axis: Axis) -> FloatMap:
    """Projector coordinates of the points at a depth on the rays of pixels, (n,), px."""
    points = transform(rig.T_projector_camera, rays(rig.camera, pixels) * z_mm)
    if (points[:, 2] <= 0.0).any():
        raise InputError(
            f"depth range: expected depths in front of the projector, got {z_mm:g} mm, which is "
            "behind it in a part of the frame"
        )
    return np.asarray(project(rig.projector, points)[:, 0 if axis == "x" else 1])


def variance_at(rig: Rig, pixels: FloatMap, axis: Axis, depth_mm: tuple[float, float]) -> FloatMap:
    """Variance of the coordinates of known points by the calibration, (n,), px²; the larger one of
    both depths."""
    residual = 0.0 if rig.residual_px is None else float(np.hypot(*rig.residual_px))
    variance = np.full(len(pixels), residual**2)
    if rig.covariance is None:
        return variance
    k = 0 if axis == "x" else 1
    by = [
        projector_by_parameters(rig, pixels, np.full(len(pixels), 1.0 / z))[1][:, k]
        for z in depth_mm
    ]
    covariance = rig.covariance
    each = [np.einsum("nj,nj->n", np.einsum("ni,ij->nj", b, covariance), b) for b in by]
    return np.asarray(variance + np.maximum(np.maximum(*each), 0.0))


def interval_at(rig: Rig, pixels: FloatMap, axis: Axis, depth_mm: tuple[float, float]) -> Interval:
    """The interval of coordinates at pixels (n, 2)."""
    low, high = (coordinates_at(rig, pixels, z, axis) for z in depth_mm)
    return clipped(low, high, variance_at(rig, pixels, axis, depth_mm), axis_length(rig, axis))


def clipped(low: FloatMap, high: FloatMap, variance: FloatMap, length: int) -> Interval:
    """The interval between two ends in any order, within the projector's frame."""
    first = np.maximum(np.minimum(low, high), -0.5)
    last = np.minimum(np.maximum(low, high), length - 0.5)
    return Interval(0.5 * (first + last), 0.5 * (last - first), variance)


class DepthRange:
    """A range of depths in front of a rig, which resolves the fringe orders of repeating plans.

    Parameters
    ----------
    rig : Rig
    depth_mm : (near, far)
        Smallest and largest z of what the projector lights, in camera coordinates, mm.

    Raises
    ------
    InputError
        If the range is not positive and rising, or reaches behind the projector.

    Notes
    -----
    The points of the range on a pixel's ray have projector coordinates in an interval. A coordinate
    x that repeats with the period P is x + k P, and exactly one k must lead into the interval,
    which is widened by 5 σ of the coordinate and of the calibration. Without such a k the pixel is
    NaN (``OUTSIDE_DEPTH``), with several of them as well (``ORDER_AMBIGUOUS``).

    A surface outside the range that is off by a whole period from a point within it cannot be told
    from that point. The finding of ``resolve`` says from which depths on this happens, and those of
    ``measure`` what the scene says about it (``range_evidence``).

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> depth = DepthRange(standard_rig(scale=0.25), (480.0, 520.0))
    >>> round(depth.period_px("x"))  # shortest period with room for the range
    42
    """

    def __init__(self, rig: Rig, depth_mm: Sequence[float]) -> None:
        near, far = _checked(depth_mm)
        self._rig, self._depth = rig, (near, far)
        self._nodes = node_pixels(rig)
        self._at_nodes: dict[Axis, Interval] = {}
        self._at_pixels: dict[Axis, Interval] = {}
        self._words: dict[tuple[Axis, float], Finding] = {}

    @property
    def rig(self) -> Rig:
        """The rig whose coordinates are resolved."""
        return self._rig

    @property
    def depth_mm(self) -> tuple[float, float]:
        """Smallest and largest depth, mm."""
        return self._depth

    def period_px(self, axis: Axis) -> float:
        """Shortest period with room for the range where the projector lights, projector px.

        The room for the noise of the coordinates comes on top.
        """
        found = self._interval(axis)
        return 2.0 * float(np.max(found.reach[found.half > 0.0], initial=0.0))

    def resolve(self, decoded: Decoded) -> Decoded:
        """Make coordinates that repeat absolute, and remove those outside the range.

        Parameters
        ----------
        decoded : Decoded
            From the rig's camera and projector. Absolute coordinates are compared with the range
            only.

        Returns
        -------
        Decoded, with absolute coordinates and a finding for each axis.

        Raises
        ------
        RigMismatch for maps of another size than the rig's camera. InputError where coordinates
        repeat and the range is longer than a period in most of the frame, or the projector lights
        nothing of it.
        """
        maps, findings = {}, list(decoded.findings)
        for axis, found in decoded.maps.items():
            if found.coordinate_px.shape != self._rig.camera.shape:
                h, w = found.coordinate_px.shape
                camera = self._rig.camera
                raise RigMismatch(
                    f"rig: it is for a camera of {camera.width_px} × {camera.height_px} px, got "
                    f"frames of {w} × {h}"
                )
            if found.repeats_px is not None:
                with found_before(decoded.findings):
                    self.check_lit(axis)
                    self._refuse_long(axis, found.repeats_px)
            maps[axis] = self._resolved(found)
            findings.append(self._finding(maps[axis], found))
        return replace(decoded, x=maps.get("x"), y=maps.get("y"), findings=tuple(findings))

    def orders(self, found: CoordinateMap, period_px: float) -> tuple[FloatMap, FloatMap]:
        """Fewest and most periods that lead absolute coordinates into the range, each (h, w).

        Parameters
        ----------
        found : CoordinateMap
        period_px : float
            Period of the fringes, projector px.

        Returns
        -------
        Whole numbers; the first is larger than the second where no order does, and NaN is where
        the coordinate is.

        Raises
        ------
        InputError where the projector lights nothing of the range.
        """
        self.check_lit(found.axis)
        allowed = self._pixels(found.axis)
        reach = allowed.half + ROOM_SIGMAS * np.sqrt(found.sigma_px**2 + allowed.variance)
        off = allowed.middle - found.coordinate_px
        return np.ceil((off - reach) / period_px), np.floor((off + reach) / period_px)

    def _resolved(self, found: CoordinateMap) -> CoordinateMap:
        """The map with absolute coordinates of the range alone."""
        allowed = self._pixels(found.axis)
        period = found.repeats_px or np.inf
        x, sigma, reason = found.coordinate_px, found.sigma_px, found.reason.copy()
        with np.errstate(invalid="ignore"):
            x = (x + period * np.rint((allowed.middle - x) / period)) if found.repeats_px else x
            off = np.abs(x - allowed.middle)
            reach = allowed.half + ROOM_SIGMAS * np.sqrt(sigma**2 + allowed.variance)
            measured = reason == Reason.OK
            outside = measured & ~(off <= reach)
            ambiguous = measured & ~outside & (period - off <= reach)
        reason[outside] = Reason.OUTSIDE_DEPTH
        reason[ambiguous] = Reason.ORDER_AMBIGUOUS
        lost = reason != Reason.OK
        return replace(
            found,
            coordinate_px=sealed(np.where(lost, np.nan, x).astype(np.float32)),
            sigma_px=sealed(np.where(lost, np.nan, sigma).astype(np.float32)),
            reason=sealed(reason),
            repeats_px=None,
        )

    def _running_on(self, found: CoordinateMap, before: CoordinateMap) -> int:
        """Pairs of neighbours whose repeating coordinate continues, but not within the range: the
        second one lies outside, or a period away."""
        period = before.repeats_px
        assert period is not None
        x, here = before.coordinate_px, found.coordinate_px
        count = 0
        for ahead, behind in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
            step = x[ahead] - x[behind]
            with np.errstate(invalid="ignore"):
                same = np.abs(step - period * np.rint(step / period)) < RUNS_ON_SHARE * period
                jumps = np.abs(here[ahead] - here[behind]) > 0.5 * period
            a, b = found.reason[ahead], found.reason[behind]
            leaves = (a == Reason.OK) & (b == Reason.OUTSIDE_DEPTH)
            enters = (b == Reason.OK) & (a == Reason.OUTSIDE_DEPTH)
            count += int(np.count_nonzero(same & (leaves | enters | jumps)))
        return count

    def _interval(self, axis: Axis) -> Interval:
        """The interval at the nodes."""
        if axis not in self._at_nodes:
            self._at_nodes[axis] = interval_at(self._rig, self._nodes, axis, self._depth)
        return self._at_nodes[axis]

    def _pixels(self, axis: Axis) -> Interval:
        """The interval at every pixel, (h, w)."""
        if axis not in self._at_pixels:
            ends = [coordinates_at(self._rig, self._nodes, z, axis) for z in self._depth]
            variance = variance_at(self._rig, self._nodes, axis, self._depth)
            low, high, spread = (self._spline(v) for v in (*ends, variance))
            length = axis_length(self._rig, axis)
            self._at_pixels[axis] = clipped(low, high, np.maximum(spread, 0.0), length)
        return self._at_pixels[axis]

    def _spline(self, values: FloatMap) -> NDArray[np.float32]:
        """Values at the nodes, interpolated to every pixel."""
        h, w = self._rig.camera.shape
        v, u = np.linspace(0, h - 1, NODES[0]), np.linspace(0, w - 1, NODES[1])
        spline = scipy.interpolate.RectBivariateSpline(v, u, values.reshape(NODES))
        return np.asarray(spline(np.arange(h), np.arange(w)), np.float32)

    def _refuse_long(self, axis: Axis, period: float) -> None:
        """Refuse a range that a period cannot hold in most of the frame."""
        found = self._interval(axis)
        if np.mean(2.0 * found.reach[found.half > 0.0] < period) >= MOST_AMBIGUOUS:
            return
        near, far = self._depth
        longest = self.longest_mm(axis, period)
        raise InputError(
            f"depth range: {near:g} to {far:g} mm spans {self.period_px(axis):.0f} px along "
            f"{axis}, but coordinates repeat every {period:g} px: expected up to {longest:.0f} mm, "
            "or a plan with a longer period"
        )

    def check_lit(self, axis: Axis) -> None:
        """Refuse a range of which the projector lights nothing that the camera sees.

        Raises
        ------
        InputError that names the depths it lights, and the unit in which the range holds some.
        """
        if (self._interval(axis).half > 0.0).any():
            return
        (near, far), (first, last) = self._depth, self._lit_mm(axis)
        meant = _meant(near, far, first, last)
        unit = f"; likely {', or '.join(meant)}" if meant else ""
        to = f"to {last:.0f} mm" if np.isfinite(last) else "mm and more"
        lit = f"{first:.0f} {to}" if first < last else "none"
        raise InputError(
            f"depth range: expected points that the projector lights along {axis}, got none from "
            f"{near:g} to {far:g} mm; the camera sees {lit} lit{unit}"
        )

    def _lit_mm(self, axis: Axis) -> tuple[float, float]:
        """Smallest and largest depth that the projector lights in the camera's view, mm; infinity
        for no limit, and (infinity, 0) for no depth."""
        ends = [
            inverse_depth(self._rig, self._nodes, np.full(len(self._nodes), goal), axis)
            for goal in (-0.5, axis_length(self._rig, axis) - 0.5)
        ]
        # A ray that the lens model loses on its way to one end is left out.
        w = np.maximum(np.stack(ends)[:, np.isfinite(ends).all(axis=0)], 0.0)
        w = w[:, w.max(axis=0) > 0.0]
        nearest, farthest = float(w.max(initial=0.0)), float(w.min(initial=np.inf))
        return (1.0 / nearest if nearest else np.inf), (1.0 / farthest if farthest else np.inf)

    def longest_mm(self, axis: Axis, period_px: float) -> float:
        """Largest far depth for the same near one at which a period has room for the range.

        Parameters
        ----------
        axis : "x" or "y"
        period_px : float
            Distance after which coordinates repeat, projector px.

        Returns
        -------
        float, mm; infinity where any depth has room.
        """
        near = self._depth[0]

        def fits(far: float) -> bool:
            found = interval_at(self._rig, self._nodes, axis, (near, far))
            return bool(np.all(2.0 * found.reach[found.half > 0.0] < period_px))

        low, high = near, FARTHEST * near
        if fits(high):
            return float("inf")
        for _ in range(LIMIT_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if fits(middle) else (low, middle)
        return low

    def clear_mm(self, axis: Axis, period_px: float) -> tuple[float, float]:
        """Depths between which every surface outside the range is recognised as such.

        Parameters
        ----------
        axis : "x" or "y"
        period_px : float
            Distance after which coordinates repeat, projector px.

        Returns
        -------
        (nearest, farthest), mm; 0 and infinity where there is no limit. A surface that is nearer or
        farther may have the coordinates of points within the range, a period away.
        """
        found, length = self._interval(axis), axis_length(self._rig, axis)
        lit = found.half > 0.0
        near, far = 1.0 / self._depth[0], 1.0 / self._depth[1]
        nearest, farthest = np.inf, 0.0
        for sign in (-1.0, 1.0):
            goal = (found.middle + sign * (period_px - found.reach))[lit]
            pixels = self._nodes[lit]
            seen = (goal > -0.5) & (goal < length - 0.5)
            w = inverse_depth(self._rig, pixels[seen], goal[seen], axis)
            nearest = min(nearest, float(np.min(w[w > near], initial=np.inf)))
            farthest = max(farthest, float(np.max(w[w < far], initial=0.0)))
        return 1.0 / nearest, float("inf") if farthest <= 0.0 else 1.0 / farthest

    def _finding(self, found: CoordinateMap, before: CoordinateMap) -> Finding:
        """What the range did to a map."""
        out = found.reason == Reason.OUTSIDE_DEPTH
        count, kept = int(np.count_nonzero(out)), int(np.count_nonzero(found.reason == Reason.OK))
        at = Pixels(count, count + kept, region_of(out))
        near, far = self._depth
        axis, period = found.axis, before.repeats_px
        share = f"{at.share:.1%} of the pixels measured along {axis} lie outside"
        if period is None:
            seen = f"{share} {near:g} to {far:g} mm of depth"
            figures = {"outside": at.share, "near_mm": near, "far_mm": far}
            words = Finding("depth range", seen, axis=axis, figures=figures, severity="note")
            if count and at.share > MOST_OUTSIDE:
                words = self._wrong(words, at, before, out)
        else:
            if (axis, period) not in self._words:
                self._words[axis, period] = self._of_period(axis, period)
            words = self._words[axis, period]
            running = self._running_on(found, before)
            figures = {**words.figures, "outside": at.share, "running_on": float(running)}
            words = replace(words, seen=f"{words.seen}; {share}", figures=figures)
            if running > MOST_RUNNING_ON:
                words = replace(
                    words,
                    seen=f"{words.seen}; surfaces run on past an end of the range at {running} "
                    "pairs of neighbouring pixels, so that they lie outside it, in part or in all, "
                    "and may come out a period off",
                    causes=("a range of another set-up or unit", "a range that cuts a surface"),
                    advice="give a range that holds all that is lit",
                    severity="warning",
                )
        return replace(words, pixels=at, severity=words.severity if kept or not count else "error")

    def _wrong(self, words: Finding, at: Pixels, before: CoordinateMap, out: BoolMap) -> Finding:
        """The finding for a range that holds hardly a pixel: where the pixels lie instead."""
        axis, (near, far) = before.axis, self._depth
        v, u = (places[:: at.count // PLACES + 1] for places in np.nonzero(out))
        pixels = np.stack((u, v), axis=-1).astype(np.float64)
        goal = before.coordinate_px[v, u].astype(np.float64)
        with np.errstate(divide="ignore"):
            there = 1.0 / inverse_depth(self._rig, pixels, goal, axis)
        there = there[np.isfinite(there) & (there > 0.0)]
        if not there.size:
            return replace(words, severity="warning")
        ends = np.quantile(there, (PLACES_QUANTILE, 1.0 - PLACES_QUANTILE))
        first, last = (float(z) for z in ends)
        which = f"all {at.of}" if at.count == at.of else f"{at.count} of {at.of}"
        seen = (
            f"{which} pixels measured along {axis} lie outside the depth range of {near:g} to "
            f"{far:g} mm: they are at {first:.0f} to {last:.0f} mm"
        )
        return replace(
            words,
            seen=seen,
            causes=(*_meant(near, far, first, last), "the range is of another set-up"),
            advice="give a range in mm that holds what is to be measured",
            figures={**words.figures, "nearest_mm": first, "farthest_mm": last},
            severity="warning",
        )

    def _of_period(self, axis: Axis, period: float) -> Finding:
        """What a period and the range mean for a capture."""
        near, far = self._depth
        nearest, farthest = self.clear_mm(axis, period)
        step = np.diff(
            [coordinates_at(self._rig, self._nodes, z, axis) for z in (near, far)], axis=0
        )[0]
        lit = self._interval(axis).half > 0.0
        span = period * (far - near) / float(np.median(np.abs(step[lit])))
        seen = (
            f"fringe orders along {axis} come from the depth range of {near:g} to {far:g} mm; a "
            f"period of {period:.4g} px spans {span:.0f} mm of depth"
        )
        advice = (
            f"light no surface nearer than {nearest:.0f} mm or farther than {farthest:.0f} mm: it "
            "can come out a period off"
        )
        figures = {
            "near_mm": near,
            "far_mm": far,
            "period_px": period,
            "period_mm": span,
            "nearest_mm": nearest,
            "farthest_mm": farthest,
        }
        return Finding("depth range", seen, (), advice, axis, (), figures, "note")


def _meant(near: float, far: float, first: float, last: float) -> tuple[str, ...]:
    """Units in which a range was given by mistake, where the depths lie between two, mm."""
    meant = [n for n, mm in UNITS_MM.items() if near * mm < last and far * mm > first]
    return tuple(f"the range was given in {name}" for name in meant)


def depth_range_of(depth_mm: DepthRange | Sequence[float] | None, rig: Rig) -> DepthRange | None:
    """A range of depths for a rig from what a caller gave; None for none.

    Raises
    ------
    InputError for a range that is not valid, or was made for another rig.
    """
    if depth_mm is None:
        return None
    if not isinstance(depth_mm, DepthRange):
        return DepthRange(rig, depth_mm)
    if depth_mm.rig != rig:
        raise InputError("depth range: expected one for the same rig, got one for another rig")
    return depth_mm


def _checked(depth_mm: Sequence[float]) -> tuple[float, float]:
    try:
        values = tuple(float(z) for z in depth_mm)
    except (TypeError, ValueError):
        raise InputError(
            f"depth range: expected two depths in mm, as (450, 560), got {depth_mm!r}"
        ) from None
    if len(values) != 2 or not np.isfinite(values).all() or not 0.0 < values[0] < values[1]:
        got = ", ".join(f"{z:g}" for z in values)
        raise InputError(f"depth range: expected two depths in mm, 0 < near < far, got {got}")
    return values[0], values[1]
