"""Sign and start of the phase steps, as the borders of a Gray code show them.

A border between two cells lies at a known projector coordinate. The phase there, and the direction
in which it runs across the border, tell whether the steps have the sign and the start that the plan
says. Cells of any width show it, also those of one period, inside which a wrong start is invisible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.fits import wave_of
from fringeworks.stack.gray_frames import GrayFrames
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames
from fringeworks.stack.sample import Lines
from fringeworks.stack.set_ratios import SEARCHED, rate_of
from fringeworks.types import BoolMap, FloatMap

FIRM = 0.2
"""Smallest distance of the other bits of a pixel from their threshold, as a share of their
contrast. Noise and blur then change none of them. An empirical choice."""
LIT = 0.3
"""Smallest contrast of a pixel that is used, as a share of the 95th percentile. Dimmer pixels have
less contrast than indirect light adds. An empirical choice."""
QUARTERS = 4
"""Starts per turn that programs use whatever the number of their steps: cosines and sines of either
sign. They use whole steps as well."""
SNAP_TURNS = 0.03
"""Distance from such a start up to which it is taken, turns: borders tell it to 0.01."""
FEWEST = 30
"""Fewest borders for a statement beside a plan that fits otherwise."""
ALIKE_TURNS = 0.15
"""Largest scatter of the start from border to border, turns: that of unrelated phases is larger."""
BORDER_PX = 0.03
"""Error of the place of borders that they share, camera px: of straight lines between pixels that
blur bends, and of a threshold beside the middle. Borders fall anywhere between two pixels, and
either side may be bright, so most of it averages out. An empirical choice."""
SMALLEST = 1e-9
"""Smallest length of a mean direction, so that its logarithm exists."""
AGAINST_SIGMAS = 4.0
"""Standard deviations by which the phase clearly runs against the code: 16 borders that agree."""
AT_BORDER_TURNS = 0.0128
"""Standard deviation of what a response that is not linear changes between borders, turns: its
ripple of 0.4 rad at most (γ of 2.2, three steps), and borders of bits that move with it, at five
standard deviations."""
LEAST_STEPS = 3
"""Number of steps whose phases have a ripple in the first place."""
AT_END = 0.9
"""Share of the searched range from which on a rate may lie beyond it."""
EXACT_SIGMAS = 2.0
"""Standard deviations within which a start is that of other steps: in 14 simulated stacks, it was
met to 0.5, and seven stacks that had moved were 2.9 to 8.5 from one."""
MOST_BORDERS = 2000
"""Borders that the period is looked for with, at most."""
CLEAR_SIGMAS = 5.0
"""Standard deviations by which a start differs clearly from the plan's."""


@dataclass(frozen=True)
class Convention:
    """What the borders of a Gray code say about the phase steps of a set."""

    borders: int
    """Number of borders that were used."""
    direction: float
    """Direction of the phase: 1 along the code, −1 against it."""
    start_turns: float
    """Phase at coordinate 0 px in the direction that the phase has, turns, −0.5…0.5; 0 expected."""
    scatter_turns: float
    """Standard deviation of the start from border to border, turns."""
    turns_per_px: float
    """Change of the phase from one camera pixel to the next, turns."""
    frames: int
    """Number of steps of the set."""
    period_px: float
    """Period of the set, projector px: the plan's, or the one that the borders clearly show."""
    planned_px: float
    """Period of the set in the plan, projector px."""

    @property
    def offset_px(self) -> float:
        """Distance of the fringes from where the code has them, projector px."""
        return self.start_turns * self.period_px

    @property
    def steps(self) -> tuple[float, float]:
        """Sign and start of the steps, ± 1 and turns: a usual start where one is near."""
        start = self.usual_start if self._near_usual else self.start_turns
        return (-1.0 if self.direction < 0.0 else 1.0), start - float(np.rint(start))

    @property
    def usual(self) -> bool:
        """Whether programs use such steps: of the other sign, or that start a quarter of a turn or
        whole steps later."""
        return self.direction < 0.0 or self._near_usual

    @property
    def _near_usual(self) -> bool:
        return bool(abs(self.start_turns - self.usual_start) < SNAP_TURNS)

    @property
    def exact(self) -> bool:
        """Whether a usual start is met as exactly as the borders tell, with more than three steps:
        what moved between the code and the fringes is near one by chance only. The ripple of three
        steps moves the phase at borders."""
        off = abs(self.start_turns - self.usual_start)
        return self.frames <= LEAST_STEPS or off < EXACT_SIGMAS * self.start_error

    @property
    def usual_start(self) -> float:
        """The nearest start that programs use, turns."""
        starts = [round(self.start_turns * n) / n for n in (QUARTERS, self.frames)]
        return float(min(starts, key=lambda start: abs(start - self.start_turns)))

    @property
    def clear(self) -> bool:
        """Whether the borders agree that the start is another one than the plan's."""
        if self.borders < FEWEST or self.scatter_turns > ALIKE_TURNS:
            return False
        return bool(abs(self.start_turns) > CLEAR_SIGMAS * self.start_error)

    @property
    def start_error(self) -> float:
        """Standard deviation of the start, turns."""
        return float(self.scatter_turns / self.borders**0.5 + BORDER_PX * self.turns_per_px)

    def fitting_deg(self, shifts_rad: tuple[float, ...]) -> list[float]:
        """The steps that the frames show, degrees, 0…360."""
        sign, start = self.steps
        turns = np.asarray(shifts_rad) / TURN - start
        return [float(d) for d in (np.rint(sign * turns * 360.0) % 360.0)]


