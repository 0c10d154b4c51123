"""Windowed inversion: displacement by local least squares (theory §4, "Windowed inversion")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.albedo import albedo_error
from fringeworks.pair.edges import Edges, FitSettings, across_edges
from fringeworks.pair.methods.window_sigma import window_sigma
from fringeworks.pair.methods.window_start import (
    MIN_SHARE_COUNTED,
    smoothed,
    start_field,
)
from fringeworks.pair.prepared import PreparedPair, fill_nearest
from fringeworks.pair.registry import Solution, method
from fringeworks.pair.still_edges import mixed_paint, still_edges
from fringeworks.pair.windows import (
    CONFIDENCE,
    SCALE_LIMITS_PX,
    Fitted,
    Windows,
    is_rare,
    misfit_variance,
    unexplained,
)
from fringeworks.signal.bands import by_bands, row_bands
from fringeworks.signal.filters import smooth, smooth_known, widened
from fringeworks.types import BoolMap, ByteMap, FloatMap, InputError, Reason, sealed

SCALES_PX = (32.0, 16.0, 8.0, 4.0, 2.0)
"""Default widths σ of the Gaussian windows, px (theory §4).

Factors of two, so that neighbouring scales differ enough to be compared; 2 px is close to the
resolution of a camera. An empirical choice.
"""
MIN_SCALE_PERIODS = 1.0 / 16.0
"""Narrowest default window, periods (theory §4).

A narrower window cannot distinguish displacement from modulation ratio and offset. An empirical
choice.
"""
MAX_SCALE_PERIODS = 2.2
"""Widest default window, periods; the widest of ``SCALES_PX`` is for periods of 15 px and more.

An object's shape is drawn with its fringes: wider windows than these flatten it. An empirical
choice.
"""
START_PERIODS = 1.0
"""Largest width of the smoothing of the start, periods; it then follows what the fringes show."""
MAX_SCALE_SHARE = 1.0 / 8.0
"""Widest default window, as a share of the frame's width.

A window of that σ covers most of the frame. An empirical choice.
"""
MAX_ITERATIONS = 100
"""Largest number of Gauss–Newton steps per scale that a caller may choose; it bounds the time."""
STILL_PASSES = 6
"""Largest number of times that pixels with other paint than their matching point are left out: each
removes two fifths or more of what the edges have pulled the displacement by."""
SETTLED_SIGMAS = 0.3
"""Largest change of the start at which no further pass is needed, in the median σ: what is left to
remove is about as much again."""
MAX_LEFT = 0.5
"""Largest share of the places beside still edges that stays unexplained without these pixels. Where
the edges are not those of the object frame, most of them do."""
MIN_ROWS = 8
"""Smallest number of rows; fewer do not determine the slope of the displacement across them."""
MAX_GAP = 0.25
"""Largest distance from usable samples up to which gaps are bridged, periods.

Beyond it a window could only extrapolate. An empirical choice.
"""
OUTSIDE_PX = 1.0
"""Distance beyond the reference frame up to which a matching point is still accepted, px.

A window at the frame's edge determines it from pixels inside. An empirical choice.
"""
DARK_RATIO = 0.1
"""Local modulation below which a failed pixel is called dark, as a share of the reference's.

Only the reported reason depends on it, not the values. An empirical choice.
"""
DARK_NOISE_FACTOR = 2.0
"""Local variance below which a failed pixel is called dark, in variances of the noise.

