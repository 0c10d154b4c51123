"""Errors of single regions of a scene, from residuals and disagreements around every pixel.

Noise is the same all over a scene. Motion of a part of it, compression, vibration at printed edges
and light between surfaces make errors in some regions only. Where the sample shows such errors, the
variances of every pixel are raised to what its neighbourhood shows.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.stack.fits import harmonic_noise
from fringeworks.stack.frames import Planes, in_bands
from fringeworks.stack.kernel_settings import HARMONICS, Decoding, Limits, lit_pixels
from fringeworks.types import CameraNoise, FloatMap

NEIGHBOURHOOD = 5
"""Side of the neighbourhood that errors are averaged in, px.

25 pixels with one degree of freedom determine a variance to 28 %. A larger one would spread errors
of edges farther. An empirical choice.
"""

SIGNIFICANT_EXCESS = 3.0
"""Excess of a neighbourhood's mean χ² from which on it is raised, in standard deviations."""

MOST = 100.0
"""Largest χ² of a pixel, in units of its degrees of freedom, that counts in its neighbourhood.

Single pixels with huge errors, such as edges, would otherwise spoil all their neighbours.
"""


def inflation(
    planes: Planes,
    decoding: Decoding,
    maps: dict[str, Any],
    noise: CameraNoise,
    limits: Limits,
) -> tuple[FloatMap, float]:
    """Factors on the variances of every pixel, from the errors in its neighbourhood.

    Parameters
    ----------
    planes : (h, w) arrays in the decoding's order, counts
    decoding : Decoding
    maps : the kernel's maps, with the disagreement of the sets
    noise : CameraNoise
    limits : Limits

    Returns
    -------
    factors : (h, w) float32 array, ≥ 1
    usual : float ≥ 1
        Median factor of the lit pixels. The judgement knows it already; fringe orders are in danger
        only where a region exceeds it.
    """
    lit = lit_pixels(maps)
    square = np.zeros(lit.shape, np.float32)
    freedom = np.zeros(lit.shape, np.float32)
    sets = len(decoding.sets)
    if sets > 1:
        known = lit & np.isfinite(maps["disagreement"])
        square[known] += np.minimum(maps["disagreement"][known], MOST * (sets - 1))
        freedom[known] += sets - 1
    sums = {"square": square, "freedom": freedom, "lit": lit}
    in_bands(planes, sums, partial(_add_residuals, decoding, (noise, limits)))
    count = NEIGHBOURHOOD**2 * scipy.ndimage.uniform_filter(freedom, NEIGHBOURHOOD)
    total = NEIGHBOURHOOD**2 * scipy.ndimage.uniform_filter(square, NEIGHBOURHOOD)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
        raised = mean > 1.0 + SIGNIFICANT_EXCESS * np.sqrt(2.0 / count)
    factors = np.where(raised, mean, 1.0).astype(np.float32)
    return factors, float(np.median(factors[lit])) if lit.any() else 1.0


def _add_residuals(
    decoding: Decoding,
    known: tuple[CameraNoise, Limits],
    planes: Planes,
    sums: dict[str, Any],
) -> None:
    """Add the χ² of the residuals of sets with four or more steps, and its degrees of freedom."""
    noise, limits = known
    for phases in decoding.sets:
        steps = len(phases.frames)
        if steps < 4:
            continue
        design = np.array(phases.rows, np.float32)
        shares = np.array(phases.harmonics, np.float32).reshape(steps, -1)
        factor = decoding.noise_factor
        if phases.harmonics:
            factor *= harmonic_noise(phases.harmonics)
        _core.add_residual_chi(
            [planes[decoding.frames.index(k)] for k in phases.frames],
            {
                "design": design,
                "solver": np.linalg.pinv(design),
                "harmonics": shares,
                "orders": HARMONICS if phases.harmonics else (),
            },
            {
                "dark": factor * noise.read_counts**2,
                "gain": factor * noise.gain,
                # The floor is a phase error: it moves the samples by its share of the modulation.
                "floor": 0.5 * phases.floor_rad**2,
                "saturation": limits.threshold,
                "most": MOST,
            },
            sums["lit"],
            (sums["square"], sums["freedom"]),
        )
