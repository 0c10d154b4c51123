"""Points of calibrated cameras under a projector that only codes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fringeworks.rig.camera_points import CameraPoints, Values, differences, scattered_noise
from fringeworks.rig.light_sheets import LightSheets
from fringeworks.rig.ray_estimates import Estimates, combined, errors_over, estimates_by_code
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.rig.triangulate import RESIDUAL_SIGMAS
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import (
    Axis,
    BoolMap,
    ByteMap,
    Decoded,
    FloatMap,
    InputError,
    MultiRig,
    PointCloud,
    Reason,
    RigMismatch,
)
from fringeworks.types.numbers import number

CELL_SIGMAS = float(np.sqrt(12.0))
"""Width of a cell over the standard deviation of a uniform error within it."""
SLOPE_PX = 8
"""Pixels over which the change of a Gray code's coordinate is taken, more than a cell."""
MIN_RATE = 0.1
"""Lower bound on this change, projector px per camera px: cells of ten pixels and more have too few
independent pixels for a smaller one."""
NO_RIG_PX = 5.0
"""Distance from the epipolar lines from which on a rig is not that of the frames, px. A camera that
was knocked is off by one or two pixels; captures in the wrong order by tens."""


def coded_points(
    rig: MultiRig,
    camera: int,
    decoded: Sequence[Decoded],
    fields: Mapping[int, CoordinateField],
    axes: Sequence[Axis],
    *,
    colour: FloatMap | None = None,
) -> CameraPoints:
    """Points on the pixels of one camera, from every other camera that decodes the same codes.

    Parameters
    ----------
    rig : MultiRig
    camera : int
        Number of the camera, from 0.
    decoded : Decoded of every camera
    fields : coordinates of the other cameras, by number
    axes : the axes of the codes
    colour : (h, w) or (h, w, 3) array, optional
        Brightness or colour of the scene.

    Raises
    ------
    InputError for codes that repeat. RigMismatch for matches far from their epipolar lines.

    Notes
    -----
    With both axes a match that is far from the epipolar line, in its σ, is left out. With one axis
    the match lies on this line by its making. What is left to find there are places that the other
    camera does not see, where it sees another one with the same code in the same epipolar plane.
    The points themselves tell them: each column of the projector lights a sheet
    (``LightSheets``), and a wrong match is off its sheet.
    """
    _check_absolute(decoded, axes)
    here = decoded[camera]
    found = estimates_by_code(rig, camera, decoded, fields, axes)
    cloud = _empty(here, axes, colour)
    if not len(found.pixels):
        return _nothing(cloud, found)
    noise = scattered_noise(found, cloud.shape, stride=_cell_px(here, axes))
    covariance, sigma, misfit = _errors(rig, camera, found, noise)
    found.w[np.abs(found.across) > RESIDUAL_SIGMAS * sigma] = np.nan
    w, weights = _merged(found, covariance)
    difference, sigmas = differences(found, covariance)
    values = Values(found, cloud, w, weights, covariance, noise)
    reason = _reasons(values, here, axes, w, sigmas)
    good = values.of(reason) == Reason.OK
    most = np.argmax(weights, axis=1)[:, None]
    across, off = (np.take_along_axis(a, most, axis=1)[:, 0] for a in (found.across, sigma))
    far = np.where(good, across / np.where(off > 0, off, np.inf), np.nan)
    points = values.cloud(w, weights, reason)
    return CameraPoints(
        points=_with_residual(points, values, across, good, axes),
        devices=found.devices,
        pairs=tuple(values.pair(i, reason) for i in range(len(found.devices))),
        weights=values.as_map(np.where(good[:, None], weights, np.nan)),
        difference_mm=values.as_map(difference),
        difference_sigmas=values.as_map(sigmas),
        across_sigmas=None if len(axes) == 1 else values.as_map(far),
        misfit_px=misfit,
    )


def _cell_px(decoded: Decoded, axes: Sequence[Axis]) -> int:
    """Distance of pixels in different cells of a Gray code alone, px; 1 with fringes.

    Errors within a cell are alike, so that neighbours scatter by less than their σ.
    """
    cells = [1]
    for axis in axes:
        found = decoded.maps[axis]
        if found.periods_px:
            continue
        q = found.coordinate_px.astype(np.float64)
        rates = [
            np.nanmedian(np.abs(q[SLOPE_PX:] - q[:-SLOPE_PX])) / SLOPE_PX,
            np.nanmedian(np.abs(q[:, SLOPE_PX:] - q[:, :-SLOPE_PX])) / SLOPE_PX,
        ]
        cell = CELL_SIGMAS * float(np.nanmedian(found.sigma_px))
        cells.append(1 + int(np.ceil(cell / max(*rates, MIN_RATE))))
    return max(cells)


def _check_absolute(decoded: Sequence[Decoded], axes: Sequence[Axis]) -> None:
    """Refuse coordinates that repeat."""
    for found in decoded:
        for axis in axes:
            if found.maps[axis].repeats_px is not None:
                raise InputError(
                    f"decoded: expected absolute coordinates along {axis}, got some that repeat: "
                    "only these tell which pixels of two cameras see one place"
                )


