"""Points without the error that the camera's blur causes on curved and on unevenly lit surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.rig.pinhole import project, transform
from fringeworks.surface.clean import inside_surface
from fringeworks.surface.cloud import LONG_SIDE
from fringeworks.types import (
    Axis,
    BoolMap,
    CameraBlur,
    FloatMap,
    InputError,
    PointCloud,
    Rig,
    need_camera_frame,
)

Periods = float | Sequence[float]
"""Period of fringes, or those of the sets that coordinates are the mean of, projector px."""

HALF_WINDOW_PX = 2
"""Half side of the windows in which a parabola smooths coordinates before they are blurred, px. The
correction so hardly adds to the noise of a point; 3 px would smooth more, but reach farther over
creases."""
LEAST_POINTS = 9
"""Smallest number of points of such a window; a parabola has six parameters."""
MAX_BLUR_PX = 3.0
"""Largest blur that is corrected, px: wider ones hide more of a surface than its corrected points
could show."""
PASSES = 6
"""Number of times that the sharp surface is blurred and compared with what was measured. On balls
and cylinders, at a blur of 1.2 px, the seventh changes nothing by more than a tenth of σ."""
LEVELS = 3
"""Number of blurs that are computed where the blur differs over the frame; between them, the shift
is interpolated by the variance, to which it is proportional but for small terms."""
REACH_SIGMAS = 4.0
"""Distance to which a blur is computed, in its standard deviations."""
SAMPLED_PX2 = 0.5
"""Variance from which on samples of a Gaussian stand for it, px²: theirs is right to 1e-4."""
MOMENTS = 5
"""Number of even moments, from that of order 0 on, that the taps of narrower ones have."""
LONG_PERIOD_PX = 1e4
"""Period that stands for fringes of unknown period, projector px: long against any shift."""
MOST_SHARPENED = 2.0
"""Largest change of the brightness from pass to pass, as a factor: dark pixels beside bright ones
would otherwise overshoot."""
BEYOND_PX = 4.0
"""Distance to which a surface is continued beyond its end by its slope there, px: that of nearly
all light that a blur of 1 px brings in."""
STEEPEST = 2.0
"""Largest change of the fringes' phase from pixel to pixel for which the noise is computed, rad."""
SLOPES = 17
"""Number of such changes from 0 on; between them, the noise is interpolated: to 3 %, and up to
30 % too large where it doubles."""
UNKNOWN_PX = 0.716
"""Blur that stands for an unknown one, px: the root mean square of its variance, that of a pixel,
1/12 px², and of a blur that is uniform from 0 to 1 px. Lenses in focus on machine vision sensors
have 0.3 to 0.9 px; blur beyond 1 px is seen by eye."""
STEP = 1e-3
"""Step for the derivative of the projector's coordinate by the distance, relative: small against
the perspective, large against rounding."""


