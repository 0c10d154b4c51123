"""The noise of a camera, measured from a sample of a stack's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.signal.noise import (
    BRIGHTNESS_GROUPS,
    GAIN_SIGMAS,
    MIN_BRIGHTNESS_SPREAD,
    noise_of_residuals,
    noise_variance,
)
from fringeworks.stack.fits import (
    DesignRows,
    SampleFit,
    fit_matrices,
    gram,
    parts_of_orders,
    samples_at,
    times,
)
from fringeworks.stack.kernel_settings import MIN_SNR, Decoding, Limits, PhaseFrames
from fringeworks.stack.sample import Sample
from fringeworks.stack.stretch_noise import LOCAL_SHARE, squares_of_pieces
from fringeworks.statistics.chi_square import residual_variance
from fringeworks.statistics.groups import equal_groups
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, quantile
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap

DIFFERENCE_GAIN = 36.0
"""Variance of the product of second differences along x and y, over that of white noise."""
MEDIAN_INFORMATION = 0.37 / 4.0
"""Information of a product of second differences in a median, over that of an independent residual:
the median uses 37 % of it, and about four neighbouring products share their noise."""
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

ROUGH_STRIDE = 4
"""Every so many pixels give the rough noise that ``CLIPPED_SIGMAS`` needs; a quarter suffices."""

LOST = 0.02
"""Share of pixels that the noise of the whole frame must lose before that of pieces replaces it.

The larger one is kept otherwise: it covers what uneven harmonics do to phases, too. Without this,
one of 33 simulated photographs was refused for sets that disagree.
"""

WHOLE_CONTRAST = 0.9
"""Share of a pixel's largest difference of a bit and its inverse, from which on both add up to the
light of white and black.

A projector that resamples the pattern before its γ shows fine stripes too dark: at a contrast c
before it, a bit and its inverse add up to ((1 + c)/2)^γ + ((1 - c)/2)^γ. With γ = 2.2 that is 0.9
at c = 0.9 and 0.6 at 0.5.
"""

EXPOSURE_PASSES = 2
"""Number of estimates of the exposures: the first one takes the light from uneven sums."""

BACKGROUND_PASSES = 2
"""Number of estimates from backgrounds: one from all pixels, one without those near the limits."""


def neighbour_noise(patch: Sequence[FloatMap], limits: Limits, rough: CameraNoise) -> CameraNoise:
    """Noise as a function of brightness, from the differences of neighbouring pixels.

    Parameters
    ----------
    patch : (h, w) float arrays
        Connected pixels of some frames, counts.
    limits : Limits
    rough : CameraNoise
        The same without regard to brightness; returned where too few pixels keep their distance
        from the sensor's limits, which cut off the noise.

    Returns
    -------
    CameraNoise; it contains the texture of the scene.

    Notes
    -----
    σ² = read² + gain · I by weighted least squares over groups of similar brightness. Variances are
    medians of products of second differences (Immerkær, CVIU 64, 1996).
    """
    brightness, off = (np.concatenate(v) for v in zip(*map(_differences, patch), strict=True))
    margin = CLIPPED_SIGMAS * rough.read_counts
    inside = (brightness > limits.darkest + margin) & ~(brightness > limits.saturation - margin)
    if inside.sum() < MIN_JUDGED_PIXELS:
        return rough
    brightness, off = brightness[inside], off[inside]
    order = np.argsort(brightness, kind="stable")
    groups = np.array_split(order, min(BRIGHTNESS_GROUPS, order.size // MIN_JUDGED_PIXELS))
    mean = np.array([brightness[group].mean() for group in groups])
    variance = np.array([_variance(off[group]) for group in groups])
    constant = CameraNoise(_variance(off) ** 0.5)
    if np.ptp(mean) < MIN_BRIGHTNESS_SPREAD * mean.max() or not (variance > 0.0).all():
        return constant
    design = np.stack((np.ones_like(mean), mean), axis=1)
    size = MEDIAN_INFORMATION * np.array([group.size for group in groups])
    weighted = design.T * (size / (2.0 * variance**2))
    read, gain = np.linalg.solve(weighted @ design, weighted @ variance)
    error = np.linalg.inv(weighted @ design)[1, 1] ** 0.5
    if gain < GAIN_SIGMAS * error:
        return constant
    if read < 0.0:
        read, gain = 0.0, float(weighted[1] @ variance / (weighted[1] @ mean))
    return CameraNoise(float(read) ** 0.5, float(gain))


def _differences(frame: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Mean brightness of 3 × 3 pixels, counts, and magnitude of the product of second differences,
    of every neighbourhood that is finite."""
    if min(frame.shape) < 3:
        return np.empty(0), np.empty(0)
    mean = scipy.ndimage.uniform_filter(frame, 3)[1:-1, 1:-1]
    off = np.abs(np.diff(np.diff(frame, 2, axis=0), 2, axis=1))
    finite = np.isfinite(off) & np.isfinite(mean)
    return mean[finite], off[finite]


