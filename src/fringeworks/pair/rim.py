"""The zero of a displacement: what the undisplaced background at the frame's rim tells of it.

A camera that moved between the frames, and a pattern that drifted, displace the background too.
Both leave few unknowns, which the rim determines. Where the rim is no background, nothing tells the
zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.counting import MAX_DISPLACEMENT_PERIODS, RowMethod
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import ReferencePhase, reference_phase
from fringeworks.signal.bands import row_bands
from fringeworks.signal.filters import widened
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import BoolMap, DisplacementMap, FloatMap, Frozen, InputError, sealed

BLOCKS_PER_PERIOD = 4.0
"""Blocks per period over which the displacement is averaged: a walk of them stays close to the
rim."""
BORDER_PERIODS = 0.5
"""Width of the frame's border that is not used, periods: filters see beyond the frame there. The
kernel of ``fourier`` has a width of 0.4 periods."""
CLEAR_PERIODS = 1.0
"""Distance from the border, and from the object, of the background that determines the movement,
periods, where there is enough of it: filters and windows mix what is closer."""
INWARDS_PERIODS = 0.25
"""Distance from the rim of the second walk, which shows whether the surface bends, periods."""
SEGMENTS = 32
"""Parts of the rim of which one at a time is left out for the covariance: with four unknowns, the
covariance is known to about a quarter."""
DEPTHS = 8
"""Parts of the background, by their distance from the frame's border, of which one at a time is
left out as well: the skirt of an object goes around the frame, and shows from the rim inwards."""
UNKNOWN_PERIODS = float(np.sqrt(MAX_DISPLACEMENT_PERIODS * (MAX_DISPLACEMENT_PERIODS + 1.0) / 3.0))
"""Standard deviation of a zero whose whole periods nothing tells, periods: displacements are
searched up to ``MAX_DISPLACEMENT_PERIODS`` either way, and each order among them is as likely."""
SIDE_PARTS = 8
"""Parts of one side of the rim, whose scatter tells how well the mean of the side is known."""
FIT_STEPS = 30
"""Steps of the robust fit; it has settled after about ten."""
MIN_PLACES = 40
"""Fewest blocks of the rim that a fit needs, ten for each unknown."""
BENT_PERIODS = 0.05
"""Distance from the fit up to which a block still counts as background, periods. Half of the rims
of the photographed pairs (sheets and boards that were touched between the frames) lies within
0.006, and objects close to the rim reach into it by filters."""
OBJECT_SIGMAS = 5.0
"""The same in standard deviations of a block."""
CLEAR_SIGMAS = 3.0
"""Distance from which on two figures differ, in standard deviations: 0.3 % of chance."""
MAJORITY = 0.5
"""Share of the blocks on a side of the rim from which that side shows background. A robust fit
stands less than a half of outliers."""
MIN_SIDES = 3
"""Sides of the frame that must show background: an object may stand on one side."""
PEAKED = 2.0 / float(np.sqrt(2.0 * np.pi * np.exp(1.0)))
"""Standard deviation, over half the width of an interval, at which values within it are as likely
by a normal distribution as by one that is uniform."""
MIN_OBJECT_SHARE = 0.01
"""Smallest share of the blocks that shows an object; without one, a plane at another height cannot
be told from a camera that moved."""
TINY_RANK = 1e-6
"""Singular value, over the largest, below which two movements look the same in this frame."""

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns of blocks."""


@dataclass(frozen=True, eq=False, repr=False)
class Rim(Frozen):
    """What the rim of the frame tells of the zero of a displacement."""

    is_background: bool
    """Whether one movement of camera or pattern explains most of the rim on three sides."""
    has_object: bool = False
    """Whether a part of the frame is not displaced like the rim."""
    significant: bool = False
    """Whether the rim is displaced, by its likelihood, and by more than σ of a pixel."""
    shift_px: float = 0.0
    """Displacement of the rim in the middle of the frame, px."""
    shift_sigma_px: float = 0.0
    """Standard deviation of that, px."""
    turn_deg: float = 0.0
    """Turn of the object frame's background against that of the reference, degrees."""
    displacement_px: FloatMap | None = None
    """The displacement by the movement, (h, w), px, where it is removed."""
    sigma_px: FloatMap | None = None
    """Standard deviation of that, (h, w), px."""
    zero_sigma_px: float = 0.0
    """Standard deviation of the zero, which all pixels share, px, where its whole periods are
    unknown."""


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Block means of a displacement, (r, c), in the orientation of the prepared pair."""

    u: FloatMap
    sigma: FloatMap
    side: int

    def places(self) -> tuple[FloatMap, FloatMap]:
        """Rows and columns of the blocks' middles, (r, c), px."""
        index: FloatMap = np.indices(self.u.shape, dtype=np.float64)
        at = index * self.side + 0.5 * (self.side - 1)
        return at[0], at[1]


