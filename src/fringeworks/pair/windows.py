"""The two frames in units of the reference's modulation, and the windows fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.prepared import PreparedPair
from fringeworks.signal.bands import by_bands, row_bands
from fringeworks.signal.filters import box_mean, opened
from fringeworks.signal.noise import noise_variance
from fringeworks.types import BoolMap, ByteMap, FloatMap

PATCH_PX = 7
"""Side of the squares over which misfits are averaged: the mean of 49 squares scatters by 20 %."""
MIN_MISFIT = 4.0
"""Mean squared misfit of a patch that the windows do not explain, in variances of the noise."""
MIN_MISFIT_SHARE = 1e-3
"""The same as a share of the squared modulation, on frames without noise."""
MIN_BLOB_PX = 5
"""Side of the smallest square of such pixels that counts; smaller ones are chance or dust."""
MIN_POOR_PIXELS = 50
"""Number of such pixels from which edges are searched."""
MEDIAN_STEP = 4
"""Every so many rows and columns determine the median."""
REFERENCE_SMOOTHING = (1.0 / 30.0, 1.0 / 6.0)
"""Smallest and largest width of the low-pass that reduces the reference's noise, periods.

The smallest passes the first harmonics almost unchanged (tests: 1e-4 of the modulation), the
largest 98 % of the fringe. Empirical choices.
"""
SLOPE_NOISE = 87.0 / (64.0 * np.pi)
"""Variance of the slope of white noise of variance 1 behind that low-pass, times width⁴:
(1/2π) ∫ q e^(−2q) (1 + q + q²/2)² dq."""
MAX_DILUTION = 0.03
"""Largest share of noise in the mean square of the reference's slope. A window divides by that mean
square: the share is what a step lacks of the displacement."""
FREQUENCIES = 64
"""Frequencies along each axis at which the low-pass is averaged."""
FILTER_REACH = 6.0
"""Width of the border that is added for the low-pass, in widths of the filter.

The filter's response is negligible at that distance.
"""
CONFIDENCE = 2.5
"""Default for the largest difference of a window's estimate from those of all smaller windows, σ.

Lepski's rule (theory §4): a larger value averages more noise, a smaller one follows details. An
empirical choice.
"""
SCALE_LIMITS_PX = (0.8, 1e3)
"""Smallest and largest width of a window that a caller may choose, px.

Below about 1 px a window holds too few pixels for its five unknowns; above 1000 px it is as wide as
a frame.
"""
MIN_RATIO = 1e-2
"""Smallest modulation ratio that the noise is divided by."""
FINEST = 1e-9
"""The same for the estimate of the smallest window that determines the displacement."""
MAX_SIGMA = 1.0 / 25.0
"""Largest standard deviation of an estimate that is kept, periods.

0.25 rad of phase; beyond it the linearised model is no longer reliable. An empirical choice.
"""
DRIFT = 0.01
"""Expected change of offset and modulation ratio between scales, as a share of the modulation.

It loosens the prior that a scale gets from the coarser one. An empirical choice.
"""
MIN_NOISE = 1e-3
"""Lower bound on the noise's standard deviation, as a share of the modulation.

On ideal frames, interpolation and single precision leave residuals of about this size. An empirical
choice.
"""
MIN_EXPLAINED = 0.3
"""Smallest share of the local contrast that the warped reference must explain, 0…1.