def _variance(off: FloatMap) -> float:
    """Variance of a pixel, counts², from products of second differences."""
    median = float(np.partition(off, off.size // 2)[off.size // 2])  # one of the values
    if median > 0.0 and not (off % 1.0).any():
        # Whole numbers: the place of the median within its count.
        median += float((0.5 - np.mean(off < median)) / np.mean(off == median)) - 0.5
    return (median / NORMAL_MEDIAN) ** 2 / DIFFERENCE_GAIN


def usable(fit: SampleFit, limits: Limits) -> BoolMap:
    """Mark pixels without saturated samples; where those are too few and samples may only touch
    the sensor's limit, all finite pixels."""
    finite = fit.finite
    inner = np.asarray(finite & (fit.largest < limits.saturation))
    enough = limits.given or np.count_nonzero(inner) >= MIN_JUDGED_PIXELS
    return inner if enough else finite


def _finite_fits(decoding: Decoding, sample: Sample) -> tuple[NDArray[np.intp], list[SampleFit]]:
    """Indices of the pixels whose samples are finite in all sets, and the fits there."""
    fits = [sample.fits.of(phases) for phases in decoding.sets]
    finite = [fit.finite for fit in fits] or [np.zeros(sample.points[0].size, bool)]
    pixels = np.flatnonzero(np.logical_and.reduce(finite))
    return pixels, [fit.at(pixels) for fit in fits]


def _brightness(fits: list[SampleFit], decoding: Decoding) -> FloatMap:
    """Mean of the samples of all phase frames of every pixel, (n,) array, counts."""
    total = sum(len(s.frames) * fit.mean for s, fit in zip(decoding.sets, fits, strict=True))
    return np.asarray(total / len(decoding.phase_frames))


def measure_noise(
    decodings: dict[Axis, Decoding], sample: Sample, limits: Limits, spatial: CameraNoise
) -> tuple[CameraNoise, str]:
    """Measure the noise of the camera, and name the source of the result.

    Parameters
    ----------
    decodings : decoding of each axis
    sample : Sample
    limits : Limits
    spatial : CameraNoise
        Noise from the differences of neighbouring pixels.

    Returns
    -------
    noise : CameraNoise
    source : str
        "the residuals of the fits", from sets of four or more steps. Otherwise "the sums of the
        Gray code's bits and their inverse", for a Gray code without fringes. Otherwise "the
        backgrounds of the sets", from the differences of their backgrounds. Otherwise spatial
        noise, "the differences of neighbouring pixels".
    """
    margin = CLIPPED_SIGMAS * max(spatial.read_counts, QUANTISATION_VARIANCE**0.5)
    for decoding in decodings.values():
        noise = _residual_noise(decoding, sample, limits, margin)
        if noise is not None:
            return _local(noise, decoding, sample, limits, margin), "the residuals of the fits"
    for decoding in decodings.values():
        noise = _pair_noise(decoding, sample, limits)
        if noise is not None:
            return noise, "the sums of the Gray code's bits and their inverse"
    for decoding in decodings.values():
        _, fits = _finite_fits(decoding, sample)
        clear = _unsaturated(fits, limits)
        fits = [fit.at(np.flatnonzero(clear)) for fit in fits]
        noise = _background_noise(decoding, fits, limits)
        if noise is None:
            continue
        variance = noise.variance(float(np.mean(_brightness(fits, decoding))))
        largest = BACKGROUND_EXCESS * max(spatial.read_counts**2, QUANTISATION_VARIANCE)
        if variance > largest:
            return spatial, (
                "the differences of neighbouring pixels, because the backgrounds of the sets "
                "differ by more"
            )
        return noise, "the backgrounds of the sets"
    return spatial, "the differences of neighbouring pixels"


def _pair_noise(decoding: Decoding, sample: Sample, limits: Limits) -> CameraNoise | None:
    """Noise from a Gray code without fringes, whose bits and inverse add up to the same light."""
    gray = decoding.gray
    if decoding.sets or gray is None or len(gray.inverse) < 2:
        return None
    points = sample.below(limits.saturation)
    bits, inverse = (
        np.stack([points[k][0].astype(np.float64) for k in frames])
        for frames in (gray.bits, gray.inverse)
    )
    known = np.isfinite(bits).all(axis=0) & np.isfinite(inverse).all(axis=0)
    if np.count_nonzero(known) < MIN_JUDGED_PIXELS:
        return None
    bits, inverse = bits[:, known], inverse[:, known]
    lit = _lit(np.asarray((bits + inverse).mean(axis=0)))
    bits, inverse = bits[:, lit], inverse[:, lit]
    # Stripes that the projector's scaler makes darker add up to less with their inverse.
    contrast = np.abs(bits - inverse)
    whole = contrast > WHOLE_CONTRAST * contrast.max(axis=0)
    sums = _of_one_exposure(bits, inverse, whole)
    count = whole.sum(axis=0)
    pixels = np.bincount(count)
    if pixels[2:].max(initial=0) < MIN_JUDGED_PIXELS:
        return None
    # Pixels of one number of pairs, so that their sums follow one distribution.
    pairs = int(np.argmax((pixels * (np.arange(pixels.size) - 1))[2:])) + 2
    sums, whole = sums[:, count == pairs], whole[:, count == pairs]
    mean = np.sum(sums * whole, axis=0) / pairs
    square = np.sum((sums - mean) ** 2 * whole, axis=0) / 2.0
    return noise_of_residuals(mean / 2.0, square, pairs - 1, QUANTISATION_VARIANCE**0.5)


def _of_one_exposure(bits: FloatMap, inverse: FloatMap, whole: BoolMap) -> FloatMap:
    """Sums of bits and their inverse, (pairs, n), as if all frames had one exposure.

    A bit and its inverse add up to the light S of the white and the black frame. Where the exposure
    or the lamp changes from frame to frame, to gains e and e', their sum is
    ½ (e + e') S + ½ (e − e') D', with the difference D' that both would have. Least squares over
    the pixels of which a pair is ``whole`` gives both factors.
    """
    sums = bits + inverse
    even = sums
    for _ in range(EXPOSURE_PASSES):
        light = np.mean(even, axis=0, where=whole)
        last = sums.copy()
        for k, difference in enumerate(bits - inverse):
            if np.count_nonzero(whole[k]) < MIN_JUDGED_PIXELS:
                continue
            design = np.stack((light, difference))[:, whole[k]]
            share, tilt = np.linalg.lstsq(design.T, sums[k, whole[k]], rcond=None)[0]
            last[k] = (sums[k] - tilt * difference) / share
        even = last
    return even


def spatial_noise(patch: Sequence[FloatMap], *, below: float | None = None) -> CameraNoise:
    """Noise from the differences of neighbouring pixels; it contains the texture of the scene.

    Parameters
    ----------
    patch : (h, w) float arrays
        Connected pixels of some frames, counts.
    below : float, optional
        Counts from which on samples are saturated; they do not take part.
    """
    limit = np.inf if below is None else below
    variances = [noise_variance(frame, np.isfinite(frame) & (frame < limit)) for frame in patch]
    return CameraNoise(float(np.sqrt(np.mean(variances))) if variances else 0.0)


def _residual_noise(
    decoding: Decoding, sample: Sample, limits: Limits, margin: float
) -> CameraNoise | None:
    """Noise from the residuals of sets with four or more steps; None where there are none.

    Near the sensor's limits the noise is cut off. Leaving out samples by their own value would bias
    the result, because noise decides which ones stay. Samples are therefore chosen by their fitted
    brightness.
    """
    pixels, fits = _finite_fits(decoding, sample)
    pairs = zip(decoding.sets, fits, strict=True)
    overdetermined = [(phases, fit) for phases, fit in pairs if len(phases.frames) > 3]
    if not overdetermined or pixels.size < MIN_JUDGED_PIXELS:
        return None
    chosen = np.flatnonzero(_lit(_brightness(fits, decoding), _unsaturated(fits, limits)))
    chosen = chosen[:: max(1, chosen.size * len(overdetermined) // MAX_RESIDUALS)]
    pixels = pixels[chosen]
    clear = [
        _clear_fit(sample.fits.planes(phases), pixels, fit.at(chosen), phases, limits, margin)
        for phases, fit in overdetermined
    ]
    background, square, count = (np.concatenate(parts) for parts in zip(*clear, strict=True))
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


def _local(
    noise: CameraNoise, decoding: Decoding, sample: Sample, limits: Limits, margin: float
) -> CameraNoise:
    """The noise; that of short stretches where it is far smaller, as where a part of the scene
    shows the harmonics of the fringes weaker than another one."""
    pixels, fits = _finite_fits(decoding, sample)
    lit = np.zeros(sample.points[0].size, bool)
    lit[pixels[_lit(_brightness(fits, decoding), _unsaturated(fits, limits))]] = True
    found = []
    for phases in decoding.sets:
        if len(phases.frames) > 3:
            fit = sample.fits.of(phases)
            used = lit & (fit.largest < limits.saturation)
            if used.any() and _at_limits(fit.at(np.flatnonzero(used)), limits):
                used &= _inside(fit.fitted, phases.rows, limits, margin).all(axis=0)
            planes = sample.fits.planes(phases)
            at, square = squares_of_pieces(planes, fit.fitted, phases.rows, used)
            found.append((len(phases.frames) - 3, fit.fitted[0, at], square))
    freedom = max(f for f, _, _ in found)
    brightness = np.concatenate([b for f, b, _ in found if f == freedom])
    square = np.concatenate([s for f, _, s in found if f == freedom])
    if square.size < MIN_JUDGED_PIXELS:
        return noise
    local = noise_of_residuals(brightness, square, freedom, QUANTISATION_VARIANCE**0.5)
    middle = float(np.median(brightness))
    if local.variance(middle) > LOCAL_SHARE * noise.variance(middle):
        return noise
    return local if _lost(noise, decoding, fits) > _lost(local, decoding, fits) + LOST else noise


def _lost(noise: CameraNoise, decoding: Decoding, fits: list[SampleFit]) -> float:
    """Share of the pixels whose modulation is too small for a noise, in any set."""
    dark = np.zeros(fits[0].mean.shape, bool)
    for phases, fit in zip(decoding.sets, fits, strict=True):
        variance = noise.variance(fit.fitted[0]) * 2.0 / len(phases.frames)
        dark |= fit.power < MIN_SNR**2 * variance
    return float(np.mean(dark))


def _unsaturated(fits: list[SampleFit], limits: Limits) -> BoolMap:
    """Mark pixels whose samples are all below the saturation; where those are too few, all."""
    clear = np.logical_and.reduce([fit.largest < limits.saturation for fit in fits])
    few = np.count_nonzero(clear) < MIN_JUDGED_PIXELS
    return np.ones(clear.shape, bool) if few else np.asarray(clear)


def _lit(brightness: FloatMap, unsaturated: BoolMap | slice = slice(None)) -> BoolMap:
    """Mark pixels that are not dim beside the unsaturated ones; where those are too few, all."""
    lit = np.asarray(brightness > DIM * quantile(brightness[unsaturated], 0.99))
    return lit if np.count_nonzero(lit) >= MIN_JUDGED_PIXELS else np.ones(lit.shape, bool)


def _clear_fit(
    planes: list[NDArray[Any]],
    pixels: NDArray[np.intp],
    fit: SampleFit,
    phases: PhaseFrames,
    limits: Limits,
    most: float,
) -> tuple[FloatMap, FloatMap, NDArray[np.intp]]:
    """Fit a set without the samples near the sensor's limits.

    Samples count as near within three standard deviations of the residuals, but at most ``most``
    counts: residuals that are not noise must not empty the sample. Returns the background, the sum
    of squared residuals and the number of samples of every pixel. The background is that of all
    samples.
    """
    steps = len(phases.frames)
    square, count = fit.square.copy(), np.full(fit.square.shape, steps)
    rough = residual_variance(square[::ROUGH_STRIDE], steps - 3) ** 0.5
    margin = min(CLIPPED_SIGMAS * rough, most)
    whole: BoolMap = np.ones(square.shape, bool)
    if _at_limits(fit, limits):
        inside = _inside(fit.fitted, phases.rows, limits, margin)
        whole = np.asarray(inside.all(axis=0))
        partly = np.flatnonzero(~whole)
        if phases.harmonics:
            count[partly] = 0  # without all samples, the shares of the harmonics are others
        elif partly.size:
            found = _solve_partly(planes, pixels[partly], phases.rows, inside[:, partly])
            square[partly], count[partly] = found
    return fit.fitted[0], square, count


def _at_limits(fit: SampleFit, limits: Limits) -> bool:
    """Whether a sample reaches a limit of the sensor."""
    darkest, largest = float(fit.smallest.min()), float(fit.largest.max())
    return darkest <= limits.darkest or largest >= limits.saturation


def _inside(fitted: FloatMap, rows: DesignRows, limits: Limits, margin: float) -> BoolMap:
    """Mark samples whose fitted brightness keeps a margin (counts) to both limits of the sensor."""
    design, _ = fit_matrices(rows)
    low, high = limits.darkest + margin, limits.saturation - margin
    a, c, s = (np.ascontiguousarray(row) for row in fitted)
    return _core.fitted_inside((a, c, s), design, low=low, high=high)


def _solve_partly(
    planes: list[NDArray[Any]], chosen: NDArray[np.intp], rows: DesignRows, inside: BoolMap
) -> tuple[FloatMap, NDArray[np.intp]]:
    """Fit every chosen pixel to the samples that are inside.

    Returns the sum of squared residuals and the number of samples of every pixel; the number is 0
    where the samples leave no residual.
    """
    count = np.where(inside.sum(axis=0) > 3, inside.sum(axis=0), 0)
    square = np.zeros(chosen.size)
    if not count.any():
        return square, count
    values = samples_at(planes, chosen)
    # Pixels that lack the same samples share a fit.
    bits = np.int64(1) << np.arange(len(rows), dtype=np.int64)
    first, group = equal_groups(bits @ inside)
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


def _background_noise(
    decoding: Decoding, fits: list[SampleFit], limits: Limits
) -> CameraNoise | None:
    """Noise from the differences of the sets' backgrounds; None where there is one set only."""
    if len(decoding.sets) < 2:
        return None
    steps = np.array([len(s.frames) for s in decoding.sets])
    backgrounds = _of_one_light(steps, fits)
    background = steps @ backgrounds / steps.sum()
    square = steps @ (backgrounds - background) ** 2
    chosen = np.ones(background.shape, bool)
    for _ in range(BACKGROUND_PASSES):
        if np.count_nonzero(chosen) < MIN_JUDGED_PIXELS:
            return None
        part = np.asarray(square)[chosen]
        noise = noise_of_residuals(
            background[chosen], part, len(fits) - 1, QUANTISATION_VARIANCE**0.5
        )
        margin = CLIPPED_SIGMAS * residual_variance(part, len(fits) - 1) ** 0.5
        clear = _clear_of_limits(decoding, fits, background, limits, margin)
        if clear.all() or np.count_nonzero(clear) < MIN_JUDGED_PIXELS:
            break
        chosen = clear
    return noise


def _of_one_light(steps: NDArray[np.intp], fits: list[SampleFit]) -> FloatMap:
    """Backgrounds of the sets, (M, n), as if all frames had one exposure and one light of the room.

    Light that differs from set to set adds a constant and a share of the background. A response
    that is not linear adds the harmonic that N steps take for light, h_N B cos(Nφ + ψ). All shares
    follow from the differences of the backgrounds, by least squares.
    """
    backgrounds = np.stack([fit.fitted[0] for fit in fits])
    mean = steps / steps.sum()
    light = mean @ backgrounds
    added = np.stack(
        [
            (
                *parts_of_orders(fit.fitted[1] + 1j * fit.fitted[2], (int(n),)),
                light,
                0.0 * light + 1,
            )
            for n, fit in zip(steps, fits, strict=True)
        ]
    )
    # What each term adds to the background of its set less the mean of all, (4 M, M, n).
    apart = np.eye(len(steps)) - mean
    seen = (apart[:, None, :, None] * added[:, :, None, :]).reshape(-1, *backgrounds.shape)
    off = backgrounds - light
    products = gram(np.concatenate((seen.reshape(len(seen), -1), off.reshape(1, -1))))
    size = np.sqrt(np.maximum(np.diag(products)[:-1], np.finfo(float).tiny))
    normal, projected = products[:-1, :-1] / np.outer(size, size), products[:-1, -1] / size
    shares = (np.linalg.lstsq(normal, projected, rcond=None)[0] / size).reshape(len(steps), -1)
    return np.asarray(backgrounds - np.einsum("mk,mkn->mn", shares, added))


def _clear_of_limits(
    decoding: Decoding,
    fits: list[SampleFit],
    background: FloatMap,
    limits: Limits,
    margin: float,
) -> BoolMap:
    """Mark pixels whose fitted samples keep a margin (counts) to the sensor's limits in all sets.

    The fitted brightness is that around the mean background. The differences of the backgrounds do
    not depend on it, whereas a fit of three samples reproduces them exactly, noise included, so
    that noise would decide which ones are inside.
    """
    clear = np.ones(background.shape, bool)
    for fit, phases in zip(fits, decoding.sets, strict=True):
        if _at_limits(fit, limits):
            around = np.stack((background, fit.fitted[1], fit.fitted[2]))
            clear &= _inside(around, phases.rows, limits, margin).all(axis=0)
    return clear
