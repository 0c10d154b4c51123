"""Blocks of a frame with phases of their own, and the plane or slightly bent surface of these."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.bandpass import band_pass
from fringeworks.pair.carrier import Carrier
from fringeworks.pair.unwrap import unwrap
from fringeworks.pair.waveform import (
    SINE,
    Waveform,
    block_harmonics,
    common_waveform,
    harmonic_count,
)
from fringeworks.patterns.order_chain import TURN
from fringeworks.types import BoolMap, FloatMap, InputError

PLANE_TERMS = 5
"""Coefficients of a plane in perspective."""
BENDS = 7
"""Modes of a bend: the polynomials of the second and third degree in u and v."""
BEND_PRIOR = 0.005
"""Standard deviation of a mode of the bend in the prior, as a share of the phase over the frame.

Lenses of cameras and projectors displace the edges of a frame by about 1 % of half its width. A
sheet that sags by as much bends the fringes less.
"""
PERSPECTIVE_PRIOR = 0.5
"""Standard deviation of the two perspective terms in the prior of the fit. 0.5 means that the plane
is three times as far away at one end of the frame as at the other."""
PRIOR_RAD = 0.1
"""Standard deviation of a block's phase against which the prior of the perspective counts, rad."""
MIN_BOTTOM = 0.1
"""Smallest denominator of the plane's projective phase, with 1 in the middle of the frame.

The denominator is proportional to the distance of the plane, so no part of the frame may be more
than ten times closer than the middle. It also keeps the phase finite. An empirical choice.
"""
BLOCK_PERIODS = 2.0
"""Side of a block, periods: whole fringes tell their phase from their brightness."""
PER_SIDE = 16
"""Blocks along a side of a frame with few fringes; they are one period long at least."""
MAX_BLOCKS = 4000
"""Approximate number of blocks of a frame; more only cost time."""
MIN_USABLE = 0.5
"""Smallest share of a block that must be usable."""
MIN_STRENGTH = 0.3
"""Smallest fringe amplitude of a block of background, as a share of that of the strong fringes.

It excludes shadows and dark objects, whose phase is unreliable. An empirical choice.
"""
STRONG_PERCENTILE = 90.0
"""Percentile of the fringe amplitude that represents the frame's strong fringes, %."""
TINY = 1e-12
"""Weight that keeps places along one line from dividing by zero."""
TINY_RAD = 1e-6
"""Smallest scatter of blocks, rad, where there is no noise."""
WAVEFORM_STEPS = 8
"""Number of fits of a block's phase, each with the harmonics at the phase of the fit before.

At γ = 2.2 each divides the error by more than five in blocks of whole periods, and by two in blocks
of less than a period, where perspective widens the fringes.
"""


@dataclass(frozen=True)
class Blocks:
    """The blocks of a frame, (n,) arrays."""

    u: FloatMap
    """Place along x, −1 to 1."""
    v: FloatMap
    """Place along y, −1 to 1."""
    phase: FloatMap
    """Unwrapped phase, rad."""
    amplitude: FloatMap
    """Amplitude of the fringes, counts."""
    brightness: FloatMap
    """Mean of the fringes, counts."""
    sigma: FloatMap
    """Standard deviation of the phase by noise, rad."""
    rim: BoolMap
    """True along the rim of what shows fringes."""
    row: NDArray[np.intp]
    """Place in the grid of blocks."""
    column: NDArray[np.intp]
    harmonics: NDArray[np.complex128]
    """Harmonics of the fringes over their fundamental, (n, k)."""

    def at(self, chosen: NDArray[np.generic]) -> Blocks:
        fields = (self.u, self.v, self.phase, self.amplitude, self.brightness, self.sigma)
        others = (self.rim, self.row, self.column, self.harmonics)
        return Blocks(*(np.asarray(values[chosen]) for values in (*fields, *others)))


