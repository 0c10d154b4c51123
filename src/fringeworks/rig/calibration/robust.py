"""Robust weights of corners: their scatter, estimated from the residuals, and Huber's weights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap

IntMap = NDArray[np.intp]
HUBER_SIGMAS = 2.5
"""Residual length in standard deviations beyond which a corner's weight falls (Huber). 4 % of the
lengths of two normal coordinates are longer, so good corners lose almost nothing."""
OUTLIER_SIGMAS = 6.0
"""Residual length in standard deviations beyond which a corner is an outlier and left out. Two
normal coordinates exceed it once in 10⁸ corners, so no good corner is lost."""
POOLED_CORNERS = 20
"""Weight of the pooled scatter of all poses, as an equivalent number of corners. A pose with many
more corners is weighted by its own scatter, one with few by the pooled one. Poses differ, because
of edges along the pixel grid, blur and light. Empirical: with a scatter per pose, 97.9 % of the
true parameters lie within three standard deviations on photographs (docs/rig.md)."""
MIN_SCATTER_PX = 1e-4
"""Lower bound on the scatter, px, far below that of real corners (0.002 px and more). Noise-free
corners would otherwise lead to a division by zero."""
MIN_REDUNDANCY = 0.2
"""Lower bound on the share of the measured values that exceeds the number of parameters, 0…1. The
scatter is divided by its square root, and few corners must not blow it up without limit."""
MEDIAN_LENGTH = 1.1774
"""Median length of two independent standard normal coordinates: √(2 ln 2)."""


def first_scatter(
    independent: FloatMap, rows: list[slice], parameters: int, camera_of: IntMap | None = None
) -> FloatMap:
    """Estimate the standard deviation of every corner's residuals by medians, to start from.

    Parameters
    ----------
    independent : (n, 4) array
        Residuals of camera and projector, px.
    rows : list of slice
        Which corners belong to each pose.
    parameters : int
        Number of estimated parameters: they reduce the residuals.
    camera_of : (poses,) array, optional
        Number of the camera that saw each pose; one camera by default.

    Returns
    -------
    (n, 2) array, standard deviation per coordinate of the camera's and the projector's residual,
    px; the same for all corners of a pose.
    """
    corners = len(independent)
    share = max(1.0 - 0.5 * parameters / (2.0 * corners), MIN_REDUNDANCY)

    def rough(length: FloatMap, _: FloatMap) -> float:
        return float(np.median(length) / MEDIAN_LENGTH / np.sqrt(share))

    return _by_camera(independent, rows, np.full((corners, 2), 2.0 * share), rough, camera_of)


def scatter_of(
    independent: FloatMap,
    rows: list[slice],
    determined: FloatMap,
    camera_of: IntMap | None = None,
) -> FloatMap:
    """Estimate the standard deviation of every corner's residuals, pose by pose.

    Parameters
    ----------
    independent : (n, 4) array
        Residuals of camera and projector, px.
    rows : list of slice
        Which corners belong to each pose.
    determined : (n, 2) array
        Degrees of freedom of each corner's two coordinates in camera and projector, 0…2: 2 less
        the leverage that the estimated parameters take.
    camera_of
        As for ``first_scatter``.

    Returns
    -------
    As ``first_scatter``.

    Notes
    -----
    σ² = Σ r² / Σ (1 − leverage) over all but the outliers: Helmert's and Förstner's estimate of
    variance components (Förstner, Allgemeine Vermessungs-Nachrichten 86, 1979).
    """
    return _by_camera(independent, rows, determined, _deviation, camera_of)


def _by_camera(
    independent: FloatMap,
    rows: list[slice],
    determined: FloatMap,
    deviation: Callable[[FloatMap, FloatMap], float],
    camera_of: IntMap | None,
) -> FloatMap:
    """Scatter of every pose, camera by camera: cameras differ in resolution and focus."""
    if camera_of is None or not camera_of.any():
        return _by_pose(independent, rows, determined, deviation)
    scatter = np.empty((len(independent), 2))
    for camera in np.unique(camera_of):
        own = [rows[k] for k in np.flatnonzero(camera_of == camera)]
        which = np.concatenate([np.arange(r.start, r.stop) for r in own])
        ends = np.cumsum([r.stop - r.start for r in own])
        moved = [slice(int(a), int(b)) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        scatter[which] = _by_pose(independent[which], moved, determined[which], deviation)
    return scatter


def _by_pose(
    independent: FloatMap,
    rows: list[slice],
    determined: FloatMap,
    deviation: Callable[[FloatMap, FloatMap], float],
) -> FloatMap:
    """Scatter of every pose, drawn towards that of all poses."""
    scatter = np.empty((len(independent), 2))
    for device in (0, 1):
        length = np.hypot(*independent[:, 2 * device : 2 * device + 2].T)
        pooled = deviation(length, determined[:, device])
        for pose_rows in rows:
            n = pose_rows.stop - pose_rows.start
            of_pose = deviation(length[pose_rows], determined[pose_rows, device])
            variance = (n * of_pose**2 + POOLED_CORNERS * pooled**2) / (n + POOLED_CORNERS)
            scatter[pose_rows, device] = max(np.sqrt(variance), MIN_SCATTER_PX)
    return scatter


def _deviation(length: FloatMap, determined: FloatMap) -> float:
    """Standard deviation per coordinate of residuals with these lengths, outliers left out."""
    near = length <= OUTLIER_SIGMAS * float(np.median(length)) / MEDIAN_LENGTH
    freedom = max(float(determined[near].sum()), 2.0 * MIN_REDUNDANCY * int(near.sum()))
    return float(np.sqrt(np.sum(length[near] ** 2) / freedom))


def weights_of(independent: FloatMap, scatter: FloatMap) -> FloatMap:
    """Compute Huber's weights of every corner, (n, 2) for camera and projector; 0 for outliers."""
    weights = np.empty(scatter.shape)
    for device in (0, 1):
        length = np.hypot(*independent[:, 2 * device : 2 * device + 2].T) / scatter[:, device]
        weights[:, device] = np.minimum(1.0, HUBER_SIGMAS / np.maximum(length, 1e-9))
        weights[length > OUTLIER_SIGMAS, device] = 0.0
    # A corner that is wrong in one device was found in the wrong place: it is wrong in both.
    weights[(weights == 0).any(axis=1)] = 0.0
    return weights


def root_weights(scatter: FloatMap, weights: FloatMap | None) -> FloatMap:
    """Factor of every residual in the least-squares sum, (n, 4): √weight over scatter, 1/px."""
    root = np.ones(scatter.shape) if weights is None else np.sqrt(weights)
    return np.repeat(root / scatter, 2, axis=1)
