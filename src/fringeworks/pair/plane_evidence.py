"""What the fringes of the reference frame tell of a stated plane (theory §8, "Stated plane").

A rig and a plane predict the projector coordinate q at every pixel. The phase ψ of the reference is
q · 2π/P + c, with the period P of the pattern in the projector and its start c. Where both are
unknown, they hide one tilt and the offset of the plane; what a caller states of its accuracy then
remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import (
    LEAST_MISFIT,
    NODES_PER_PERIOD,
    REJECTED_MADS,
    WIDTH_PERIODS,
    PhaseNodes,
    phase_nodes,
)
from fringeworks.rig.stated_plane import MODES, StatedPlane
from fringeworks.types import BoolMap, FloatMap, Frozen
from fringeworks.types.computed import cached_property

SHARED_NODES = 4.0 * np.pi * (NODES_PER_PERIOD * WIDTH_PERIODS) ** 2
"""Nodes that have one error in common: averages over a Gaussian of width σ have errors with the
correlation exp(−r²/4σ²), which adds up to 4πσ² over the squares of the grid."""
DRAWINGS = 2
"""Times that fringes are drawn for comparison: on the stated plane, then on the surface that this
has shown."""
STEPS = 3
"""Gauss–Newton steps: a displacement of 1 % of the distance leaves 1e-4 of itself after the first,
and 1e-8 after the second."""
PLANE_SIGMA_MM = 1.0
"""Standard deviation of a plane that is stated without one, mm: that of a distance by a ruler, and
of a board that was set up by eye (1 mm at its edges)."""
LEAST_MM = 0.02
"""Least standard deviation of a stated plane, mm: the flatness of good glass plates."""
LARGEST_SHARE = 0.1
"""Largest standard deviation that is tried, as a share of the plane's distance: a plane that is off
by more was stated in another unit or for another rig."""
CLEAR = 4.5
"""Logarithm of a likelihood ratio from which on it decides: that of three standard deviations."""


ORDER_SIGMAS = 3.0
"""Standard deviations of the stated plane within which a known start of the pattern must leave one
order of the fringes."""
TINY_PERIODS = 1e-6
"""Least scatter of the nodes, periods: frames without noise keep finite weights."""


@dataclass(frozen=True, eq=False, repr=False)
class PlaneEvidence(Frozen):
    """The surface that stated plane and fringes support together."""

    modes_mm: FloatMap
    """Displacement of the stated plane, (MODES,), mm; see ``StatedPlane``."""
    covariance: FloatMap
    """Covariance of that, (MODES, MODES), mm²."""
    sigma_mm: float
    """Standard deviation of the stated plane that the fringes allow for, mm: that of the caller, or
    a larger one where the fringes contradict it."""
    contradicted: bool = False
    """Whether the fringes contradict the plane and its stated standard deviation."""
    moved: bool = False
    """Whether the fringes show that the plane is not exactly where it was stated."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """Linear least squares: what is seen, and columns of modes, rig errors and free terms."""

    seen: FloatMap
    modes: FloatMap
    rig: FloatMap
    free: FloatMap

    def solved(self, sigma_mm: float, weight: float) -> tuple[FloatMap, FloatMap, float]:
        """Solution, its covariance, and the logarithm of the marginal likelihood, for a standard
        deviation of the modes and a weight of each node. Rig errors have a variance of 1."""
        design = np.concatenate((self.modes, self.rig, self.free), axis=1)
        prior = np.zeros(design.shape[1])
        prior[:MODES] = sigma_mm**-2
        prior[MODES : MODES + self.rig.shape[1]] = 1.0
        scale = np.sqrt(weight * np.sum(design**2, axis=0) + prior)
        scaled = design / scale
        precision = weight * scaled.T @ scaled + np.diag(prior / scale**2)
        found = np.linalg.solve(precision, weight * scaled.T @ self.seen) / scale
        left = self.seen - design @ found
        misfit = weight * float(left @ left) + float(prior @ found**2)
        volume = np.linalg.slogdet(precision)[1] + 2.0 * np.sum(np.log(scale))
        likelihood = -MODES * np.log(sigma_mm) - 0.5 * (misfit + volume)
        return found, np.linalg.inv(precision) / np.outer(scale, scale), float(likelihood)


def plane_evidence(
    prepared: PreparedPair,
    stated: StatedPlane,
    sigma_mm: float,
    *,
    period_px: float | None = None,
    bright_px: float | None = None,
) -> PlaneEvidence:
    """Compare the fringes of the reference frame with those that a stated plane would show.

    Parameters
    ----------
    prepared : PreparedPair
    stated : StatedPlane
    sigma_mm : float ≥ 0
        Standard deviation of every mode of the stated plane, mm.
    period_px : float > 0, optional
        Period of the fringes in the projector, px, where it is known.
    bright_px : float, optional
        Coordinate of a bright fringe in the projector, px, where it is known.

    Notes
    -----
    Least squares over ψ/2π = (q(modes) + E n) / P + c at nodes, with n the errors of the rig's
    parameters. The standard deviation
    of the modes is the stated one. Where the marginal likelihood speaks for a larger one by
    ``CLEAR``, the statement is wrong, and the most likely one from ``PLANE_SIGMA_MM`` on is
    taken.
    """
    found = PlaneEvidence(np.zeros(MODES), sigma_mm**2 * np.eye(MODES), sigma_mm)
    if prepared.plane_sigma_px is not None:  # the reference of a single frame is computed
        return found
    for _ in range(DRAWINGS):
        seen = _seen(prepared, stated, found.modes_mm)
        if seen is None:
            return found
        misfit = max(float(np.sqrt(np.mean(seen.unexplained() ** 2))), LEAST_MISFIT)
        seen = seen.with_pattern(period_px, bright_px, sigma_mm)
        found = _decided(seen, max(sigma_mm, LEAST_MM), 1.0 / (SHARED_NODES * misfit**2))
    return found


@dataclass(frozen=True, eq=False)
class _Seen:
    """Nodes of the reference, and what the stated plane predicts there."""

    stated: StatedPlane
    pixels: FloatMap
    """(n, 2), px of the capture."""
    phase: FloatMap
    """Phase that was measured, (n,), periods."""
    per_px: float | None = None
    """Periods per projector px, with the sign of the phase; None where unknown."""
    start: float | None = None
    """Phase at the projector's coordinate 0, periods; None where unknown."""

    def where(self, keep: BoolMap) -> _Seen:
        """A part of the nodes."""
        return replace(self, pixels=self.pixels[keep], phase=self.phase[keep])

    @cached_property
    def at_stated(self) -> FloatMap:
        """Projector coordinates of the plane as it was stated, (n,), px."""
        return self.stated.along_axis(self.pixels)

    @cached_property
    def rig(self) -> FloatMap:
        """Columns of the rig's errors, (n, k)."""
        return self.stated.rig_errors(self.pixels)

    def by_modes(self, modes_mm: FloatMap) -> FloatMap:
        """Derivative of the coordinates by the modes, (n, MODES), px/mm."""
        per_mm = self.stated.per_mm(self.pixels, modes_mm)
        return per_mm[:, None] * self.stated.shapes(self.pixels)

    def unexplained(self) -> FloatMap:
        """What neither modes nor errors of the rig, period and start explain, (n,), periods."""
        free = (self.at_stated, np.ones_like(self.phase))
        design = np.column_stack((self.by_modes(np.zeros(MODES)), self.rig, *free))
        design /= np.linalg.norm(design, axis=0)
        found = np.linalg.lstsq(design, self.phase, rcond=None)[0]
        return np.asarray(self.phase - design @ found)

    def slope(self, modes_mm: FloatMap | None = None) -> float:
        """Periods per projector px on a surface, the stated plane by default."""
        q = self.at_stated if modes_mm is None else self.stated.along_axis(self.pixels, modes_mm)
        return float(np.polynomial.polynomial.polyfit(q, self.phase, 1)[1])

    def with_pattern(
        self, period_px: float | None, bright_px: float | None, sigma_mm: float
    ) -> _Seen:
        """The nodes with what is known of the pattern; its start only where the stated plane
        leaves one order of the fringes."""
        if period_px is None:
            return self
        per_px = float(np.sign(self.slope())) / period_px
        per_mm = np.abs(self.stated.per_mm(self.pixels, np.zeros(MODES)))
        unclear = ORDER_SIGMAS * sigma_mm * float(np.median(per_mm)) > 0.5 * period_px
        if bright_px is None or unclear:
            return replace(self, per_px=per_px)
        start = -per_px * bright_px
        order = np.round(np.median(self.phase - per_px * self.at_stated - start))
        return replace(self, per_px=per_px, start=start + float(order))

    def fitted(self, sigma_mm: float, weight: float) -> tuple[FloatMap, FloatMap, float]:
        """Modes, their covariance, and the logarithm of the marginal likelihood."""
        modes: FloatMap = np.zeros(MODES)
        per_px = self.per_px or self.slope()
        for _ in range(STEPS):
            q, by = self.stated.along_axis(self.pixels, modes), per_px * self.by_modes(modes)
            seen, free = self.phase + by @ modes, [q, np.ones_like(q)]
            if self.per_px is not None:
                seen, free = seen - per_px * q, free[1:]
            if self.start is not None:
                seen, free = seen - self.start, []
            columns = np.column_stack(free) if free else np.empty((q.size, 0))
            fit = _Fit(seen, by, per_px * self.rig, columns)
            found, covariance, likelihood = fit.solved(sigma_mm, weight)
            modes = found[:MODES]
            if self.per_px is None:
                per_px = float(found[-2])
        return modes, covariance[:MODES, :MODES], likelihood


