"""The zero of a displacement: what the undisplaced background at the frame's rim tells of it.

A camera that moved between the frames, and a pattern that drifted, displace the background too.
Both leave few unknowns, which the rim determines. Where the rim is no background, nothing tells the
zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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


def _covariance(design: FloatMap, u: FloatMap, weight: FloatMap) -> FloatMap:
    """Covariance of the fit by leaving out one part of the rim at a time (the jackknife): errors
    that go on along the rim count as they are."""
    weighted = design * weight[:, None]
    starts = -(-np.arange(SEGMENTS) * u.size // SEGMENTS)
    parts = [slice(*ends) for ends in pairwise((*starts, u.size))]
    normals = np.stack([weighted[part].T @ design[part] for part in parts])
    pulls = np.stack([weighted[part].T @ u[part] for part in parts])
    without = normals.sum(axis=0) - normals, pulls.sum(axis=0) - pulls
    fits = np.stack([_solved(*one) for one in zip(*without, strict=True)])
    apart = fits - fits.mean(axis=0)
    return np.asarray((SEGMENTS - 1) / SEGMENTS * apart.T @ apart)


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
    if np.count_nonzero(known) < MIN_PLACES:
        return Rim(is_background=False)
    return _measured(prepared, found, blocks, known, given=background is not None)


def _measured(
    prepared: PreparedPair, found: DisplacementMap, blocks: _Blocks, known: BoolMap, *, given: bool
) -> Rim:
    """What blocks of the displacement tell."""
    motion = _Motion(prepared)
    y, x = blocks.places()
    design = motion.design(y, x - np.where(known, blocks.u, 0.0))
    sides = [_places(known)] if given else _sides(known)
    walk = tuple(np.concatenate(part) for part in zip(*sides, strict=True))
    u, of_walk = blocks.u[walk], design[walk]
    if u.size < MIN_PLACES:
        return Rim(is_background=False)
    scale = max(_scatter(u), float(np.finfo(np.float32).eps))
    theta, _ = _fit(of_walk, u, scale)
    near = np.maximum(OBJECT_SIGMAS * blocks.sigma, BENT_PERIODS * prepared.period)
    off = np.abs(blocks.u - design @ theta) > near
    shares = [float(np.mean(~off[side])) for side in sides]
    if sum(share >= MAJORITY for share in shares) < min(MIN_SIDES, len(sides)):
        return Rim(is_background=False)
    if not given:
        left = (blocks.u - design @ theta) / prepared.period
        if _goes_on_bending(left, known, sides, min(prepared.reference.shape) / prepared.period):
            return Rim(is_background=False)
    has_object = given or float(np.mean(off[known])) >= MIN_OBJECT_SHARE
    flat = known & ~_near_object(off & known) & _inside(known.shape, CLEAR_PERIODS)
    if np.count_nonzero(flat) < MIN_PLACES:
        flat = np.zeros(known.shape, bool)
        flat[walk] = True
    around = np.argsort(np.arctan2(y - y.mean(), x - x.mean())[flat], kind="stable")
    of_flat, u = design[flat][around], blocks.u[flat][around]
    theta, weight = _fit(of_flat, u, scale)
    covariance = _covariance(of_flat, u, weight)
    # What the background's own σ covers is no movement: that σ holds errors which neighbours share.
    least = CLEAR_SIGMAS * float(np.median(blocks.sigma[flat]))
    clear = float(np.sqrt(np.mean((of_flat @ theta) ** 2))) > least
    rim = _told(prepared, motion, (theta, covariance), clear)
    if abs(rim.shift_px) >= 0.5 * prepared.period:
        return Rim(is_background=False)  # fringes tell a movement modulo one period
    rim = replace(rim, has_object=has_object)
    if not (rim.significant and has_object):
        return rim
    moved, sigma = _maps(prepared, found, motion, (theta, covariance))
    return replace(rim, displacement_px=moved, sigma_px=sigma)


def _goes_on_bending(left: FloatMap, known: BoolMap, sides: list[Places], periods: float) -> bool:
    """Whether the surface leaves the fit from the rim inwards, as a body that fills the frame does.

    ``left`` are the residuals, periods, and ``periods`` is the shorter side of the frame. A sheet
    that sags by ``BENT_PERIODS`` in its middle has at its rim, L periods from there, a slope of
    2 · BENT_PERIODS / L. Fewer than ``MIN_SIDES`` without such a slope are no background.
    """
    inner = known & _inside(known.shape, BORDER_PERIODS + INWARDS_PERIODS)
    if np.count_nonzero(inner) < MIN_PLACES:
        return False
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