def _blocks(u: FloatMap, sigma: FloatMap, side: int) -> _Blocks:
    """Means over whole blocks; NaN where a pixel is missing."""
    r, c = (n // side for n in u.shape)

    def mean(values: FloatMap) -> FloatMap:
        cut = np.asarray(values[: r * side, : c * side], np.float64)
        return np.asarray(cut.reshape(r, side, c, side).mean(axis=(1, 3)))

    return _Blocks(mean(u), mean(sigma), side)


def _inside(shape: tuple[int, ...], periods: float) -> BoolMap:
    """Blocks at least so many periods from the border of the frame, (r, c)."""
    depth = round(periods * BLOCKS_PER_PERIOD)
    inside = np.zeros(shape, bool)
    inside[depth:-depth, depth:-depth] = True
    return inside


def _places(where: BoolMap) -> Places:
    """Rows and columns of the marked blocks."""
    rows, columns = np.nonzero(where)
    return rows, columns


def _near_object(off: BoolMap) -> BoolMap:
    """Blocks within ``CLEAR_PERIODS`` of those that are not background, (r, c)."""
    return widened(off, round(CLEAR_PERIODS * BLOCKS_PER_PERIOD))


def _sides(known: BoolMap) -> list[Places]:
    """Rows and columns of the outermost known blocks, as seen from left, bottom, right and top, in
    the order of a walk around the frame."""
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    last_row, last_column = known.shape[0] - 1, known.shape[1] - 1
    left = known[rows].argmax(axis=1)
    right = last_column - known[rows][:, ::-1].argmax(axis=1)
    top = known[:, columns].argmax(axis=0)
    bottom = last_row - known[::-1][:, columns].argmax(axis=0)
    return [
        (rows, left),
        (bottom, columns),
        (rows[::-1], right[::-1]),
        (top[::-1], columns[::-1]),
    ]


class _Motion:
    """How movements of camera and pattern displace the fringes of a reference."""

    def __init__(self, prepared: PreparedPair) -> None:
        self.phase: ReferencePhase | None = reference_phase(prepared)
        self.frequency = prepared.frequency
        self.shape = prepared.reference.shape

    def design(self, y: FloatMap, x: FloatMap) -> FloatMap:
        """Displacement along x, px, by a shift along x of 1 px, along y of 1 px, a turn of 1 rad
        and a drift of 1 rad, at places of the reference, (…, 4)."""
        h, w = self.shape
        fx, fy = np.full(x.shape, self.frequency[0]), np.full(x.shape, self.frequency[1])
        if self.phase is not None:
            along_x, along_y = self.phase.slopes(y, x)
            fx += along_x / (2.0 * np.pi)
            fy += along_y / (2.0 * np.pi)
        across = fy / fx
        down, right = y - 0.5 * (h - 1), x - 0.5 * (w - 1)
        return np.stack(
            [np.ones_like(fx), across, across * right - down, 1.0 / (2.0 * np.pi * fx)], axis=-1
        )


def _fit(design: FloatMap, u: FloatMap, scale: float) -> tuple[FloatMap, FloatMap]:
    """Robust fit of a linear model, and the weights of the places, 0…1.

    Least absolute deviations first, then Tukey's biweight about that.
    """
    weight: FloatMap = np.ones(u.size)
    found: FloatMap = np.zeros(design.shape[-1])
    for step in range(FIT_STEPS):
        weighted = design * weight[:, None]
        found = _solved(weighted.T @ design, weighted.T @ u)
        residual = np.abs(u - design @ found)
        if step < FIT_STEPS // 2:
            weight = scale / np.maximum(residual, scale)
        else:
            width = OBJECT_SIGMAS * max(scale, float(np.median(residual)) / NORMAL_MEDIAN)
            weight = np.maximum(1.0 - (residual / width) ** 2, 0.0) ** 2
    return np.asarray(found), weight


def _solved(normal: FloatMap, pull: FloatMap) -> FloatMap:
    """Solution of normal equations; directions that nothing determines stay at 0."""
    return np.asarray(np.linalg.pinv(normal, rcond=TINY_RANK**2, hermitian=True) @ pull)


def _covariance(design: FloatMap, u: FloatMap, weight: FloatMap, count: int) -> FloatMap:
    """Covariance of the fit by leaving out one of ``count`` parts at a time (the jackknife): errors
    that go on within a part count as they are."""
    weighted = design * weight[:, None]
    starts = -(-np.arange(count) * u.size // count)
    parts = [slice(*ends) for ends in pairwise((*starts, u.size))]
    normals = np.stack([weighted[part].T @ design[part] for part in parts])
    pulls = np.stack([weighted[part].T @ u[part] for part in parts])
    without = normals.sum(axis=0) - normals, pulls.sum(axis=0) - pulls
    fits = np.stack([_solved(*one) for one in zip(*without, strict=True)])
    apart = fits - fits.mean(axis=0)
    return np.asarray((count - 1) / count * apart.T @ apart)


def _depth(shape: tuple[int, ...]) -> FloatMap:
    """Distance of blocks from the border of the frame, (r, c), blocks."""
    rows, columns = (np.minimum(np.arange(n), np.arange(n)[::-1]) for n in shape)
    return np.minimum(rows[:, None], columns).astype(np.float64)


def _spread(left: FloatMap) -> float:
    """Standard deviation of residuals, from their median magnitude."""
    return float(np.median(np.abs(left))) / NORMAL_MEDIAN


def _scatter(u: FloatMap) -> float:
    """Standard deviation of the noise along a walk, from its second differences."""
    second = u[2:] - 2.0 * u[1:-1] + u[:-2]
    return float(np.median(np.abs(second)) / NORMAL_MEDIAN / np.sqrt(6.0))


def measure_rim(
    prepared: PreparedPair, found: DisplacementMap, background: BoolMap | None = None
) -> Rim:
    """Find whether the rim of the frame shows the background, and how that has moved.

    Parameters
    ----------
    prepared : PreparedPair
    found : DisplacementMap
        Of that pair.
    background : (h, w) bool array, optional
        True where the reference plane shows in the object frame; the rim by default.

    Returns
    -------
    Rim

    Raises
    ------
    InputError for a background of another shape.

    Notes
    -----
    Theory §5, "Zero": the image moves by (t_x − ω y, t_y + ω x) and the pattern by a phase δ, so
    that the fringes of the background are displaced by t_x − ω y + (t_y + ω x) f_y/f_x + δ/(2π f_x)
    with the local frequency (f_x, f_y) of the reference.
    """
    if background is not None and background.shape != found.displacement_px.shape:
        raise InputError(
            f"background: expected shape {found.displacement_px.shape}, got {background.shape}"
        )
    turn = prepared.to_capture
    u, sigma = turn(found.displacement_px), turn(found.sigma_px)
    if background is not None:
        u = np.where(turn(background), u, np.nan)
    side = max(1, round(prepared.period / BLOCKS_PER_PERIOD))
    blocks = _blocks(u, sigma, side)
    known = np.isfinite(blocks.u) & np.isfinite(blocks.sigma)
    known &= _inside(known.shape, BORDER_PERIODS)
    rim = Rim(is_background=False)
    if np.count_nonzero(known) >= MIN_PLACES:
        rim = _measured(prepared, found, blocks, known, given=background is not None)
    if rim.is_background and (rim.has_object or not rim.significant):
        return rim
    return replace(rim, zero_sigma_px=UNKNOWN_PERIODS * prepared.period)


def _measured(
    prepared: PreparedPair, found: DisplacementMap, blocks: _Blocks, known: BoolMap, *, given: bool
) -> Rim:
    """What blocks of the displacement tell."""
    motion = _Motion(prepared)
    y, x = blocks.places()
    design = motion.design(y, x - np.where(known, blocks.u, 0.0))
    sides = [_places(known)] if given else _sides(known)
    rim = _fit_of_rim(prepared, blocks, design, sides)
    if rim is None or (not given and _goes_on_bending(prepared, rim.left, known, sides)):
        return Rim(is_background=False)
    apart = np.abs(rim.left)
    # A surface that goes up and down as the rim does is no object on a background.
    off = apart > np.maximum(rim.near, OBJECT_SIGMAS * rim.spread)
    has_object = given or float(np.mean(off[known])) >= MIN_OBJECT_SHARE
    # The skirt of an object leaves the rim's level by more than the rim itself does.
    least = np.minimum(rim.near, OBJECT_SIGMAS * rim.spread)
    off = known & (apart > np.maximum(OBJECT_SIGMAS * blocks.sigma, least))
    flat = known & ~_near_object(off) & _inside(known.shape, CLEAR_PERIODS)
    if np.count_nonzero(flat) < MIN_PLACES:
        flat = np.zeros(known.shape, bool)
        flat[tuple(np.concatenate(part) for part in zip(*sides, strict=True))] = True
    angle = np.arctan2(y - y.mean(), x - x.mean())[flat]
    fit = _fit_of_background(design[flat], blocks.u[flat], (angle, _depth(known.shape)[flat]), rim)
    # What the background's own σ covers is no movement: that σ holds errors which neighbours share.
    shared = float(np.median(blocks.sigma[flat]))
    if found.method in get_args(RowMethod):  # only the pixels of one fringe of a row do
        shared /= np.sqrt(blocks.side)
    clear = float(np.sqrt(np.mean((design[flat] @ fit[0]) ** 2))) > CLEAR_SIGMAS * shared
    told = replace(_told(prepared, motion, fit, clear), has_object=has_object)
    if not has_object:  # what is displaced fills the frame, and has no skirt
        told = replace(told, significant=clear)
    if abs(told.shift_px) >= 0.5 * prepared.period:
        return Rim(is_background=False)  # fringes tell a movement modulo one period
    if not (told.significant and has_object):
        return told
    moved, sigma = _maps(prepared, found, motion, fit)
    return replace(told, displacement_px=moved, sigma_px=sigma)


class _RimFit(NamedTuple):
    """A movement that explains most of the rim."""

    left: FloatMap
    """What it leaves of all blocks, (r, c), px."""
    near: FloatMap
    """Distance up to which a block counts as background, (r, c), px."""
    spread: float
    """Standard deviation of what it leaves of the rim, px."""
    scale: float
    """Noise of a block, px."""


def _fit_of_rim(
    prepared: PreparedPair, blocks: _Blocks, design: FloatMap, sides: list[Places]
) -> _RimFit | None:
    """The movement that explains most of the rim; None where none does on three sides.

    What it leaves of the background must be closer to a normal distribution than to one in which
    any level is as likely, as on a surface that goes up and down.
    """
    walk = tuple(np.concatenate(part) for part in zip(*sides, strict=True))
    u = blocks.u[walk]
    if u.size < MIN_PLACES:
        return None
    scale = max(_scatter(u), float(np.finfo(np.float32).eps))
    theta, _ = _fit(design[walk], u, scale)
    left = blocks.u - design @ theta
    near = np.maximum(OBJECT_SIGMAS * blocks.sigma, BENT_PERIODS * prepared.period)
    share = np.abs(left) / near
    clear = [float(np.mean(share[side] <= 1.0)) for side in sides]
    if sum(s >= MAJORITY for s in clear) < min(MIN_SIDES, len(sides)):
        return None
    inside = share[walk][share[walk] <= 1.0]
    if float(np.sqrt(np.mean(inside**2))) > PEAKED:
        return None
    return _RimFit(left, near, _spread(left[walk]), scale)


def _fit_of_background(
    design: FloatMap, u: FloatMap, places: tuple[FloatMap, FloatMap], rim: _RimFit
) -> tuple[FloatMap, FloatMap]:
    """The movement of the background's blocks, and its covariance.

    ``places`` are the angle about the frame's middle and the distance from its border, by which the
    blocks are taken apart for the covariance.
    """
    theta, weight = _fit(design, u, rim.scale)
    covariance: FloatMap = np.zeros((theta.size, theta.size))
    for place, parts in zip(places, (SEGMENTS, DEPTHS), strict=True):
        order = np.argsort(place, kind="stable")
        covariance += _covariance(design[order], u[order], weight[order], parts)
    # What a movement leaves of the rim is shape, of the sheet or of the object, which may as well
    # raise all of it.
    raised = _solved((design * weight[:, None]).T @ design, design.T @ weight)
    return theta, covariance + rim.spread**2 * np.outer(raised, raised)


def _goes_on_bending(
    prepared: PreparedPair, left_px: FloatMap, known: BoolMap, sides: list[Places]
) -> bool:
    """Whether the surface leaves the fit from the rim inwards, as a body that fills the frame does.

    ``left_px`` are the residuals. A sheet that sags by ``BENT_PERIODS`` in its middle has at its
    rim, L periods from there, a slope of 2 · BENT_PERIODS / L. Fewer than ``MIN_SIDES`` without
    such a slope are no background.
    """
    inner = known & _inside(known.shape, BORDER_PERIODS + INWARDS_PERIODS)
    if np.count_nonzero(inner) < MIN_PLACES:
        return False
    left, periods = left_px / prepared.period, min(prepared.reference.shape) / prepared.period
    sag = 2.0 * BENT_PERIODS / (0.5 * periods) * INWARDS_PERIODS
    bent = 0
    for walk, further in zip(sides, _sides(inner), strict=True):
        outer, deeper = (np.array_split(left[places], SIDE_PARTS) for places in (walk, further))
        steps = [np.median(b) - np.median(a) for a, b in zip(outer, deeper, strict=True) if b.size]
        error = float(np.std(steps)) / np.sqrt(len(steps))
        bent += abs(float(np.mean(steps))) > sag + CLEAR_SIGMAS * error
    return len(sides) - bent < MIN_SIDES


def _told(
    prepared: PreparedPair, motion: _Motion, fit: tuple[FloatMap, FloatMap], clear: bool
) -> Rim:
    """The movement as a shift and a turn, and whether its likelihood speaks for it (the Bayesian
    information criterion)."""
    theta, covariance = fit
    h, w = prepared.reference.shape
    rows, columns = np.array([0.5, 0.0, 1.0]) * (h - 1), np.full(3, 0.5 * (w - 1))
    middle, top, bottom = motion.design(rows, columns)
    tilt = float((bottom - top) @ theta) / max(h - 1, 1)
    evidence = float(theta @ np.linalg.pinv(covariance, rcond=TINY_RANK**2) @ theta)
    price = float(np.linalg.matrix_rank(covariance)) * np.log(SEGMENTS)
    return Rim(
        is_background=True,
        significant=bool(clear and evidence > price),
        shift_px=float(middle @ theta),
        shift_sigma_px=float(np.sqrt(max(middle @ covariance @ middle, 0.0))),
        turn_deg=-float(np.degrees(np.arctan(tilt))),
    )


def _maps(
    prepared: PreparedPair, found: DisplacementMap, motion: _Motion, fit: tuple[FloatMap, FloatMap]
) -> tuple[FloatMap, FloatMap]:
    """The displacement by a movement at every pixel, and its standard deviation, px."""
    theta, covariance = fit
    turn = prepared.to_capture
    u = turn(found.displacement_px)
    moved, sigma = (np.empty(u.shape, np.float32) for _ in range(2))
    columns = np.arange(u.shape[1], dtype=np.float64)
    for band in row_bands(u.shape, bytes_per_px=160):
        part = u[band.rows]
        rows = np.broadcast_to(np.arange(u.shape[0])[band.rows, None], part.shape)
        place = columns - np.where(np.isfinite(part), part, 0.0)
        design = motion.design(rows.astype(np.float64), place)
        moved[band.rows] = design @ theta
        variance = np.einsum("...i,ij,...j->...", design, covariance, design)
        sigma[band.rows] = np.sqrt(np.maximum(variance, 0.0))
    return sealed(turn(moved)), sealed(turn(sigma))


def without_movement(found: DisplacementMap, rim: Rim) -> DisplacementMap:
    """A displacement less that of the rim, whose uncertainty becomes a part of σ; the displacement
    itself where nothing is removed."""
    if rim.displacement_px is None or rim.sigma_px is None:
        return found
    kind = found.displacement_px.dtype
    return replace(
        found,
        displacement_px=sealed((found.displacement_px - rim.displacement_px).astype(kind)),
        sigma_px=sealed(np.hypot(found.sigma_px, rim.sigma_px).astype(found.sigma_px.dtype)),
    )


def with_unknown_zero(found: DisplacementMap, rim: Rim) -> DisplacementMap:
    """A displacement whose σ holds the whole periods that the zero may be off by.

    ``details["zero_sigma_px"]`` is that part, which all pixels share. σ is in double precision
    then, so that the part of single pixels can be told again (``of_pixels``).
    """
    if rim.zero_sigma_px == 0.0:
        return found
    sigma = np.hypot(found.sigma_px.astype(np.float64), rim.zero_sigma_px)
    details = {**found.details, "zero_sigma_px": rim.zero_sigma_px}
    return replace(found, sigma_px=sealed(sigma), details=details)


def of_pixels(found: DisplacementMap) -> tuple[DisplacementMap, float]:
    """The displacement without the part of σ by an unknown zero, and that part, px."""
    zero = float(found.details.get("zero_sigma_px", 0.0))
    if zero == 0.0:
        return found, zero
    sigma = np.sqrt(np.maximum(found.sigma_px**2 - zero**2, 0.0))
    return replace(found, sigma_px=sealed(sigma)), zero
