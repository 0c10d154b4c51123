"""Windowed inversion: the fringe's displacement by local least squares (theory §4, last item)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft, ndimage

from fringeworks import _core
from fringeworks.pair.methods.fourier import fourier
from fringeworks.pair.orders import guided_count
from fringeworks.pair.prepared import PreparedPair, fill_nearest
from fringeworks.pair.registry import Solution, method
from fringeworks.types import BoolMap, FloatMap, InputError, Reason

SCALES = (32.0, 16.0, 8.0, 4.0, 2.0)
"""Widths σ of the Gaussian windows, px."""
MIN_SCALE = 1.0 / 16.0
"""Narrowest window, periods: a narrower one cannot tell displacement from gain and offset."""
SMOOTHING = 1.0 / 30.0
"""Width of the reference's noise filter, periods; it passes the first harmonics unchanged."""
CONFIDENCE = 2.5
"""A window is kept while its estimate lies within this many σ of all smaller ones."""
MAX_SIGMA = 1.0 / 25.0
"""Estimates less certain than this share of a period are no estimates."""
DRIFT = 0.01
"""How far offset and gain may drift between scales, share of the modulation."""
MAX_SLOPE = 0.3
"""Slope of the displacement, px/px, from which a band-pass rounds off more than it should."""
OFF_BAND = 0.03
"""Mean difference of count and band-pass, periods, from which the count is believed; at twice
that, fully."""
COUNT_SMOOTHING = 0.25
"""Smoothing of a start that was counted, periods."""
FOLD = 0.125
"""Differences between a smooth and a sharp start, periods, from which the sharp one is right."""
MIN_ROWS = 8
"""Fewer rows leave the displacement's slope across them open."""
MAX_GAP = 0.25
"""Gaps in the data are bridged up to this distance from usable samples, periods."""
MIN_NOISE = 1e-3
"""Floor of the noise's standard deviation, share of the modulation: single precision's sums."""
MIN_EXPLAINED = 0.3
"""Least share of the local contrast that the warped reference must explain."""


def smooth_reference(frame: FloatMap, width_px: float) -> FloatMap:
    """Low-pass with a response flat to sixth order, e^(−q)(1 + q + q²/2) with q = (σk)²/2.

    The harmonics that make up a real fringe pass unchanged, and white noise does not.
    """
    wanted = int(np.ceil(6.0 * width_px)) + 1
    top, left = (min(wanted, side - 1) for side in frame.shape)
    # Odd reflection keeps value and slope at the border; even reflection would flatten the fringe.
    padded = np.pad(frame, ((top, top), (left, left)), mode="reflect", reflect_type="odd")
    rows, columns = padded.shape
    shape = (fft.next_fast_len(rows, real=True), fft.next_fast_len(columns, real=True))
    spectrum = fft.rfft2(padded, s=shape, workers=-1)
    ky = 2.0 * np.pi * width_px * fft.fftfreq(shape[0])[:, None]
    kx = 2.0 * np.pi * width_px * fft.rfftfreq(shape[1])[None, :]
    q = 0.5 * (ky**2 + kx**2)
    spectrum *= np.exp(-q) * (1.0 + q + 0.5 * q * q)
    smooth = fft.irfft2(spectrum, s=shape, overwrite_x=True, workers=-1)
    h, w = frame.shape
    return np.ascontiguousarray(smooth[top : top + h, left : left + w])


def spline_coefficients(rows: FloatMap) -> np.ndarray:
    """Cubic B-spline coefficients along rows with one mirrored coefficient in front, two behind."""
    coefficients = ndimage.spline_filter1d(rows, 3, axis=1, mode="mirror")
    padded = np.pad(coefficients, ((0, 0), (1, 2)), mode="reflect")
    return np.ascontiguousarray(padded, dtype=np.float32)


def start_field(pair: PreparedPair, width_px: float) -> FloatMap:
    """A first guess of the displacement, defined everywhere.

    The band-pass alone where it has no cause for doubt, smoothed over ``width_px``. Where it leaves
    gaps or is steep, it may have rounded off or lost what counting the fringes still sees: the
    count is taken where it differs from the band-pass on an average over a period, and not only
    by its own scatter.
    """

    def smooth(values: FloatMap, width: float) -> FloatMap:
        return np.asarray(ndimage.gaussian_filter(values, width, mode="nearest", truncate=3.0))

    band = fourier(pair).displacement_px
    known = np.isfinite(band)
    if not known.any():
        return np.zeros(band.shape)
    band = fill_nearest(band, known)
    if known.all() and np.abs(np.diff(band, axis=1)).max() <= MAX_SLOPE:
        return smooth(band, width_px)
    counted = guided_count(pair, lambda: np.where(known, band, np.nan)).displacement_px
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(counted) & (~known | (np.abs(counted - band) < 0.5 * pair.period))
    difference = np.where(usable, counted - band, 0.0)
    share = smooth(usable.astype(float), 0.5 * pair.period)
    mean = smooth(difference, 0.5 * pair.period) / np.maximum(share, 1e-6)
    trust = _rise(mean, OFF_BAND * pair.period)
    trust[~known] = 1.0
    start = band + trust * np.where(usable, difference, mean)
    # What varies faster than the first window stays in the field, right or wrong: only folds that
    # stand out from the start's own ripple may.
    wide = smooth(start, width_px)
    sharp = smooth(start, min(width_px, COUNT_SMOOTHING * pair.period))
    return wide + _rise(sharp - wide, FOLD * pair.period) * (sharp - wide)


