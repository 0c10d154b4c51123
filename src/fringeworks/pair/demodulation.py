"""One path for all methods that demodulate: phasor → phase → unwrapped → displacement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fringeworks.pair.bandpass import Analytic
from fringeworks.pair.orders import settle_orders
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.pair.unwrap import unwrap
from fringeworks.types import BoolMap, ByteMap, FloatMap, Reason

MIN_MODULATION = 0.05
"""Fringes weaker than this share of the reference's are not measured …"""
NOISE_FACTOR = 4.0
"""… nor those within this many standard deviations of the noise that passes the filter."""


@dataclass(frozen=True)
class Demodulated:
    """What a demodulating method finds in a pair, in the pair's orientation."""

    phasor: Analytic
    """(h, w) complex; its argument is φ = 2π u / p, wrapped."""
    reference_amplitude: FloatMap
    """Modulation of the reference as filtered, (h, w), counts."""
    object_amplitude: FloatMap
    """Modulation of the object as filtered, (h, w), counts."""
    noise_share: float
    """Variance of an analytic signal, B/2 · exp(iφ), per variance of the frame's white noise."""
    details: dict[str, Any] = field(default_factory=dict)


def to_displacement(pair: PreparedPair, found: Demodulated) -> Solution:
    """Unwrap a phase against the reference and turn it into a displacement.

    Notes
    -----
    The order is set so that the frame's rim lies on the reference plane, and checked against
    fringe counting (``settle_orders``). σ is that of white noise through the filter, half of
    whose variance turns the phase, against the local amplitude B/2.
    """
    noise = tuple(v * found.noise_share for v in pair.noise)
    half_reference, half_object = 0.5 * found.reference_amplitude, 0.5 * found.object_amplitude
    weak = (half_object < MIN_MODULATION * 0.5 * pair.modulation) | (
        half_object < NOISE_FACTOR * np.sqrt(noise[1])
    )
    reason: ByteMap = np.where(weak, Reason.LOW_MODULATION, Reason.OK).astype(np.uint8)
    usable = ~weak & pair.wanted
    if not usable.any():
        nothing = np.full(pair.object.shape, np.nan)
        return Solution(nothing, nothing, nothing, reason, details=found.details)
    unwrapped = unwrap(np.angle(found.phasor), usable)
    reason[usable & (unwrapped.region > 1)] = Reason.ORDER_AMBIGUOUS
    main = unwrapped.region == 1
    phase = np.where(main, _anchor(unwrapped.phase, main), np.nan)
    to_px = pair.period / (2.0 * np.pi)
    displacement, open_orders, moved = settle_orders(
        pair, phase * to_px, suspect=unwrapped.residues > 0 or not main.all()
    )
    reason[open_orders] = Reason.ORDER_AMBIGUOUS
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = 0.5 * noise[0] / half_reference**2 + 0.5 * noise[1] / half_object**2
        gain = found.object_amplitude / found.reference_amplitude
    details = {
        **found.details,
        "regions": int(unwrapped.region.max()),
        "residues": unwrapped.residues,
        "unwrapping": unwrapped.algorithm,
        "pixels_moved_by_counting": moved,
    }
    return Solution(displacement, np.sqrt(variance) * to_px, gain, reason, details=details)


def _anchor(phase: FloatMap, main: BoolMap) -> FloatMap:
    """Shift the orders so that the rim of the frame, where the reference plane shows, is near 0."""
    h, w = phase.shape
    rim = np.ones(phase.shape, bool)
    by, bx = max(1, h // 50), max(1, w // 50)
    rim[by : h - by, bx : w - bx] = False
    where = main & rim if (main & rim).any() else main
    offset = 2.0 * np.pi * np.round(np.median(phase[where]) / (2.0 * np.pi))
    return np.asarray(phase - offset, dtype=np.float64)
