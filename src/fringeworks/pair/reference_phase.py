"""How fringes on the reference differ from a plane wave, and what that does to displacements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.unwrap import unwrap
from fringeworks.signal.bands import row_bands
from fringeworks.signal.filters import gaussian
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import FloatMap, Frozen

DEGREE = 4
"""Degree of the polynomial in x and y: perspective and lens distortion leave less than 0.01 rad."""
NODES_PER_PERIOD = 2.0
"""Nodes per period at which the phase is read; it changes little between them."""
BLOCKS_PER_PERIOD = 8.0
"""Blocks per period that are summed before the average: half of a fringe has four."""
WIDTH_PERIODS = 1.0
"""Width σ of the Gaussian of the average, periods: exp(−2π²) of the background is left."""
BORDER_PERIODS = 2.0
"""Width of the frame's border without nodes, periods: averages there see one side only."""
CUT_WIDTHS = 4.0
"""Distance at which that Gaussian is cut off, widths: 6e-5 of it lie beyond."""
MIN_AMPLITUDE = 0.3
"""Amplitude of a node that is used, over the median: weaker ones see the border of the light."""
MIN_NODES = 60
"""Nodes that a fit needs, four for each coefficient."""
SIGNIFICANT = 0.003
"""Root mean square of the local frequency's change, as a share of the mean one, from which on it is
corrected: below, the error is 0.3 % of a displacement."""
MAX_RESIDUAL_RAD = 0.3
"""Largest root mean square of the residuals: beyond, the reference is no smooth surface."""
LEAST_MISFIT = 3e-4
"""Least misfit of the nodes, periods: on 14 planes of a ray-caster, the phase of drawn fringes
deviates from that of photographed ones by 2e-4, smoothly over the frame."""
REJECTED_MADS = 5.0
"""Residuals beyond this many median absolute deviations are left out of the second fit."""
UNKNOWN_PERIOD = 0.05
"""Standard deviation of the local period where the reference is no smooth surface, as a share of
the mean one: half of the 10 % by which strong perspective changes it."""
STEPS = 4
"""Steps of the fixed point. Each is closer by the share of the local frequency's change, 10 % for
strong perspective: four leave 1e-4 of the correction."""


@dataclass(frozen=True, eq=False, repr=False)
class PhaseNodes(Frozen):
    """Phase of the reference's fringes at nodes, in the orientation of the prepared pair."""

    rows: FloatMap
    """(n,), px."""
    columns: FloatMap
    """(n,), px."""
    beyond_rad: FloatMap
    """Unwrapped phase less that of the carrier, (n,), rad, up to a common multiple of 2π."""