def _rise(values: FloatMap, limit: float) -> FloatMap:
    """From 0 at |value| = limit to 1 at twice that."""
    return np.clip(np.abs(values) / limit - 1.0, 0.0, 1.0)


@method("windowed")
def windowed(
    pair: PreparedPair,
    *,
    scales: Sequence[float] | None = None,
    iterations: int = 1,
    confidence: float = CONFIDENCE,
) -> Solution:
    """Windowed inversion: local least squares in windows that follow the information.

    Parameters
    ----------
    pair : PreparedPair
    scales : sequence of float, optional
        Widths σ of the Gaussian windows in px, from coarse to fine; 32, 16, 8, 4, 2 by default,
        those wider than an eighth of the rows
        or narrower than a sixteenth of the period left out. One value gives a fixed window.
    iterations : int, 1 … 100
        Gauss–Newton steps per scale. More lower the bias on smooth surfaces and raise the noise;
        beside hard edges of paint they take the edge for shape.
    confidence : float > 0
        Each pixel keeps the largest window whose estimate lies within this many σ of those of
        all smaller windows (Lepski's rule).

    Notes
    -----
    Minimises Σ w [d − a − b·s(x − u − u_x i − u_y j)]² over offset, gain and affine displacement
    in every window (theory §4). The waveform s is measured, so that γ and whatever else both
    frames share cancels. σ comes from the normal equations with the residual's variance and the
    reference's noise. Starts from ``fourier``, or, where that is in doubt, from counted fringes.
    """
    if pair.reference.shape[0] < MIN_ROWS:
        raise InputError(
            f"windowed: expected at least {MIN_ROWS} rows along the fringes, got "
            f"{pair.reference.shape[0]}; single rows are for ifa, sifa, gsifa and exact"
        )
    widths = _check_scales(pair, scales)
    if not 1 <= iterations <= 100:
        raise InputError(f"iterations: expected 1 to 100, got {iterations}")
    if not confidence > 0:
        raise InputError(f"confidence: expected > 0, got {confidence}")
    modulation, level = pair.modulation, pair.level
    noise_reference, noise_object = (max(v / modulation**2, MIN_NOISE**2) for v in pair.noise)
    smooth = smooth_reference(pair.reference, SMOOTHING * pair.period)
    displacement, sigma, gain, scale, correlation = _core.invert_windowed(
        spline_coefficients((smooth - level) / modulation),
        ((pair.object - level) / modulation).astype(np.float32),
        pair.reference_ok.astype(np.uint8),
        pair.object_ok.astype(np.uint8),
        start_field(pair, 0.5 * widths[0]).astype(np.float32),
        scales=widths,
        iterations=iterations,
        period=pair.period,
        confidence=confidence,
        object_noise=noise_object,
        reference_noise=noise_reference,
        drift=DRIFT,
        max_sigma=MAX_SIGMA * pair.period,
        min_explained=MIN_EXPLAINED,
    )
    displacement[_far_from_data(pair)] = np.nan
    kept = np.isfinite(displacement)
    reason = np.where(kept, Reason.OK, Reason.UNDETERMINED).astype(np.uint8)
    column = np.arange(displacement.shape[1]) - displacement
    outside = kept & ((column < -1.0) | (column > displacement.shape[1]))
    reason[outside] = Reason.OUTSIDE
    reason[~kept & _dark(pair)] = Reason.LOW_MODULATION
    steps = np.where(kept, (scale + 1.0) * iterations, len(widths) * iterations)
    return Solution(
        displacement,
        sigma,
        gain,
        reason,
        iterations=np.minimum(steps, 255).astype(np.uint8),
        details={
            "scales_px": widths,
            "scale_share": [float(np.mean(scale == k)) for k in range(len(widths))],
            "noise_correlation": correlation,
            "noise_counts": float(np.sqrt(noise_object) * modulation),
        },
    )


def _check_scales(pair: PreparedPair, scales: Sequence[float] | None) -> list[float]:
    if scales is None:
        narrowest = min(MIN_SCALE * pair.period, SCALES[0])
        fitting = [s for s in SCALES if s >= narrowest]
        widest = max(pair.reference.shape[1] / 8.0, fitting[-1])
        return [s for s in fitting if s <= widest]
    widths = [float(s) for s in scales]
    if not widths or not all(0.8 <= s <= 1e3 for s in widths) or widths != sorted(widths)[::-1]:
        raise InputError(f"scales: expected widths from 1000 down to 0.8 px, got {list(scales)}")
    return widths


def _far_from_data(pair: PreparedPair) -> BoolMap:
    """True where the nearest usable sample is so far that a window could only extrapolate."""
    if pair.object_ok.all():
        return np.zeros(pair.object_ok.shape, bool)
    gap = ndimage.distance_transform_edt(~pair.object_ok)
    return np.asarray(gap > MAX_GAP * pair.period)


def _dark(pair: PreparedPair) -> BoolMap:
    """True where the object frame's local contrast is not told from noise."""
    size = max(3, int(np.ceil(pair.period)))
    mean = ndimage.uniform_filter(pair.object, size)
    variance = ndimage.uniform_filter(pair.object**2, size) - mean**2
    return np.asarray(variance < 0.5 * (0.1 * pair.modulation) ** 2 + 2.0 * pair.noise[1])
