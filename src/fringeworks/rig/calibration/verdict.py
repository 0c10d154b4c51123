"""The verdict on a calibration: by how much points that are measured with it may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.pinhole import transform
from fringeworks.rig.ray_depth import inverse_depth_by_parameters, structure_variance


@dataclass(frozen=True)
class Verdict:
    """What a calibration is good for, where the board has been."""

    sigma_mm: float
    """Median standard deviation of a point along the camera's ray that the calibration causes, mm,
    over all corners of all poses."""
    distance_mm: float
    """Median distance of these corners from the camera, mm."""

    @property
    def text(self) -> str:
        """The verdict in one line."""
        return f"good for ±{self.sigma_mm:.2g} mm at {self.distance_mm:.0f} mm"


def verdict(calibration: Calibration) -> Verdict:
    """Say by how much points measured with a calibration may be off (one standard deviation).

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    Verdict. Noise of the measurement comes in addition; the covariance contains errors of the
    board and what leaving out poses shows.
    """
    rig, adjusted = calibration.rig, calibration.adjusted
    assert rig.covariance is not None
    board = calibration.board.points_mm
    pixels, points = [], []
    for o, T, used in zip(calibration.observations, adjusted.poses, adjusted.used, strict=True):
        lit = np.flatnonzero(o.found.read)[used]
        pixels.append(o.view.pixels[lit])
        points.append(transform(T, board[o.view.index[lit]]))
    place = np.concatenate(points)
    where = np.concatenate(pixels), 1.0 / place[:, 2], None
    by = inverse_depth_by_parameters(rig, *where)
    variance = np.einsum("ni,ij,nj->n", by, rig.covariance, by)
    variance += structure_variance(rig, *where)
    distance = np.linalg.norm(place, axis=1)
    sigma = np.sqrt(np.maximum(variance, 0.0)) * place[:, 2] * distance
    return Verdict(float(np.nanmedian(sigma)), float(np.median(distance)))
