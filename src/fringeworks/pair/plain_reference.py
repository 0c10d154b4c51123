"""Reference for a single frame: the plain fringes that fit its plane background.

The frame is cut into blocks of two periods. Each block of background has a phase of its own, free
of what filters carry over from the object, and the phase of a plane is fitted to these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.bandpass import band_pass
from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.unwrap import unwrap
from fringeworks.pair.waveform import (
    SINE,
    Waveform,
    block_harmonics,
    common_waveform,
    harmonic_count,
)
from fringeworks.patterns.order_chain import TURN
from fringeworks.signal.filters import widened
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median
from fringeworks.types import BoolMap, FloatMap, InputError, Pair

MIN_BACKGROUND = 0.02
"""Smallest share of the frame that can serve as background, 0…1.

A smaller patch determines the plane's perspective poorly at the far end of the frame. An empirical
choice.
"""
OFF_PLANE_RAD = 0.5
"""Distance of a block's phase from the plane from which on it is never background, rad: about a
twelfth of a period."""
OFF_PLANE_SIGMAS = 5.0
"""The same in standard deviations of noise and ``UNEVEN_RAD``."""
UNEVEN_RAD = 0.02
"""Standard deviation of the blocks' distances from a plane by other causes than noise, rad: lenses
and sensors bend its fringes by as much."""
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
MIN_BOTTOM = 0.1
"""Smallest denominator of the plane's projective phase, with 1 in the middle of the frame.

The denominator is proportional to the distance of the plane, so no part of the frame may be more
than ten times closer than the middle. It also keeps the phase finite. An empirical choice.
"""
MIN_PERSPECTIVE_SIDE = 16
"""Smallest side of a frame for which perspective is fitted, px.

In a frame of a few rows, noise would determine the perspective. An empirical choice.
"""
PERSPECTIVE_PRIOR = 0.5
"""Standard deviation of the two perspective terms in the prior of the fit. 0.5 means that the plane
is three times as far away at one end of the frame as at the other."""
PRIOR_RAD = 0.1
"""Standard deviation of a block's phase against which the prior of the perspective counts, rad."""
CANDIDATES = 600
"""Planes through five random blocks of the rim that are compared. With half of the rim on one
plane, 19 of them are true."""
REFINED = 20
"""The most likely ones of these, which are fitted to all blocks before the choice."""
REFINEMENTS = 5
"""Rounds of that fit, each with the weights of a Cauchy distribution."""
SHARED_RIM = 0.5
"""Smallest share of the rim that must lie on one plane, if the background is not given: otherwise
another plane could hold more of it."""
SECOND_PLANE = 0.75
"""Share of the rim's blocks on the plane, from which on as many others on another plane make the
choice between both ambiguous."""
ROBUST = 2.0
"""Scale of the Cauchy weights of the blocks, in standard deviations of their scatter."""
SETTLED = 0.1
"""Change of the plane that ends its fit, over the scatter of the blocks."""
TINY = 1e-12
"""Weight that keeps places along one line from dividing by zero."""
TINY_RAD = 1e-6
"""Smallest scatter of blocks, rad, where there is no noise."""
ADVICE = "give the pixels that show the reference plane (background), or a reference frame"
"""What to do about a background that is not found."""
WAVEFORM_STEPS = 3
"""Number of fits of a block's phase, each with the harmonics at the phase of the fit before. Each
divides the error by more than five at γ = 2.2."""
MIN_AWAY = 20
"""Fewest blocks that must remain away from the object: four for each coefficient of a plane."""
MAX_FIT_STEPS = 30
"""Largest number of steps of the fit; it usually takes five."""
PARTS = 4
"""Parts per side into which the background is cut, to see how much the plane depends on each."""
MIN_RISING = 0.99
"""Smallest share of the frame on which the plane's phase must rise along the carrier, 0…1.

A phase that falls belongs to no carrier, so the fit has failed there. An empirical choice.
"""


class PlainReference(NamedTuple):
    """Plain fringes of the plane background of a frame."""

    carrier: Carrier
    """Its period and cross frequency are the medians over the plane."""
    reference: FloatMap
    """A + B s(phase of the plane), (h, w), counts, as captured, with the waveform s of the
    background's fringes."""
    sigma_px: FloatMap
    """Standard deviation of the plane's phase, as a displacement, (h, w), px, as captured. Its
    errors are common to large parts of the frame."""
    converged: bool
    """False where the background still changed when the fit ended."""