def remove_blur(
    cloud: PointCloud,
    rig: Rig,
    blur: CameraBlur | float | None = None,
    *,
    axis: Axis | None = None,
    period_px: Periods | Mapping[Axis, Periods] | None = None,
    removed_px: float | Mapping[Axis, float] = 0.0,
    modulation: FloatMap | Mapping[Axis, FloatMap] | None = None,
) -> PointCloud:
    """Move points to where the camera would see them without blur.

    Parameters
    ----------
    cloud : PointCloud
        With brightness, where ``modulation`` is not given.
    rig : Rig
        The one that the points were measured with.
    blur : CameraBlur or float, optional
        The camera's blur with that of the pixels themselves; as a number, its standard deviation,
        0…3 px, as ``board_pose`` measures it. 0.3 px is a perfect lens. By default the rig's.
    axis : "x" or "y", optional
        Axis of the fringes, where they ran along one only; by default the direction that depends on
        depth. What follows may be given for each axis, as {"x": …, "y": …}.
    period_px : float > 0 or sequence of them, optional
        Period of the fringes, projector px, or those of all sets that the coordinates are the mean
        of: ``CoordinateMap.periods_px``. Where the camera sees them with few pixels, blur changes
        curved fringes less; by default they are taken to be long.
    removed_px : float ≥ 0
        Blur whose shift at edges of brightness ``decode`` has already removed, px:
        ``details[axis]["removed_blur_px"]`` of its result.
    modulation : (h, w) array, optional
        Modulation of the finest of these fringes, counts; by default the brightness stands for it.

    Returns
    -------
    PointCloud. ``blur_mm`` is what stays uncertain, which σ contains: the error of the blur itself,
    what the passes after the second have changed, and near the end of a surface the correction of
    its last pixels. There, a point at which they have changed more than the first pass found stays
    where it is.

    Raises
    ------
    InputError for a cloud without brightness, a blur out of range, and a rig without one where none
    is given.

    Notes
    -----
    A pixel sees the fringes of its neighbourhood: the wave W = B exp(iku) becomes G ∗ W, with the
    blur's Gaussian G. The measured coordinate is u + arg((G ∗ W)/W)/k, the measured modulation
    |G ∗ W|. From the measured ones as a start, the sharp surface is blurred, and what it lacks is
    added (Van Cittert's iteration, Zeitschrift für Physik 69, 1931), with u smoothed by parabolas
    in windows of 5 × 5 px that do not cross steps in depth. The first order of this is
    v (∇ln B · ∇u + ∇²u/2) for the variance v: towards the brighter side, and against the curvature.
    A ball of 50 mm that is seen with 0.5 mm/px and a blur of 0.5 px becomes 0.01 mm too small.

    The noise of coordinates and modulations, which is alike in radians and as a share, passes
    through the same steps, linearised for an even slope; ``noise_mm`` becomes what comes out.

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> x, y = np.meshgrid(np.arange(-6.0, 7.0), np.arange(-6.0, 7.0))
    >>> xyz = np.stack((x, y, 475.0 + (x**2 + y**2) / 50.0), axis=-1)
    >>> flat = np.zeros(x.shape)
    >>> ball = PointCloud(xyz, flat, flat, flat.astype(np.uint8), colour=flat + 100.0)
    >>> found = remove_blur(ball, standard_rig(), 0.5)
    >>> round(float((ball.xyz_mm - found.xyz_mm)[6, 6, 2]), 3)
    0.01
    """
    blur = _blur_of(cloud, blur, rig)
    ok = cloud.reason == 0
    if not ok.any():
        return replace(cloud, blur_mm=np.full(cloud.shape, np.nan, np.float32))
    of_axis = _Axes(("x", "y") if axis is None else (axis,), period_px, removed_px, modulation)
    error = _errors(cloud, rig, blur, of_axis)
    along = error.along
    left = np.where(ok, _left(error.changed, blur.relative_sigma * along, error.beside), np.nan)
    length = np.linalg.norm(cloud.xyz_mm.astype(np.float64), axis=-1)
    moved = cloud.xyz_mm * (1.0 - along / length)[..., None]
    noise = error.gain * cloud.noise_mm
    grown = cloud.sigma_mm**2 + noise**2 - cloud.noise_mm**2
    return replace(
        cloud,
        xyz_mm=moved.astype(np.float32),
        sigma_mm=np.sqrt(grown + left**2).astype(np.float32),
        noise_mm=noise.astype(np.float32),
        blur_mm=left.astype(np.float32),
    )


def doubt_blur(
    cloud: PointCloud, rig: Rig, *, removed_px: float | Mapping[Axis, float] = 0.0
) -> PointCloud:
    """Let σ hold what the blur of a camera does of which nothing is known.

    Parameters
    ----------
    cloud : PointCloud
        With brightness.
    rig : Rig
        The one that the points were measured with.
    removed_px : float ≥ 0
        As for ``remove_blur``.

    Returns
    -------
    PointCloud, whose points stay where they are. ``blur_mm`` is what a blur of 0.72 px has moved
    them by, and beside the end of a surface what it may have done to the last pixels.

    Raises
    ------
    InputError for a cloud without brightness.

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> x, y = np.meshgrid(np.arange(-6.0, 7.0), np.arange(-6.0, 7.0))
    >>> xyz = np.stack((x, y, 475.0 + (x**2 + y**2) / 50.0), axis=-1)
    >>> flat = np.zeros(x.shape)
    >>> ball = PointCloud(xyz, flat, flat, flat.astype(np.uint8), colour=flat + 100.0)
    >>> round(float(doubt_blur(ball, standard_rig()).blur_mm[6, 6]), 3)
    0.022
    """
    need_camera_frame(cloud, "the doubt of blur")
    ok = cloud.reason == 0
    if not ok.any():
        return replace(cloud, blur_mm=np.full(cloud.shape, np.nan, np.float32))
    # The coordinate that depends on depth: the one along the baseline.
    along_x, along_y = np.abs(rig.T_projector_camera[:2, 3])
    axis: Axis = "x" if along_x >= along_y else "y"
    of_axis = _Axes((axis,), None, removed_px, None)
    error = _errors(cloud, rig, CameraBlur.everywhere(UNKNOWN_PX), of_axis)
    size = np.copysign(np.hypot(error.along, error.beside), error.along)
    left = np.where(ok, size, np.nan)
    return replace(
        cloud,
        sigma_mm=np.hypot(cloud.sigma_mm, left).astype(np.float32),
        blur_mm=left.astype(np.float32),
    )


