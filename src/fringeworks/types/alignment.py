"""How a measured part is brought to its model: what is known of it, and what is found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fringeworks.types.area import Area
from fringeworks.types.arrays import FloatMap
from fringeworks.types.errors import InputError
from fringeworks.types.finding import Finding
from fringeworks.types.frozen import Frozen

Ball = tuple[float, float, float, float]
"""A part of space: x, y, z of its centre and its radius, mm, in the part's coordinates."""
Where = Area | Ball
"""A part of a surface: an area of the camera's image, or a ball around it."""
LEAST_DATUM_POINTS = 3
"""Smallest number of datum points: fewer leave a rotation free."""


def _checked(name: str, values: FloatMap, shape: tuple[int | None, int]) -> FloatMap:
    found = np.asarray(values, np.float64)
    wanted = f"({'n' if shape[0] is None else shape[0]}, {shape[1]})"
    fits = found.ndim == 2 and found.shape[1] == shape[1] and shape[0] in (None, len(found))
    if not fits or not np.isfinite(found).all():
        raise InputError(f"{name}: expected finite numbers of shape {wanted}, got {found.shape}")
    return found


@dataclass(frozen=True, eq=False, repr=False)
class DatumPoints(Frozen):
    """Points that are known on the part and on its model, three or more, as pairs.

    Raises
    ------
    InputError for fewer than three pairs, and for arrays of other shapes.
    """

    part_mm: FloatMap
    """(n, 3), on the part, in its coordinates, mm."""
    model_mm: FloatMap
    """(n, 3), the same points on the model, mm."""
    sigma_mm: float | None = None
    """Standard deviation of a coordinate of a point of the part, mm; by default from the distances
    of the pairs."""

    def __post_init__(self) -> None:
        part = _checked("datum points on the part", self.part_mm, (None, 3))
        if len(part) < LEAST_DATUM_POINTS:
            raise InputError(
                f"datum points: expected {LEAST_DATUM_POINTS} pairs or more, got {len(part)}"
            )
        model = _checked("datum points on the model", self.model_mm, (len(part), 3))
        if self.sigma_mm is not None and not 0 < self.sigma_mm < np.inf:
            raise InputError(f"datum points: expected a σ > 0 mm, got {self.sigma_mm}")
        object.__setattr__(self, "part_mm", part)
        object.__setattr__(self, "model_mm", model)
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class DatumPlanes(Frozen):
    """Three planes of the part by rank, which fix three, two and one degrees of freedom (3-2-1).

    Raises
    ------
    InputError for another number of planes.
    """

    where: tuple[Where, Where, Where]
    """Where the part shows each plane, the primary datum first."""
    model_mm: FloatMap
    """(3, 3), a point of the model on each of these planes, mm."""

    def __post_init__(self) -> None:
        if len(self.where) != 3:
            raise InputError(f"datum planes: expected 3, got {len(self.where)}")
        object.__setattr__(
            self, "model_mm", _checked("datum planes on the model", self.model_mm, (3, 3))
        )
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class BestFit(Frozen):
    """The pose with the smallest distances from the model.

    Raises
    ------
    InputError for a start that is no transform.
    """

    start: FloatMap | DatumPoints | None = None
    """T_model_part (4, 4) to start from, or datum points for a rough start; None to search for it
    by the shape."""
    within: Where | None = None
    """The part of the surface that is fitted; all of it by default."""

    def __post_init__(self) -> None:
        if self.start is not None and not isinstance(self.start, DatumPoints):
            object.__setattr__(self, "start", _transform(self.start))
        super().__post_init__()


@dataclass(frozen=True, eq=False, repr=False)
class KnownPose(Frozen):
    """A pose that is known without error, such as that of points in the model's coordinates.

    Raises
    ------
    InputError for an array that is no transform.
    """

    T_model_part: FloatMap
    """(4, 4), maps the part's coordinates to the model's, mm."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_model_part", _transform(self.T_model_part))
        super().__post_init__()


def _transform(T: FloatMap) -> FloatMap:
    found = _checked("pose", T, (4, 4))
    turn = found[:3, :3]
    right = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
    if not right or not np.array_equal(found[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError("pose: expected a rotation and a translation (4, 4), got another matrix")
    return found


AlignBy = BestFit | DatumPoints | DatumPlanes | KnownPose
"""Ways in which a part is brought to its model."""
AlignedBy = Literal["best fit", "datum points", "datum planes", "known pose"]


@dataclass(frozen=True, eq=False, repr=False)
class Alignment(Frozen):
    """Pose of a part in the coordinates of its model, with its covariance.

    An error ξ = (ω, v) turns and moves points of the part in the model's coordinates: p becomes
    p + ω × p + v.
    """

    by: AlignedBy
    T_model_part: FloatMap
    """(4, 4), maps the part's coordinates to the model's, mm."""
    noise: FloatMap
    """(6, 6) covariance of ξ from errors that are independent from point to point; rad, mm."""
    common: FloatMap
    """(6, 6) covariance of ξ from errors that points have in common, such as those of the
    calibration."""
    determined: FloatMap
    """(6, k), the directions of ξ that are determined, as columns."""
    points: int
    """Number of points that it was computed from."""
    share: float
    """Share of the points that could have been used, 0…1."""
    rms_mm: float
    """Root mean square distance of these points from the model, mm."""
    converged: bool
    """Whether the last step was below its limit."""
    response: FloatMap | None = None
    """(6, k), errors ξ by the k independent parts of the rig's covariance; None where they are not
    known."""
    findings: tuple[Finding, ...] = ()
    """What is likely wrong, and what to do about it."""

    @property
    def covariance(self) -> FloatMap:
        """(6, 6) covariance of ξ."""
        return np.asarray(self.noise + self.common)

    @property
    def slides(self) -> int:
        """Number of directions in which the surface slides on itself: 3 for a sphere."""
        return 6 - int(self.determined.shape[1])
