"""Standard deviation of the epipolar error that a rig causes."""

from __future__ import annotations

import numpy as np

from fringeworks.rig.ray_depth import inverse_depth, main_axis, projector_by_parameters
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import Axis, CoordinateMap, Rig

SAMPLES = 2000
"""Approximate number of pixels of the frame that are sampled. Where all are decoded, the median of
their epipolar errors is known to 3 %."""
SHARE_SAMPLES = 400
"""Approximate largest number of decoded pixels at which the share by a covariance is computed; it
is smooth over the frame."""
MIN_SAMPLES = 20
"""Smallest number of decoded pixels for an estimate; with fewer, nothing is known."""
COVERED = 0.95
"""Share of the sampled pixels whose standard deviation from the covariance is below the one that
is used: a rim where lens distortion is extrapolated does not decide for the whole frame."""
MAX_UNKNOWN_PX = 1.0
"""Largest standard deviation that is taken from a capture, where the rig states none, px. Rigs that
measure have reprojection errors below 1 px; a larger epipolar error is a rig that does not fit."""


def calibration_share(rig: Rig, maps: dict[Axis, CoordinateMap]) -> float:
    """Return the standard deviation of the epipolar error that is not noise of the capture, px.

    Parameters
    ----------
    rig : Rig
    maps : dict of CoordinateMap
        Coordinates along both axes.

    Returns
    -------
    float, px. The reprojection residual of the calibration, and what its covariance does to the
    epipolar error, as a root of the sum of squares. Where the rig states neither of them: the
    scatter of the epipolar error in this capture, at most ``MAX_UNKNOWN_PX``.
    """
    residual = 0.0 if rig.residual_px is None else float(np.hypot(*rig.residual_px))
    covariance = rig.covariance if rig.covariance is not None and rig.covariance.any() else None
    if covariance is None and rig.residual_px is not None:
        return residual
    h, w = rig.camera.shape
    step = max(1, round(np.sqrt(h * w / SAMPLES)))
    part = np.s_[step // 2 :: step, step // 2 :: step]
    decoded = np.stack([maps[a].coordinate_px[part].astype(np.float64) for a in ("x", "y")], -1)
    v, u = np.nonzero(np.isfinite(decoded).all(axis=2))
    if len(u) < MIN_SAMPLES:
        return residual
    if covariance is not None:
        # Thinned after the decoded ones are known: a small object keeps its pixels.
        thin = max(1, len(u) // SHARE_SAMPLES)
        v, u = v[::thin], u[::thin]
    goal = decoded[v, u]
    pixels = np.stack((u, v), axis=-1) * float(step) + step // 2
    along = main_axis(rig)
    depth = inverse_depth(rig, pixels, goal[:, 0 if along == "x" else 1], along)
    seen, by, by_w, _ = projector_by_parameters(rig, pixels, np.where(depth > 0, depth, np.nan))
    with np.errstate(invalid="ignore"):
        across = np.stack((-by_w[:, 1], by_w[:, 0]), -1) / np.linalg.norm(by_w, axis=1)[:, None]
    good = np.isfinite(across).all(axis=1)
    if good.sum() < MIN_SAMPLES:
        return residual
    if covariance is None:
        error = np.einsum("ni,ni->n", goal - seen, across)[good]
        return min(robust_sigma(error), MAX_UNKNOWN_PX)
    by_error = np.einsum("nij,ni->nj", by, across)[good]
    variance = np.einsum("nj,nj->n", np.einsum("ni,ij->nj", by_error, covariance), by_error)
    return float(np.sqrt(residual**2 + max(np.quantile(variance, COVERED), 0.0)))