@dataclass(frozen=True)
class Plane:
    """Phase of a plane, centre + scale · (a + bu + cv + bend) / (1 + du + ev).

    The bend is a polynomial of the second and third degree: that of lenses and of a curved sheet.
    """

    centre: float
    scale: float
    a: FloatMap
    """a, b, c, then d, e where perspective is fitted, then the coefficients of the bend."""

    @property
    def terms(self) -> int:
        """Number of coefficients without the bend: of blocks that determine a plane."""
        return min(len(self.a), PLANE_TERMS)

    def bent(self) -> Plane:
        """The same plane, of which the bend is fitted as well."""
        if self.terms < PLANE_TERMS or len(self.a) > PLANE_TERMS:
            return self
        return replace(self, a=np.append(self.a, np.zeros(BENDS)))

    def prior(self) -> FloatMap:
        """Inverse variances of the coefficients before anything is seen."""
        found = np.zeros(len(self.a))
        found[3:PLANE_TERMS] = PERSPECTIVE_PRIOR**-2
        found[PLANE_TERMS:] = BEND_PRIOR**-2
        return found

    def bottom(self, u: FloatMap, v: FloatMap) -> FloatMap:
        """The denominator."""
        d, e = self.a[3:PLANE_TERMS] if self.terms == PLANE_TERMS else (0.0, 0.0)
        return np.asarray(1.0 + d * u + e * v)

    def phase(self, u: FloatMap, v: FloatMap) -> FloatMap:
        top = self.a[0] + self.a[1] * u + self.a[2] * v
        for coefficient, mode in zip(self.a[PLANE_TERMS:], _bends(u, v), strict=False):
            top = top + coefficient * mode
        bottom = np.maximum(self.bottom(u, v), MIN_BOTTOM)
        return np.asarray(self.centre + self.scale * top / bottom)

    def __sub__(self, blocks: Blocks) -> FloatMap:
        """Distance of the plane from the phases of blocks but for whole turns, rad."""
        off = self.phase(blocks.u, blocks.v) - blocks.phase
        return np.asarray(off - TURN * np.rint(off / TURN))

    def counted(self, blocks: Blocks) -> Blocks:
        """The blocks with the whole turns of the plane."""
        return replace(blocks, phase=self.phase(blocks.u, blocks.v) - (self - blocks))

    def variance(self, blocks: Blocks, weight: FloatMap, u: FloatMap, v: FloatMap) -> FloatMap:
        """Variance of the phase at places, rad², by blocks of some weight, 1/rad², and the prior of
        the perspective."""
        design = self._design(blocks.u, blocks.v, self.phase(blocks.u, blocks.v))
        bottom = self.bottom(blocks.u, blocks.v)[:, None]
        weighted = (design / bottom).T * (weight * self.scale**2)
        precision = weighted @ (design / bottom)
        precision.flat[:: len(self.a) + 1] += self.prior()
        across, down = np.broadcast_arrays(u, v)
        at = self._design(across, down, self.phase(u, v))
        at = at / self.bottom(u, v)[..., None] * self.scale
        return np.asarray(np.sum((at @ np.linalg.pinv(precision, hermitian=True)) * at, axis=-1))

    def _design(self, u: FloatMap, v: FloatMap, phase: FloatMap) -> FloatMap:
        """Derivatives of the numerator by the coefficients, less those of the denominator times a
        phase, (…, terms)."""
        value = (phase - self.centre) / self.scale
        columns = (np.ones_like(value), u, v, -u * value, -v * value, *_bends(u, v))
        return np.stack(columns[: len(self.a)], axis=-1)

    def fitted(self, blocks: Blocks, weight: FloatMap) -> Plane:
        """The plane that fits blocks with their whole turns best."""
        value = (blocks.phase - self.centre) / self.scale
        design = self._design(blocks.u, blocks.v, blocks.phase)
        weighted = design.T * weight
        normal = weighted @ design
        normal.flat[:: len(self.a) + 1] += TINY + (PRIOR_RAD / self.scale) ** 2 * self.prior()
        return replace(self, a=np.linalg.solve(normal, weighted @ value))


def _bends(u: FloatMap, v: FloatMap) -> tuple[FloatMap, ...]:
    """The modes of a bend at places: 1 at most."""
    return (u * u, u * v, v * v, u**3, u * u * v, u * v * v, v**3)


def _filtered(frame: FloatMap, usable: BoolMap, carrier: Carrier) -> tuple[FloatMap, BoolMap]:
    """Unwrapped phase of a frame after a band-pass, rad, and where it is known."""
    y, x = np.indices(frame.shape, float)
    carried = TURN * (x / carrier.period_px + y * carrier.cross_frequency)
    analytic, _ = band_pass(frame, (1.0 / carrier.period_px, carrier.cross_frequency))
    slow = unwrap(np.angle(analytic * np.exp(-1j * carried)), usable)
    return np.nan_to_num(slow.phase) + carried, usable & (slow.region > 0)