class _Axes(NamedTuple):
    """What is known of the fringes of each axis; see ``remove_blur``."""

    axes: tuple[Axis, ...]
    period_px: Periods | Mapping[Axis, Periods] | None
    removed_px: float | Mapping[Axis, float]
    modulation: FloatMap | Mapping[Axis, FloatMap] | None


class _Errors(NamedTuple):
    """What blur does to points, each (h, w)."""

    along: FloatMap
    """Error along the ray, mm."""
    changed: FloatMap
    """What the passes after the second changed of it, mm."""
    beside: FloatMap
    """Size of the errors around pixels beside an edge, mm."""
    gain: FloatMap
    """Factor of the noise."""


def _errors(cloud: PointCloud, rig: Rig, blur: CameraBlur, known: _Axes) -> _Errors:
    axes, ok = known.axes, cloud.reason == 0
    # Fringes fade on slopes across them, so that each axis has a modulation of its own.
    lights = [_light(cloud, _of_axis(known.modulation, a)) for a in axes]
    xyz = cloud.xyz_mm.astype(np.float64)
    # Beyond a surface goes on what is nearest.
    nearest = scipy.ndimage.distance_transform_edt(~ok, return_distances=False, return_indices=True)
    xyz = xyz[tuple(nearest)]
    place = np.stack(np.meshgrid(*map(np.arange, ok.shape[::-1])), axis=-1).astype(np.float64)
    variance = blur.variance_px2(cloud.shape, place, xyz[..., 2])
    pixel = _projected(rig, xyz)
    length = np.linalg.norm(xyz, axis=-1)
    rate = (_projected(rig, xyz * (1.0 + STEP)) - pixel) / (STEP * length[..., None])
    inside = inside_surface(cloud)
    smooth = _Smoothing(cloud, ok, inside, nearest)
    columns, shifts = ["xy".index(a) for a in axes], []
    for a, k, light in zip(axes, columns, lights, strict=True):
        fringes = _fringes(_of_axis(known.period_px, a))
        given = pixel[..., k]
        removed = _at_edges(given, ok, light, fringes, _of_axis(known.removed_px, a) or 0.0)
        shifts.append(_shift(given, given + removed, light, variance, fringes, smooth))
    shift, doubt, gain = np.stack(shifts, axis=-1)
    by = rate[..., columns]
    along, changed = (np.sum(s * by, axis=-1) / np.sum(by * by, axis=-1) for s in (shift, doubt))
    beside = _spread(np.abs(along) * ~inside, variance)
    gains = np.sqrt(np.sum((by * gain) ** 2, axis=-1) / np.sum(by * by, axis=-1))
    return _Errors(along, changed, beside, gains)


def _of_axis(value: Any, axis: Axis) -> Any:
    """What is given for an axis, or for both."""
    return value.get(axis) if isinstance(value, Mapping) else value


class _Fringes(NamedTuple):
    """What coordinates are measured by."""

    wave: float
    """Phase per projector px that stands for all sets, rad."""
    finest: float
    """That of the finest set, whose modulation is known, rad."""
    light_noise: float
    """Relative noise of that modulation over the noise of the coordinate times ``wave``."""


def _fringes(periods: Periods | None) -> _Fringes:
    """Fringes of one period, or of the sets that a coordinate is the mean of: a set counts by the
    inverse of its coordinate's variance, thus by the square of its phase per px, and its shift
    changes by that square again. The relative noise of a modulation is that of its phase."""
    given = np.array(LONG_PERIOD_PX if periods is None else periods, float)
    squares = np.atleast_1d((2.0 * np.pi / given) ** 2)
    wave = float(np.sqrt(np.sum(squares**2) / np.sum(squares)))
    return _Fringes(wave, float(np.sqrt(squares.max())), float(np.sqrt(np.sum(squares)) / wave))


