"""Whether light exceeds the sensor's limit, or samples only touch it."""

from __future__ import annotations

import numpy as np

from fringeworks.stack.fits import DesignRows, fit_matrices, samples_at, times
from fringeworks.stack.kernel_settings import Decoding, Limits
from fringeworks.stack.sample import Sample
from fringeworks.types import BoolMap, CameraNoise, FloatMap

RARE = 0.01
"""Share of samples at the sensor's limit that may exceed it in a stack without saturation.

It allows for chance and for a small highlight. An empirical choice.
"""

EXCEEDED_SIGMAS = 4.0
"""Excess over the sensor's limit from which on a sample counts as cut off, standard deviations.

Noise alone reaches it in 0.003 % of the samples, far below ``RARE``.
"""


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
        if phases.line_px is not None:
            many = np.count_nonzero(at.any(axis=0))  # other samples do not predict a line's
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