def _seen(prepared: PreparedPair, stated: StatedPlane, modes_mm: FloatMap) -> _Seen | None:
    """The nodes at which reference and plane both have a phase, without outliers.

    A node averages over its surroundings, which shifts its phase where period and modulation
    change, and at the border of the frame. Fringes drawn on the surface that is expected, with the
    brightness and the modulation of the reference, are shifted alike, and show by how much.
    """
    seen = _at_nodes(prepared, stated)
    if seen is None:
        return None
    per_px = seen.slope(modes_mm)
    plane = _at_nodes(_drawn(prepared, stated, modes_mm, per_px), stated)
    if plane is None:
        return None
    shift = plane.phase - per_px * stated.along_axis(plane.pixels, modes_mm)
    shift -= np.round(np.median(shift))
    known = {tuple(at): value for at, value in zip(plane.pixels.tolist(), shift, strict=True)}
    shifts = np.array([known.get(tuple(at), np.nan) for at in seen.pixels.tolist()])
    seen = replace(seen, phase=seen.phase - shifts).where(np.isfinite(shifts))
    for _ in range(2):
        if seen.phase.size <= 2 * MODES + seen.rig.shape[1]:
            return None
        left = np.abs(seen.unexplained())
        limit = REJECTED_MADS * max(float(np.median(left)), TINY_PERIODS)
        seen = seen.where(left <= limit)
    return seen


