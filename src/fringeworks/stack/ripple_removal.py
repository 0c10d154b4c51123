"""Ripple of every set of a stack: measured in a sample, and taken out where frames cause it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames, lit_pixels
from fringeworks.stack.phase_light import (
    MIN_PIXELS,
    MOST_STEPS,
    Light,
    with_frames,
    with_light,
)
from fringeworks.stack.phase_spread import spread_of, with_spread
from fringeworks.stack.real_frames import design_rows
from fringeworks.stack.ripple import (
    LINES_NOISE_ALONE,
    MIN_PLACES,
    MOST_USUAL,
    RESPONSE_ORDER,
    STEP_RIPPLE_RAD,
    SURE,
    Ripple,
    measure_ripple,
    unknown_ripple,
    usual_rad,
)
from fringeworks.stack.set_residuals import Known, phase_variance
from fringeworks.stack.set_ripples import orders_of, set_ripples
from fringeworks.statistics.quantiles import median
from fringeworks.types import BoolMap, FloatMap

MAX_RIPPLE_NOISE_RAD = 0.2
"""Largest phase noise of a pixel that a ripple is measured from, rad. An empirical choice: noisier
pixels only add noise."""

LIGHT_PIXELS = 6000
"""Approximate number of pixels whose brightness tells the response. Noise of 0.1 of the modulation
leaves 0.002; more only take time."""

REACH = 1.5
"""Factor by which a response changes the brightest sample and the modulation from phase to phase:
1.4 for γ of 2.2 in three steps."""

RIPPLE_PASSES = 6
"""Most passes of taking a ripple out. Each one leaves a share of the ripple of its size in radians,
because errors bend the phases that it is measured over; few stacks need more than three."""

REPORTED = 5.0
"""Errors of a ripple, rms over the phases, that it must exceed to be reported as other steps than
those of the plan."""

MOST_COMPRESSED = 0.7
"""Largest decrease of the measured phase's slope by a response, as a share: γ of 2.2 takes 0.67 off
it in three steps, γ of 0.4 takes 0.60. Steeper errors would blow up the noise of the phase where
they are subtracted."""

STAYS = 0.5
"""Share of the ripple of steps and gains that is left where they are not its cause: light between
surfaces, for example, does not scale with the background as gains do."""

LONGER = 2.0
"""Period over the finest one from which on a ripple must not contradict the other sets. The finest
set, which determines the coordinate, has errors of its own: in shares of a longer fringe they are
at most half as large."""


def without_ripples(
    decoding: Decoding,
    lines: list[NDArray[Any]],
    planes: list[NDArray[Any]],
    known: Known,
    *,
    steps: bool = True,
) -> tuple[Decoding, list[Ripple | None]]:
    """The decoding without the ripple that the phases show, and what is left of it in every set.

    The ripple of a set is measured along lines. Where they hold too few of its fringes, it is that
    of the differences from the other sets. Ripple of one and two per fringe comes from steps and
    gains: it changes the design. That of higher orders comes from a response that is not linear: a
    table of the set subtracts it, where it was seen at several places along the lines. ``steps``
    says whether the design may change.
    """
    count = len(decoding.sets)
    ripples: list[Ripple | None] = [None] * count
    planned = decoding.sets
    # Sets whose design, or table, may still change.
    low, high = (set(range(count)) if steps else set()), set(range(count))
    best: tuple[float, Decoding, list[Ripple | None]] = (float("inf"), decoding, ripples)
    before: list[Ripple | None] = [None] * count
    for left in reversed(range(RIPPLE_PASSES)):
        maps = decode_sample(decoding, lines, known.noise, known.limits.open)
        ripples = [_ripple(decoding, maps, lines, k, known) for k in range(count)]
        ripples = _with_set_ripples(decoding, planes, known, ripples)
        size = sum(r.rms_rad**2 for r in ripples if r is not None)
        if size < best[0]:
            best = size, decoding, ripples
        sets = list(decoding.sets)
        for k, (ripple, earlier) in enumerate(zip(ripples, before, strict=True)):
            if ripple is None or not ripple.sure:
                low.discard(k)
                high.discard(k)
                continue
            if earlier is None and not _of_response(ripple, len(planned[k].frames)):
                high.discard(k)
            if earlier is not None and ripple.low_rad > STAYS * earlier.low_rad > 0.0 and k in low:
                # Neither steps nor gains are the cause: taking them out was no use.
                low.discard(k)
                sets[k] = replace(sets[k], design=planned[k].design, unsure=planned[k].unsure)
            sets[k] = _without_ripple(sets[k], ripple, low=k in low, high=k in high)
        if not known.estimate_steps or not left or tuple(sets) == decoding.sets:
            break
        decoding, before = replace(decoding, sets=tuple(sets)), ripples
    return best[1], best[2]


def _of_response(ripple: Ripple, steps: int) -> bool:
    """Whether the higher orders come from a response, not from steps that are far off, from frames
    in a wrong order, or from the surface: then they are the larger ones, unless the brightness
    tells both, not larger than responses make them, and seen everywhere."""
    high = max(abs(ripple.significant(k)) for k in ripple.orders if k >= RESPONSE_ORDER)
    larger = ripple.told or ripple.low_rad < high
    return ripple.repeated and larger and high < MOST_USUAL * usual_rad(steps, steps)


def _ripple(
    decoding: Decoding, maps: dict[str, Any], lines: list[NDArray[Any]], k: int, known: Known
) -> Ripple | None:
    """Ripple of a set along lines, by the spread of its phases, and by its brightness; None where
    nothing shows any."""
    phases = decoding.sets[k]
    found, steps = line_ripple(phases, maps, k, known), len(phases.frames)
    if found is None or found.smooth:
        return found
    told = light = None
    if steps <= MOST_STEPS or decoding.gray is not None:
        light = _light(decoding, maps, lines, k, known)
    if light is not None and steps <= MOST_STEPS:
        told = with_light(found, light, steps, _table(phases, maps, k))
    elif light is not None:
        told = with_frames(found, light, steps)
    if told is None:
        told = found if found.repeated else _with_spread(phases, maps, k, known, found)
        few = light is not None and np.count_nonzero(light.used) < MIN_PIXELS
        if few and not told.places and len(decoding.sets) == 1:
            # Nearly all pixels are saturated. Several sets show it by their differences.
            told = replace(told, unknown_rad=usual_rad(steps, steps) / 2.0**0.5)
    return told if told.places or told.told or told.unknown_rad else None


def line_ripple(phases: PhaseFrames, maps: dict[str, Any], k: int, known: Known) -> Ripple | None:
    """Ripple of a set along lines; None where there is no light, unknown where they hold too few
    fringes."""
    modulation, background = maps["modulations"][k], maps["background"]
    bright, sigma = _bright(phases, maps, k, known)
    if not bright.any():
        return None
    turns = np.where(bright, maps["phases"][k] / TURN, 0.0)
    steps = len(phases.frames)
    orders = orders_of(phases)
    found = measure_ripple(turns, bright, sigma, orders, steps) or unknown_ripple(orders, steps)
    return replace(found, background_ratio=median(background[bright] / modulation[bright]))


def _with_spread(
    phases: PhaseFrames, maps: dict[str, Any], k: int, known: Known, ripple: Ripple
) -> Ripple:
    """The ripple with what the spread of the phases along lines tells of it."""
    bright, sigma = _bright(phases, maps, k, known)
    peak = REACH * (maps["background"] + maps["modulations"][k])
    near = (peak >= known.limits.threshold) | (REACH * sigma > MAX_RIPPLE_NOISE_RAD)
    share = np.count_nonzero(bright & near) / np.count_nonzero(bright)
    steps = len(phases.frames)
    return with_spread(ripple, spread_of(ripple, maps["phases"][k], bright, steps, share), steps)


def _light(
    decoding: Decoding, maps: dict[str, Any], lines: list[NDArray[Any]], k: int, known: Known
) -> Light | None:
    """What a set shows along lines beside other frames: those of the Gray code, or else of the
    other sets; None where there are none."""
    place = {frame: n for n, frame in enumerate(decoding.frames)}
    few = max(1, maps["reason"].size // LIGHT_PIXELS)

    def seen(frames: Sequence[int]) -> list[NDArray[Any]]:
        return [lines[place[frame]][:, ::few] for frame in frames]

    modulations = [modulation[:, ::few] for modulation in maps["modulations"]]
    lit = lit_pixels(maps)[:, ::few]
    if decoding.gray is not None:
        gray = seen(decoding.gray_frames)
        dark, brightest = np.min(gray, axis=0), np.max(gray, axis=0).astype(np.float32)
        modulation, mean = 0.5 * (brightest - dark), 0.5 * (brightest + dark)
        if decoding.gray.white_black:
            # In shadow, light of the room that flickers looks like fringes of one phase.
            white, black = (frame.astype(np.float32) for frame in gray[-2:])
            lit &= white - black > modulation
    elif len(decoding.sets) > 1:
        others = [j for j in range(len(decoding.sets)) if j != k]
        modulation = np.mean([modulations[j] for j in others], axis=0)
        mean = np.mean(seen([f for j in others for f in decoding.sets[j].frames]), axis=0)
        brightest = mean + REACH * modulation
    else:
        return None
    with np.errstate(invalid="ignore", divide="ignore"):  # pixels that are not finite, or dark
        sigma = np.sqrt(phase_variance(decoding.sets[k], modulation, mean, known.noise))
        used = lit & (REACH * sigma < MAX_RIPPLE_NOISE_RAD)
        used &= ~(brightest >= known.limits.threshold)
        own = np.mean(seen(decoding.sets[k].frames), axis=0)
        relative = modulations[k] / modulation
        phase = np.ascontiguousarray(maps["phases"][k][:, ::few])
        fringe = None
        if decoding.gray is not None:
            fringe = np.floor(maps["coordinate"][:, ::few] / decoding.sets[k].period_px)
        return Light(phase, used, relative, (own - mean) / modulation, fringe)


def _table(phases: PhaseFrames, maps: dict[str, Any], k: int) -> NDArray[np.float64]:
    """The phase errors that a set is without, at usual brightness, turns."""
    if not phases.table_turns:
        return np.zeros(TABLE_BINS)
    tables = np.array(phases.table_turns).reshape(-1, TABLE_BINS)
    if len(tables) == 1:
        return np.asarray(tables[0])
    bright = maps["background"] + maps["modulations"][k]
    usual = median(bright[np.isfinite(bright)])
    of_bins = [np.interp(usual, phases.brightness, column) for column in tables.T]
    return np.asarray(of_bins)


def _bright(
    phases: PhaseFrames, maps: dict[str, Any], k: int, known: Known
) -> tuple[BoolMap, FloatMap]:
    """Pixels whose phase noise is small, and that noise, rad."""
    with np.errstate(invalid="ignore"):  # pixels that are not finite
        variance = phase_variance(phases, maps["modulations"][k], maps["background"], known.noise)
        sigma = np.sqrt(variance)
        return lit_pixels(maps) & (sigma < MAX_RIPPLE_NOISE_RAD), sigma


def _with_set_ripples(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    known: Known,
    ripples: list[Ripple | None],
) -> list[Ripple | None]:
    """The ripples, with those of sets that lines do not show at several places, and of those of
    long fringes, from the residuals of the sets.

    A crease that crosses the lines at the same phase, as that of a groove, looks like a ripple of
    long fringes there. The sets do not disagree by it.
    """
    finest = min(phases.period_px for phases in decoding.sets)
    longer = {k for k, s in enumerate(decoding.sets) if s.period_px > LONGER * finest}
    doubtful = longer | {k for k, r in enumerate(ripples) if r is None or r.places < MIN_PLACES}
    if not doubtful:
        return ripples
    found = set_ripples(decoding, planes, known)
    out = list(ripples)
    for k in doubtful:
        ripple, own = found[k], ripples[k]
        if ripple is None:
            continue
        if own is not None and k not in longer and _by_lines(own, ripple):
            continue
        if own is not None and own.told and own.error_rad < ripple.error_rad:
            ripple = ripple.with_response_of(own, len(decoding.sets[k].frames))
        out[k] = ripple
    return out


def _by_lines(own: Ripple, of_sets: Ripple) -> bool:
    """Whether what few places along lines show counts: where the surface itself is smooth, and sets
    hardly show the ripple, as that of the finest one, from which the coordinate is taken."""
    smooth = own.places > 0 and own.excess <= LINES_NOISE_ALONE
    return smooth and own.rms_rad <= SURE * of_sets.error_rad


def _without_ripple(phases: PhaseFrames, ripple: Ripple, *, low: bool, high: bool) -> PhaseFrames:
    """The set whose phases do not have the ripple: the ``low`` orders of steps and gains, and the
    ``high`` ones of a response."""
    if high and _of_response(ripple, len(phases.frames)):
        phases = _without_response(phases, ripple)
    if not low or (phases.design and not ripple.low_rad):
        return phases
    sure = phases.design and not phases.unsure
    unsure = not sure and ripple.rms_rad < REPORTED * ripple.error_rad
    # Beside a large response, brightness tells no less than what steps and gains usually make.
    unsure |= not sure and ripple.told and ripple.low_rad < STEP_RIPPLE_RAD
    return replace(phases, design=_without_low_orders(phases, ripple), unsure=unsure)


def _without_response(phases: PhaseFrames, ripple: Ripple) -> PhaseFrames:
    """The set with a table that subtracts the orders of a response."""
    rows = ripple.by_brightness or ((0.0, ripple.phasors_rad),)
    levels = phases.brightness if len(phases.brightness) > 1 else tuple(b for b, _ in rows)
    tables = np.array(phases.table_turns or np.zeros(TABLE_BINS)).reshape(-1, TABLE_BINS)
    tables = np.broadcast_to(tables, (len(levels), TABLE_BINS))
    known = [b for b, _ in rows]
    found = []
    for level, table in zip(levels, tables, strict=True):
        z = [
            np.interp(level, known, [row[k] for _, row in rows]) for k in range(len(ripple.orders))
        ]
        response = {
            order: z[k]
            for k, order in enumerate(ripple.orders)
            if order >= RESPONSE_ORDER and ripple.significant(order) != 0
            # Steps and light make no other orders, but relief does.
            if not ripple.told or order % len(phases.frames) == 0
        }
        found.append(table + _error_after(table, response))
    turns = np.concatenate(found)
    if not turns.any():
        return phases
    return replace(phases, table_turns=tuple(map(float, turns)), brightness=tuple(levels))


def _error_after(table: NDArray[np.float64], response: dict[int, complex]) -> NDArray[np.float64]:
    """Phase error of a response at the middles of the bins of a table, turns.

    It is a function of the true phases, and adds to what the table has corrected.
    """
    corrected = TURN * ((np.arange(TABLE_BINS) + 0.5) / TABLE_BINS - 0.5 - table)
    phase = TURN * np.arange(4 * TABLE_BINS) / (4 * TABLE_BINS)
    error = np.zeros(phase.size)
    for order, z in response.items():
        error += np.real(z * np.exp(-1j * order * phase))
    # No response turns the phase back: what seems to do so is noise.
    steepest = -float(np.gradient(error, phase).min())
    error *= min(1.0, MOST_COMPRESSED / max(steepest, MOST_COMPRESSED))
    return np.asarray(np.interp(corrected, phase + error, error, period=TURN) / TURN)


def _without_low_orders(
    phases: PhaseFrames, ripple: Ripple
) -> tuple[tuple[float, float, float], ...]:
    """The design whose fits do not have the ripple of one and two per fringe.

    A fit that mixes A, c and s shifts the phase by (A/B)(ν cos φ − μ sin φ) + ζ cos 2φ − γ sin 2φ,
    where μ and ν are the shares of A in c and s, and (γ, ζ; ζ, −γ) mixes c and s.
    """
    once, twice = ripple.significant(1), ripple.significant(2)
    if once == 0 and twice == 0:
        return phases.design
    nu, mu = once.real / ripple.background_ratio, -once.imag / ripple.background_ratio
    zeta, gamma = twice.real, -twice.imag
    mixing = np.array([[1.0, 0.0, 0.0], [mu, 1.0 + gamma, zeta], [nu, zeta, 1.0 - gamma]])
    return design_rows(np.array(phases.rows) @ mixing)
