"""The pose of a board that a point cloud shows, from the measured points of its corners."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.pinhole import skew, transform
from fringeworks.statistics.quantiles import MAD_TO_SIGMA
from fringeworks.types import (
    BoardNotFound,
    FloatMap,
    Frozen,
    InputError,
    PointCloud,
    Reason,
    need_camera_frame,
)
from fringeworks.views.poses import ViewPose, from_twist

HALF_WINDOW_PX = 4
"""Half side of the window around a corner whose points give its place, px: about 40 points of the
white squares. A board is flat, so a larger window costs nothing but corners near the edge."""
MIN_WINDOW_POINTS = 12
"""Smallest number of points around a corner; a plane has three parameters."""
CORNER_PX = 0.1
"""Standard deviation of a corner's place in the image, px, to weight the corners with. The scatter
of the corners about the pose scales the covariance."""
MIN_CORNERS = 8
"""Smallest number of corners with points: a pose has six parameters, a corner three coordinates."""
FAR_SIGMAS = 4.0
"""Distance of a corner from the pose, in robust standard deviations, from which on it is left out,
as a corner that something half hides."""
PATCHES = 1
"""Number of independent patches into which an error of the calibration divides a board. Empirical:
a calibration mostly shifts the whole board. With 16 calibrations of the virtual rig, errors of the
pose are 0.7 to 1.1 of their σ along the axes and 0.2 in rotation."""
ROUNDS = 10
"""Largest number of rounds of the fit; corners that are far off are chosen anew after each."""


@dataclass(frozen=True, eq=False, repr=False)
class BoardPose(Frozen):
    """A board that was found in a view."""

    pose: ViewPose
    """Maps camera coordinates to those of the board: its x and y along rows and columns, z into
    it."""
    corners: int
    """Number of corners that it was fitted to."""
    residual_mm: float
    """Root mean square distance of the measured corners from the board's, mm."""
    blur_px: float | None = None
    """Standard deviation of the camera's blur at the corners, with that of its pixels, median, px;
    None for boards of circles."""


def board_pose(cloud: PointCloud, board: Board) -> BoardPose:
    """Measure the pose of a board that a view shows.

    Parameters
    ----------
    cloud : PointCloud
        With brightness, in which the corners are found.
    board : Board
        Its corners may be hidden in part; a ChArUco board names those that are seen.

    Returns
    -------
    BoardPose

    Raises
    ------
    BoardNotFound where the board is not found or too few of its corners have points; InputError for
    a cloud without brightness.

    Notes
    -----
    A corner lies on the ray of its place in the image, at the depth of the plane through the points
    around it. Its covariance has the image error across the ray and the plane's error along it.
    The rigid transform minimises the weighted squares. Errors of the calibration are taken to be
    the same all over the board.
    """
    need_camera_frame(cloud, "the pose of a board")
    if cloud.colour is None:
        raise InputError("cloud: expected brightness to find the board in, got none")
    image = cloud.colour if cloud.colour.ndim == 2 else cloud.colour.mean(axis=2)
    view = find_board(np.nan_to_num(image), board)
    measured = [_corner(cloud, pixel) for pixel in view.pixels]
    seen = np.array([m is not None for m in measured])
    if np.count_nonzero(seen) < MIN_CORNERS:
        raise BoardNotFound(
            f"expected {MIN_CORNERS} corners with points around them or more, got "
            f"{np.count_nonzero(seen)}"
        )
    points, noise, common = (np.array(part) for part in zip(*filter(None, measured), strict=True))
    found = _fitted(board.points_mm[view.index[seen]], points, noise, common)
    if view.blur_px is None:
        return found
    return replace(found, blur_px=float(np.median(view.blur_px[seen])))


