"""The counts at which the sensor saturates, and whether light exceeds them or only touches them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import DesignRows, fit_matrices, samples_at, times
from fringeworks.stack.kernel_settings import Decoding, Limits
from fringeworks.stack.sample import Sample
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap

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


def saturation_level(decodings: dict[Axis, Decoding], sample: Sample) -> float | None:
    """Return the counts at which the sensor cuts off, also below the largest count of the type.

    Returns
    -------
    float; None where the samples show none.

    Notes
    -----
    Samples that are cut off make a spike at the largest value. Fringes make none otherwise. A Gray
    code also makes one where white is the same everywhere and nothing is noisy. Its spike counts
    only if the dark samples of a pixel differ while its bright samples are equal, or if a pixel
    shows the largest value in all frames.
    """
    levels = []
    for decoding in decodings.values():
        for frames in (decoding.phase_frames, decoding.gray_frames):
            values = np.concatenate([sample.points[k] for k in frames] or [np.empty((0, 0))])
            values = values[:, np.isfinite(values).all(axis=0)]
            level = _spike(values)
            if level is not None and (frames != decoding.gray_frames or _cut_off(values, level)):
                levels.append(level)
    return max(levels, default=None)


def _spike(values: NDArray[Any]) -> float | None:
    """The largest value of the samples, where their histogram has a spike there."""
    # The top of the histogram suffices: sorting all values takes time.
    if values.size == 0:
        return None
    level = values.max()
    cut = np.count_nonzero(values == level)
    if cut < FEWEST_CUT:
        return None
    below = values[values < level]
    # The next value may be rare by chance: the commonest of three counts.
    for _ in range(3):
        if below.size == 0:
            break
        largest = below.max()
        if np.count_nonzero(below == largest) * SPIKE > cut:
            return None
        below = below[below < largest]
    return float(level)


def _cut_off(values: NDArray[Any], level: float) -> bool:
    """Whether (N, n) samples of a Gray code lack their noise at a level, or the code itself."""
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
    if level is not None:
        return replace(limits, saturation=level, given=True)
    if not np.isfinite(limits.saturation):
        return limits
    exceeded = [exceeds(decoding, sample, limits, noise) for decoding in decodings.values()]
    return limits if any(exceeded) else replace(limits, saturation=float("inf"))


def exceeds(decoding: Decoding, sample: Sample, limits: Limits, noise: CameraNoise) -> bool:
    """Decide whether light exceeds the sensor's limit or samples only touch it.

    A sample at the limit is compared with its prediction. The prediction is the fit of its set
    without it; for three steps, it follows from the background of the other sets. Without any
    prediction the answer is True.
    """
    fits = [sample.fits.of(phases) for phases in decoding.sets]
    touching = [np.flatnonzero(fit.largest >= limits.saturation) for fit in fits]
    pixels = np.unique(np.concatenate([*touching, np.empty(0, np.intp)]))
    if pixels.size == 0:
        return False
    # The other pixels have no sample at the limit.
    values = [samples_at(sample.fits.planes(phases), pixels) for phases in decoding.sets]
    clear = np.stack([(data < limits.saturation).all(axis=0) for data in values])
    means = np.stack([fit.mean[pixels] for fit in fits])
    excesses: list[FloatMap] = []
    for data, phases in zip(values, decoding.sets, strict=True):
        at = data >= limits.saturation
        many = np.count_nonzero(at.sum(axis=0) > max(1, len(data) // 4))
        if many > RARE * sample.points[0].size:
            return True  # too many samples of a set at the limit: it cannot be a mere touch
        if len(data) == 3:
            excesses.append(_excess_of_three(data, at, clear, means, limits.saturation))
        else:
            excesses += _excess_of_more(data, at, phases.rows, limits.saturation)
    tested = np.concatenate(excesses) if excesses else np.empty(0)
    if tested.size == 0:
        return True
    sigma = np.sqrt(noise.variance(limits.saturation))
    return bool(np.mean(tested > EXCEEDED_SIGMAS * sigma) > RARE)


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
