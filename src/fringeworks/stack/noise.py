"""The noise of a camera, measured from a sample of a stack's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.signal.noise import noise_of_residuals, noise_variance, residual_variance
from fringeworks.stack.fits import DesignRows, fit_matrices, solve, times
from fringeworks.stack.kernel_settings import Decoding, Limits, PhaseFrames
from fringeworks.stack.ripple import harmonics
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap

MIN_JUDGED_PIXELS = 200
"""Smallest number of pixels for a statement about the whole stack.

A variance from 200 residuals errs by 10 %. An empirical choice: more would leave small objects
without a measured noise.
"""

MAX_RESIDUALS = 16_000
"""Approximate largest number of residuals from which the noise is measured: a standard deviation to
about 0.6 %. More only take time."""

BACKGROUND_EXCESS = 4.0
"""Variance of the backgrounds over the spatial noise up to which it counts as noise of the camera.

Spatial noise includes the texture of the scene and is usually the larger one. Backgrounds that
differ by more than twice as much have another cause, such as changing light. An empirical choice.
"""

QUANTISATION_VARIANCE = 1.0 / 12.0
"""Variance that rounding to whole counts adds, counts²."""

DIM = 0.1
"""Smallest mean brightness of a pixel for measuring the noise.

As a share of the 99th percentile. In darker pixels the sensor cuts off the noise at zero counts, so
that it seems too small. An empirical choice.
"""

CLIPPED_SIGMAS = 3.0
"""Distance from the sensor's limits within which it cuts off the noise, standard deviations.

Beyond three, 0.1 % of Gaussian noise is cut off, which lowers its variance by 0.3 %.
"""

MORE_THAN_NOISE = 1.1
"""Residuals over spatial noise from which on harmonics of the fringe are looked for. Empirical."""

HARMONICS = (2, 3, 4)
"""Harmonics of the fringe that are looked for in the residuals; higher ones are weak."""

SMALL_POWER = 1e-6
"""Power of a harmonic outside of the fit, over that of the fringes, below which it is not seen."""

EXPLAINED_BY_HARMONICS = 0.7
"""Share of the residuals' power that harmonics must leave at most to count as their cause."""

ROUGH_STRIDE = 4
"""Every so many pixels give the rough noise that ``CLIPPED_SIGMAS`` needs; a quarter suffices."""

BACKGROUND_PASSES = 2
"""Number of estimates from backgrounds: one from all pixels, one without those near the limits."""


def phase_samples(sample: Sequence[NDArray[Any]], decoding: Decoding) -> FloatMap:
    """The sample of the phase frames, set after set: (frames, n) float array, counts."""
    frames = decoding.phase_frames
    if not frames:
        return np.empty((0, sample[0].size))
    return np.stack([sample[k][0].astype(np.float64) for k in frames])


def bit_sums(sample: Sequence[NDArray[Any]], decoding: Decoding) -> FloatMap:
    """Sums of every bit of the Gray code and its inverse: (bits, n) float array, counts."""
    gray = decoding.gray
    if gray is None or len(gray.inverse) < 2:
        return np.empty((0, sample[0].size))
    pairs = zip(gray.bits, gray.inverse, strict=True)
    return np.stack([sample[a][0].astype(np.float64) + sample[b][0] for a, b in pairs])


def set_parts(decoding: Decoding) -> list[slice]:
    """The rows of ``phase_samples`` that belong to each set."""
    ends = np.cumsum([len(phases.frames) for phases in decoding.sets])
    return [
        slice(int(end) - len(s.frames), int(end))
        for s, end in zip(decoding.sets, ends, strict=True)
    ]


def usable(values: FloatMap, limits: Limits) -> BoolMap:
    """Mark pixels without saturated samples; where those are too few, all finite pixels."""
    finite = np.asarray(np.isfinite(values).all(axis=0))
    inner = finite & (values < limits.saturation).all(axis=0)
    return inner if inner.sum() >= MIN_JUDGED_PIXELS else finite


def measure_noise(
    decodings: dict[Axis, Decoding],
    values: dict[Axis, FloatMap],
    bits: dict[Axis, FloatMap],
    limits: Limits,
    spatial: CameraNoise,
) -> tuple[CameraNoise, str]:
    """Measure the noise of the camera, and name the source of the result.

    Parameters
    ----------
    decodings : decoding of each axis
    values : ``phase_samples`` of each axis
    bits : ``bit_sums`` of each axis
    limits : Limits
    spatial : CameraNoise
        Noise from the differences of neighbouring pixels.

    Returns
    -------
    noise : CameraNoise
    source : str
        "the residuals of the fits", from sets of four or more steps. Otherwise "the backgrounds of
        the sets", from the differences of their backgrounds. Otherwise spatial noise, "the
        differences of neighbouring pixels".
    """
    margin = CLIPPED_SIGMAS * max(spatial.read_counts, QUANTISATION_VARIANCE**0.5)
    for axis, decoding in decodings.items():
        noise = _residual_noise(decoding, values[axis], limits, margin)
        if noise is not None:
            return noise, "the residuals of the fits"
    for axis, decoding in decodings.items():
        noise = _pair_noise(decoding, bits[axis])
        if noise is not None:
            return noise, "the sums of the Gray code's bits and their inverse"
    for axis, decoding in decodings.items():
        noise = _background_noise(decoding, values[axis], limits)
        if noise is None:
            continue
        variance = noise.variance(float(np.mean(values[axis])))
        largest = BACKGROUND_EXCESS * max(spatial.read_counts**2, QUANTISATION_VARIANCE)
        if variance > largest:
            return spatial, (
                "the differences of neighbouring pixels, because the backgrounds of the sets "
                "differ by more"
            )
        return noise, "the backgrounds of the sets"
    return spatial, "the differences of neighbouring pixels"