def convention(decoding: Decoding, lines: Lines) -> Convention | None:
    """Compare the phase of the set that fits the cells best with the borders of the Gray code.

    Parameters
    ----------
    decoding : Decoding
    lines : (r, l) arrays, one per frame of the plan
        Lines of the frames across the fringes, counts.

    Returns
    -------
    Convention, or None for plans without a Gray code of two levels beside fringes.
    """
    gray = decoding.gray
    if gray is None or gray.levels != 2 or not decoding.sets:
        return None
    phases = min(decoding.sets, key=lambda s: abs(float(np.log(s.period_px / gray.step_px))))
    offset, wave = wave_of(phases, [lines[k] for k in phases.frames])
    signed, lit = _bits(gray, lines, offset, np.abs(wave))
    row, column, place, coordinate, direction = _borders(gray, signed, lit)
    # Pixels that come from outside of a moved frame have no phase.
    known = np.isfinite(wave[row, column]) & np.isfinite(wave[row, column + 1])
    row, column, place, coordinate, direction = (
        one[known] for one in (row, column, place, coordinate, direction)
    )
    left, right = wave[row, column], wave[row, column + 1]
    along = np.angle(right * np.conj(left)) * direction
    sign = _direction(along)
    at_border = np.exp(1j * np.angle((1.0 - place) * left + place * right))
    slope = float(np.median(np.abs(along))) / TURN if along.size else 0.0
    rough = _rough_rate(wave, (row, column, place), coordinate / phases.period_px)
    return _convention(phases, sign, at_border, coordinate, slope, rough)


def _rough_rate(
    wave: NDArray[np.complex128],
    at: tuple[NDArray[np.intp], NDArray[np.intp], FloatMap],
    turns: FloatMap,
) -> float:
    """Turns of the phase over those that the plan expects, from border to border of neighbouring
    cells along a line; 1 where they tell no clearly different rate.

    The phase at the borders alone leaves whole turns per cell open.
    """
    row, left, place = at
    step = np.angle(wave[:, 1:] * np.conj(wave[:, :-1]))
    phase = np.pad(np.cumsum(np.nan_to_num(step), axis=1), ((0, 0), (1, 0))) / TURN
    seen = phase[row, left] + place * np.nan_to_num(step)[row, left] / TURN
    between, planned = np.abs(np.diff(seen)), np.abs(np.diff(turns))
    cell = float(np.median(planned[planned > 0])) if (planned > 0).any() else 0.0
    near = (np.diff(row) == 0) & (planned > 0) & (planned < 1.5 * cell)
    if np.count_nonzero(near) < FEWEST:
        return 1.0
    rate = float(np.median(between[near] / planned[near]))
    return rate if rate > 0.0 and abs(rate - 1.0) > SEARCHED else 1.0


def _direction(along: FloatMap) -> float:
    """Direction of the phase across the borders: −1 where it clearly runs against the code.

    The camera may see a line as sharp as its steps: its phase then stays the same over some pixels,
    and noise alone turns it.
    """
    turned = np.sin(along)
    size = float(np.sqrt(np.sum(turned**2)))
    return -1.0 if float(np.sum(turned)) < -AGAINST_SIGMAS * size else 1.0