@dataclass(frozen=True)
class _Blocks:
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

    def at(self, chosen: NDArray[np.generic]) -> _Blocks:
        fields = (self.u, self.v, self.phase, self.amplitude, self.brightness, self.sigma)
        others = (self.rim, self.row, self.column, self.harmonics)
        return _Blocks(*(np.asarray(values[chosen]) for values in (*fields, *others)))


def plain_reference(frame: FloatMap, usable: BoolMap, pair: Pair) -> PlainReference:
    """Compute the fringes of a frame's plane background over the whole frame.

    Parameters
    ----------
    frame : (h, w) float array
        Object frame of ``pair``, counts, gaps filled.
    usable : (h, w) bool array
        False where a gap was filled, or the frame is saturated.
    pair : Pair
        ``axis`` is the direction of the fringes or None. ``background`` is True where the reference
        plane is visible; without it, the plane is that of the rim of the frame.

    Raises
    ------
    InputError
        If the frame has no carrier, or no background whose fringes fit a plane; without a given
        background also if less than half of the rim lies on one plane, or if a second plane holds
        as much of it.

    Notes
    -----
    Theory §5, "Single frames".
    """
    carrier = find_carrier(frame, pair.axis, name="object")
    given = pair.background
    if given is not None and given.shape != frame.shape:
        raise InputError(f"background: expected shape {frame.shape}, got {given.shape}")
    usable = usable if given is None else usable & given
    if carrier.axis == "y":
        frame, usable = frame.T, usable.T
    if usable.mean() < MIN_BACKGROUND:
        raise InputError(
            f"background: expected fringes over at least {MIN_BACKGROUND:.0%} of the frame, "
            f"got {usable.mean():.1%}"
        )
    blocks = _blocks(frame, usable, carrier)
    plane, member, converged = _fit(blocks, frame.shape, search=given is None)
    background = blocks.at(member)
    phase, variance = _phase_map(blocks, member, plane, frame.shape)
    if not (np.diff(phase, axis=1) > 0).mean() > MIN_RISING:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    wave = common_waveform(background.harmonics)
    reference = median(background.brightness) + median(background.amplitude) * wave.at(phase)
    fx = float(np.median(np.diff(phase, axis=1))) / TURN
    fy = float(np.median(np.diff(phase, axis=0))) / TURN if frame.shape[0] > 1 else 0.0
    sigma = np.sqrt(variance) / (TURN * fx)

    def turned(values: FloatMap) -> FloatMap:
        return np.ascontiguousarray(values if carrier.axis == "x" else values.T)

    fitted = Carrier(carrier.axis, 1.0 / fx, carrier.share, fy)
    return PlainReference(fitted, turned(reference), turned(sigma), converged)


