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
UNEXPLAINED = 3.0
"""Median epipolar error over the standard deviation that noise and rig explain, from which on the
rig is taken to be off. Noise makes 0.7 of it. A rig whose one error is its calibration's may have
any share of it everywhere, but exceeds three in 0.3 % of the calibrations."""
SEEN_MISFIT_PX = 1.0
"""Median epipolar error from which on all of it counts, projector px: the residuals that a rig
states let such rays meet, but they are no part of σ."""
MAX_UNKNOWN_PX = 1.0
"""Largest standard deviation that is taken from a capture, where the rig states none, px. Rigs that
measure have reprojection errors below 1 px; a larger epipolar error is a rig that does not fit."""


def unstated_error(
    misfit_px: float,
    rms_px: float,
    rig: Rig,
    maps: dict[Axis, CoordinateMap],
    stated_px: float,
) -> float:
    """Return the epipolar error of a capture that neither its noise nor its rig explains, px.

    Parameters
    ----------
    misfit_px, rms_px : float
        Median and root mean square of the magnitudes of the epipolar errors, px. The median tells
        whether the rig is off; where it is, as by a wrong lens distortion, errors are far larger
        at some places than at others.
    rig : Rig
    maps : dict of CoordinateMap
        Coordinates along both axes.
    stated_px : float
        Standard deviation of the epipolar error that the rig is known to cause, px.

    Returns
    -------
    float, standard deviation in px; 0 where noise and rig explain the errors. Large errors count
    whatever the rig states.
    """
    if misfit_px > SEEN_MISFIT_PX:
        return rms_px
    step = max(1, round(np.sqrt(rig.camera.width_px * rig.camera.height_px / SAMPLES)))
    thinned = [m.sigma_px[::step, ::step] for m in maps.values()]
    known = [part[np.isfinite(part)] for part in thinned]
    noise = max((float(np.median(part)) for part in known if part.size), default=np.inf)
    explained = float(np.hypot(stated_px, noise))
    if not misfit_px > UNEXPLAINED * explained:
        return 0.0
    return float(np.sqrt(rms_px**2 - explained**2))


def states_errors(rig: Rig) -> bool:
    """Whether a rig states errors of its own."""
    covariance = rig.covariance is not None and bool(rig.covariance.any())
    return covariance or rig.residual_px is not None


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