@dataclass(frozen=True, eq=False, repr=False)
class ReferencePhase(Frozen):
    """Phase of the reference beyond its carrier, as a polynomial."""

    coefficients: FloatMap
    """(degree + 1, degree + 1), rad: powers of y, then of x, both from −1 to 1 over the frame."""
    shape: tuple[int, int]
    """Rows and columns of the frame."""

    def at(self, x: FloatMap, part: slice = slice(None)) -> FloatMap:
        """Return the phase at columns (r, w) of some rows, rad."""
        h, w = self.shape
        across = 2.0 * np.arange(h)[part] / max(h - 1, 1) - 1.0
        rows = np.polynomial.polynomial.polyval(across, self.coefficients)
        along = 2.0 * x / max(w - 1, 1) - 1.0
        value = np.zeros_like(along)
        for power in range(len(rows) - 1, -1, -1):
            value = value * along + rows[power][:, None]
        return value

    def slopes(self, y: FloatMap, x: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Return the slopes of the phase along x and y at places of any shape, rad/px."""
        polynomial = np.polynomial.polynomial
        half = [0.5 * max(side - 1, 1) for side in self.shape]
        at = (y / half[0] - 1.0, x / half[1] - 1.0)
        down, along = (
            polynomial.polyval2d(*at, polynomial.polyder(self.coefficients, axis=axis))
            for axis in (0, 1)
        )
        return np.asarray(along / half[1]), np.asarray(down / half[0])

    def left(self, nodes: PhaseNodes) -> FloatMap:
        """Return what the polynomial leaves of the phase of nodes, (n,), rad."""
        half = [0.5 * max(side - 1, 1) for side in self.shape]
        at = (nodes.rows / half[0] - 1.0, nodes.columns / half[1] - 1.0)
        value = np.polynomial.polynomial.polyval2d(*at, self.coefficients)
        return np.asarray(nodes.beyond_rad - value)


def phase_nodes(prepared: PreparedPair) -> PhaseNodes | None:
    """Read the phase of the reference at nodes: the largest region in which fringes are clear.

    Returns
    -------
    PhaseNodes, or None where fewer than ``MIN_NODES`` are clear.
    """
    field, rows, columns = _nodes(prepared)
    if field.size < MIN_NODES:
        return None
    amplitude = np.abs(field)
    used = amplitude > MIN_AMPLITUDE * np.median(amplitude)
    if used.sum() < MIN_NODES:
        return None
    unwrapped = unwrap(np.angle(field), used)
    used &= unwrapped.region == 1
    at = np.broadcast_arrays(rows[:, None], columns[None, :])
    phase = np.asarray(unwrapped.phase, np.float64)[used]
    return PhaseNodes(at[0][used].astype(np.float64), at[1][used].astype(np.float64), phase)


def reference_phase(prepared: PreparedPair) -> ReferencePhase | None:
    """Measure how the phase of the reference differs from that of its carrier.

    Parameters
    ----------
    prepared : PreparedPair

    Returns
    -------
    ReferencePhase, or None where the fringes have one period, or are no smooth surface.
    """
    nodes = phase_nodes(prepared)
    found = None if nodes is None else polynomial_phase(prepared, nodes)
    if nodes is None or found is None:
        return None
    along, _ = found.slopes(nodes.rows, nodes.columns)
    change = np.sqrt(np.mean(along**2)) / (2.0 * np.pi * prepared.frequency[0])
    return None if change < SIGNIFICANT else found


def polynomial_phase(prepared: PreparedPair, nodes: PhaseNodes) -> ReferencePhase | None:
    """Fit a polynomial to the phase of nodes; None where they are on no smooth surface.

    Notes
    -----
    The frame is multiplied by the carrier and averaged; a polynomial is fitted to the unwrapped
    phase of the nodes, twice, the second time without outliers.
    """
    h, w = prepared.reference.shape
    y, x = 2.0 * nodes.rows / max(h - 1, 1) - 1.0, 2.0 * nodes.columns / max(w - 1, 1) - 1.0
    phase = nodes.beyond_rad
    powers = [(j, i) for j in range(DEGREE + 1) for i in range(DEGREE + 1 - j)]
    design = np.stack([y**j * x**i for j, i in powers], axis=-1)
    keep = np.ones(phase.size, bool)
    for _ in range(2):
        if keep.sum() < MIN_NODES:
            return None
        found = np.linalg.lstsq(design[keep], phase[keep], rcond=None)[0]
        residual = phase - design @ found
        spread = np.median(np.abs(residual[keep]))
        keep = np.abs(residual) <= REJECTED_MADS * max(float(spread), 1e-9)
    if np.sqrt(np.mean(residual[keep] ** 2)) > MAX_RESIDUAL_RAD:
        return None
    table = np.zeros((DEGREE + 1, DEGREE + 1))
    for c, (j, i) in zip(found, powers, strict=True):
        table[j, i] = c
    return ReferencePhase(table, (h, w))


def _nodes(prepared: PreparedPair) -> tuple[NDArray[np.complex64], FloatMap, FloatMap]:
    """The reference times its carrier, averaged, at nodes; with their rows and columns.

    Sums over small blocks come first, so that the average itself is one of few values.
    """
    frame, ok = prepared.reference, prepared.reference_ok
    h, w = frame.shape
    fx, fy = prepared.frequency
    centred = np.subtract(frame, prepared.mean_brightness, dtype=np.float32)
    centred[~ok] = 0.0
    side = max(1, int(prepared.period / BLOCKS_PER_PERIOD))
    tops, lefts = (np.arange(0, n - n % side, side) for n in (h, w))
    across = np.exp(-2j * np.pi * fx * np.arange(w)).astype(np.complex64)
    down = np.exp(-2j * np.pi * fy * np.arange(h)).astype(np.complex64)
    wide = lefts.size * side
    turned = centred[:, :wide].reshape(h, lefts.size, side)
    sums = np.einsum("yks,ks->yk", turned, across[:wide].reshape(-1, side))
    sums *= down[:, None]
    blocks = np.add.reduceat(sums[: tops.size * side], tops, axis=0)
    # Blocks have a variance of their own, in squares of their side.
    sigma = float(np.sqrt(max((WIDTH_PERIODS * prepared.period / side) ** 2 - 1.0 / 12.0, 0.01)))
    reach = (round(2.0 * CUT_WIDTHS * sigma) + 1) // 2
    mixed = [gaussian(part, sigma, reach, "zero") for part in (blocks.real, blocks.imag)]
    step = max(1, round(BLOCKS_PER_PERIOD / NODES_PER_PERIOD))
    border = int(np.ceil(BORDER_PERIODS * prepared.period / side))
    places = [np.arange(border, n.size - border, step) for n in (tops, lefts)]
    field = (mixed[0] + 1j * mixed[1]).astype(np.complex64)[np.ix_(*places)]
    middle = 0.5 * (side - 1)
    return field, tops[places[0]] + middle, lefts[places[1]] + middle


def with_local_period(prepared: PreparedPair, displacement_px: FloatMap) -> FloatMap:
    """Correct a displacement that was computed from a phase by the mean period of the reference.

    Parameters
    ----------
    prepared : PreparedPair
    displacement_px : (h, w) array
        The phase φ as p φ/2π, px; NaN where unknown.

    Returns
    -------
    (h, w) array, px.

    Notes
    -----
    With the reference's phase 2π f x + P(x), φ(x) = 2π f u + P(x) − P(x − u). The fixed point
    u = (φ − P(x) + P(x − u)) / (2π f) is found by iteration.
    """
    known = reference_phase(prepared)
    if known is None:
        return displacement_px
    per_rad = 1.0 / (2.0 * np.pi * prepared.frequency[0])
    corrected = np.empty(displacement_px.shape, np.float64)
    for band in row_bands(corrected.shape, bytes_per_px=56):
        corrected[band.rows] = _fixed_point(known, displacement_px[band.rows], band.rows, per_rad)
    return corrected


def _fixed_point(
    known: ReferencePhase, displacement_px: FloatMap, rows: slice, per_rad: float
) -> FloatMap:
    """The corrected displacement of some rows, (r, w), px."""
    w = displacement_px.shape[1]
    columns = np.broadcast_to(np.arange(w, dtype=np.float64), displacement_px.shape)
    here = known.at(columns, rows)
    u = displacement_px.astype(np.float64)
    for _ in range(STEPS):
        place = np.clip(columns - np.where(np.isfinite(u), u, 0.0), 0.0, w - 1.0)
        u = displacement_px + (known.at(place, rows) - here) * per_rad
    return u


def moved_by_periods(
    prepared: PreparedPair, displacement_px: FloatMap, whole: NDArray[np.integer]
) -> tuple[FloatMap, FloatMap]:
    """Move places by whole periods of the reference there.

    Parameters
    ----------
    prepared : PreparedPair
    displacement_px : (h, w) array
        In the orientation of the prepared pair, px; NaN where unknown.
    whole : (h, w) int array
        Periods to add.

    Returns
    -------
    change_px, sigma_px : (h, w) arrays
        What to add to the displacement, and the standard deviation of that; 0 where nothing is
        moved.

    Notes
    -----
    The period of a reference in perspective differs by percents from the mean one, which is many σ
    of a displacement. The place a = x − u moves to a' with 2π f a' + P(a') = 2π f a + P(a) − 2π n.
    What the polynomial P leaves of the nodes is the uncertainty of both its values.
    """
    change = np.multiply(whole, prepared.period, dtype=np.float64)
    nodes = phase_nodes(prepared) if whole.any() else None
    known = None if nodes is None else polynomial_phase(prepared, nodes)
    if nodes is None or known is None:
        return change, UNKNOWN_PERIOD * np.abs(change)
    rows = np.flatnonzero((whole != 0).any(axis=1))
    part = slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)
    per_rad = 1.0 / (2.0 * np.pi * prepared.frequency[0])
    w = displacement_px.shape[1]
    place = np.arange(w) - np.nan_to_num(np.asarray(displacement_px[part], np.float64))
    before, step = known.at(np.clip(place, 0.0, w - 1.0), part), change[part].copy()
    further = step
    for _ in range(STEPS):
        after = known.at(np.clip(place - further, 0.0, w - 1.0), part)
        further = step - (before - after) * per_rad
    change[part] = np.where(whole[part] != 0, further, 0.0)
    left = float(np.median(np.abs(known.left(nodes)))) * per_rad / NORMAL_MEDIAN
    sigma = np.sqrt(2.0) * max(left, LEAST_MISFIT * prepared.period)
    return change, np.where(whole != 0, sigma, 0.0)
