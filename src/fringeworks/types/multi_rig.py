"""Several cameras and one projector as a rig; the projector need not be calibrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import unmasked
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.provenance import Provenance
from fringeworks.types.rig import RIG_PARAMETERS, ROTATION_TOLERANCE, Pinhole, Rig

DEVICE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Names of a device's parameters, in the order of ``Pinhole.parameters``."""
MIN_ALONE = 2
"""Smallest number of cameras that measure without a calibrated projector."""


def multi_rig_parameters(cameras: int, *, projector: bool = True) -> tuple[str, ...]:
    """Return the names of the parameters of a rig of several cameras, in their order.

    Parameters
    ----------
    cameras : int ≥ 1
    projector : bool
        Whether the projector is calibrated.

    Returns
    -------
    tuple of 24 + 15 (cameras − 1) names: those of the first camera and the projector
    (``RIG_PARAMETERS``), then of every further camera its nine parameters and its pose relative to
    the first camera; px, 1, rad, mm. Without a projector 9 + 15 (cameras − 1).

    Examples
    --------
    >>> len(multi_rig_parameters(2)), multi_rig_parameters(2)[24]
    (39, 'camera 2 fx')
    >>> multi_rig_parameters(2, projector=False)[9]
    'camera 2 fx'
    """
    pose = (*(f"rotation {a}" for a in "xyz"), *(f"translation {a}" for a in "xyz"))
    further = (
        f"camera {number} {name}"
        for number in range(2, cameras + 1)
        for name in (*DEVICE_NAMES, *pose)
    )
    first = RIG_PARAMETERS if projector else RIG_PARAMETERS[: len(DEVICE_NAMES)]
    return (*first, *further)


@dataclass(frozen=True, eq=False, repr=False)
class MultiRig(Frozen):
    """Several calibrated cameras and one projector, which need not be calibrated.

    Coordinates are those of the first camera. A projector that is not calibrated only codes: its
    coordinates tell which pixels of the cameras see the same place.

    Raises
    ------
    InputError for no camera, one camera without a projector, poses that are no rigid transforms,
    two devices at one place, and a covariance or residuals of another size.
    """

    cameras: tuple[Pinhole, ...]
    projector: Pinhole | None
    """None where it is not calibrated."""
    T_projector_camera: FloatMap | None
    """(4, 4) float64, maps points in coordinates of the first camera to the projector's; mm. None
    with ``projector``."""
    T_camera_first: FloatMap
    """(n, 4, 4) float64, maps points in coordinates of the first camera to those of every camera;
    the first is the identity; mm."""
    covariance: FloatMap | None = None
    """Covariance of ``multi_rig_parameters``, square; None where unknown. A rotation error ω turns
    R into exp(ω) R."""
    residual_px: tuple[float, ...] | None = None
    """Root mean square reprojection residual of every camera and the projector, as far as it is
    calibrated, px; None where unknown."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        for name in ("T_projector_camera", "T_camera_first", "covariance"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, unmasked(value, name).astype(np.float64))
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
        calibrated = self.projector is not None
        size = len(multi_rig_parameters(n, projector=calibrated))
        covariance = self.covariance
        if covariance is not None and (
            covariance.shape != (size, size) or not np.isfinite(covariance).all()
        ):
            raise InputError(
                f"rig: expected a finite ({size}, {size}) covariance, got {covariance.shape}"
            )
        if self.residual_px is not None and len(self.residual_px) != n + calibrated:
            raise InputError(
                f"rig: expected residuals of {n} cameras{' and the projector' * calibrated}, got "
                f"{len(self.residual_px)} values"
            )
        self._check_projector()

    def _check_projector(self) -> None:
        """Refuse half a projector, and a single camera without one."""
        if (self.projector is None) != (self.T_projector_camera is None):
            raise InputError("rig: expected a projector together with its pose, got one of both")
        if self.projector is not None and self.T_projector_camera is not None:
            # A Rig refuses a projector at the camera's place, and what is no rigid transform.
            Rig(self.cameras[0], self.projector, self.T_projector_camera)
        elif len(self.cameras) < MIN_ALONE:
            raise InputError(
                "rig: expected two cameras or more without a calibrated projector, got one"
            )


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