def _convention(
    phases: PhaseFrames,
    sign: float,
    at_border: NDArray[np.complex128],
    coordinate: FloatMap,
    slope: float,
    rough: float,
) -> Convention:
    """The convention, and the period, by the phase at every border; ``rough`` is the planned period
    over the one that neighbouring borders show."""
    period, turns, borders = phases.period_px, coordinate / phases.period_px, coordinate.size

    def start_of(rate: float) -> tuple[float, float]:
        mean = np.mean(at_border * np.exp(-1j * TURN * rate * turns)) if borders else 0.0
        length = float(np.clip(np.abs(mean), SMALLEST, 1.0))
        return float(np.angle(mean)) / TURN, float(np.sqrt(-2.0 * np.log(length))) / TURN

    def seen(rate: float) -> Convention:
        start, scatter = start_of(rate)
        return Convention(
            borders, sign, start, scatter, slope, len(phases.frames), period / abs(rate), period
        )

    planned = seen(sign)
    if borders < FEWEST:
        return planned
    few = slice(None, None, max(1, borders // MOST_BORDERS))
    near = seen(rate_of(at_border[few], turns[few], sign, SEARCHED)[0])
    fits, off = [near], abs(near.planned_px / near.period_px - 1.0)
    # A rate just beyond the search scatters little at its end.
    if rough != 1.0 and (near.scatter_turns > ALIKE_TURNS or off > AT_END * SEARCHED):
        fits.append(seen(rate_of(at_border[few], turns[few], sign * rough, SEARCHED * rough)[0]))
    fitted, spread = min(fits, key=lambda fit: fit.scatter_turns), float(np.std(turns))
    error = float(np.hypot(fitted.start_error, AT_BORDER_TURNS)) / max(spread, SMALLEST)
    at_edge = np.hypot(fitted.start_error, float(np.mean(turns)) * error)
    rate = fitted.planned_px / fitted.period_px
    other = abs(rate - 1.0) > CLEAR_SIGMAS * error and fitted.scatter_turns < ALIKE_TURNS
    # What moved between the code and the fringes may look stretched, but hardly from the edge on.
    fixed = abs(fitted.start_turns - fitted.usual_start) < SNAP_TURNS + CLEAR_SIGMAS * at_edge
    return fitted if other and fixed else planned


def steps_in_words(decoding: Decoding, found: Convention, labels: list[str]) -> tuple[str, str]:
    """What the borders of the code show, and the steps that fit."""
    phases = decoding.sets[0]
    steps = ", ".join(f"{d:.0f}°" for d in found.fitting_deg(phases.shifts_rad))
    sign, start = found.steps
    seen = (
        "the phase runs against the Gray code"
        if sign < 0
        else f"the phase at coordinate 0 is {360.0 * start:.0f}°, expected 0°"
    )
    if not found.usual or (sign > 0 and not found.exact):
        seen = f"the phase at coordinate 0 is {360.0 * found.start_turns:.0f}°, expected 0°"
        return (
            f"the fringes along {decoding.axis} lie {abs(found.offset_px):.2g} px beside the Gray "
            f"code ({seen}): the scene or the camera moved between them, or the steps have another "
            "start than the plan says",
            f"; steps that fit the frames from {labels[phases.frames[0]]} on: {steps}",
        )
    return (
        f"the steps along {decoding.axis} have another sign or start than the plan says ({seen})",
        f"; steps that fit the frames from {labels[phases.frames[0]]} on: {steps}",
    )


def _samples(lines: Lines, frames: tuple[int, ...]) -> FloatMap:
    """Lines of some frames, (frames, r, l), counts; NaN where a sample is not finite."""
    data = np.stack([lines[k].astype(np.float64) for k in frames])
    return np.where(np.isfinite(data), data, np.nan)


def _bits(
    gray: GrayFrames, lines: Lines, offset: FloatMap, modulation: FloatMap
) -> tuple[FloatMap, BoolMap]:
    """Bits of the lines, (bits, r, l): −1 dark … 1 bright; and which pixels are lit, (r, l)."""
    bits = _samples(lines, gray.bits)
    if gray.inverse:
        signed = bits - _samples(lines, gray.inverse)
        contrast = np.abs(signed).max(axis=0)
    elif gray.white_black is not None:
        white, black = _samples(lines, gray.white_black)
        signed, contrast = 2.0 * bits - (white + black), white - black
    else:
        signed, contrast = 2.0 * (bits - offset), 2.0 * modulation
    signed[list(gray.inverted)] *= -1.0
    least = LIT * np.nanpercentile(contrast, 95)
    lit = np.asarray(contrast > max(float(least), 0.0))
    return np.where(lit, signed / np.where(lit, contrast, 1.0), 0.0), lit


def _borders(gray: GrayFrames, signed: FloatMap, lit: BoolMap) -> tuple[Any, ...]:
    """Places where neighbouring pixels lie in neighbouring cells.

    Returns
    -------
    row, column : of the pixel before the border
    place : where the border lies between the two pixels, 0…1
    coordinate : of the border, projector px
    direction : 1 where the cells' numbers rise along the line, −1 where they fall
    """
    before, after = signed[:, :, :-1], signed[:, :, 1:]
    changes = (before > 0.0) != (after > 0.0)
    number = np.where(lit[:, :-1] & lit[:, 1:], changes.sum(axis=0), 0)
    row, column = np.nonzero(number == 1)
    bit, place = changes[:, row, column].argmax(axis=0), np.arange(row.size)
    sides = before[:, row, column], after[:, row, column]
    first, last = (_cells(side) for side in sides)
    firm = np.ones(row.size, bool)
    for side in sides:
        distance = np.abs(side)
        distance[bit, place] = np.inf
        firm &= distance.min(axis=0) > FIRM
    kept = firm & (np.abs(last - first) == 1)
    row, column, bit, place = row[kept], column[kept], bit[kept], place[kept]
    start, end = sides[0][bit, place], sides[1][bit, place]
    # Pixel centres lie on integers: the border before pixel k is at k − ½.
    coordinate = gray.offset_px + np.maximum(first, last)[kept] * gray.step_px - 0.5
    share = start / (start - end)
    return row, column, share, coordinate, (last - first)[kept]


def _cells(signed: FloatMap) -> NDArray[np.intp]:
    """Numbers of the cells of (bits, n) signed bits, most significant bit first."""
    binary = np.bitwise_xor.accumulate((signed > 0.0).astype(np.intp), axis=0)
    weights = 1 << np.arange(len(signed), dtype=np.intp)[::-1]
    return np.asarray(weights @ binary)
