"""Colour of points from a photograph: of a separate colour camera, or under white light."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import project, rotation, transform
from fringeworks.types import (
    BoolMap,
    Finding,
    FloatMap,
    InputError,
    MultiRig,
    Pinhole,
    Pixels,
    PointCloud,
    unmasked,
)
from fringeworks.types.multi_rig import multi_rig_parameters
from fringeworks.types.numbers import number

CHANNELS = 3
"""Red, green and blue."""
CELL_SPACINGS = 2.0
"""Side of the cells in which the nearest point hides others, in distances of neighbouring points in
the photograph: with less, points behind a surface show through between its own. Empirical."""
STEEPEST = 4.0
"""Slope of a surface to the photograph's plane, tan 76°, up to which its own points do not hide
each other."""
HIDDEN_SIGMAS = 5.0
"""Distance behind the nearest point, in standard deviations, from which on a point is hidden."""
SAMPLED = 2000
"""Number of points from which distances of neighbours and errors of places are taken, to 2 %."""
LENS_PARTS = (2, 4)
"""Where focal lengths, principal point and distortion part in the parameters of a camera."""
POSE_SIZE = 6
"""Parameters of a pose: rotation and translation."""
RELATIVE_STEP = 1e-5
"""Step of numerical derivatives in units of a parameter's size: rounding and curvature both stay
below 1e-5 of the derivative."""
SRGB_END, SRGB_SLOPE, SRGB_OFFSET, SRGB_EXPONENT = 0.04045, 12.92, 0.055, 2.4
"""End and slope of the straight part of sRGB, and offset and exponent of the rest (IEC
61966-2-1)."""


def colour_by_photograph(
    points: PointCloud,
    photograph: NDArray[Any],
    rig: MultiRig | None = None,
    *,
    camera: int = 2,
    srgb: bool = False,
) -> PointCloud:
    """Give points the colour that a photograph shows of them.

    Parameters
    ----------
    points : PointCloud
        In the coordinates of the first camera.
    photograph : (h, w, 3) array
        Counts in proportion to the light. Of the points' own camera, such as under white light
        after the scan, without a rig.
    rig : MultiRig, optional
        Where another camera has taken the photograph: it has the camera of the points first.
    camera : int
        Which camera of the rig has taken the photograph, from 1.
    srgb : bool
        Whether the counts follow sRGB, as those of JPEG do; they are made linear.

    Returns
    -------
    PointCloud with the colour of every point, (h, w, 3), interpolated between pixels; NaN where the
    photograph does not show a point, because it lies outside or another point hides it. A finding
    says how many these are, and by how much the places in the photograph may be off.

    Raises
    ------
    InputError for a photograph of another shape or size than its camera's, and for a camera that
    the rig does not have.

    Notes
    -----
    A point is hidden where another one in the same cell of the photograph is nearer by more than a
    steep surface explains. The error of a place comes from the σ of the point along its ray, and
    from the covariance of the parameters of the photograph's camera.

    Examples
    --------
    >>> import fringeworks as fw
    >>> from fringeworks.simulate import bust, look, standard_rig
    >>> view = look(standard_rig(scale=0.1), bust())
    >>> seen = np.where(view.lit, 0, 1).astype(np.uint8)
    >>> sigma = np.full(seen.shape, 0.01, np.float32)
    >>> cloud = fw.PointCloud(view.points_mm.astype(np.float32), sigma, sigma, seen)
    >>> white = np.full((*seen.shape, 3), (200, 150, 100), np.uint8)
    >>> fw.views.colour_by_photograph(cloud, white).colour[50, 60].tolist()
    [200.0, 150.0, 100.0]
    """
    seen = unmasked(photograph, "photograph")
    if seen.ndim != 3 or seen.shape[2] != CHANNELS or seen.dtype.kind not in "uif":
        raise InputError(f"photograph: expected colours, (h, w, 3), got shape {seen.shape}")
    light = _linear(seen) if srgb else seen.astype(np.float32)
    if rig is None:
        if seen.shape[:2] != points.shape:
            raise InputError(
                f"photograph: expected the size of the points' camera, {points.shape}, got "
                f"{seen.shape[:2]}; a rig places that of another camera"
            )
        return replace(points, colour=light)
    device, T = _camera(rig, camera, (seen.shape[0], seen.shape[1]))
    xyz = np.asarray(points.xyz_mm, np.float64).reshape(-1, 3)
    measured = np.flatnonzero((points.reason == 0).reshape(-1))
    local = transform(T, xyz[measured])
    place = project(device, local)
    sigma = np.asarray(points.sigma_mm, np.float64).reshape(-1)[measured]
    shown = _inside(place, device) & ~_hidden(place, local[:, 2], sigma, device)
    colour = np.full((len(xyz), CHANNELS), np.nan, np.float32)
    at = place[shown].T[::-1]
    for k in range(CHANNELS):
        colour[measured[shown], k] = scipy.ndimage.map_coordinates(
            light[..., k], at, order=1, mode="nearest"
        )
    said = _finding(rig, camera, xyz[measured], sigma, shown)
    return replace(
        points,
        colour=colour.reshape(*points.shape, CHANNELS),
        findings=(*points.findings, said),
    )


def _linear(counts: NDArray[Any]) -> FloatMap:
    """Light in the unit of the counts, of counts that follow sRGB."""
    if counts.dtype.kind != "u":
        raise InputError(f"srgb: expected unsigned counts, got {counts.dtype}")
    top = float(np.iinfo(counts.dtype).max)
    value = counts.astype(np.float32) / top
    curved = ((value + SRGB_OFFSET) / (1.0 + SRGB_OFFSET)) ** SRGB_EXPONENT
    return np.asarray(top * np.where(value <= SRGB_END, value / SRGB_SLOPE, curved), np.float32)


def _camera(rig: MultiRig, camera: int, shape: tuple[int, int]) -> tuple[Pinhole, FloatMap]:
    """A camera of a rig, and its pose, for a photograph of a shape."""
    if not 1 <= camera <= len(rig.cameras):
        raise InputError(f"camera: expected 1 to {len(rig.cameras)}, got {camera}")
    device = rig.cameras[camera - 1]
    if device.shape != shape:
        raise InputError(
            f"photograph: expected {device.shape}, the size of camera {camera} of the rig, got "
            f"{shape}"
        )
    return device, rig.T_camera_first[camera - 1]


def _inside(place: FloatMap, device: Pinhole) -> BoolMap:
    """Which places lie within a frame; those that are unknown do not."""
    rows, columns = device.shape
    inside = (place >= -0.5) & (place <= np.array([columns, rows]) - 0.5)
    return np.asarray(inside.all(axis=1))


def _hidden(place: FloatMap, depth: FloatMap, sigma: FloatMap, device: Pinhole) -> BoolMap:
    """Which points another one hides: the nearest of a cell and of the cells around it."""
    hidden = np.zeros(len(place), bool)
    known = np.flatnonzero(_inside(place, device))
    if len(known) < CHANNELS:
        return hidden
    at, z = place[known], depth[known]
    some = at[:: max(1, len(at) // SAMPLED)]
    spacing = float(np.median(scipy.spatial.cKDTree(at).query(some, k=2)[0][:, 1]))
    side = max(CELL_SPACINGS * spacing, 1.0)
    cell = ((at + 0.5) / side).astype(np.intp)
    nearest = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(nearest, (cell[:, 0], cell[:, 1]), z)
    nearest = scipy.ndimage.minimum_filter(nearest, 3, mode="nearest")
    slope = STEEPEST * 2.0 * side * z / np.mean(device.focal_px)
    limit = slope + HIDDEN_SIGMAS * np.nan_to_num(sigma[known])
    hidden[known] = z > nearest[cell[:, 0], cell[:, 1]] + limit
    return hidden


def _finding(rig: MultiRig, camera: int, xyz: FloatMap, sigma: FloatMap, shown: BoolMap) -> Finding:
    """How many points the photograph does not show, and how far off the places may be."""
    lacking = int(np.count_nonzero(~shown))
    off = _place_sigma_px(rig, camera, xyz[shown], sigma[shown])
    words = f"colour from a photograph of camera {camera}, which does not show "
    words += f"{lacking} of {len(shown)} points: they have no colour"
    figures = {"points without colour": float(lacking)}
    if off is not None:
        words += f"; places in it are off by {number(off, digits=2)} px (σ)"
        figures["place / px"] = off
    severity = "warning" if 2 * lacking > len(shown) else "note"
    return Finding(
        "photograph",
        words,
        figures=figures,
        severity=severity,  # type: ignore[arg-type]
        pixels=Pixels(lacking, len(shown)),
    )


def _place_sigma_px(rig: MultiRig, camera: int, xyz: FloatMap, sigma: FloatMap) -> float | None:
    """Median σ of the places in the photograph, px; None without points or a covariance."""
    if rig.covariance is None or not len(xyz) or camera == 1:
        return None
    step = max(1, len(xyz) // SAMPLED)
    xyz, sigma = xyz[::step], sigma[::step]
    device, T = rig.cameras[camera - 1], rig.T_camera_first[camera - 1]
    names = multi_rig_parameters(len(rig.cameras), projector=rig.projector is not None)
    own = [k for k, name in enumerate(names) if name.startswith(f"camera {camera} ")]
    part = rig.covariance[np.ix_(own, own)]
    start = project(device, transform(T, xyz))
    rows = []
    for k in range(len(own)):
        size = max(float(np.sqrt(part[k, k])), RELATIVE_STEP)
        moved = _moved(device, T, xyz, k, size)
        rows.append((moved - start) / size)
    slopes = np.stack(rows, axis=-1)
    by_rig = np.einsum("nik,kl,nil->n", slopes, part, slopes)
    ray = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    along = project(device, transform(T, xyz + sigma[:, None] * ray)) - start
    return float(np.sqrt(np.nanmedian(by_rig + np.sum(along**2, axis=1))))


def _moved(device: Pinhole, T: FloatMap, xyz: FloatMap, k: int, by: float) -> FloatMap:
    """Places with one parameter of a camera changed: of its lens, or of its pose."""
    values = device.parameters
    local = transform(T, xyz)
    if k < len(values):
        values[k] += by
        focal, principal, distortion = np.split(values, LENS_PARTS)
        changed = replace(
            device,
            focal_px=(focal[0], focal[1]),
            principal_px=(principal[0], principal[1]),
            distortion=tuple(distortion),
        )
        return project(changed, local)
    pose = k - len(values)
    turn = np.zeros(POSE_SIZE)
    turn[pose] = by
    # A rotation error ω turns R into exp(ω) R, and leaves the translation.
    offset = T[:3, 3]
    return project(device, (local - offset) @ rotation(turn[:3]).T + offset + turn[3:])