A window that explains less does not show the reference's fringes. An empirical choice.
"""

LEAST_SHARE = 1e-3
"""Smallest share of a patch with data, and smallest mean square slope of the fringes in it, that
is divided by."""


def mean_square(misfit: NDArray[np.float32], side_px: int = PATCH_PX) -> NDArray[np.float32]:
    """Mean square over squares of a side, (h, w); pixels without data count as 0."""
    square = np.where(np.isfinite(misfit), misfit**2, np.float32(0))
    return box_mean(square, side_px, "edge")


def usual_noise(patches: NDArray[np.float32], noise: float) -> float:
    """Variance that most patches show, at least that of the noise: compression leaves more."""
    return max(noise, float(np.median(patches[::MEDIAN_STEP, ::MEDIAN_STEP])))


def unexplained(misfit: NDArray[np.float32], noise: float, most: float = MIN_MISFIT) -> BoolMap:
    """Where the mean squared misfit of a patch is more than ``most`` variances of noise, (h, w)."""
    patches = mean_square(misfit)
    poor = patches > most * usual_noise(patches, noise) + MIN_MISFIT_SHARE
    return opened(poor, MIN_BLOB_PX)


def is_rare(places: BoolMap) -> bool:
    """Whether so few pixels are marked that nothing is searched there."""
    return int(np.count_nonzero(places)) < MIN_POOR_PIXELS


def misfit_variance(
    windows: Windows, fitted: Fitted, albedo: NDArray[np.float32] | None
) -> NDArray[np.float32] | float:
    """Variance of the displacement by what the windows leave unexplained, (h, w), px².

    Notes
    -----
    What noise does not explain is no noise: it is common to a patch, and no window averages it. In
    units of the mean square slope of the fringes there, it is the square of a displacement. Pixels
    that show two surfaces, beside cliffs, have it.
    """
    if is_rare(unexplained(fitted.misfit, windows.object_noise)):
        return 0.0
    windows = windows.above_dark()
    known = np.isfinite(fitted.displacement_px)
    value, slope, both = windows.warp(np.where(known, fitted.displacement_px, np.float32(0)))
    known &= both > 0
    beta = np.ones_like(value) if albedo is None else albedo
    gain = np.where(known, fitted.modulation_ratio, 0) / beta

    def mean(values: FloatMap) -> FloatMap:
        share = np.maximum(box_mean(known.astype(np.float32), PATCH_PX, "edge"), LEAST_SHARE)
        total = box_mean(np.where(known, values, 0).astype(np.float32), PATCH_PX, "edge")
        return np.asarray(total / share)

    level = mean(windows.object / beta - gain * value)
    patches = mean((windows.object - beta * (level + gain * value)) ** 2)
    usual = usual_noise(patches.astype(np.float32), windows.object_noise)
    more = np.maximum(patches - MIN_MISFIT * usual - MIN_MISFIT_SHARE, 0.0)
    steep = np.maximum(mean((beta * gain * slope) ** 2), LEAST_SHARE)
    return np.asarray(more / steep, np.float32)


class Fitted(NamedTuple):
    """What the windows found; (h, w) maps, NaN where none determines the displacement."""

    displacement_px: NDArray[np.float32]
    sigma_px: NDArray[np.float32]
    modulation_ratio: NDArray[np.float32]
    """b of d = β (a + b s)."""
    offset: NDArray[np.float32]
    """a, in modulations of the reference."""
    misfit: NDArray[np.float32]
    """What windows of about half a period leave of the object, in modulations."""
    unlike_finer: NDArray[np.float32]
    """Mean squared difference from the next finer windows, px²; 0 where none determine it."""
    scale: ByteMap
    """Index of the window that was kept; 255 where none was."""
    noise_correlation: float
    model_variance: NDArray[np.float32] | float = 0.0
    """Variance that paint adds to that of the windows, (h, w), px²."""

    def replaced(self, other: Fitted, where: BoolMap) -> Fitted:
        """Take another result where a map says so; the misfit and the correlation stay."""
        models = self.model_variance, other.model_variance
        return self._replace(
            displacement_px=np.where(where, other.displacement_px, self.displacement_px),
            sigma_px=np.where(where, other.sigma_px, self.sigma_px),
            modulation_ratio=np.where(where, other.modulation_ratio, self.modulation_ratio),
            offset=np.where(where, other.offset, self.offset),
            unlike_finer=np.where(where, other.unlike_finer, self.unlike_finer),
            scale=np.where(where, other.scale, self.scale),
            model_variance=np.where(where, models[1], models[0]).astype(np.float32),
        )


@dataclass(frozen=True, eq=False)
class Windows:
    """A pair of frames, normalised for the kernel.

    Brightness is in units of the reference's modulation, above ``dark`` of them.
    """

    spline: NDArray[np.float32]
    """(h, w + 3) coefficients of the smoothed reference, see ``spline_coefficients``."""
    object: NDArray[np.float32]
    reference_ok: ByteMap
    object_ok: ByteMap
    period_px: float
    modulation: float
    """Counts."""
    reference_noise: float
    """Variance of the captured reference."""
    reference_left: float
    """Variance that smoothing leaves of it in single pixels."""
    object_noise: float
    """Variance."""
    dark: float
    """Brightness that is 0 here: that of the reference's mean, or no light."""
    albedo: NDArray[np.float32] | None = None
    """Albedo that a white frame has shown, (h, w); the brightness is above no light then."""

    @staticmethod
    def of(pair: PreparedPair) -> Windows:
        """Normalise a pair; its brightness is above the mean of the reference, or above no light
        where the albedo is known."""
        modulation, mean = pair.modulation, pair.mean_brightness
        reference_noise, object_noise = pair.noise
        captured, albedo = pair.object, None
        if pair.albedo is not None:
            captured, mean, albedo = pair.object * pair.albedo, 0.0, pair.albedo.astype(np.float32)
            object_noise = noise_variance(captured, pair.object_ok)
        unit = modulation**2
        noise = max(reference_noise / unit, MIN_NOISE**2)
        width = _reference_width(pair.period, noise)
        smooth = smooth_reference(pair.reference, width)
        smooth -= mean
        smooth /= modulation

        def normalised(counts: FloatMap) -> FloatMap:
            return (counts.astype(np.float64) - mean) / modulation

        return Windows(
            spline_coefficients(smooth),
            by_bands(normalised, captured, dtype=np.float32),
            (pair.reference_ok & ~pair.reference_empty).astype(np.uint8),
            (pair.object_ok & ~pair.object_empty).astype(np.uint8),
            pair.period,
            modulation,
            noise,
            noise * _noise_left(width),
            max(object_noise / unit, MIN_NOISE**2),
            dark=mean / modulation,
            albedo=albedo,
        )

    def above_dark(self) -> Windows:
        """The same frames with 0 for no light: paint scales them, and adds nothing."""
        dark = np.float32(self.dark)
        return replace(self, spline=self.spline + dark, object=self.object + dark, dark=0.0)

    @property
    def pair(self) -> _core._Pair:
        """The pair for the kernels, without an albedo."""
        return {
            "spline": self.spline,
            "object": self.object,
            "reference_ok": self.reference_ok,
            "object_ok": self.object_ok,
            "albedo": None,
        }

    def fit(
        self,
        start_px: NDArray[np.float32],
        widths: Sequence[float],
        *,
        albedo: NDArray[np.float32] | None = None,
        walls: ByteMap | None = None,
        iterations: int = 1,
        confidence: float = CONFIDENCE,
    ) -> Fitted:
        """Fit the windows of all widths, from coarse to fine.

        Parameters
        ----------
        start_px : (h, w) float32 array
            Displacement to start from, px; finite.
        widths : sequence of float
            Widths σ of the windows, px, falling.
        albedo : (h, w) float32 array > 0, optional
            Albedo of the object over that of the reference, β; that of ``self`` by default.
        walls : (h, w) uint8 array, optional
            1 for pixels that no window sees or sees past.
        iterations, confidence
            As for ``windowed``.
        """
        return Fitted(
            *_core.invert_windowed(
                {**self.pair, "albedo": self.albedo if albedo is None else albedo},
                start_px,
                {
                    "scales": widths,
                    "iterations": iterations,
                    "period": self.period_px,
                    "confidence": confidence,
                    "limits": {
                        "object_noise": self.object_noise,
                        "reference_noise": self.reference_noise,
                        "reference_left": self.reference_left,
                        "drift": DRIFT,
                        "max_sigma": MAX_SIGMA * self.period_px,
                        "min_explained": MIN_EXPLAINED,
                    },
                },
                walls,
            )
        )

    def left(
        self, fitted: Fitted, albedo: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """What the kept windows leave of the object, (h, w), in modulations; NaN without data."""
        albedo = self.albedo if albedo is None else albedo
        value, _, known = self.warp(fitted.displacement_px)
        model = value
        model *= fitted.modulation_ratio
        model += fitted.offset
        if albedo is not None:
            model *= albedo
        np.subtract(self.object, model, out=model)
        model[known == 0] = np.nan
        return model

    def warp(
        self, displacement_px: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], ByteMap]:
        """Reference and its slope per px at the matching points, (h, w), and 1 where both frames
        have a sample; 0 elsewhere."""
        return _core.warp_windowed(self.pair, displacement_px)