def _errors(
    rig: MultiRig, camera: int, found: Estimates, noise: FloatMap
) -> tuple[FloatMap, FloatMap, float]:
    """Covariance of the estimates (n, e, e), σ of their distances from the epipolar lines (n, e)
    and the misfit that both hold, px."""
    errors = errors_over(rig, camera, found.devices, found.w)
    stated = found.across_variance(errors)
    misfit = _misfit_px(rig, found, stated)
    if misfit > NO_RIG_PX:
        raise RigMismatch(
            f"rig: pixels of equal codes are {number(misfit)} px from their epipolar lines; it is "
            "for other cameras or frames, or its cameras come in another order than the captures"
        )
    covariance = noise + found.calibration_covariance(errors)
    each = np.arange(len(found.devices))
    covariance[:, each, each] += misfit**2 * np.sum(found.by_pixel**2, axis=2)
    return covariance, np.sqrt(stated + misfit**2), misfit


def _reasons(
    values: Values, decoded: Decoded, axes: Sequence[Axis], w: FloatMap, sigmas: FloatMap
) -> ByteMap:
    """Why pixels have no point: without a match, or with one that is wrong by what is known."""
    found = values.found
    reason = values.alone.reason.copy()
    lit = np.asarray(found.measured.any(axis=1))
    values.put(reason, lit, Reason.OK)
    wrong = ~lit | (np.abs(np.nan_to_num(sigmas)) > RESIDUAL_SIGMAS)
    wrong |= _off_sheets(found.rays / w[:, None], decoded, values, axes, lit & ~wrong)
    values.put(reason, wrong, Reason.RAYS_APART)
    return reason


def _misfit_px(rig: MultiRig, found: Estimates, stated: FloatMap) -> float:
    """Standard deviation of the pixels at which the rig predicts points, beyond what it states, px.

    It is what the distances from the epipolar lines have in excess of noise and calibration, whose
    variance is ``stated``. On one axis nothing shows it; there the residual of a rig without a
    covariance stands for it.
    """
    seen = found.measured & (found.across_by_coordinate != 0).any(axis=2)
    if not seen.any():
        unstated = rig.covariance is None and rig.residual_px is not None
        return float(np.linalg.norm(rig.residual_px or ()) if unstated else 0.0)
    across, known = found.across[seen], stated[seen]
    near = np.abs(across) <= RESIDUAL_SIGMAS * np.median(np.abs(across)) / NORMAL_MEDIAN
    excess = float(np.mean(across[near] ** 2) - np.mean(known[near]))
    return float(np.sqrt(max(excess, 0.0)))


def _empty(decoded: Decoded, axes: Sequence[Axis], colour: FloatMap | None) -> PointCloud:
    """A cloud without points: the reasons are those of the coordinates, or no other camera."""
    maps = [decoded.maps[a] for a in axes]
    reason = np.full(maps[0].reason.shape, Reason.OUTSIDE, np.uint8)
    for found in reversed(maps):
        failed = found.reason != Reason.OK
        reason[failed] = found.reason[failed]
    blank = np.full(reason.shape, np.nan, np.float32)
    return PointCloud(
        np.full((*reason.shape, 3), np.nan, np.float32), blank, blank, reason, colour=colour
    )


def _nothing(cloud: PointCloud, found: Estimates) -> CameraPoints:
    """No points at all."""
    blank = cloud.sigma_mm
    weights = np.full((*blank.shape, len(found.devices)), np.nan, np.float32)
    return CameraPoints(
        cloud, found.devices, tuple(cloud for _ in found.devices), weights, blank, blank, blank
    )


def _merged(found: Estimates, covariance: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Merged inverse depths (n,) and weights (n, e); NaN and 0 for pixels without an estimate."""
    lit = np.asarray(found.measured.any(axis=1))
    w, weights = np.full(len(lit), np.nan), np.zeros(found.w.shape)
    w[lit], weights[lit] = combined(found.w[lit], covariance[lit])
    return w, weights


def _off_sheets(
    points_mm: FloatMap, decoded: Decoded, values: Values, axes: Sequence[Axis], good: BoolMap
) -> BoolMap:
    """Points (n, 3) whose coordinates are not those of the light where they are."""
    wrong = np.zeros(len(points_mm), bool)
    for k, axis in enumerate(axes):
        goal = values.of(decoded.maps[axis].coordinate_px).astype(np.float64)
        sheets = LightSheets.fit(points_mm[good], goal[good])
        if sheets is None:
            continue
        off = goal[good] - sheets.at(points_mm[good])
        own = values.found.own_variance[good, k]
        sigma = np.sqrt(sheets.sigma_px(points_mm[good]) ** 2 + own)
        wrong[good] |= np.abs(off) > RESIDUAL_SIGMAS * sigma
    return wrong


def _with_residual(
    points: PointCloud, values: Values, across: FloatMap, good: BoolMap, axes: Sequence[Axis]
) -> PointCloud:
    """The points with their distances from the epipolar line, where both axes tell them."""
    if len(axes) == 1:
        return points
    return replace(points, residual_px=values.as_map(np.where(good, np.abs(across), np.nan)))