It is added to that of ``DARK_RATIO``. An empirical choice.
"""


@method("windowed")
def windowed(
    pair: PreparedPair,
    *,
    scales: Sequence[float] | None = None,
    iterations: int = 1,
    confidence: float = CONFIDENCE,
    paint: bool = True,
) -> Solution:
    """Fits the displacement by least squares in local windows, whose size adapts to every pixel.

    Parameters
    ----------
    pair : PreparedPair
    scales : sequence of float, optional
        Widths σ of the Gaussian windows, from coarse to fine, 1000 to 0.8 px. By default 32, 16, 8,
        4 and 2 px, without those wider than an eighth of the frame or narrower than a sixteenth of
        the period. A single value gives a fixed window.
    iterations : int, 1 … 100
        Gauss–Newton steps per scale. More steps lower the bias on smooth surfaces and raise the
        noise; beside hard edges of paint they take the edge for shape.
    confidence : float > 0
        Each pixel keeps the largest window whose estimate lies within this many σ of those of all
        smaller windows (Lepski's rule).
    paint : bool
        Search hard edges of paint and, where there are any, the albedo of every pixel, so that
        windows may cross them (``across_edges``). It takes three times as long then. Not used where
        a white frame shows the albedo.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range, or the frame has fewer than 8 rows along the fringes.

    Notes
    -----
    In every window, minimises Σ w [d − a − b·s(x − u − u_x i − u_y j)]² over offset a, modulation
    ratio b and an affine displacement (theory §4). The waveform s is measured, so γ and any other
    distortion common to both frames cancels. Pixels that show other paint than their matching
    point, beside edges that do not move, are left out (``still_edges``). σ comes from the normal
    equations with the residual's variance and the reference's noise. Windows end at cliffs. The
    iteration starts from ``fourier`` or, where that is unreliable, from counted fringes
    (``start_field``).
    """
    widths = _check_options(pair, scales, iterations, confidence)
    windows = Windows.of(pair)
    start = start_field(pair, _start_width(pair, widths))
    settings: FitSettings = {"iterations": iterations, "confidence": confidence}
    found, edges = _fitted(pair, windows, start.displacement_px, widths, settings, paint)
    albedo, walls = (None, None) if edges is None else (edges.albedo, edges.walls)
    if windows.albedo is not None:
        albedo = windows.albedo
        found = found._replace(modulation_ratio=albedo * found.modulation_ratio)
    displacement, scale = found.displacement_px, found.scale
    displacement[_far_from_data(pair)] = np.nan
    found = found._replace(
        model_variance=found.model_variance + misfit_variance(windows, found, albedo)
    )
    sigma = window_sigma(start, found, walls, widths, iterations, pair.period)
    return Solution(
        displacement_px=sealed(displacement),
        sigma_px=sealed(sigma),
        modulation_ratio=sealed(found.modulation_ratio),
        reason=_reasons(pair, displacement),
        noise_length_px=(start.wide_px, start.wide_px),
        iterations=_steps(displacement, scale, len(widths), iterations),
        albedo=albedo,
        walls=None if walls is None else walls.astype(np.uint8),
        details={
            "scales_px": widths,
            "scale_share": [float(np.mean(scale == k)) for k in range(len(widths))],
            "noise_correlation": found.noise_correlation,
            "noise_counts": float(np.sqrt(windows.object_noise) * pair.modulation),
            "painted": albedo is not None,
            "cliffs": walls is not None,
        },
    )


def _fitted(
    pair: PreparedPair,
    windows: Windows,
    start: NDArray[np.float32],
    widths: list[float],
    settings: FitSettings,
    paint: bool,
) -> tuple[Fitted, Edges | None]:
    """Windows that know still edges, cliffs and paint, and the latter two."""
    plain = windows.fit(start, widths, **settings)
    windows, found, start = _without_mixed(pair, windows, plain, start, widths, settings)
    pulled = None if found is plain else albedo_error(plain, found, pair.period)
    edges = across_edges(windows, found, start, widths, paint=paint, **settings)
    if edges is not None:
        found = edges.fitted
    if pulled is not None:
        found = found._replace(model_variance=found.model_variance + pulled)
    return found, edges


def _without_mixed(
    pair: PreparedPair,
    windows: Windows,
    found: Fitted,
    start: NDArray[np.float32],
    widths: list[float],
    settings: FitSettings,
) -> tuple[Windows, Fitted, NDArray[np.float32]]:
    """Windows that leave out pixels which show other paint than their matching point, where that
    explains what the others do not; the displacement that they start from, too."""
    poor = unexplained(found.misfit, windows.object_noise)
    if is_rare(poor):
        return windows, found, start
    edges = still_edges(pair)
    poor &= widened(edges, round(0.5 * pair.period))
    if is_rare(poor):
        return windows, found, start
    again, there, begin = windows, found, start
    reach, known = _start_width(pair, widths), ~widened(edges, round(0.5 * pair.period))
    for _ in range(STILL_PASSES):
        u = there.displacement_px
        last = begin
        begin = smoothed(_continued(u, known & np.isfinite(u), begin, reach), reach)
        determined = there.sigma_px[np.isfinite(u)]
        if not determined.size:
            return windows, found, start
        settled = SETTLED_SIGMAS * float(np.median(determined))
        if known.all() and float(np.abs(begin - last).max()) < settled:
            break
        mixed = mixed_paint(edges, begin)
        again = replace(windows, object_ok=np.where(mixed, np.uint8(0), windows.object_ok))
        there = again.fit(begin, widths, **settings)
        known = np.ones(u.shape, bool)
    left = poor & unexplained(there.misfit, windows.object_noise)
    if np.count_nonzero(left) > MAX_LEFT * np.count_nonzero(poor):
        return windows, found, start
    return again, there, begin


def _continued(
    u: NDArray[np.float32], known: BoolMap, start: NDArray[np.float32], width_px: float
) -> NDArray[np.float32]:
    """The displacement where it is known, and its local mean from there elsewhere, px."""
    if not known.any():
        return start
    mean = smooth_known(np.where(known, u, 0.0).astype(np.float64), known, (width_px, width_px))
    near = smooth(known.astype(np.float64), (width_px, width_px)) > MIN_SHARE_COUNTED
    return np.where(known, u, fill_nearest(mean, near)).astype(np.float32)


def _steps(displacement_px: FloatMap, scale: ByteMap, scales: int, iterations: int) -> ByteMap:
    """Refinement steps of every pixel, (h, w), at most 255."""

    def steps(u: FloatMap, scale: ByteMap) -> ByteMap:
        of_pixel = np.where(np.isfinite(u), scale + 1.0, scales) * iterations
        return np.asarray(np.minimum(of_pixel, np.iinfo(np.uint8).max), np.uint8)

    return by_bands(steps, displacement_px, scale, dtype=np.uint8)


def _check_options(
    prepared: PreparedPair, scales: Sequence[float] | None, iterations: int, confidence: float
) -> list[float]:
    """Check the frame's size and the options; return the widths of the windows, px."""
    rows = prepared.reference.shape[0]
    if rows < MIN_ROWS:
        raise InputError(
            f"windowed: expected at least {MIN_ROWS} rows along the fringes, got {rows}; "
            "for single rows use ifa, sifa, gsifa or exact"
        )
    widths = _default_scales(prepared) if scales is None else [float(s) for s in scales]
    smallest, largest = SCALE_LIMITS_PX
    in_range = bool(widths) and all(smallest <= s <= largest for s in widths)
    if scales is not None and not (in_range and widths == sorted(widths)[::-1]):
        raise InputError(
            f"scales: expected widths from {largest:g} down to {smallest:g} px, got {list(scales)}"
        )
    if not 1 <= iterations <= MAX_ITERATIONS:
        raise InputError(f"iterations: expected 1 to {MAX_ITERATIONS}, got {iterations}")
    if not confidence > 0:
        raise InputError(f"confidence: expected > 0, got {confidence}")
    return widths


def _default_scales(prepared: PreparedPair) -> list[float]:
    """Default widths that suit the period and the frame, px; at least one."""
    narrowest = min(MIN_SCALE_PERIODS * prepared.period, SCALES_PX[0])
    wide_enough = [s for s in SCALES_PX if s >= narrowest]
    widest = min(prepared.reference.shape[1] * MAX_SCALE_SHARE, MAX_SCALE_PERIODS * prepared.period)
    widest = max(widest, wide_enough[-1])
    return [s for s in wide_enough if s <= widest]


def _start_width(prepared: PreparedPair, widths: list[float]) -> float:
    """Width of the smoothing of the start, px."""
    return min(0.5 * widths[0], START_PERIODS * prepared.period)


def _reasons(prepared: PreparedPair, displacement_px: FloatMap) -> ByteMap:
    """``Reason`` of every pixel: outside the reference, too dark, or undetermined."""
    kept = np.isfinite(displacement_px)
    columns = np.arange(displacement_px.shape[1])

    def outside(u: FloatMap) -> BoolMap:
        column = columns - u
        return np.asarray((column < -OUTSIDE_PX) | (column > columns[-1] + OUTSIDE_PX))

    reason = np.where(kept, np.uint8(Reason.OK), np.uint8(Reason.UNDETERMINED))
    reason[kept & by_bands(outside, displacement_px, dtype=bool)] = Reason.OUTSIDE
    if not kept.all():
        reason[~kept & _dark(prepared)] = Reason.LOW_MODULATION
    return reason


def _far_from_data(prepared: PreparedPair) -> BoolMap:
    """True where the nearest usable sample is so far that a window could only extrapolate."""
    if prepared.object_ok.all():
        return np.zeros(prepared.object_ok.shape, bool)
    gap = scipy.ndimage.distance_transform_edt(~prepared.object_ok)
    return np.asarray(gap > MAX_GAP * prepared.period)


def _dark(prepared: PreparedPair) -> BoolMap:
    """True where the local contrast of the object frame is not distinguishable from noise."""
    size = max(3, int(np.ceil(prepared.period)))
    weak_fringe = 0.5 * (DARK_RATIO * prepared.modulation) ** 2
    limit = weak_fringe + DARK_NOISE_FACTOR * prepared.noise[1]
    dark = np.empty(prepared.object.shape, bool)
    for band in row_bands(dark.shape, bytes_per_px=40, halo=size, least=size):
        counts = prepared.object[band.seen].astype(np.float64)
        mean = scipy.ndimage.uniform_filter(counts, size)
        variance = scipy.ndimage.uniform_filter(counts**2, size) - mean**2
        dark[band.rows] = (variance < limit)[band.inner]
    return dark
