"""Reference for a single frame: the plain fringes that fit its plane background.

The frame is cut into blocks of two periods. Each block of background has a phase of its own, free
of what filters carry over from the object, and the phase of a plane is fitted to these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.plane_blocks import (
    MIN_BOTTOM,
    PLANE_TERMS,
    TINY_RAD,
    Blocks,
    Plane,
    cut_blocks,
    places_of,
)
from fringeworks.pair.waveform import common_waveform
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
MIN_PERSPECTIVE_SIDE = 16
"""Smallest side of a frame for which perspective is fitted, px.

In a frame of a few rows, noise would determine the perspective. An empirical choice.
"""
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
ADVICE = "give the pixels that show the reference plane (background), or a reference frame"
"""What to do about a background that is not found."""
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
    search = given is None
    blocks = cut_blocks(frame, usable, carrier)
    plane = _start(blocks, frame.shape, carrier, search=search)
    plane, member, _ = _fit(blocks, plane, search=search)
    if search:
        _check_rim(plane, blocks)
        _check_object(plane, blocks)
    scatter = _spread((plane - blocks)[member])
    # A filter bends the phase at the frame's border and beside objects; the plane's own does not.
    blocks = cut_blocks(frame, usable, carrier, plane)
    plane, member, converged = _fit(blocks, plane, search=search, scatter=scatter)
    plane, settled = _refined(blocks, plane.bent(), member)
    converged &= settled
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


def _spread(off: FloatMap) -> float:
    """Robust standard deviation of distances from a plane, rad."""
    return max(median(np.abs(off)) / NORMAL_MEDIAN, TINY_RAD)


def _robust(off: FloatMap, spread: float) -> FloatMap:
    """Cauchy weights of distances with this standard deviation."""
    return np.asarray(1.0 / (1.0 + (off / (ROBUST * spread)) ** 2))


def _start(blocks: Blocks, shape: tuple[int, int], carrier: Carrier, *, search: bool) -> Plane:
    """The plane that most blocks share; with ``search``, of those along the rim of the frame."""
    terms = PLANE_TERMS if min(shape) >= MIN_PERSPECTIVE_SIDE else 3
    if blocks.u.size < terms:
        raise InputError(
            f"background: expected fringes in {terms} places or more, got {blocks.u.size}"
        )
    scale = TURN * shape[1] / carrier.period_px
    plane = Plane(float(blocks.phase.mean()), scale, np.zeros(terms))
    if search:
        return _on_the_rim(blocks, plane)
    return _most_shared(replace(blocks, rim=np.ones(blocks.u.size, bool)), plane)


def _fit(
    blocks: Blocks, plane: Plane, *, search: bool, scatter: float = 0.0
) -> tuple[Plane, BoolMap, bool]:
    """Fit the phase of a plane; return it, the blocks that lie on it, and whether these settled.

    ``search``: the blocks next to the plane are its background, by their scatter around it and at
    least by ``scatter``, rad; otherwise all blocks are.
    """
    if not search:
        every = np.ones(blocks.u.size, bool)
        plane, converged = _refined(blocks, plane, every)
        return plane, every, converged
    member = _explained(plane, blocks)
    converged = False
    for step in range(MAX_FIT_STEPS):
        plane, moved, spread = _step(blocks, plane, member)
        most = OFF_PLANE_SIGMAS * max(spread, scatter)
        near = (np.abs(plane - blocks) < most) & _explained(plane, blocks)
        near = _away(blocks, near)
        if step >= MAX_FIT_STEPS // 2:  # blocks that come and go are no certain background
            near &= member
        converged = bool((near == member).all() and moved < SETTLED * spread)
        member = near
        if converged:
            break
    return plane, member, converged


def _refined(blocks: Blocks, plane: Plane, member: BoolMap) -> tuple[Plane, bool]:
    """Fit the phase of a plane to some blocks; return it, and whether it settled."""
    for _ in range(MAX_FIT_STEPS):
        plane, moved, spread = _step(blocks, plane, member)
        if moved < SETTLED * spread:
            return plane, True
    return plane, False


def _step(blocks: Blocks, plane: Plane, member: BoolMap) -> tuple[Plane, float, float]:
    """A step of that fit: the plane, its largest change and the scatter around it before, rad."""
    if np.count_nonzero(member) < plane.terms:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    off = plane - blocks
    spread = _spread(off[member])
    found = plane.fitted(plane.counted(blocks), member * _robust(off, spread))
    moved = found.phase(blocks.u, blocks.v) - plane.phase(blocks.u, blocks.v)
    return found, float(np.abs(moved[member]).max()), spread


def _check_object(plane: Plane, blocks: Blocks) -> None:
    """InputError where all blocks lie on a plane."""
    if np.mean(_explained(plane, blocks)) > 1.0 - MIN_BACKGROUND:
        raise InputError(
            "background: expected an object before a plane, got one plane all over the frame, "
            f"whose own height and tilt a single frame does not show; {ADVICE}"
        )


def _excess(plane: Plane, blocks: Blocks) -> FloatMap:
    """Distance of blocks from a plane over the largest one of its own blocks."""
    most = np.minimum(OFF_PLANE_SIGMAS * np.hypot(blocks.sigma, UNEVEN_RAD), OFF_PLANE_RAD)
    return np.asarray(np.abs(plane - blocks) / most)


def _away(blocks: Blocks, member: BoolMap) -> BoolMap:
    """Blocks of the background without a neighbour that is off its plane.

    An object has a skirt. Its outer blocks are still close to the plane, but all on one side of it.
    Where too few blocks would be left, the background is narrow, and all blocks count.
    """
    grid = np.zeros((int(blocks.row.max()) + 1, int(blocks.column.max()) + 1), bool)
    grid[blocks.row, blocks.column] = ~member
    away = member & ~widened(grid, 1)[blocks.row, blocks.column]
    return away if np.count_nonzero(away) >= MIN_AWAY else member


def _explained(plane: Plane, blocks: Blocks) -> BoolMap:
    """Blocks whose distance from a plane noise and an uneven background explain."""
    return np.asarray(_excess(plane, blocks) < 1.0)


def _on_the_rim(blocks: Blocks, start: Plane) -> Plane:
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


def _check_rim(plane: Plane, blocks: Blocks) -> int:
    """Blocks of the rim on a plane; InputError where they are less than half of the rim."""
    found, rim = int(np.sum(_explained(plane, blocks) & blocks.rim)), int(np.sum(blocks.rim))
    if found < SHARED_RIM * rim:
        raise InputError(
            "background: expected the fringes of one plane along at least half of the rim of the "
            f"frame, got {found / max(rim, 1):.0%} of it; {ADVICE}"
        )
    return found


def _most_shared(blocks: Blocks, start: Plane) -> Plane:
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

    def loss(plane: Plane) -> float:
        return float(np.minimum(_excess(plane, blocks), 1.0).sum())

    best = sorted(planes, key=loss)[:REFINED]
    for _ in range(REFINEMENTS):
        near = [1.0 / (OFF_PLANE_SIGMAS**-2 + _excess(plane, blocks) ** 2) for plane in best]
        best += [p.fitted(p.counted(blocks), w) for p, w in zip(best, near, strict=True)]
        best = sorted(best, key=loss)[:REFINED]
    return best[0]


def _phase_map(
    blocks: Blocks, member: BoolMap, plane: Plane, shape: tuple[int, int]
) -> tuple[FloatMap, FloatMap]:
    """Phase of the plane over the frame, and its variance, rad².

    The variance has two parts. The first is the scatter of the blocks around the plane: where the
    object hides the background, it may be as uneven as where it is seen. The second is the larger
    of two estimates of the errors that neighbouring blocks share. One is a jackknife over parts of
    the background, plus the change when the next row of blocks beside the object is left out,
    which the object's skirt may have raised. The other is what as many parts leave of the prior of
    the plane.
    """
    u, v = places_of(shape)
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
