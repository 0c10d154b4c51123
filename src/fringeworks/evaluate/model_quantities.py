"""Quantities of the deviation of an area from the model, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints, Term, area_points, sigma_of
from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.quantified import Quantified, noise_range, raised
from fringeworks.surface.form import DISCARDED
from fringeworks.types import Area, FloatMap, InputError, PointCloud, Reason, Rig


@dataclass(frozen=True)
class AreaDeviation(AreaPoints):
    """The points of an area with their distances from the model.

    ``by_rig`` holds what is left of the calibration's errors when the alignment has followed them.
    """

    distance: FloatMap
    """Signed distance from the model, (n,), mm."""
    outwards: FloatMap
    """Directions out of the model, in the part's coordinates, (n, 3)."""
    by_pose: FloatMap
    """Derivative of the distances by an error ξ of the alignment, (n, 6)."""
    pose_covariance: FloatMap
    """(6, 6) covariance of ξ that is not in ``by_rig``."""

    def sigma_by(self, weights: FloatMap) -> float:
        """Return σ of a quantity with these derivatives by the distances, (n,)."""
        pose = weights @ self.by_pose
        variance = float(pose @ self.pose_covariance @ pose)
        return float(np.hypot(sigma_of([Term(self, weights, self.outwards)]), np.sqrt(variance)))


def area_deviation(found: Deviation, area: Area, rig: Rig | None) -> AreaDeviation:
    """Return the points of an area with their distances.

    Parameters
    ----------
    found : Deviation
        Of a cloud of a camera.
    area : Area
    rig : Rig, optional
        The rig that the deviation was computed with.

    Raises
    ------
    InputError for a part that is no cloud, an area with fewer than ten measured pixels, and one of
    which more than 0.3 % lie beyond the reach of the model.
    """
    if not isinstance(found.part, PointCloud):
        raise InputError("deviation: expected a cloud of a camera for an area of its image")
    pixels = area.pixels(found.part.shape)
    beyond = float(np.mean(found.reason[pixels] == Reason.OUTSIDE))
    if beyond > DISCARDED:
        raise InputError(
            f"deviation: expected points within reach of the model, got {beyond:.1%} that lie "
            "farther away; give a larger reach, or another area"
        )
    cloud = replace(found.part, reason=found.reason)
    base = area_points(cloud, area, rig)
    rows, columns = np.nonzero(pixels & (found.reason == Reason.OK))
    T, pose = found.alignment.T_model_part, found.alignment
    n = np.asarray(found.normals[rows, columns], np.float64)
    placed = np.asarray(found.points_mm[rows, columns], np.float64)
    by_rig = base.by_rig
    if by_rig is not None and pose.response is not None:
        count = np.bincount(base.cell, minlength=len(by_rig))
        middle = [np.bincount(base.cell, placed[:, k], len(by_rig)) / count for k in range(3)]
        turned = np.cross(pose.response[:3].T[None], np.stack(middle, axis=-1)[:, None])
        moved = turned + pose.response[3:].T[None]
        by_rig = by_rig + np.einsum("ji,ckj->cik", T[:3, :3], moved)
    covariance = pose.noise
    if by_rig is None and pose.by != "best fit":
        covariance = covariance + pose.common
    return AreaDeviation(
        **{field.name: getattr(base, field.name) for field in fields(base)} | {"by_rig": by_rig},
        distance=np.asarray(found.distance_mm[rows, columns], np.float64),
        outwards=n @ T[:3, :3],
        by_pose=np.column_stack((np.cross(placed, n), n)),
        pose_covariance=covariance,
    )


def deviation_mean(part: AreaDeviation) -> Quantified:
    """Mean signed distance from the model."""
    n = len(part.distance)
    return Quantified(float(part.distance.mean()), part.sigma_by(np.full(n, 1.0 / n)), "mm")


def deviation_rms(part: AreaDeviation) -> Quantified:
    """Root mean square distance from the model."""
    value = float(np.sqrt(np.mean(part.distance**2)))
    weights = part.distance / (len(part.distance) * max(value, np.finfo(np.float64).tiny))
    along = np.einsum("nc,nc->n", part.by_value, part.outwards)
    noise = float(np.sqrt(np.mean((along * part.sigma) ** 2)))
    return Quantified(value, part.sigma_by(weights), "mm", raised(value, noise))


def deviation_max(part: AreaDeviation) -> Quantified:
    """Largest distance from the model to either side, without the farthest 0.3 %."""
    size = np.abs(part.distance)
    kept = max(int(np.ceil((1.0 - DISCARDED) * size.size)), 1)
    at = int(np.argsort(size, kind="stable")[kept - 1])
    weights = np.zeros(size.size)
    weights[at] = np.sign(part.distance[at])
    along = np.abs(np.einsum("nc,nc->n", part.by_value, part.outwards))
    noise = 0.5 * noise_range(along * part.sigma)
    return Quantified(float(size[at]), part.sigma_by(weights), "mm", raised(float(size[at]), noise))