def _reference_width(period_px: float, noise: float) -> float:
    """Width σ of the reference's low-pass, px, for a variance of its noise in squared modulations.

    Notes
    -----
    The low-pass leaves a variance ``SLOPE_NOISE`` · noise / width⁴ of the slope's noise beside the
    mean square ½(2π/p)² of the slope itself.
    """
    slope = 0.5 * (2.0 * np.pi / period_px) ** 2
    needed = (SLOPE_NOISE * noise / (MAX_DILUTION * slope)) ** 0.25
    least, most = (share * period_px for share in REFERENCE_SMOOTHING)
    return float(np.clip(needed, least, most))


def _low_pass(q: FloatMap) -> FloatMap:
    """Response of the low-pass at q = (σk)²/2."""
    return np.exp(-q) * (1.0 + q + 0.5 * q * q)


def _noise_left(width_px: float) -> float:
    """Share of the variance of white noise that the low-pass leaves in single pixels, 0…1."""
    k = np.linspace(0.0, np.pi, FREQUENCIES) * width_px
    return float(np.mean(_low_pass(0.5 * (k[:, None] ** 2 + k**2)) ** 2))


def smooth_reference(frame: FloatMap, width_px: float) -> FloatMap:
    """Low-pass a frame with a response that is flat to sixth order.

    Parameters
    ----------
    frame : (h, w) float array
    width_px : float > 0
        Width σ of the filter, px.

    Returns
    -------
    (h, w) float64 array

    Notes
    -----
    The response is exp(−q) (1 + q + q²/2) with q = (σk)²/2: the first harmonics of a fringe pass
    almost unchanged, and white noise is reduced.
    """
    required = int(np.ceil(FILTER_REACH * width_px)) + 1
    top, left = (min(required, side - 1) for side in frame.shape)
    # Odd reflection keeps value and slope at the border; even reflection would flatten the fringe.
    padded = np.pad(
        frame.astype(np.float64), ((top, top), (left, left)), mode="reflect", reflect_type="odd"
    )
    rows, columns = padded.shape
    shape = (scipy.fft.next_fast_len(rows, real=True), scipy.fft.next_fast_len(columns, real=True))
    spectrum = scipy.fft.rfft2(padded, s=shape, workers=-1)
    del padded
    ky = 2.0 * np.pi * width_px * scipy.fft.fftfreq(shape[0])[:, None]
    kx = 2.0 * np.pi * width_px * scipy.fft.rfftfreq(shape[1])[None, :]
    spectrum *= _low_pass(0.5 * (ky**2 + kx**2))
    smooth = scipy.fft.irfft2(spectrum, s=shape, overwrite_x=True, workers=-1)
    h, w = frame.shape
    return np.ascontiguousarray(smooth[top : top + h, left : left + w])


def spline_coefficients(rows: FloatMap) -> NDArray[np.float32]:
    """Cubic B-spline coefficients along rows, with one mirrored coefficient before and two after.

    Returns an (h, w + 3) float32 array for (h, w) rows.
    """
    h, w = rows.shape
    padded = np.empty((h, w + 3), np.float32)
    for band in row_bands((h, w), bytes_per_px=24):
        coefficients = scipy.ndimage.spline_filter1d(rows[band.rows], 3, axis=1, mode="mirror")
        padded[band.rows] = np.pad(coefficients, ((0, 0), (1, 2)), mode="reflect")
    return padded