def _left(changed: FloatMap, of_blur: FloatMap, beside: FloatMap) -> FloatMap:
    """Error that stays: by what the passes change, by that of the blur, and by pixels beside an
    edge. Neighbours share the sign of the larger of the first two."""
    size = np.sqrt(changed**2 + of_blur**2 + beside**2)
    return np.copysign(size, np.where(np.abs(changed) > np.abs(of_blur), changed, of_blur))


def _blur_of(cloud: PointCloud, blur: CameraBlur | float | None, rig: Rig) -> CameraBlur:
    need_camera_frame(cloud, "the removal of blur")
    if blur is None:
        if rig.blur is None:
            raise InputError("blur: expected that of the camera, got none here nor in the rig")
        return rig.blur
    if isinstance(blur, CameraBlur):
        return blur
    if not 0 <= blur <= MAX_BLUR_PX:
        raise InputError(f"blur_px: expected 0 to {MAX_BLUR_PX:g} px, got {blur:g}")
    return CameraBlur.everywhere(blur)


def _light(cloud: PointCloud, modulation: FloatMap | None) -> FloatMap:
    """What the fringes are weighted with, (h, w), counts."""
    if modulation is None:
        if cloud.colour is None:
            raise InputError("cloud: expected brightness to remove the blur by, got none")
        modulation = cloud.colour if cloud.colour.ndim == 2 else cloud.colour.mean(axis=2)
    if modulation.shape != cloud.shape:
        raise InputError(f"modulation: expected shape {cloud.shape}, got {modulation.shape}")
    light = np.maximum(np.nan_to_num(modulation.astype(np.float64)), 0.0)
    return np.asarray(light + max(float(light.max()), 1.0) * 1e-6)


def _projected(rig: Rig, xyz: FloatMap) -> FloatMap:
    return project(rig.projector, transform(rig.T_projector_camera, xyz))


def _shift(
    given: FloatMap,
    measured: FloatMap,
    light: FloatMap,
    variance: FloatMap,
    fringes: _Fringes,
    smooth: _Smoothing,
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """What the blur has left in a coordinate as given, how much the passes after the second changed
    it, px, and the noise of what comes out over that before, each (h, w).

    Beside the end of a surface and beside steps, where the passes changed more than the first
    found, as in dark pixels beside bright ones, the sharp surface cannot be told: the shift is then
    0. Inside a surface, such a change is noise.
    """
    levels = _levels(variance)
    wave, finest, noise = fringes
    slope = np.minimum(np.hypot(*np.gradient(smooth(measured))), STEEPEST / wave)
    # Blur fades the finest fringes more than those that the coordinates stand for.
    light = light * np.exp(0.5 * variance * (finest**2 - wave**2) * slope**2)
    sharp, light_now, first, second = measured, light, measured, measured
    for k in range(PASSES):
        even = smooth(sharp)
        seen = np.zeros(measured.shape, complex)
        back = np.exp(1j * wave * even)
        own = light_now * back
        for v, share in levels:
            seen += share * _blurred(own, v)
        shift = np.angle(seen / back) / wave
        sharp = measured - shift
        if k == 0:
            first = shift
        change = light / np.maximum(np.abs(seen), 1e-12)
        light_now = light_now * np.clip(change, 1.0 / MOST_SHARPENED, MOST_SHARPENED)
        if k == 1:
            second = sharp
    changed = smooth(sharp - second)
    untold = ~smooth.whole & (np.abs(changed) > np.abs(first))
    gain = sum(share * _noise_gain(v, wave * slope, noise) for v, share in levels)
    return np.where(untold, 0.0, given - sharp), changed, np.asarray(gain)


def _levels(variance: FloatMap) -> list[tuple[float, FloatMap | float]]:
    """Some variances, and their shares in each pixel."""
    low, high = float(variance.min()), float(variance.max())
    if high - low < 1e-6:
        return [(high, 1.0)]
    at = np.linspace(low, high, LEVELS)
    place = (variance - low) / (at[1] - at[0])
    return [(float(v), np.maximum(1.0 - np.abs(place - k), 0.0)) for k, v in enumerate(at)]


def _at_edges(
    given: FloatMap, ok: BoolMap, light: FloatMap, fringes: _Fringes, removed_px: float
) -> FloatMap:
    """The shift at edges of brightness that ``decode`` has removed, px, by the same kernel."""
    shift, told, slope = np.zeros((3, *given.shape), np.float32)
    if removed_px > 0:
        # As in ``decode``, the noise of a coordinate goes by the inverse of its light.
        maps = (np.where(ok, given, np.nan), np.where(ok, 1.0 / light, np.nan), np.log(light))
        coordinate, sigma, bright = (values.astype(np.float32) for values in maps)
        steps: _core._EdgeSteps = {"most": np.pi / fringes.finest, "repeats": np.inf}
        lights: _core._Lights = {
            "modulation": bright,
            "background": bright,
            "shift": shift,
            "told": told,
            "faint": 0.0,
        }
        _core.blur_shift(coordinate, sigma, lights, steps, slope)
    return np.asarray(removed_px**2 * np.nan_to_num(shift), np.float64)


@cache
def _taps(variance: float) -> FloatMap:
    """Samples of a Gaussian at whole pixels. Where they do not resolve it, taps with its moments up
    to the eighth take their place: exact for polynomials."""
    if variance >= SAMPLED_PX2:
        reach = int(np.ceil(REACH_SIGMAS * np.sqrt(variance)))
        taps = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2.0 * variance))
        return np.asarray(taps / taps.sum())
    order = np.arange(MOMENTS)
    moments = variance**order * scipy.special.factorial2(np.maximum(2 * order - 1, 1))
    powers = np.arange(MOMENTS, dtype=float) ** (2 * order[:, None])
    powers[:, 1:] *= 2.0  # both sides
    half = np.linalg.solve(powers, moments)
    return np.concatenate((half[:0:-1], half))


