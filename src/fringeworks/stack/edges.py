"""Errors of coordinates beside edges: the shift that blur makes at paint, and mixed depths.

The camera's blur mixes the light of neighbouring pixels. Beside an edge of brightness this shifts
the coordinate in a known way, which is taken out. Beside a depth step the shift depends on what is
hidden, so that σ covers it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median, quantile
from fringeworks.statistics.surface_scatter import MIN_DIFFERENCES, SHARED
from fringeworks.statistics.third_difference import third_difference, third_difference_variance
from fringeworks.types import BoolMap, FloatMap

STEP = 3
"""Distance of the pixels whose differences the blur is estimated from, px. At 1 px, the higher
orders of a blur of 1.3 px lower the estimate to 0.9 px; at 3 and 4 px it is right within 0.1 px."""

STRONG = 0.97
"""Quantile of the influence of the blur from which on differences are used. Errors at weak edges
are noise, ripple and relief. Empirical; 0.9 to 0.99 give the same blur within 3 %."""

PASSES = 4
"""Most passes; each computes slopes without the shift that the one before has found. For a blur of
1.3 px, one, two and three passes leave rms errors of 0.26, 0.17 and 0.16 px. Simulated."""

SETTLED = 0.01
"""Relative change of the blur's variance from pass to pass that ends them. Narrow blur needs two
passes, one of 1.3 px four."""

SAMPLED = 50_000
"""Approximate number of pixels per direction that the blur is estimated from: they determine its
variance to 1 %."""

MOST_BLUR_PX = 3.0
"""Largest blur that is taken out, px: the first order of a wider one does not describe it."""

SIGNIFICANT = 4.0
"""Standard errors of the blur's variance from which on it is taken out."""

EXPLAINED = 0.5
"""Share of the squared differences beyond noise that the shift must explain. Simulated blur
explains 0.65 and more, even beside vibration; ripple of a bent response beside paint, blending and
mixed depths explain up to 0.3 by chance."""

ROBUST = 2.0
"""Scale of the Cauchy weights of the differences, in standard deviations of their scatter."""

ROUNDS = 8
"""Rounds of reweighting; most stacks need four."""

FITTED = 2
"""Neighbours to each side that a slope is fitted to, px, as in the kernel."""

EDGE_REACH = 4
"""Distance from an edge of brightness to both sides at which its height is taken, px: twice the
blur of usual lenses."""

CLEAR = 20.0
"""Smallest height of an edge whose width is taken, over the noise of the modulation: the share of
it over two pixels is then known to 0.1."""

CLEAR_SHARE = 0.3
"""The same over the brighter side. Lower ones are texture of which several edges meet."""

SHARPEST = 0.75
"""Quantile of the rise of edges over two pixels that counts as that of the sharpest. Half of all
edges lie between pixels or aslant."""

SHARPEST_RISE = 0.9999
"""Largest rise over two pixels, over the height of the edge: that of a blur of 0.26 px, which is
less than the area of a pixel makes."""

FAINT = 4.0
"""Slope of the modulation's logarithm, in standard deviations, below which a pixel is no edge: six
of 100,000 exceed it by noise."""

PIXEL_PX2 = 1.0 / 12.0
"""Variance of the light over the area of a pixel, px²."""

USUAL_BLUR_PX2 = 1.0
"""Largest variance of the blur of usual lenses that are in focus, px²: where nothing tells it, more
would count shades as edges."""

FEWEST_EDGES = 5
"""Smallest number of edges that bound the blur."""

SLOPE_REACH = 3
"""Distance to both sides over which the slope along a line is taken, px."""

CELLS_PER_PERIOD = 16.0
"""Cells of a Gray code alone that count as a period of fringes: differences of four are a step,
three times the noise of what six cells extrapolate to."""

STEEPEST = 0.25
"""Steepest slope of a coordinate along a line that is used, periods of the fringes per px."""

NOT_SEEN = (0.0, float("inf"), 0.0)
"""Coefficient, error and scatter where the coordinates tell nothing of the blur."""

TINY = 1e-12
"""Divides instead of a zero."""

RINGS = 4
"""Largest distance from a depth step at which σ is raised, px, as in the kernel."""

FEWEST = 30
"""Smallest number of pixels at a distance from steps whose errors count by themselves: their rms
is known to 13 %. With fewer, the errors at the next smaller distance count."""


class Fringes(TypedDict):
    """What the coordinates of a map are measured by."""

    period_px: float
    """Shortest period of the fringes, projector px."""
    repeats_px: float
    """Distance after which coordinates repeat, projector px; infinite for absolute ones."""
    light_noise: float
    """Noise of the modulation's logarithm, which is that of the set with the shortest period, over
    the noise of the coordinate, rad per projector px."""


