"""What the phases of the sets leave of each other, in a sample of a stack's pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.kernel_settings import Decoding, Limits, PhaseFrames, lit_pixels
from fringeworks.types import CameraNoise, FloatMap

MIN_MODULATION = 1e-6
"""Divides instead of a modulation of zero, counts."""


@dataclass(frozen=True)
class Known:
    """What is known of the frames when their phases are judged."""

    noise: CameraNoise
    limits: Limits
    estimate_steps: bool
    """Whether errors of steps and gains may be taken out, and the ripple of a response."""
    peaks_rad: tuple[float, ...] = ()
    """Largest phase error of every set by ripple that is left, rad; none where empty."""


def set_residuals(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known
) -> tuple[FloatMap, FloatMap, dict[str, Any]]:
    """Residuals of the phases of a sample and their variances by noise, (M, n), turns and turns²,
    and the kernel's maps with the pixels that were used."""
    maps = decode_sample(decoding.nearest, planes, known.noise, known.limits.open)
    used = lit_pixels(maps)
    # A coordinate that is not written is that of the phases nearest to it: the residuals are those
    # of the nearest fringe orders.
    used &= np.isfinite(maps["disagreement"]) & np.isfinite(maps["coordinate"])
    maps["used"] = used
    sets = zip(decoding.sets, maps["phases"], maps["modulations"], strict=True)
    sample: _core._SampleMaps = {
        "coordinate": maps["coordinate"],
        "background": maps["background"],
        "used": used,
    }
    noise: _core._SampleNoise = {
        "read_variance": known.noise.read_counts**2,
        "gain": known.noise.gain,
        "min_modulation": MIN_MODULATION,
    }
    found = [
        _core.phase_residuals(
            sample,
            {
                "phase": turns,
                "modulation": modulation,
                "period": phases.period_px,
                "variance": 2.0 / len(phases.frames) / TURN**2,
            },
            noise,
        )
        for phases, turns, modulation in sets
    ]
    return np.stack([off for off, _ in found]), np.stack([v for _, v in found]), maps


def phase_variance(
    phases: PhaseFrames, modulation: FloatMap, background: FloatMap, noise: CameraNoise
) -> FloatMap:
    """Variance of the phase by camera noise, rad²: that of equal steps."""
    variance = noise.variance(np.where(np.isfinite(background), background, 0.0))
    return np.asarray(
        2.0 / len(phases.frames) * variance / np.maximum(modulation, MIN_MODULATION) ** 2
    )
