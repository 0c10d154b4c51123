"""The counts at which the sensor saturates, and whether light exceeds them or only touches them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import DesignRows, fit_matrices, samples_at, times
from fringeworks.stack.kernel_settings import Decoding, Limits
from fringeworks.stack.sample import Sample
from fringeworks.statistics.quantiles import median
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap

NO_LEVEL = 0.02
"""Distance from darkness and from the limit, as a share of the limit, from which on a sample shows
neither level of a picture: blur and the paint of a scene make such samples."""

RARE = 0.01
"""Share of samples at the sensor's limit that may exceed it in a stack without saturation.

It allows for chance and for a small highlight. An empirical choice.
"""

EXCEEDED_SIGMAS = 4.0
"""Excess over the sensor's limit from which on a sample counts as cut off, standard deviations.

Noise alone reaches it in 0.003 % of the samples, far below ``RARE``.
"""

SPIKE = 3.0
"""Smallest ratio of the number of samples with the largest value to that of the value below.

Rounded fringes that are not cut off reach 2.4 at their crests: √1 to √2 − √1, by the phases within
one and two counts of the crest.
"""

FEWEST_CUT = 10
"""Smallest number of samples with the largest value that counts as a spike. Empirical."""

BANDS = 32
"""Number of bands of brightness in which the response below the saturation is looked at; one is as
wide as the noise of an 8-bit camera."""

LINEAR_BANDS = 12, 22
"""Bands whose response is the reference: of the lower bands, the largest samples have little
fringe, and sensors bend above seven tenths of their range only. Empirical."""

TINY = 1e-30
"""Divides instead of a largest count of zero."""

BENT_SIGMAS = 0.5
"""Mean excess of a band from which on its samples are left out, standard deviations of a sample."""

BENT_ERRORS = 4.0
"""The same in standard errors of this mean."""


def saturation_level(decodings: dict[Axis, Decoding], sample: Sample) -> float | None:
    """Return the counts at which the sensor may cut off, also below the largest count of the type.

    Returns
    -------
    float, where the histogram of the fringes or of a Gray code has a spike at its largest value;
    None otherwise. Fringes make none unless they are cut off, or repeated without noise.
    """
    groups = [frames for d in decodings.values() for frames in (d.phase_frames, d.gray_frames)]
    levels = [_spike(_finite_samples(sample, frames)) for frames in groups if frames]
    return max((level for level in levels if level is not None), default=None)


def _finite_samples(sample: Sample, frames: list[int]) -> NDArray[Any]:
    """Samples of some frames at the pixels that are finite in all of them, (N, n)."""
    values = np.concatenate([sample.points[k] for k in frames])
    if values.dtype.kind == "u":
        return values
    return values[:, np.isfinite(values).all(axis=0)]


def _spike(values: NDArray[Any]) -> float | None:
    """The largest value of the samples, where their histogram has a spike there: of single values,
    or of bands where the response bends."""
    if values.size == 0:
        return None
    levels, counts = _distinct(values)
    level, single = float(levels[-1]), counts[-4:]
    top = levels > (1.0 - 4.0 / BANDS) * level
    places = np.minimum((level - levels[top]) * BANDS / max(level, TINY), 3.0).astype(np.intp)
    bands = np.bincount(places, weights=counts[top])
    # The next value may be rare by chance: the commonest of three counts.
    # A bent response makes many values in its band, exact repetitions make one.
    for cut, rest in ((single[-1], single[:-1]), (bands[0] - single[-1], bands[1:])):
        if cut >= max(FEWEST_CUT, SPIKE * rest.max(initial=0)):
            return level
    return None


def _distinct(values: NDArray[Any]) -> tuple[FloatMap, NDArray[np.intp]]:
    """The distinct values, rising, and how often each is there."""
    if values.dtype.kind == "u":  # of 8 or 16 bits: a histogram takes less time than sorting
        counts = np.bincount(values.ravel())
        levels = np.flatnonzero(counts)
        return levels.astype(np.float64), counts[levels]
    levels, counts = np.unique(values, return_counts=True)
    return levels.astype(np.float64), counts


def _cut_off(decoding: Decoding, sample: Sample, level: float) -> bool:
    """Whether a Gray code is cut off at a level.

    A pixel then shows the level in all frames, or its dark samples differ by noise that its bright
    samples lack.
    """
    if not decoding.gray_frames:
        return False
    values = _finite_samples(sample, decoding.gray_frames)
    reaching = values[:, (values == level).any(axis=0)].astype(np.float64)
    low = reaching.min(axis=0)
    if np.count_nonzero(low == level) >= FEWEST_CUT:
        return True
    dark = reaching < 0.5 * (low + level)
    uneven = np.where(dark, reaching, low).max(axis=0) > low
    even = np.where(dark, level, reaching).min(axis=0) == level
    several = (dark.sum(axis=0) > 1) & ((~dark).sum(axis=0) > 1)
    need = 0.5 * np.count_nonzero(several)
    return bool(np.count_nonzero(uneven & several) > need < np.count_nonzero(even & several))


def known_limits(
    decodings: dict[Axis, Decoding],
    sample: Sample,
    limits: Limits,
    noise: CameraNoise,
    level: float | None,
) -> Limits:
    """Return the limits with the saturation that the samples show.

    Parameters
    ----------
    decodings : decoding of each axis
    sample : Sample
    limits : Limits
    noise : CameraNoise
    level : float, optional
        From ``saturation_level``.

    Returns
    -------
    Limits; ``given`` where the frames show for certain that samples are cut off. The saturation is
    infinite where they only touch it.
    """
    if limits.given:
        return limits
    if level is not None and any(
        exceeds(decoding, sample, replace(limits, saturation=level), noise)
        or _cut_off(decoding, sample, level)
        for decoding in decodings.values()
    ):
        bent = _bent_above(decodings, sample, level, noise)
        return replace(limits, saturation=bent, given=True)
    if not np.isfinite(limits.saturation):
        return limits
    if not any(exceeds(decoding, sample, limits, noise) for decoding in decodings.values()):
        return replace(limits, saturation=float("inf"))
    return replace(limits, saturation=_bent_above(decodings, sample, limits.saturation, noise))


def exceeds(decoding: Decoding, sample: Sample, limits: Limits, noise: CameraNoise) -> bool:
    """Decide whether light exceeds the sensor's limit or samples only touch it.

    A sample at the limit is compared with its prediction. The prediction is the fit of its set
    without it; for three steps, it follows from the background of the other sets. Without any
    prediction the answer is True at the largest count of the type, where cameras saturate.
    """
    key = (tuple((s.frames, s.rows, s.line_px) for s in decoding.sets), limits.saturation)
    if key not in sample.excesses:
        sample.excesses[key] = _excesses(decoding, sample, limits.saturation)
    tested = sample.excesses[key]
    if tested is None:
        return False
    if tested.size == 0:
        counts = sample.points[0].dtype
        return counts.kind == "u" and limits.saturation >= np.iinfo(counts).max
    sigma = np.sqrt(noise.variance(limits.saturation))
    return bool(np.mean(tested > EXCEEDED_SIGMAS * sigma) > RARE)


def _excesses(decoding: Decoding, sample: Sample, saturation: float) -> FloatMap | None:
    """Predicted excess of the samples at a saturation, counts, scaled to the noise of a sample.

    None where no sample reaches it; a single infinite value where too many samples of a set do for
    a mere touch.
    """
    if not decoding.sets:
        return _excess_of_code(decoding, sample, saturation)
    fits = [sample.fits.of(phases) for phases in decoding.sets]
    touching = np.zeros(sample.points[0].size, bool)
    for fit in fits:
        touching |= fit.largest >= saturation
    pixels = np.flatnonzero(touching)
    if pixels.size == 0:
        return None
    # The other pixels have no sample at the limit.
    values = [samples_at(sample.fits.planes(phases), pixels) for phases in decoding.sets]
    clear = np.stack([(data < saturation).all(axis=0) for data in values])
    means = np.stack([fit.mean[pixels] for fit in fits])
    excesses: list[FloatMap] = []
    for data, phases in zip(values, decoding.sets, strict=True):
        at = data >= saturation
        many = np.count_nonzero(at.sum(axis=0) > max(1, len(data) // 4))
        if phases.line_px is not None:
            many = np.count_nonzero(at.any(axis=0))  # other samples do not predict a line's
        if many > RARE * sample.points[0].size:
            return np.array([np.inf])
        if len(data) == 3:
            excesses.append(_excess_of_three(data, at, clear, means, saturation))
        else:
            excesses += _excess_of_more(data, at, phases.rows, saturation)
    return np.concatenate(excesses) if excesses else np.empty(0)


def _excess_of_code(decoding: Decoding, sample: Sample, saturation: float) -> FloatMap | None:
    """The same of a Gray code alone, which predicts nothing: pictures that no camera has seen touch
    the largest count, and show two levels of brightness only."""
    values = np.concatenate([sample.points[k] for k in decoding.frames])
    largest = values.dtype.kind == "u" and saturation >= np.iinfo(values.dtype).max
    if not largest or not (values >= saturation).any():
        return None
    grey = np.abs(values - 0.5 * saturation) < (0.5 - NO_LEVEL) * saturation
    return np.array([np.inf if np.mean(grey.any(axis=0)) > RARE else 0.0])


def _bent_above(
    decodings: dict[Axis, Decoding], sample: Sample, level: float, noise: CameraNoise
) -> float:
    """Counts from which on the response bends towards the saturation; the saturation where it does
    not.

    The largest sample of a set is compared with its prediction by the others, as in ``exceeds``.
    Harmonics of the fringes make an excess in proportion to them at any brightness; a sensor that
    bends makes more in the bands below its saturation. Its samples also pile up there. Below such
    a pile, bands that show nothing are not trusted.
    """
    width = level / BANDS
    found = [_largest(decoding, sample, width) for decoding in decodings.values()]
    band, excess, unsure = np.concatenate(found, axis=1)
    frames = {k for decoding in decodings.values() for k in decoding.phase_frames}
    values = np.concatenate([sample.points[k][0] for k in frames] or [np.empty(0)])
    values = values[(values >= 0.0) & (values < level)]
    counts = np.bincount((values / width).astype(np.intp), minlength=BANDS)
    sigma, bent, soft = noise.variance(level) ** 0.5, BANDS, False
    for k in range(BANDS - 1, LINEAR_BANDS[1] - 1, -1):
        seen = (excess - unsure)[band == k]
        piled = counts[k] > max(SPIKE * counts[k - 3 : k].max(), FEWEST_CUT)
        if bent == k + 1 and piled:
            soft = True
        elif seen.size >= FEWEST_CUT:
            error = float(np.std(seen)) / seen.size**0.5
            if not float(np.mean(seen)) > max(BENT_SIGMAS * sigma, BENT_ERRORS * error):
                break
        elif not soft:
            continue
        bent = k
    return level if bent == BANDS else bent * width


def _largest(decoding: Decoding, sample: Sample, width: float) -> FloatMap:
    """Band of the largest sample of every set and pixel, its predicted excess, scaled to the noise
    of a sample and without that of the linear bands, and what these leave of it; (3, …)."""
    fits = [sample.fits.of(phases) for phases in decoding.sets]
    found = [np.empty((3, 0))]
    for phases, fit in zip(decoding.sets, fits, strict=True):
        data = np.concatenate(sample.fits.planes(phases)).astype(np.float64)
        steps, place = len(data), data.argmax(axis=0)
        below = np.partition(data, steps - 2, axis=0)[steps - 2]
        excess = np.full(below.shape, np.nan)
        others = [other for other in fits if other is not fit]
        if steps == 3 and others:
            below = np.maximum(below, np.max([other.largest for other in others], axis=0))
            background = np.mean([other.mean for other in others], axis=0)
            excess = 3.0 * (background - fit.mean) / np.sqrt(3.0 + 3.0 / len(others))
        design, _ = fit_matrices(phases.rows)
        for step in range(steps if steps > 3 else 0):
            kept = np.arange(steps) != step
            _, solver = fit_matrices(phases.rows, tuple(kept.tolist()))
            at = np.flatnonzero(place == step)
            if solver is not None and at.size:
                weights = design[step] @ solver
                off = times(weights[None], data[np.ix_(kept, at)])[0] - data[step, at]
                excess[at] = off / np.hypot(1.0, np.linalg.norm(weights))
        spread = fit.largest - fit.smallest
        band = np.floor(fit.largest / width)
        # The other samples lie in lower bands: they are bent less than the largest.
        known = np.isfinite(excess) & (np.floor(below / width) < band) & (spread > 0.0)
        band, share = band[known], excess[known] / spread[known]
        linear = (band >= LINEAR_BANDS[0]) & (band < LINEAR_BANDS[1])
        if np.count_nonzero(linear) >= FEWEST_CUT:
            share -= median(share[linear])
            bands = range(*LINEAR_BANDS)
            means = [share[band == k].mean() for k in bands if (band == k).sum() >= FEWEST_CUT]
            unsure = np.full(share.shape, np.max(np.abs(means), initial=0.0))
            found.append(np.stack((band, share * spread[known], unsure * spread[known])))
    return np.concatenate(found, axis=1)


def _excess_of_three(
    data: FloatMap, at: BoolMap, clear: BoolMap, means: FloatMap, saturation: float
) -> FloatMap:
    """Predicted excess of single samples at the limit, counts, scaled to the noise of a sample.

    The mean of three equal steps is the background, which the sets that are ``clear`` of the limit
    give by their ``means``.
    """
    others = clear.sum(axis=0)
    known = (at.sum(axis=0) == 1) & (others > 0)
    background = np.sum(np.where(clear, means, 0.0), axis=0)[known] / others[known]
    predicted = 3.0 * background - np.sum(np.where(at, 0.0, data), axis=0)[known]
    return np.asarray((predicted - saturation) / np.sqrt(2.0 + 3.0 / others[known]))


def _excess_of_more(
    data: FloatMap, at: BoolMap, rows: DesignRows, saturation: float
) -> list[FloatMap]:
    """Predicted excess of single samples at the limit by the other samples of their set, counts,
    scaled to the noise of a sample; one array per step."""
    single = at.sum(axis=0) == 1
    design, _ = fit_matrices(rows)
    excesses = []
    for step in range(len(data)):
        others = np.arange(len(data)) != step
        pixels = np.flatnonzero(single & at[step])
        _, solver = fit_matrices(rows, tuple(others.tolist()))
        if solver is None or pixels.size == 0:
            continue
        weights = design[step] @ solver
        predicted = times(weights[None], data[np.ix_(others, pixels)])[0]
        excesses.append(np.asarray((predicted - saturation) / np.linalg.norm(weights)))
    return excesses