def _corner(cloud: PointCloud, pixel: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap] | None:
    """Point of a corner, covariance by noise and by calibration; None with too few points."""
    low = np.rint(pixel).astype(int) - HALF_WINDOW_PX
    if (low < 0).any() or (low + 2 * HALF_WINDOW_PX >= cloud.shape[::-1]).any():
        return None
    box = tuple(slice(v, v + 2 * HALF_WINDOW_PX + 1) for v in low[::-1])
    ok = cloud.reason[box] == Reason.OK
    if np.count_nonzero(ok) < MIN_WINDOW_POINTS:
        return None
    y, x = np.nonzero(ok)
    at = np.column_stack((np.ones(x.size), x + low[0] - pixel[0], y + low[1] - pixel[1]))
    xyz = cloud.xyz_mm[box][ok].astype(np.float64)
    depth = xyz[:, 2]
    alone, total = (a[box][ok].astype(np.float64) for a in (cloud.noise_mm, cloud.sigma_mm))
    # x/z, y/z and 1/z of a plane are linear in the pixel, but for the lens distortion.
    rays = np.linalg.lstsq(at, xyz[:, :2] / depth[:, None], rcond=None)[0]
    slopes = rays[1:]
    s = alone / (depth * np.linalg.norm(xyz, axis=1))
    root = at / s[:, None]
    fit = np.linalg.lstsq(root, 1.0 / depth / s, rcond=None)[0]
    point = np.append(rays[0], 1.0) / fit[0]
    length = np.linalg.norm(point)
    chi2 = float(np.sum((root @ fit - 1.0 / depth / s) ** 2)) / (x.size - 3)
    along = max(1.0, chi2) * np.linalg.inv(root.T @ root)[0, 0] * (point[2] * length) ** 2
    aside = 0.5 * (CORNER_PX * np.linalg.norm(slopes) * point[2]) ** 2
    outer = np.outer(point, point) / length**2
    calibration = max(float(np.mean(total**2 - alone**2)), 0.0)
    return point, along * outer + aside * (np.eye(3) - outer), calibration * outer


def _fitted(board_mm: FloatMap, points: FloatMap, noise: FloatMap, common: FloatMap) -> BoardPose:
    """The rigid transform from camera to board, its covariance, and corners far off left out."""
    T = rigid(points, board_mm)
    used = np.ones(len(points), bool)
    for _ in range(ROUNDS):
        root, J, r = _whitened(T, board_mm, points, noise + common)
        step = np.linalg.lstsq(J[used].reshape(-1, 6), -r[used].ravel(), rcond=None)[0]
        T = from_twist(step) @ T
        length = np.linalg.norm(_whitened(T, board_mm, points, noise + common)[2], axis=1)
        scale = max(1.0, MAD_TO_SIGMA / np.sqrt(3.0) * float(np.median(length[used])))
        kept = length < FAR_SIGMAS * np.sqrt(3.0) * scale
        if np.count_nonzero(kept) < MIN_CORNERS:
            raise BoardNotFound(
                f"expected {MIN_CORNERS} corners that fit the board, got {np.count_nonzero(kept)}"
            )
        if np.linalg.norm(step) < 1e-9 and (kept == used).all():
            break
        used = kept
    root, J, r = _whitened(T, board_mm, points, noise + common)
    inverse_normal = np.linalg.inv(np.einsum("nki,nkj->ij", J[used], J[used]))
    chi2 = np.sum(r[used] ** 2) / (3 * np.count_nonzero(used) - 6)
    gain = np.einsum("ij,nkj,nkl->nil", inverse_normal, J, root)[used]
    R = T[:3, :3]
    shared = np.einsum("nil,lm,nmo,po,njp->ij", gain, R, common[used], R, gain)
    alone = np.einsum("nil,lm,nmo,po,njp->ij", gain, R, noise[used], R, gain)
    patches = max(1.0, np.count_nonzero(used) / PATCHES)
    off = transform(T, points[used]) - board_mm[used]
    return BoardPose(
        ViewPose(T, float(chi2) * alone, patches * shared),
        int(np.count_nonzero(used)),
        float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
    )


def _whitened(
    T: FloatMap, board_mm: FloatMap, points: FloatMap, covariance: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Square root of the weights (n, 3, 3), derivative by ξ (n, 3, 6) and residuals (n, 3)."""
    moved = transform(T, points)
    R = T[:3, :3]
    root = np.linalg.inv(np.linalg.cholesky(R @ covariance @ R.T))
    J = np.concatenate((-skew(moved), np.broadcast_to(np.eye(3), (len(points), 3, 3))), axis=2)
    return root, root @ J, np.einsum("nij,nj->ni", root, moved - board_mm)


def rigid(points: FloatMap, targets: FloatMap) -> FloatMap:
    """Return the rigid transform (…, 4, 4) that takes points (…, n, 3) nearest to their targets.

    Kabsch's solution by singular values (Acta Crystallographica A 32, 1976).
    """
    middle, aim = points.mean(axis=-2), targets.mean(axis=-2)
    cross = np.swapaxes(targets - aim[..., None, :], -1, -2) @ (points - middle[..., None, :])
    U, _, Vt = np.linalg.svd(cross)
    U = U.copy()
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    T = np.zeros((*points.shape[:-2], 4, 4))
    T[..., :3, :3] = U @ Vt
    T[..., :3, 3] = aim - np.einsum("...ij,...j->...i", U @ Vt, middle)
    T[..., 3, 3] = 1.0
    return T
