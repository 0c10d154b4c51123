"""Several cameras and one projector as a rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.provenance import Provenance
from fringeworks.types.rig import RIG_PARAMETERS, ROTATION_TOLERANCE, Pinhole, Rig

DEVICE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Names of a device's parameters, in the order of ``Pinhole.parameters``."""


def multi_rig_parameters(cameras: int) -> tuple[str, ...]:
    """Return the names of the parameters of a rig of several cameras, in their order.

    Parameters
    ----------
    cameras : int ≥ 1

    Returns
    -------
    tuple of 24 + 15 (cameras − 1) names: those of the first camera and the projector
    (``RIG_PARAMETERS``), then of every further camera its nine parameters and its pose relative to
    the first camera; px, 1, rad, mm.

    Examples
    --------
    >>> len(multi_rig_parameters(2)), multi_rig_parameters(2)[24]
    (39, 'camera 2 fx')
    """
    pose = (*(f"rotation {a}" for a in "xyz"), *(f"translation {a}" for a in "xyz"))
    further = (
        f"camera {number} {name}"
        for number in range(2, cameras + 1)
        for name in (*DEVICE_NAMES, *pose)
    )
    return (*RIG_PARAMETERS, *further)


@dataclass(frozen=True, eq=False, repr=False)
class MultiRig(Frozen):
    """Several calibrated cameras and one projector.

    Coordinates are those of the first camera.

    Raises
    ------
    InputError for no camera, poses that are no rigid transforms, two devices at one place, and a
    covariance or residuals of another size.
    """

    cameras: tuple[Pinhole, ...]
    projector: Pinhole
    T_projector_camera: FloatMap
    """(4, 4) float64, maps points in coordinates of the first camera to the projector's; mm."""
    T_camera_first: FloatMap
    """(n, 4, 4) float64, maps points in coordinates of the first camera to those of every camera;
    the first is the identity; mm."""
    covariance: FloatMap | None = None
    """Covariance of ``multi_rig_parameters``, square; None where unknown. A rotation error ω turns
    R into exp(ω) R."""
    residual_px: tuple[float, ...] | None = None
    """Root mean square reprojection residual of every camera and the projector, px; None where
    unknown."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        for name in ("T_projector_camera", "T_camera_first", "covariance"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, np.asarray(value, np.float64))
        super().__post_init__()
        n = len(self.cameras)
        if n < 1:
            raise InputError("rig: expected one camera or more, got none")
        if self.T_camera_first.shape != (n, 4, 4):
            raise InputError(
                f"rig: expected a (4, 4) transform for each of {n} cameras, got shape "
                f"{self.T_camera_first.shape}"
            )
        if not np.array_equal(self.T_camera_first[0], np.eye(4)):
            raise InputError("rig: expected the identity as the first camera's own pose")
        for number, pose in enumerate(self.T_camera_first[1:], 2):
            _check_pose(f"camera {number}", pose)
        size = len(multi_rig_parameters(n))
        covariance = self.covariance
        if covariance is not None and (
            covariance.shape != (size, size) or not np.isfinite(covariance).all()
        ):
            raise InputError(
                f"rig: expected a finite ({size}, {size}) covariance, got {covariance.shape}"
            )
        if self.residual_px is not None and len(self.residual_px) != n + 1:
            raise InputError(
                f"rig: expected residuals of {n} cameras and the projector, got "
                f"{len(self.residual_px)} values"
            )
        # A Rig refuses a projector at the camera's place, and what is no rigid transform.
        Rig(self.cameras[0], self.projector, self.T_projector_camera)


def _check_pose(name: str, pose: FloatMap) -> None:
    """Refuse what is no rigid transform, and a camera at the place of the first."""
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all():
        raise InputError(f"{name}: expected a finite transform, got NaN or infinity")
    off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if off > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(f"{name}: expected a rotation in its pose, got none")
    if not np.linalg.norm(pose[:3, 3]) > 0:
        raise InputError(f"{name}: expected a baseline > 0, got the place of the first camera")