def fringes_of(decoding: Decoding) -> Fringes:
    """What the coordinates of a decoding are measured by."""
    period_px = decoding.finest_px
    if decoding.gray is not None and not decoding.sets:
        period_px = CELLS_PER_PERIOD * decoding.gray.step_px
    # A coordinate is the mean of all sets by their inverse variances: a set counts by its frames
    # and by the square of its phase per px.
    finest = min(decoding.sets, key=lambda s: s.period_px, default=None)
    counted = [len(s.frames) / s.period_px**2 for s in decoding.sets]
    alone = 1.0 if finest is None else len(finest.frames) / finest.period_px**2
    share = sum(counted) / alone if counted else 1.0
    return {
        "period_px": period_px,
        "repeats_px": decoding.repeats_px,
        "light_noise": TURN / period_px * share**0.5,
    }


class Light(NamedTuple):
    """Logarithms of the light of a map, NaN where there is none."""

    modulation: FloatMap
    background: FloatMap

    @classmethod
    def of(cls, maps: Mapping[str, Any]) -> Light:
        """The light of decoded maps."""
        return cls(_log(maps["modulation"]), _log(maps["background"]))


ShiftOf = Callable[..., tuple[FloatMap, FloatMap]]
"""Function of coordinates, σ and light: their shift by blur of one px², by modulation and by
background."""


class Lines(NamedTuple):
    """Maps of which some rows are compared along themselves."""

    coordinate: FloatMap
    sigma: FloatMap
    light: Light
    rows: slice

    @classmethod
    def across(cls, coordinate: FloatMap, sigma: FloatMap, light: Light, stride: int) -> Lines:
        """Every stride-th row of maps, with the neighbours that its slopes are fitted to."""
        reach = np.arange(-FITTED, FITTED + 1)
        rows = np.arange(FITTED, coordinate.shape[0] - FITTED, stride)[:, None] + reach

        def taken(values: FloatMap) -> FloatMap:
            return np.ascontiguousarray(values[rows.ravel()])

        parts = Light(taken(light.modulation), taken(light.background))
        return cls(taken(coordinate), taken(sigma), parts, np.s_[FITTED :: reach.size])


