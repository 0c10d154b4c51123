"""Flatness of the calibration board, estimated from the residuals of a calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.calibration.bundle import Adjusted, free_parameters
from fringeworks.rig.calibration.parameters import RIG_SIZE, State
from fringeworks.rig.calibration.residuals import Sighting, residuals_of
from fringeworks.rig.pinhole import project_with_derivatives, transform
from fringeworks.types import BoolMap, FloatMap

MIN_VARIANCE = 1e-12
"""Lower bound on the residual variance relative to the scatter, so that noise-free corners still
have a covariance above zero."""


def board_bow(
    sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap | None = None
) -> tuple[FloatMap, FloatMap]:
    """Estimate how far the board is from flat, if all poses show the same board.

    Parameters
    ----------
    sightings : sequence of Sighting
    adjusted : Adjusted
        Their bundle adjustment with a flat board.
    free : (24,) bool array, optional
        As for ``adjust``.

    Returns
    -------
    flatness : (3,) array
        Quadratic flatness coefficients in mm: the height is a x² + b x y + c y², with x and y
        scaled to ±1 at half the board's size.
    covariance : (3, 3) array, mm²

    Notes
    -----
    One step of least squares for the coefficients and all other parameters together: the model is
    linear in the coefficients, and the other parameters are at their minimum.
    """
    state = State(adjusted.rig, adjusted.poses)
    residuals = residuals_of(sightings, state, derivatives=True)
    of_parameters = residuals.jacobian[
        :, :, free_parameters(len(sightings), np.ones(RIG_SIZE, bool) if free is None else free)
    ]
    used = np.concatenate(adjusted.used)
    sizes = [len(s.points_mm) for s in sightings]
    scatter = np.repeat(np.array(adjusted.scatter_px), sizes, axis=0)
    root = np.repeat(used[:, None] / scatter, 2, axis=1)
    J = np.concatenate((_by_flatness(sightings, state), of_parameters), axis=2)
    J = (J * root[:, :, None]).reshape(-1, J.shape[2])
    r = (residuals.independent * root).ravel()
    scale = np.linalg.norm(J, axis=0)
    A = (J / scale).T @ (J / scale)
    covariance = np.linalg.inv(A) / np.outer(scale, scale)
    step = covariance @ (J.T @ r)
    # The scatter was estimated with a flat board and may contain its bend, so the noise is taken
    # from the residuals of the bent one.
    remaining = r - J @ step
    variance = float(remaining @ remaining) / max(4.0 * used.sum() - len(step), 1.0)
    return step[:3], covariance[:3, :3] * max(variance, MIN_VARIANCE)


def _by_flatness(sightings: Sequence[Sighting], state: State) -> FloatMap:
    """Derivative of the predicted pixels by the flatness coefficients, (n, 4, 3), px/mm."""
    rig = state.rig
    R = rig.T_projector_camera[:3, :3]
    all_points = np.concatenate([s.points_mm for s in sightings])
    low, high = all_points.min(axis=0), all_points.max(axis=0)
    parts = []
    for sighting, T in zip(sightings, state.poses, strict=True):
        scaled = (sighting.points_mm - 0.5 * (low + high)) / (0.5 * np.max(high - low))
        x, y = scaled[:, :2].T
        in_camera = transform(T, sighting.points_mm)
        _, camera_by_point, _ = project_with_derivatives(rig.camera, in_camera)
        _, projector_by_point, _ = project_with_derivatives(
            rig.projector, transform(rig.T_projector_camera, in_camera)
        )
        normal = T[:3, 2]
        height = np.stack((x * x, x * y, y * y), axis=1)[:, None, :]
        by_camera = (camera_by_point @ normal)[..., None] * height
        by_projector = (projector_by_point @ (R @ normal))[..., None] * height
        parts.append(
            np.concatenate((by_camera, by_projector - sighting.by_pixel @ by_camera), axis=1)
        )
    return np.concatenate(parts)