def _pair_noise(decoding: Decoding, sums: FloatMap) -> CameraNoise | None:
    """Noise from a Gray code without fringes, whose bits and inverse add up to the same light."""
    finite = np.isfinite(sums).all(axis=0)
    if decoding.sets or len(sums) < 2 or finite.sum() < MIN_JUDGED_PIXELS:
        return None
    data = sums[:, finite]
    data = data[:, _lit(data, np.ones(data.shape[1], bool))]
    mean = data.mean(axis=0)
    square = np.sum((data - mean) ** 2, axis=0) / 2.0
    return noise_of_residuals(mean / 2.0, square, len(sums) - 1, QUANTISATION_VARIANCE**0.5)


def spatial_noise(patch: Sequence[FloatMap]) -> CameraNoise:
    """Noise from the differences of neighbouring pixels; it contains the texture of the scene.

    Parameters
    ----------
    patch : (h, w) float arrays
        Connected pixels of some frames, counts.
    """
    variances = [noise_variance(frame, np.asarray(np.isfinite(frame))) for frame in patch]
    return CameraNoise(float(np.sqrt(np.mean(variances))) if variances else 0.0)


def _residual_noise(
    decoding: Decoding, values: FloatMap, limits: Limits, margin: float
) -> CameraNoise | None:
    """Noise from the residuals of sets with four or more steps; None where there are none.

    Near the sensor's limits the noise is cut off. Leaving out samples by their own value would bias
    the result, because noise decides which ones stay. Samples are therefore chosen by their fitted
    brightness.
    """
    overdetermined = [
        (part, phases)
        for part, phases in zip(set_parts(decoding), decoding.sets, strict=True)
        if len(phases.frames) > 3
    ]
    finite = np.asarray(np.isfinite(values).all(axis=0))
    if not overdetermined or finite.sum() < MIN_JUDGED_PIXELS:
        return None
    data = values[:, _lit(values, finite)]
    data = data[:, :: max(1, data.shape[1] * len(overdetermined) // MAX_RESIDUALS)]
    fits = [_clear_fit(data[part], phases, limits, margin) for part, phases in overdetermined]
    background, square, count = (np.concatenate(parts) for parts in zip(*fits, strict=True))
    freedom = count - 3
    pixels = np.bincount(np.maximum(freedom, 0))[1:]
    if pixels.size == 0 or pixels.max() < MIN_JUDGED_PIXELS:
        return None
    # Pixels of one freedom, so that their sums follow one distribution: those with most residuals.
    chosen_freedom = int(np.argmax(pixels * np.arange(1, pixels.size + 1))) + 1
    chosen = freedom == chosen_freedom
    return noise_of_residuals(
        background[chosen], square[chosen], chosen_freedom, QUANTISATION_VARIANCE**0.5
    )


def _lit(values: FloatMap, finite: BoolMap) -> BoolMap:
    """Mark finite pixels that are not dim; where those are too few, all finite pixels."""
    brightness = np.where(finite, values, 0.0).mean(axis=0)
    lit = np.asarray(finite & (brightness > DIM * np.percentile(brightness[finite], 99)))
    return lit if lit.sum() >= MIN_JUDGED_PIXELS else finite


def _clear_fit(
    values: FloatMap, phases: PhaseFrames, limits: Limits, most: float
) -> tuple[FloatMap, FloatMap, NDArray[np.intp]]:
    """Fit a set without the samples near the sensor's limits.

    Samples count as near within three standard deviations of the residuals, but at most ``most``
    counts: residuals that are not noise must not empty the sample. Returns the background, the sum
    of squared residuals and the number of samples of every pixel. The background is that of all
    samples.
    """
    steps = len(phases.frames)
    fitted, square = solve(values, phases.rows)
    count = np.full(square.shape, steps)
    rough = residual_variance(square[::ROUGH_STRIDE], steps - 3) ** 0.5
    inside = _inside(values, phases.rows, fitted, limits, min(CLIPPED_SIGMAS * rough, most))
    whole = inside.all(axis=0)
    if not whole.all():
        square, count = _solve_partly(values, phases.rows, inside)
    if whole.sum() >= MIN_JUDGED_PIXELS and CLIPPED_SIGMAS * rough > MORE_THAN_NOISE * most:
        # More than noise: harmonics of the fringe are known causes, and most of them do not
        # disturb the phase.
        square[whole] = _without_harmonics(values[:, whole], phases, fitted[:, whole])
        count[~whole] = 0
    return fitted[0], square, count


def _without_harmonics(values: FloatMap, phases: PhaseFrames, fitted: FloatMap) -> FloatMap:
    """Sums of squared residuals without the harmonics that all pixels have in common.

    A response that is not linear adds harmonics Re(h_k B e^{ik(φ − δ_n)}), with the same h_k at all
    pixels of similar brightness.
    """
    design, solver = fit_matrices(phases.rows)
    assert solver is not None
    residual = values - times(design, fitted)
    _, c, s = fitted
    modulation = np.hypot(c, s)
    waves = np.exp(1j * (np.arctan2(s, c) - np.asarray(phases.shifts_rad)[:, None]))
    total = np.sum(residual**2)
    for harmonic in harmonics(waves, HARMONICS):
        wave = modulation * harmonic
        wave = (
            wave
            - times(design, times(solver, wave.real))
            - 1j * times(design, times(solver, wave.imag))
        )
        power = float(np.sum(np.abs(wave) ** 2))
        if power > SMALL_POWER * float(np.sum(modulation**2)):
            parts = np.stack((wave.real.ravel(), wave.imag.ravel()))
            shares = np.linalg.lstsq(parts @ parts.T, parts @ residual.ravel(), rcond=None)[0]
            residual = residual - shares[0] * wave.real - shares[1] * wave.imag
    if np.sum(residual**2) > EXPLAINED_BY_HARMONICS * total:
        return np.asarray(np.sum((values - times(design, fitted)) ** 2, axis=0))
    return np.asarray(np.sum(residual**2, axis=0))


def _inside(
    values: FloatMap,
    rows: DesignRows,
    fitted: FloatMap,
    limits: Limits,
    margin: float,
) -> BoolMap:
    """Mark samples whose fitted brightness keeps a margin (counts) to both limits of the sensor."""
    if not np.isfinite(limits.saturation) or (
        values.min() > 0 and values.max() < limits.saturation
    ):
        return np.ones(values.shape, bool)
    brightness = times(fit_matrices(rows)[0], fitted)
    return np.asarray((brightness > margin) & (brightness < limits.saturation - margin))


def _solve_partly(
    values: FloatMap, rows: DesignRows, inside: BoolMap
) -> tuple[FloatMap, NDArray[np.intp]]:
    """Fit every pixel to the samples that are inside.

    Returns the sum of squared residuals and the number of samples of every pixel; the number is 0
    where the samples leave no residual.
    """
    count = np.where(inside.sum(axis=0) > 3, inside.sum(axis=0), 0)
    square = np.zeros(values.shape[1])
    # Pixels that lack the same samples share a fit.
    bits = np.int64(1) << np.arange(len(rows), dtype=np.int64)
    _, first, group = np.unique(bits @ inside, return_index=True, return_inverse=True)
    for k, place in enumerate(first):
        kept = inside[:, place]
        design, solver = fit_matrices(rows, tuple(kept.tolist()))
        if len(design) <= 3 or solver is None:
            count[group == k] = 0
            continue
        pixels = np.flatnonzero(group == k)
        data = values[np.ix_(kept, pixels)]
        square[pixels] = np.sum((data - times(design, times(solver, data))) ** 2, axis=0)
    return square, count


def _background_noise(decoding: Decoding, values: FloatMap, limits: Limits) -> CameraNoise | None:
    """Noise from the differences of the sets' backgrounds; None where there is one set only."""
    if len(decoding.sets) < 2:
        return None
    finite = np.isfinite(values).all(axis=0)
    data = values[:, finite]
    parts = set_parts(decoding)
    fits = [solve(data[p], s.rows)[0] for p, s in zip(parts, decoding.sets, strict=True)]
    steps = np.array([len(s.frames) for s in decoding.sets], float)[:, None]
    background = np.sum(steps * np.stack([f[0] for f in fits]), axis=0) / steps.sum()
    chosen = np.ones(data.shape[1], bool)
    for _ in range(BACKGROUND_PASSES):
        if chosen.sum() < MIN_JUDGED_PIXELS:
            return None
        mean = background[chosen]
        square = sum(n * (f[0][chosen] - mean) ** 2 for n, f in zip(steps[:, 0], fits, strict=True))
        noise = noise_of_residuals(mean, square, len(fits) - 1, QUANTISATION_VARIANCE**0.5)
        margin = CLIPPED_SIGMAS * residual_variance(square, len(fits) - 1) ** 0.5
        # The fitted brightness is that around the mean background. The differences of the
        # backgrounds do not depend on it, whereas a fit of three samples reproduces them exactly,
        # noise included, so that noise would decide which ones are inside.
        inside = [
            _inside(data[p], s.rows, np.stack((background, f[1], f[2])), limits, margin)
            for p, s, f in zip(parts, decoding.sets, fits, strict=True)
        ]
        clear = np.logical_and.reduce([part.all(axis=0) for part in inside])
        if clear.all() or clear.sum() < MIN_JUDGED_PIXELS:
            break
        chosen = clear
    return noise
