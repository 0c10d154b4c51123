"""Sign and start of the phase steps, as the borders of a Gray code show them.

A border between two cells lies at a known projector coordinate. The phase there, and the direction
in which it runs across the border, tell whether the steps have the sign and the start that the plan
says. Cells of any width show it, also those of one period, inside which a wrong start is invisible.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import fit_matrices, times
from fringeworks.stack.gray_frames import GrayFrames
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames
from fringeworks.stack.sample import Lines
from fringeworks.types import BoolMap, Finding, FloatMap, FramesContradictPlan

FIRM = 0.2
"""Smallest distance of the other bits of a pixel from their threshold, as a share of their
contrast. Noise and blur then change none of them. An empirical choice."""
LIT = 0.3
"""Smallest contrast of a pixel that is used, as a share of the 95th percentile. Dimmer pixels have
less contrast than indirect light adds. An empirical choice."""
MIN_BORDERS = 30
"""Smallest number of borders for a statement: the mean of 30 directions is known to a tenth of
their scatter."""
RELATED = 0.5
"""Smallest mean resultant length of the phases at the borders. The phases of frames in no relation
to the code have 0.2 with 30 borders; photographs of objects in order have 0.76 and more."""
MISPLACED_TURNS = 0.125
"""Largest distance of a border of the code from its phase that blur and threshold may cause, turns.
A wrong start is off by a step, which is a quarter of a turn with four steps."""
IN_ORDER = 0.7
"""Smallest share of the changes of bits that lead to a neighbouring cell, and smallest mean
direction of the phase there, ±, for a statement about the steps. Codes in order have 0.71 and more
on photographs; with frames in another order either is below 0.65."""


@dataclass(frozen=True)
class Convention:
    """What the borders of a Gray code say about the phase steps of a set."""

    borders: int
    """Number of borders that were used."""
    direction: float
    """Mean direction of the phase: 1 along the code, −1 against it."""
    start_turns: float
    """Phase at coordinate 0 px in the direction that the phase has, turns, −0.5…0.5; 0 expected."""
    resultant: float
    """Mean resultant length of the phases at the borders, 0…1."""
    share: float
    """Share of the changes of bits that lead to a neighbouring cell, 0…1."""

    @property
    def sign(self) -> int:
        """1 where the phase runs along the code, −1 where it runs against it."""
        return -1 if self.direction < 0.0 else 1

    @property
    def contradicts(self) -> bool:
        """Whether the steps have another sign or start than the plan says."""
        in_order = min(self.share, abs(self.direction)) >= IN_ORDER
        if self.borders < MIN_BORDERS or self.resultant < RELATED or not in_order:
            return False
        # Standard error of a circular mean, turns, three times.
        scatter = np.sqrt(-2.0 * np.log(min(self.resultant, 1.0)))
        error = 3.0 * scatter / (2.0 * np.pi * self.borders**0.5)
        return self.sign < 0 or bool(abs(self.start_turns) > MISPLACED_TURNS + error)

    def fitting_deg(self, shifts_rad: tuple[float, ...]) -> list[float]:
        """The steps that the frames show, degrees, 0…360."""
        turns = np.asarray(shifts_rad) / (2.0 * np.pi) - self.start_turns
        return [float(d) for d in (np.rint(self.sign * turns * 360.0) % 360.0)]


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
    offset, wave = _fitted(phases, lines)
    signed, lit = _bits(gray, lines, offset, np.abs(wave))
    changes, row, column, place, coordinate, direction = _borders(gray, signed, lit)
    left, right = wave[row, column], wave[row, column + 1]
    along = np.angle(right * np.conj(left)) * direction
    runs = float(np.mean(np.sign(along))) if along.size else 0.0
    sign = -1.0 if runs < 0.0 else 1.0
    at_border = np.angle((1.0 - place) * left + place * right)
    expected = 2.0 * np.pi * coordinate / phases.period_px
    mean = np.mean(np.exp(1j * (at_border - sign * expected))) if along.size else 0.0
    start = float(np.angle(mean)) / (2.0 * np.pi)
    share = along.size / max(1, changes)
    return Convention(along.size, runs, start, float(np.abs(mean)), share)


def refuse_other_steps(decoding: Decoding, lines: Lines, labels: list[str]) -> None:
    """Refuse phase steps of another sign or start than the plan's, and name those that fit.

    Raises
    ------
    FramesContradictPlan where the borders of the Gray code contradict the steps.
    """
    found = convention(decoding, lines)
    if found is None or not found.contradicts:
        return
    phases = decoding.sets[0]
    steps = ", ".join(f"{d:.0f}°" for d in found.fitting_deg(phases.shifts_rad))
    seen = (
        "the phase runs against the Gray code"
        if found.sign < 0
        else f"the phase at coordinate 0 is {360.0 * found.start_turns:.0f}°, expected 0°"
    )
    finding = Finding(
        "steps",
        f"frames along {decoding.axis}: {seen}, judging by {found.borders} borders of the code",
        causes=(
            "the steps have another sign or start than the plan says",
            *_swaps(phases, found, labels),
        ),
        advice=f"steps that fit the frames from {labels[phases.frames[0]]} on: {steps}",
        axis=decoding.axis,
        figures={"start_deg": 360.0 * found.start_turns, "direction": found.direction},
        severity="error",
    )
    raise FramesContradictPlan(finding.text)


def _swaps(phases: PhaseFrames, found: Convention, labels: list[str]) -> list[str]:
    """Pairs of frames whose swap gives the steps that the frames show, in words."""
    planned = np.asarray(phases.shifts_rad)
    shown = np.radians(found.fitting_deg(phases.shifts_rad))
    pairs = []
    for i, j in combinations(range(len(planned)), 2):
        swapped = planned.copy()
        swapped[[i, j]] = planned[[j, i]]
        off = np.abs(np.angle(np.exp(1j * (swapped - shown))))
        if off.max() < MISPLACED_TURNS * 2.0 * np.pi:
            a, b = phases.frames[i], phases.frames[j]
            pairs.append(f"frames {a} and {b} ({labels[a]}, {labels[b]}) are swapped")
    return pairs


def _samples(lines: Lines, frames: tuple[int, ...]) -> FloatMap:
    """Lines of some frames, (frames, r, l), counts; NaN where a sample is not finite."""
    data = np.stack([lines[k].astype(np.float64) for k in frames])
    return np.where(np.isfinite(data), data, np.nan)


def _fitted(phases: PhaseFrames, lines: Lines) -> tuple[FloatMap, NDArray[np.complex128]]:
    """Background and complex modulation of the lines, (r, l)."""
    data = _samples(lines, phases.frames)
    solver: Any = fit_matrices(phases.rows)[1]
    a, c, s = times(solver, data.reshape(len(data), -1)).reshape(3, *data.shape[1:])
    return a, c + 1j * s


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
    least = LIT * np.nanpercentile(contrast, 95)
    lit = np.asarray(contrast > max(float(least), 0.0))
    return np.where(lit, signed / np.where(lit, contrast, 1.0), 0.0), lit


def _borders(gray: GrayFrames, signed: FloatMap, lit: BoolMap) -> tuple[Any, ...]:
    """Places where neighbouring pixels lie in neighbouring cells.

    Returns
    -------
    changes : number of places where lit neighbours differ in any bit
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
    return np.count_nonzero(number), row, column, share, coordinate, (last - first)[kept]


def _cells(signed: FloatMap) -> NDArray[np.intp]:
    """Numbers of the cells of (bits, n) signed bits, most significant bit first."""
    binary = np.bitwise_xor.accumulate((signed > 0.0).astype(np.intp), axis=0)
    weights = 1 << np.arange(len(signed), dtype=np.intp)[::-1]
    return np.asarray(weights @ binary)