def _blurred(values: NDArray[Any], variance: float) -> NDArray[Any]:
    taps = _taps(variance)
    rows = scipy.ndimage.correlate1d(values, taps, axis=0, mode="nearest")
    return np.asarray(scipy.ndimage.correlate1d(rows, taps, axis=1, mode="nearest"))


def _spread(values: FloatMap, variance: FloatMap) -> FloatMap:
    """What errors of the pixels beside an edge do around them: windows and blur pass them on."""
    window = HALF_WINDOW_PX * (HALF_WINDOW_PX + 1) / 3.0
    return np.asarray(_blurred(values, float(np.mean(variance)) + window))


def _noise_gain(variance: float, slope: FloatMap, light_noise: float) -> FloatMap:
    """Noise of a corrected point over that before, inside a surface on which the phase changes by
    ``slope`` from pixel to pixel, rad."""
    at = np.linspace(0.0, STEEPEST, SLOPES)
    by_phase, by_light = np.transpose([_gains(variance, float(a)) for a in at])
    gains = 0.5 * np.log(by_phase + light_noise**2 * by_light)
    return np.asarray(np.exp(np.interp(slope, at, gains)))


@cache
def _window(size: int) -> NDArray[Any]:
    """Transfer of the parabolas' smoothing over a frequency plane."""
    one = np.zeros((size, size))
    one[0, 0] = 1.0
    return np.asarray(np.fft.fft2(_parabola(one, "wrap")))


@cache
def _gains(variance: float, slope: float) -> tuple[float, float]:
    """Variance that comes of noise of variance 1 in the phase, and in the light: the means over a
    frequency plane of what the passes make of them."""
    size = 64
    angle = 2.0 * np.pi * np.fft.fftfreq(size)
    taps = _taps(variance)
    order = np.arange(len(taps)) - len(taps) // 2

    def passed(along: FloatMap) -> FloatMap:
        return np.asarray(np.cos(np.multiply.outer(along, order)) @ taps)

    down, still = passed(angle)[:, None], float(passed(np.array(slope)))
    after, before = passed(angle + slope), passed(angle - slope)
    own, other = down * (after + before) / (2 * still), down * (after - before) / (2j * still)
    window, found = _window(size), []
    for phase, light in ((1.0, 0.0), (0.0, 1.0)):
        sharp, light_now = (np.full((size, size), v, complex) for v in (phase, light))
        for _ in range(PASSES):
            even = window * sharp
            seen = own * even + other * light_now
            light_now = light_now + light - (own * light_now - other * even)
            sharp = phase - (seen - even)
        found.append(float(np.mean(np.abs(sharp) ** 2)))
    return found[0], found[1]