def _blocks(frame: FloatMap, usable: BoolMap, carrier: Carrier) -> _Blocks:
    """Cut a frame with fringes along x into blocks, and fit A + B cos and a slope of the brightness
    to the usable pixels of each; weak ones are left out."""
    h, w = frame.shape
    y, x = np.indices(frame.shape, float)
    carried = TURN * (x / carrier.period_px + y * carrier.cross_frequency)
    analytic, _ = band_pass(frame, (1.0 / carrier.period_px, carrier.cross_frequency))
    slow = unwrap(np.angle(analytic * np.exp(-1j * carried)), usable)
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
    weight *= cut(slow.region > 0)
    enough = weight.mean(axis=1) >= MIN_USABLE
    if not enough.any():
        raise InputError(
            f"background: expected places of {columns} × {rows} px that show it, got none"
        )
    weight, counts = weight[enough], counts[enough]
    phase = np.nan_to_num(slow.phase) + carried
    maps = [cut(values)[enough] for values in (x, y, phase)]
    found = _fit_blocks(counts, weight, maps, carrier.period_px)
    strong = found.amplitude > MIN_STRENGTH * np.percentile(found.amplitude, STRONG_PERCENTILE)
    u, v = (2.0 * m / max(n - 1, 1) - 1.0 for m, n in ((found.u, w), (found.v, h)))
    row, column = np.divmod(np.arange(down * across)[::stride][enough], across)
    found = replace(found, u=u, v=v, row=row, column=column).at(strong)
    return replace(found, rim=_outermost(found.row, found.column))


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
    counts: FloatMap, weight: FloatMap, maps: list[FloatMap], period_px: float
) -> _Blocks:
    """Fit the fringes of blocks, (n, pixels), with the places u, v of their middle in px.

    ``maps`` are the pixels' places x and y, px, and the phase of the filtered frame, rad. A block
    rarely holds whole periods, so that harmonics would displace its phase: those that strong blocks
    share are subtracted.
    """
    total = weight.sum(axis=1)
    middles = [(weight * values).sum(axis=1) / total for values in maps]
    along, aside, wave = (
        values - middle[:, None] for values, middle in zip(maps, middles, strict=True)
    )
    linear = [np.ones_like(along), along]
    if aside.any():
        linear.append(aside)
    found = _fundamental(counts, weight, linear, wave, SINE)
    harmonics = block_harmonics(counts, weight, linear, wave, harmonic_count(period_px))
    strong = found.amplitude >= np.median(found.amplitude)
    found = _fundamental(counts, weight, linear, wave, common_waveform(harmonics[strong]))
    return _Blocks(
        u=middles[0],
        v=middles[1],
        # The phase at the middle of the block, next to that of the filtered frame.
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
    """Fringes of blocks, (n,) arrays as in ``_Blocks``."""

    brightness: FloatMap
    amplitude: FloatMap
    phase: FloatMap
    """At the pixels where ``wave`` of ``_fundamental`` is 0, rad."""
    sigma: FloatMap


def _fundamental(
    counts: FloatMap, weight: FloatMap, linear: list[FloatMap], wave: FloatMap, shape: Waveform
) -> _Fundamental:
    """Fit A + B s(φ) and a slope of the brightness to blocks, (n, pixels).

    ``wave`` is the phase of the filtered frame less that in the middle of the block.
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


@dataclass(frozen=True)
class _Plane:
    """Phase of a plane, centre + scale · (a + bu + cv) / (1 + du + ev)."""

    centre: float
    scale: float
    a: FloatMap
    """a, b, c, and d, e where perspective is fitted."""

    @property
    def terms(self) -> int:
        """Number of coefficients: of blocks that determine a plane."""
        return len(self.a)

    def bottom(self, u: FloatMap, v: FloatMap) -> FloatMap:
        """The denominator."""
        d, e = self.a[3:] if self.terms == 5 else (0.0, 0.0)
        return np.asarray(1.0 + d * u + e * v)

    def phase(self, u: FloatMap, v: FloatMap) -> FloatMap:
        top = self.a[0] + self.a[1] * u + self.a[2] * v
        bottom = np.maximum(self.bottom(u, v), MIN_BOTTOM)
        return np.asarray(self.centre + self.scale * top / bottom)

    def __sub__(self, blocks: _Blocks) -> FloatMap:
        """Distance of the plane from the phases of blocks but for whole turns, rad."""
        off = self.phase(blocks.u, blocks.v) - blocks.phase
        return np.asarray(off - TURN * np.rint(off / TURN))

    def counted(self, blocks: _Blocks) -> _Blocks:
        """The blocks with the whole turns of the plane."""
        return replace(blocks, phase=self.phase(blocks.u, blocks.v) - (self - blocks))

    def variance(self, blocks: _Blocks, weight: FloatMap, u: FloatMap, v: FloatMap) -> FloatMap:
        """Variance of the phase at places, rad², by blocks of some weight, 1/rad², and the prior of
        the perspective."""
        design = self._design(blocks.u, blocks.v, self.phase(blocks.u, blocks.v))
        bottom = self.bottom(blocks.u, blocks.v)[:, None]
        weighted = (design / bottom).T * (weight * self.scale**2)
        precision = weighted @ (design / bottom)
        prior = np.zeros(self.terms)
        prior[3:] = PERSPECTIVE_PRIOR**-2
        precision.flat[:: self.terms + 1] += prior
        across, down = np.broadcast_arrays(u, v)
        at = self._design(across, down, self.phase(u, v))
        at = at / self.bottom(u, v)[..., None] * self.scale
        return np.asarray(np.sum((at @ np.linalg.pinv(precision, hermitian=True)) * at, axis=-1))

    def _design(self, u: FloatMap, v: FloatMap, phase: FloatMap) -> FloatMap:
        """Derivatives of the numerator by the coefficients, less those of the denominator times a
        phase, (…, terms)."""
        value = (phase - self.centre) / self.scale
        columns = (np.ones_like(value), u, v, -u * value, -v * value)
        return np.stack(columns, axis=-1)[..., : self.terms]

    def fitted(self, blocks: _Blocks, weight: FloatMap) -> _Plane:
        """The plane that fits blocks with their whole turns best."""
        value = (blocks.phase - self.centre) / self.scale
        design = self._design(blocks.u, blocks.v, blocks.phase)
        weighted = design.T * weight
        normal = weighted @ design
        prior = np.full(self.terms, TINY)
        prior[3:] = (PRIOR_RAD / self.scale / PERSPECTIVE_PRIOR) ** 2
        normal.flat[:: self.terms + 1] += prior
        return replace(self, a=np.linalg.solve(normal, weighted @ value))


def _spread(off: FloatMap) -> float:
    """Robust standard deviation of distances from a plane, rad."""
    return max(median(np.abs(off)) / NORMAL_MEDIAN, TINY_RAD)


def _robust(off: FloatMap, spread: float) -> FloatMap:
    """Cauchy weights of distances with this standard deviation."""
    return np.asarray(1.0 / (1.0 + (off / (ROBUST * spread)) ** 2))


def _fit(blocks: _Blocks, shape: tuple[int, int], *, search: bool) -> tuple[_Plane, BoolMap, bool]:
    """Fit the phase of a plane; return it, the blocks that lie on it, and whether these settled.

    ``search``: the plane is that of the rim of the frame; otherwise that of all blocks.
    """
    terms = 5 if min(shape) >= MIN_PERSPECTIVE_SIDE else 3
    if blocks.u.size < terms:
        raise InputError(
            f"background: expected fringes in {terms} places or more, got {blocks.u.size}"
        )
    scale = float(np.ptp(blocks.phase)) or 1.0
    plane = _Plane(float(blocks.phase.mean()), scale, np.zeros(terms))
    every = np.ones(blocks.u.size, bool)
    if search:
        plane = _on_the_rim(blocks, plane)
        member = _explained(plane, blocks)
    else:
        plane = _most_shared(replace(blocks, rim=every), plane)
        member = every
    converged = False
    for step in range(MAX_FIT_STEPS):
        off = plane - blocks
        spread = _spread(off[member])
        before = plane
        plane = plane.fitted(plane.counted(blocks), member * _robust(off, spread))
        moved = plane.phase(blocks.u, blocks.v) - before.phase(blocks.u, blocks.v)
        near = every
        if search:
            near = (np.abs(plane - blocks) < OFF_PLANE_SIGMAS * spread) & _explained(plane, blocks)
            near = _away(blocks, near)
            if step >= MAX_FIT_STEPS // 2:  # blocks that come and go are no certain background
                near &= member
        converged = bool((near == member).all() and np.abs(moved).max() < SETTLED * spread)
        member = near
        if converged or np.count_nonzero(member) < terms:
            break
    if np.count_nonzero(member) < terms:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    if search:
        _check_rim(plane, blocks)
        _check_object(plane, blocks)
    return plane, member, converged


def _check_object(plane: _Plane, blocks: _Blocks) -> None:
    """InputError where all blocks lie on a plane."""
    if np.mean(_explained(plane, blocks)) > 1.0 - MIN_BACKGROUND:
        raise InputError(
            "background: expected an object before a plane, got one plane all over the frame, "
            f"whose own height and tilt a single frame does not show; {ADVICE}"
        )


def _excess(plane: _Plane, blocks: _Blocks) -> FloatMap:
    """Distance of blocks from a plane over the largest one of its own blocks."""
    most = np.minimum(OFF_PLANE_SIGMAS * np.hypot(blocks.sigma, UNEVEN_RAD), OFF_PLANE_RAD)
    return np.asarray(np.abs(plane - blocks) / most)


def _away(blocks: _Blocks, member: BoolMap) -> BoolMap:
    """Blocks of the background without a neighbour that is off its plane.

    An object has a skirt. Its outer blocks are still close to the plane, but all on one side of it.
    Where too few blocks would be left, the background is narrow, and all blocks count.
    """
    grid = np.zeros((int(blocks.row.max()) + 1, int(blocks.column.max()) + 1), bool)
    grid[blocks.row, blocks.column] = ~member
    away = member & ~widened(grid, 1)[blocks.row, blocks.column]
    return away if np.count_nonzero(away) >= MIN_AWAY else member


def _explained(plane: _Plane, blocks: _Blocks) -> BoolMap:
    """Blocks whose distance from a plane noise and an uneven background explain."""
    return np.asarray(_excess(plane, blocks) < 1.0)


def _on_the_rim(blocks: _Blocks, start: _Plane) -> _Plane:
    """The plane that most of the blocks along the rim share; ``start`` has its form.

    Raises
    ------
    InputError where this is less than half of them, or where another plane holds as many.
    """
    first = _most_shared(blocks, start)
    near = _explained(first, blocks)
    found, rim = _check_rim(first, blocks), int(np.sum(blocks.rim))
    others = blocks.at(~near)
    second = _explained(_most_shared(others, start), others)
    another = int(np.sum(second & others.rim))
    if another > SECOND_PLANE * found:
        raise InputError(
            "background: expected the fringes of one plane along the rim of the frame, got one "
            f"with {found / rim:.0%} of it and another with {another / rim:.0%}; {ADVICE}"
        )
    return first


def _check_rim(plane: _Plane, blocks: _Blocks) -> int:
    """Blocks of the rim on a plane; InputError where they are less than half of the rim."""
    found, rim = int(np.sum(_explained(plane, blocks) & blocks.rim)), int(np.sum(blocks.rim))
    if found < SHARED_RIM * rim:
        raise InputError(
            "background: expected the fringes of one plane along at least half of the rim of the "
            f"frame, got {found / max(rim, 1):.0%} of it; {ADVICE}"
        )
    return found


def _most_shared(blocks: _Blocks, start: _Plane) -> _Plane:
    """The plane through random blocks of the rim that most of all blocks lie on, or lie closest to:
    that with the least sum of distances, of which none counts more than a block's off the plane."""
    drawn, terms = np.flatnonzero(blocks.rim), start.terms
    if drawn.size < terms:
        return start.fitted(blocks, np.ones(blocks.u.size))
    random = np.random.default_rng(0)
    planes = [
        start.fitted(blocks.at(random.choice(drawn, terms, replace=False)), np.ones(terms))
        for _ in range(CANDIDATES)
    ]

    def loss(plane: _Plane) -> float:
        return float(np.minimum(_excess(plane, blocks), 1.0).sum())

    best = sorted(planes, key=loss)[:REFINED]
    for _ in range(REFINEMENTS):
        near = [1.0 / (OFF_PLANE_SIGMAS**-2 + _excess(plane, blocks) ** 2) for plane in best]
        best += [p.fitted(p.counted(blocks), w) for p, w in zip(best, near, strict=True)]
        best = sorted(best, key=loss)[:REFINED]
    return best[0]


def _phase_map(
    blocks: _Blocks, member: BoolMap, plane: _Plane, shape: tuple[int, int]
) -> tuple[FloatMap, FloatMap]:
    """Phase of the plane over the frame, and its variance, rad².

    The variance has two parts. The first is the scatter of the blocks around the plane: where the
    object hides the background, it may be as uneven as where it is seen. The second is the larger
    of two estimates of the errors that neighbouring blocks share. One is a jackknife over parts of
    the background, plus the change when the next row of blocks beside the object is left out,
    which the object's skirt may have raised. The other is what as many parts leave of the prior of
    the plane.
    """
    h, w = shape
    u, v = np.linspace(-1.0, 1.0, w)[None, :], np.linspace(-1.0, 1.0, h)[:, None]
    if not plane.bottom(u, v).min() > MIN_BOTTOM:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    phase = plane.phase(u, v)
    background = plane.counted(blocks.at(member))
    off = plane - background
    weight = _robust(off, _spread(off))
    place = np.floor((background.u + 1.0) * 0.5 * PARTS) + PARTS * np.floor(
        (background.v + 1.0) * 0.5 * PARTS
    )
    parts = np.unique(place)
    changes = []
    for part in parts:
        kept = place != part
        if np.count_nonzero(kept) >= plane.terms:
            changes.append(plane.fitted(background.at(kept), weight[kept]).phase(u, v) - phase)
    scatter = float(np.average(off**2, weights=weight))
    count = len(changes)
    shared = np.zeros(shape)
    for change in changes:
        shared += (count - 1) / count * change**2
    further = _away(blocks, member)
    if further.any() and not (further == member).all():
        kept = further[member]
        skirt = plane.fitted(background.at(kept), weight[kept]).phase(u, v) - phase
        shared += skirt**2
    # Blocks of one part have errors in common: together they count as one.
    weight *= parts.size / weight.sum() / max(scatter, TINY_RAD**2)
    return phase, scatter + np.maximum(shared, plane.variance(background, weight, u, v))