def remove_blur_shift(
    coordinate: FloatMap, sigma: FloatMap, light: Light, **fringes: Unpack[Fringes]
) -> float:
    """Remove the shift of coordinates by the camera's blur at edges of brightness, in place.

    Parameters
    ----------
    coordinate, sigma : (h, w) float32 arrays, projector px
        NaN where a coordinate is unknown.
    light : Light
        Maps of the same shape.

    Returns
    -------
    float ≥ 0: standard deviation of the blur, camera px; 0 where the map does not show one.

    Notes
    -----
    A Gaussian blur of variance v shifts the coordinate u by v ∇ln B · ∇u, where B is the blurred
    modulation. v is the regression of the third differences of u on those of the shift, which
    vanish on smooth surfaces. σ contains the error of v, and the noise of ln B.
    """
    stride, slope = -(-coordinate.size // SAMPLED), np.empty(coordinate.shape, np.float32)
    shift_of = _shift_by(fringes, faint=_faint(sigma, fringes))
    turned = Light(light.modulation.T, light.background.T)
    both = ((coordinate, sigma, light), (coordinate.T, sigma.T, turned))
    lines = [Lines.across(*maps, stride) for maps in both if maps[0].shape[0] > 2 * FITTED]
    found = _blur(lines, shift_of, fringes["period_px"])
    if found is None:
        return 0.0
    variance, error = found
    shift, _ = _shift_by(fringes)(coordinate, sigma, light, slope)
    for _ in range(PASSES):
        again, _ = shift_of(coordinate - np.float32(variance) * shift, sigma, light)
        np.copyto(shift, again, where=again != 0.0)
    # The modulation of equal steps has the relative noise of the phase, its difference over 2 px
    # half of that variance.
    noise = 0.5 * (variance * TURN / fringes["period_px"]) ** 2
    sigma *= np.sqrt(1.0 + np.float32(noise) * slope)
    np.hypot(sigma, np.float32(error) * shift, out=sigma)
    coordinate -= np.float32(variance) * shift
    return float(variance**0.5)


def cover_blur_shift(
    coordinate: FloatMap,
    sigma: FloatMap,
    light: Light,
    most_px2: float,
    **fringes: Unpack[Fringes],
) -> None:
    """Add to σ, in place, the shift by a blur of which only the largest variance is known.

    Every variance up to ``most_px2`` is as likely: the mean square of the shift is a third of that
    by the largest. Shades that change by less than noise from pixel to pixel are left out. The
    other parameters are those of ``remove_blur_shift``.
    """
    shift_of = _shift_by(fringes, faint=_faint(sigma, fringes))
    shift, _ = shift_of(coordinate, sigma, light)
    # Slopes that half of the largest shift is taken out of.
    shift, _ = shift_of(coordinate - np.float32(0.5 * most_px2) * shift, sigma, light)
    np.hypot(sigma, np.float32(most_px2 / 3.0**0.5) * shift, out=sigma)


def line_sigma(
    coordinate: FloatMap,
    sigma: FloatMap,
    light: Light,
    most_px2: float,
    *,
    clear: bool = False,
    **fringes: Unpack[Fringes],
) -> FloatMap:
    """The same for single lines, (r, l): σ with the shift along them; with ``clear`` only at shades
    that change by more than noise."""
    shift, _ = _shift_along(fringes)(coordinate, sigma, light)
    if clear:
        shift[~(np.abs(_central(light.modulation, 1)) >= _faint(sigma, fringes))] = 0.0
    return np.asarray(np.hypot(sigma, np.float32(most_px2 / 3.0**0.5) * shift))


def _shift_by(fringes: Fringes, *, faint: float = 0.0) -> ShiftOf:
    """The function that computes the shift by blur of one px² on maps, by modulation and by
    background; 0 where neither changes by ``faint`` or more from pixel to pixel."""
    steps: _core._EdgeSteps = {"most": 0.5 * fringes["period_px"], "repeats": fringes["repeats_px"]}

    def shift_of(
        moved: FloatMap, sigma: FloatMap, light: Light, slope: FloatMap | None = None
    ) -> tuple[FloatMap, FloatMap]:
        shift, told = np.empty((2, *moved.shape), np.float32)
        slope = np.empty_like(shift) if slope is None else slope
        lights: _core._Lights = {
            "modulation": light.modulation,
            "background": light.background,
            "shift": shift,
            "told": told,
            "faint": faint,
        }
        _core.blur_shift(moved, sigma, lights, steps, slope)
        return shift, told

    return shift_of


def _faint(sigma: FloatMap, fringes: Fringes) -> float:
    """Slope of a logarithm of light below which a pixel is no edge, from the usual noise: that of
    ln B is that of the phase, of its slope over 2 px a root of two less."""
    known = sigma[np.isfinite(sigma)]
    usual = median(known) if known.size else 0.0
    return float(FAINT * fringes["light_noise"] * usual / 2.0**0.5)


def _shift_along(fringes: Fringes) -> ShiftOf:
    """The function that computes the same along lines."""

    def shift_of(moved: FloatMap, sigma: FloatMap, light: Light) -> tuple[FloatMap, FloatMap]:
        del sigma
        rise = _continued(_central(moved, SLOPE_REACH), SLOPE_REACH)
        rise[~(np.abs(rise) < STEEPEST * fringes["period_px"])] = np.nan
        by_modulation, by_background = (np.nan_to_num(rise * _central(m, 1)) for m in light)
        return by_modulation, by_background

    return shift_of


def line_shift(
    coordinate: FloatMap, sigma: FloatMap, light: Light, **fringes: Unpack[Fringes]
) -> FloatMap | None:
    """Shift of coordinates along single lines, (r, l), by the camera's blur, projector px; None
    where the lines do not show any.

    The parameters are those of ``remove_blur_shift``. Slopes across the lines are not known: the
    shift is that along them.
    """
    if coordinate.shape[1] <= 2 * SLOPE_REACH:
        return None
    shift_of = _shift_along(fringes)
    found = _blur([Lines(coordinate, sigma, light, np.s_[:])], shift_of, fringes["period_px"])
    if found is None:
        return None
    variance = np.float32(found[0])
    shift, _ = shift_of(coordinate, sigma, light)
    shift, _ = shift_of(coordinate - variance * shift, sigma, light)
    return np.asarray(variance * shift)


def most_blur(light: Light, sigma: FloatMap, **fringes: Unpack[Fringes]) -> float:
    """Largest variance of the camera's blur that the sharpest edges of brightness along lines,
    (r, l), allow, px²; infinite where there are too few edges.

    A Gaussian edge of standard deviation s rises by erf(1 / (√2 s)) of its height over two pixels.
    Edges of shades are wider than blur makes them: only the narrowest tell it.
    """
    modulation, known = np.nan_to_num(np.exp(light.modulation)), np.isfinite(sigma)
    if modulation.shape[1] <= 2 * EDGE_REACH or not known.any():
        return float("inf")
    rise = np.abs(modulation[:, 2:] - modulation[:, :-2])
    steepest = _largest_along(rise, 2 * EDGE_REACH - 1)
    rise = rise[:, EDGE_REACH - 1 : 1 - EDGE_REACH]
    ends = np.stack([modulation[:, 2 * EDGE_REACH :], modulation[:, : -2 * EDGE_REACH]])
    noise = TURN / fringes["period_px"] * median((sigma * modulation)[known])
    height = np.abs(ends[0] - ends[1])
    clear = height > np.fmax(CLEAR * noise, CLEAR_SHARE * ends.max(axis=0))
    share = rise[(rise == steepest) & clear] / height[(rise == steepest) & clear]
    share = share[share <= 1.0]
    if share.size < FEWEST_EDGES:
        return float("inf")
    # Loading this module, for plain frames, would take longer than this function.
    from statistics import NormalDist

    sharpest = min(quantile(share, SHARPEST), SHARPEST_RISE)
    return float(NormalDist().inv_cdf(0.5 * (1.0 + sharpest)) ** -2)


def _largest_along(values: FloatMap, width: int) -> FloatMap:
    """Largest value of every window of some pixels along rows."""
    reached, found = 1, values
    while reached < width:
        # Of two windows that overlap or touch.
        step = min(reached, width - reached)
        found = np.maximum(found[:, :-step], found[:, step:])
        reached += step
    return found


def most_blur_by_contrast(
    coordinate: FloatMap, periods_px: list[float], modulations: list[FloatMap]
) -> float:
    """Largest variance of the camera's blur that the contrast of the finest fringes allows, px²;
    infinite where no coarser ones show theirs.

    Blur of variance v in the camera leaves exp(−2π² v |∇u|² / p²) of the contrast of fringes of
    period p. The projector's own blur may take the rest, and the area of a pixel is always blur.
    """
    finest, coarsest = int(np.argmin(periods_px)), int(np.argmax(periods_px))
    p, q = periods_px[finest], periods_px[coarsest]
    if q <= p or coordinate.shape[1] <= 2 * SLOPE_REACH:
        return float("inf")
    rise = np.abs(_central(coordinate, SLOPE_REACH))
    with np.errstate(divide="ignore", invalid="ignore"):
        lost = np.log(modulations[coarsest] / modulations[finest])
    seen = np.isfinite(rise) & np.isfinite(lost) & (rise > 0.0) & (rise < STEEPEST * p)
    if np.count_nonzero(seen) < FEWEST:
        return float("inf")
    per_px2 = 0.5 * TURN**2 * (p**-2 - q**-2) * median(rise[seen]) ** 2
    usual = median(lost[seen])
    error = median(np.abs(lost[seen] - usual)) / NORMAL_MEDIAN / np.count_nonzero(seen) ** 0.5
    return max(PIXEL_PX2, (usual + SIGNIFICANT * error) / per_px2)


def _log(modulation: FloatMap) -> FloatMap:
    """Logarithm of the modulation, NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        light: FloatMap = np.log(modulation)
    light[~np.isfinite(light)] = np.nan
    return light


def _central(values: FloatMap, reach: int) -> FloatMap:
    """Slopes along rows between the pixels ``reach`` away to both sides; NaN at the ends."""
    slopes = np.full_like(values, np.nan)
    slopes[:, reach:-reach] = (values[:, 2 * reach :] - values[:, : -2 * reach]) / (2 * reach)
    return slopes


def _continued(slopes: FloatMap, reach: int) -> FloatMap:
    """Slopes along rows that go on from the next known one, up to ``reach`` pixels beyond it.

    The rim of a surface shows the blur best: beyond it there is no light at all.
    """
    for _ in range(reach):
        before = slopes.copy()
        for to, of in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[:, :-1], np.s_[:, 1:])):
            unknown = np.isnan(slopes[to])
            slopes[to][unknown] = before[of][unknown]
    return slopes


def _blur(lines: list[Lines], shift_of: ShiftOf, period_px: float) -> tuple[float, float] | None:
    """Variance of the blur and its standard error at an edge, px²; None where coordinates show
    none.

    ``shift_of`` computes the shifts by blur of one px² from coordinates without it, σ and light.
    """
    least, variance, before = 0.25 * period_px, 0.0, float("inf")
    shifts = [np.zeros_like(some.coordinate) for some in lines]
    for _ in range(PASSES):
        parts = []
        for k, (coordinate, sigma, light, rows) in enumerate(lines):
            moved = coordinate - np.float32(variance) * shifts[k]
            shifts[k], told = shift_of(moved, sigma, light)
            compared = [m[rows] for m in (coordinate, sigma, shifts[k], told)]
            parts.append(_differences(compared, least))
        if not parts:
            return None
        variance, error, spread = _regression(
            *(np.concatenate(p) for p in zip(*parts, strict=True))
        )
        if not SIGNIFICANT * error < variance < MOST_BLUR_PX**2:
            return None
        if abs(variance - before) < SETTLED * variance:
            break
        before = variance
    return variance, float(np.hypot(error, spread))


def _differences(maps: list[FloatMap], step_px: float) -> tuple[FloatMap, ...]:
    """Third differences along rows of the coordinate and of both shifts, and the variance of the
    first, where no depth step lies between the pixels. ``maps`` are coordinate, σ and the shifts by
    modulation and by background."""
    coordinate, sigma, shift, told = maps
    length = max(0, coordinate.shape[1] - 2 * STEP)
    left, middle, right = (coordinate[:, k * STEP : k * STEP + length] for k in range(3))
    straight: BoolMap = np.abs(left - 2.0 * middle + right) < step_px
    smooth = straight[:, STEP:] & straight[:, :-STEP]
    variance = third_difference_variance(sigma**2, STEP)[smooth]
    seen, made, by = (third_difference(m, STEP)[smooth] for m in (coordinate, shift, told))
    return seen, made, by, variance


def _regression(
    seen: FloatMap, made: FloatMap, told: FloatMap, noise: FloatMap
) -> tuple[float, float, float]:
    """Robust coefficient of what was ``seen`` on what the shift has ``made``, by the variances of
    the noise, its standard error, and its scatter from edge to edge; an infinite error where there
    are too few values, or where the shift explains little of them.

    The noise of the modulation is in ``made`` and would lower the coefficient. What the background
    has ``told`` of the same shift has another noise: it is the instrument of the regression.
    """
    if seen.size < MIN_DIFFERENCES:
        return NOT_SEEN
    influence = told**2 / noise
    strong = influence >= max(quantile(influence, STRONG), TINY)
    if not strong.any():
        return NOT_SEEN
    seen, made, told, noise = seen[strong], made[strong], told[strong], noise[strong]
    weight, found, common = 1.0 / noise, 0.0, 0.0
    for _ in range(ROUNDS):
        common = float(np.sum(weight * told * made))
        if common <= 0.0:
            return NOT_SEEN
        found = float(np.sum(weight * seen * told)) / common
        off = (seen - found * made) ** 2 / noise
        scatter = median(off) / NORMAL_MEDIAN**2
        weight = 1.0 / noise / (1.0 + off / max(ROBUST**2 * scatter, TINY))
    left = seen - found * made
    excess = np.sum(weight * (seen**2 - noise))
    if np.sum(weight * (seen**2 - left**2)) < EXPLAINED * excess:
        return NOT_SEEN
    scores = weight * told * left
    error = float(np.sqrt(SHARED * np.sum(scores**2))) / common
    # Higher orders of the blur change with the edge: they scatter about the common coefficient.
    spread = np.sum(weight * (left**2 - noise)) / np.sum(weight * made**2)
    return found, error, float(max(spread, 0.0) ** 0.5)


def beside_steps(coordinate: FloatMap, **fringes: Unpack[Fringes]) -> BoolMap:
    """Pixels of lines, (r, l), within 4 px of a depth step or of an unmeasured pixel."""
    beside = np.zeros(coordinate.shape, bool)
    # Both directions, of views.
    for values, marked in ((coordinate, beside), (coordinate[:, ::-1], beside[:, ::-1])):
        slope = 0.5 * (values[:, 2:] - values[:, :-2])
        for distance in range(1, min(RINGS, values.shape[1] - 3) + 1):
            jump = values[:, 2 + distance :] - values[:, 2:-distance]
            jump = jump - distance * slope[:, :-distance]
            if np.isfinite(fringes["repeats_px"]):
                jump -= fringes["repeats_px"] * np.round(jump / fringes["repeats_px"])
            # True for NaN.
            marked[:, 2:-distance] |= ~(np.abs(jump) < step_px(fringes))
    return beside


def step_px(fringes: Fringes) -> float:
    """Smallest difference of coordinates that is a depth step, projector px."""
    return 0.25 * fringes["period_px"]