def cut_blocks(
    frame: FloatMap, usable: BoolMap, carrier: Carrier, plane: Plane | None = None
) -> Blocks:
    """Cut a frame with fringes along x into blocks, and fit A + B cos and a slope of the brightness
    to the usable pixels of each; weak ones are left out. The phase within a block runs as that of a
    plane, or without one as that of the filtered frame."""
    h, w = frame.shape
    y, x = np.indices(frame.shape, float)
    if plane is None:
        phase, usable = _filtered(frame, usable, carrier)
    else:
        phase = plane.phase(*places_of(frame.shape))
    side = max(1, round(BLOCK_PERIODS * carrier.period_px))
    rows = max(1, min(side, h // PER_SIDE))
    columns = min(max(min(side, w // PER_SIDE), round(carrier.period_px)), w)
    down, across = h // rows, w // columns
    stride = max(1, down * across // MAX_BLOCKS)

    def cut(values: np.ndarray) -> FloatMap:
        """(blocks, pixels of one)"""
        whole = values[: down * rows, : across * columns].reshape(down, rows, across, columns)
        return np.asarray(
            whole.transpose(0, 2, 1, 3).reshape(down * across, -1)[::stride], np.float64
        )

    weight, counts = cut(usable), cut(frame)
    enough = weight.mean(axis=1) >= MIN_USABLE
    if not enough.any():
        raise InputError(
            f"background: expected places of {columns} × {rows} px that show it, got none"
        )
    weight, counts = weight[enough], counts[enough]
    maps: list[FloatMap] = [cut(values)[enough] for values in (x, y, phase)]
    middles: list[FloatMap] = [
        (weight * values).sum(axis=1) / weight.sum(axis=1) for values in maps
    ]
    u, v = (2.0 * m / max(n - 1, 1) - 1.0 for m, n in zip(middles, (w, h), strict=False))
    if plane is not None:  # the mean of a bent phase is not that in the middle
        middles[2] = plane.phase(u, v)
    found = _fit_blocks(counts, weight, maps, middles, carrier.period_px)
    strong = found.amplitude > MIN_STRENGTH * np.percentile(found.amplitude, STRONG_PERCENTILE)
    row, column = np.divmod(np.arange(down * across)[::stride][enough], across)
    found = replace(found, u=u, v=v, row=row, column=column).at(strong)
    return replace(found, rim=_outermost(found.row, found.column))


def places_of(shape: tuple[int, int]) -> tuple[FloatMap, FloatMap]:
    """Places u and v of the pixels of a frame, (1, w) and (h, 1)."""
    h, w = shape
    return np.linspace(-1.0, 1.0, w)[None, :], np.linspace(-1.0, 1.0, h)[:, None]


def _outermost(row: NDArray[np.intp], column: NDArray[np.intp]) -> BoolMap:
    """Mark the first and last block of every row and every column of blocks."""
    rim = np.zeros(row.shape, bool)
    for line, place in ((row, column), (column, row)):
        order = np.lexsort((place, line))
        first = np.flatnonzero(np.diff(line[order], prepend=-1))
        rim[order[first]] = True
        rim[order[np.append(first[1:], order.size) - 1]] = True
    return rim


def _fit_blocks(
    counts: FloatMap,
    weight: FloatMap,
    maps: list[FloatMap],
    middles: list[FloatMap],
    period_px: float,
) -> Blocks:
    """Fit the fringes of blocks, (n, pixels), with the places u, v of their middle in px.

    ``maps`` are the pixels' places x and y, px, and the phase that is expected there, rad;
    ``middles`` are those of the blocks' middles. A block rarely holds whole periods, so that
    harmonics would displace its phase: those that strong blocks share are subtracted.
    """
    total = weight.sum(axis=1)
    along, aside, wave = (
        values - middle[:, None] for values, middle in zip(maps, middles, strict=True)
    )
    linear: list[FloatMap] = [np.ones_like(along), along]
    if aside.any():
        linear.append(aside)
    found = _fundamental(counts, weight, linear, wave, SINE)
    harmonics = block_harmonics(counts, weight, linear, wave, harmonic_count(period_px))
    strong = found.amplitude >= np.median(found.amplitude)
    found = _fundamental(counts, weight, linear, wave, common_waveform(harmonics[strong]))
    return Blocks(
        u=middles[0],
        v=middles[1],
        # The phase at the middle of the block, next to the one that is expected there.
        phase=middles[2] + np.angle(np.exp(1j * (found.phase - middles[2]))),
        amplitude=found.amplitude,
        brightness=found.brightness,
        sigma=found.sigma,
        rim=np.zeros(total.shape, bool),
        row=np.zeros(total.shape, np.intp),
        column=np.zeros(total.shape, np.intp),
        harmonics=harmonics,
    )


class _Fundamental(NamedTuple):
    """Fringes of blocks, (n,) arrays as in ``Blocks``."""

    brightness: FloatMap
    amplitude: FloatMap
    phase: FloatMap
    """At the pixels where ``wave`` of ``_fundamental`` is 0, rad."""
    sigma: FloatMap


def _fundamental(
    counts: FloatMap, weight: FloatMap, linear: list[FloatMap], wave: FloatMap, shape: Waveform
) -> _Fundamental:
    """Fit A + B s(φ) and a slope of the brightness to blocks, (n, pixels).

    ``wave`` is the phase that is expected less that in the middle of the block.
    """
    design = np.stack([linear[0], np.cos(wave), np.sin(wave), *linear[1:]], axis=2)
    weighted = (design * weight[:, :, None]).transpose(0, 2, 1)
    inverse = np.linalg.pinv(weighted @ design, rcond=TINY)
    beyond = np.zeros_like(counts)
    for _ in range(WAVEFORM_STEPS if shape.harmonics.size else 1):
        seen = counts - beyond
        fitted = inverse @ (weighted @ seen[:, :, None])
        c, s = fitted[:, 1, 0], fitted[:, 2, 0]
        amplitude, phase = np.hypot(c, s), np.angle(c - 1j * s)
        left = np.sum(weight * (seen - (design @ fitted)[:, :, 0]) ** 2, axis=1)
        beyond = amplitude[:, None] * shape.beyond(wave + phase[:, None])
    total = weight.sum(axis=1)
    freedom = np.maximum(total - design.shape[2], 1.0)
    # Of an amplitude in steps over whole periods.
    noise = np.sqrt(2.0 * left / freedom / total)
    sigma = noise / np.maximum(amplitude, TINY) + TINY_RAD
    return _Fundamental(fitted[:, 0, 0], amplitude, phase, sigma)