def _at_nodes(prepared: PreparedPair, stated: StatedPlane) -> _Seen | None:
    """The nodes at which the reference has a phase and the plane a coordinate."""
    found = phase_nodes(prepared)
    if found is None:
        return None
    seen = _Seen(stated, _pixels(prepared, found), periods_at(prepared, found))
    seen = seen.where(np.isfinite(seen.at_stated))
    return seen if seen.phase.size > MODES else None


def _pixels(prepared: PreparedPair, nodes: PhaseNodes) -> FloatMap:
    """Pixels of the capture, (n, 2)."""
    places = (nodes.columns, nodes.rows)
    return np.stack(places if prepared.carrier.axis == "x" else places[::-1], axis=-1)


def periods_at(prepared: PreparedPair, nodes: PhaseNodes) -> FloatMap:
    """Phase of the fringes at nodes, (n,), periods."""
    fx, fy = prepared.frequency
    phase = fx * nodes.columns + fy * nodes.rows + nodes.beyond_rad / (2.0 * np.pi)
    return np.asarray(phase)


def _drawn(
    prepared: PreparedPair, stated: StatedPlane, modes_mm: FloatMap, per_px: float
) -> PreparedPair:
    """The pair with the fringes of a surface as its reference, as bright and as modulated."""
    h, w = prepared.reference.shape
    mean = _quadratic(prepared.reference)
    modulation = np.sqrt(2.0 * np.maximum(_quadratic((prepared.reference - mean) ** 2), 0.0))
    along = prepared.carrier.axis == "x"
    frame, ok = np.zeros((h, w), np.float32), prepared.reference_ok.copy()
    columns = np.arange(w, dtype=np.float64)
    for row in range(h):
        places = (columns, np.full(w, float(row)))
        pixels = np.stack(places if along else places[::-1], axis=-1)
        q = stated.along_axis(pixels, modes_mm)
        ok[row] &= np.isfinite(q)
        frame[row] = np.cos(2.0 * np.pi * per_px * np.nan_to_num(q))
    return replace(prepared, reference=mean + modulation * frame, reference_ok=ok)


def _quadratic(values: FloatMap) -> FloatMap:
    """The polynomial of degree 2 in x and in y that fits a map best, (h, w)."""
    bases = [np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), 3))[0] for n in values.shape]
    return np.asarray(bases[0] @ (bases[0].T @ values @ bases[1]) @ bases[1].T)


def _decided(seen: _Seen, sigma_mm: float, weight: float) -> PlaneEvidence:
    """The surface by the standard deviation that the evidence supports."""
    exact = seen.fitted(LEAST_MM, weight)[2]
    modes, covariance, stated = seen.fitted(sigma_mm, weight)
    moved = stated > exact + CLEAR
    best, used, tried = stated + CLEAR, sigma_mm, max(2.0 * sigma_mm, PLANE_SIGMA_MM)
    while tried < LARGEST_SHARE * seen.stated.distance_mm:
        there = seen.fitted(tried, weight)
        if there[2] > best:
            modes, covariance, best = there
            used = tried
        tried *= 2.0
    return PlaneEvidence(modes, covariance, used, used > sigma_mm, moved or used > sigma_mm)
