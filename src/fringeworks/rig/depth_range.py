"""Fringe orders from a rig and a range of depths, for coordinates that repeat (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.depth_interval import (
    NODES,
    ROOM_SIGMAS,
    Interval,
    clipped,
    coordinates_at,
    interval_at,
    node_pixels,
    variance_at,
)
from fringeworks.rig.ray_depth import axis_length, inverse_depth
from fringeworks.types import (
    Axis,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    InputError,
    Reason,
    Rig,
    RigMismatch,
    sealed,
)

MOST_AMBIGUOUS = 0.5
"""Share of the frame that sees the projector's light in which a period must exceed the interval, at
least. A range that leaves less is refused: it is a mistake, and its error says how long it may be.
"""
LIMIT_STEPS = 40
"""Halvings of the interval in which the longest range is searched: to 1e-9 of its length."""
FARTHEST = 100.0
"""The longest range is searched up to this multiple of the near depth. Beyond it, coordinates
hardly change."""


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
    from that point. The finding of ``resolve`` says from which depths on this happens.

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
        RigMismatch for maps of another size than the rig's camera. InputError for a range that is
        longer than a period in most of the frame.
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
                self._refuse_long(axis, found.repeats_px)
            maps[axis] = self._resolved(found)
            findings.append(self._finding(maps[axis], found.repeats_px))
        return replace(decoded, x=maps.get("x"), y=maps.get("y"), findings=tuple(findings))

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
        lit = found.half > 0.0
        if np.mean(2.0 * found.reach[lit] < period) >= MOST_AMBIGUOUS or not lit.any():
            return
        near, far = self._depth
        longest = self.longest_mm(axis, period)
        raise InputError(
            f"depth range: {near:g} to {far:g} mm spans {self.period_px(axis):.0f} px along "
            f"{axis}, but coordinates repeat every {period:g} px: expected up to {longest:.0f} mm, "
            "or a plan with a longer period"
        )

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

    def _finding(self, found: CoordinateMap, period: float | None) -> Finding:
        """What the range did to a map."""
        counts = np.bincount(found.reason.ravel(), minlength=len(Reason))
        outside = counts[Reason.OUTSIDE_DEPTH] / max(
            1, counts[Reason.OUTSIDE_DEPTH] + counts[Reason.OK]
        )
        near, far = self._depth
        share = f"{outside:.1%} of the pixels measured along {found.axis} lie outside"
        figures = {"outside": float(outside), "near_mm": near, "far_mm": far}
        if period is None:
            return Finding(
                "depth range",
                f"{share} {near:g} to {far:g} mm of depth",
                (),
                "",
                found.axis,
                (),
                figures,
            )
        key = found.axis, period
        if key not in self._words:
            self._words[key] = self._of_period(*key)
        words = self._words[key]
        return replace(
            words, seen=f"{words.seen}; {share}", figures={**words.figures, "outside": outside}
        )

    def _of_period(self, axis: Axis, period: float) -> Finding:
        """What a period and the range mean for a capture."""
        near, far = self._depth
        nearest, farthest = self.clear_mm(axis, period)
        step = np.diff(
            [coordinates_at(self._rig, self._nodes, z, axis) for z in (near, far)], axis=0
        )[0]
        lit = self._interval(axis).half > 0.0
        span = period * (far - near) / float(np.median(np.abs(step[lit]))) if lit.any() else np.nan
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
        return Finding("depth range", seen, (), advice, axis, (), figures)


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
    values = tuple(float(z) for z in depth_mm)
    if len(values) != 2 or not np.isfinite(values).all() or not 0.0 < values[0] < values[1]:
        got = ", ".join(f"{z:g}" for z in values)
        raise InputError(f"depth range: expected two depths in mm, 0 < near < far, got {got}")
    return values[0], values[1]