def _parabola(values: FloatMap, mode: str = "nearest") -> FloatMap:
    """Value of the parabola through a window of 5 × 5 px at its middle, by least squares."""
    at = np.arange(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1.0)
    flat = np.full(at.size, 1.0 / at.size)
    square = at**2 - np.mean(at**2)
    bend = square / np.sum(square**2)

    def by(down: FloatMap, across: FloatMap) -> FloatMap:
        rows = scipy.ndimage.correlate1d(values, down, axis=0, mode=mode)
        return np.asarray(scipy.ndimage.correlate1d(rows, across, axis=1, mode=mode))

    # The middle lies Σ at²/n below the mean of each bend.
    return np.asarray(by(flat, flat - np.mean(at**2) * bend) - np.mean(at**2) * by(bend, flat))


class _Smoothing:
    """Smooths a coordinate by parabolas that do not cross steps in depth."""

    def __init__(
        self, cloud: PointCloud, ok: BoolMap, inside: BoolMap, nearest: NDArray[np.integer]
    ) -> None:
        self._nearest = tuple(nearest)
        side = 2 * HALF_WINDOW_PX + 1
        whole = scipy.ndimage.minimum_filter(inside, side - 2, mode="constant", cval=False)
        self.whole = whole
        """Pixels whose window lies inside one surface, (h, w)."""
        self._rows, self._columns = np.nonzero(ok & ~whole)
        offsets = np.arange(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1)
        dy, dx = (a.ravel() for a in np.meshgrid(offsets, offsets, indexing="ij"))
        h, w = cloud.shape
        y, x = self._rows[:, None] + dy, self._columns[:, None] + dx
        within = (y >= 0) & (y < h) & (x >= 0) & (x < w)
        self._at = np.clip(y, 0, h - 1) * w + np.clip(x, 0, w - 1)
        used = within & ok.ravel()[self._at]
        used &= _linked(cloud, self._rows, self._columns, self._at, np.hypot(dx, dy))
        terms = np.stack((np.ones(dx.size), dx, dy, dx * dx, dx * dy, dy * dy), axis=-1)
        design = np.where(used[..., None], terms, 0.0)
        normal = np.einsum("nki,nkj->nij", design, design)
        few = np.count_nonzero(used, axis=1) < LEAST_POINTS
        few |= np.linalg.cond(normal) > 1e8
        normal[few] = np.eye(6)
        inverse = np.linalg.inv(normal)[:, :3]
        inverse[few] = 0.0
        self._weights = np.einsum("nij,nkj->ink", inverse, design)
        """Of the value and its slopes to the right and downwards."""
        self._weights[0][few] = (dx == 0) & (dy == 0)
        off = np.asarray(np.indices(ok.shape) - nearest, float)
        off *= np.minimum(1.0, BEYOND_PX / np.maximum(np.hypot(*off), 1.0))
        self._off = off
        """Way from the nearest pixel of a surface, as far as its slope is used, (2, h, w), px."""

    def __call__(self, values: FloatMap) -> FloatMap:
        """Smooth a map (h, w); beyond a surface it goes on by the slope where it ends."""
        found = np.where(self.whole, _parabola(values), values)
        beside = np.einsum("ink,nk->in", self._weights, values.ravel()[self._at])
        slopes = np.zeros((2, *values.shape))
        found[self._rows, self._columns], slopes[1, self._rows, self._columns] = beside[:2]
        slopes[0, self._rows, self._columns] = beside[2]
        down, right = slopes[:, *self._nearest]
        return np.asarray(found[self._nearest] + self._off[0] * down + self._off[1] * right)


def _linked(
    cloud: PointCloud,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    at: NDArray[np.intp],
    distance_px: FloatMap,
) -> BoolMap:
    """Mark the pixels of windows that continue the surface of the middle one, (n, 25): not farther
    from it than ``LONG_SIDE`` times what their distance in the frame usually is."""
    points = cloud.xyz_mm.reshape(-1, 3)
    ok = cloud.reason == 0
    both = ok[:, 1:] & ok[:, :-1]
    step = np.linalg.norm(np.diff(cloud.xyz_mm, axis=1)[both], axis=-1)
    usual = float(np.median(step / cloud.xyz_mm[:, 1:][both][:, 2])) if both.any() else 0.0
    middle = points[rows * cloud.shape[1] + columns]
    apart = np.linalg.norm(points[at] - middle[:, None], axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray(apart <= LONG_SIDE * usual * middle[:, None, 2] * distance_px)
