"""Camera and projector as pinholes, and the two together as a rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.camera import Region
from fringeworks.types.camera_blur import CameraBlur
from fringeworks.types.checks import MOST_PX, finite, positive, unmasked, whole
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.lens_field import LensField
from fringeworks.types.provenance import Provenance
from fringeworks.types.robot import RobotFrame

ROTATION_TOLERANCE = 1e-6
"""Largest deviation of RᵀR from the identity. Files hold six digits or more; a matrix that is off
by more is no rotation."""


@dataclass(frozen=True, eq=False, repr=False)
class Pinhole(Frozen):
    """A camera, or a projector as an inverse camera, with lens distortion (theory §8)."""

    width_px: int
    """Columns."""
    height_px: int
    """Rows."""
    focal_px: tuple[float, float]
    """f_x, f_y; > 0, px."""
    principal_px: tuple[float, float]
    """c_x, c_y, px, pixel centres on integers."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k₁, k₂, p₁, p₂, k₃ of Brown's model, in OpenCV's order."""
    field: LensField | None = None
    """Correction of its pixels by what this model does not hold; None for none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (whole(self.width_px, 2, MOST_PX) and whole(self.height_px, 2, MOST_PX)):
            raise InputError(
                f"device: expected 2 × 2 px to {MOST_PX} × {MOST_PX} px, got {self.width_px} × "
                f"{self.height_px}"
            )
        values = (*self.focal_px, *self.principal_px, *self.distortion)
        if len(values) != 9 or not finite(*values):
            raise InputError(f"device: expected nine finite numbers, got {values}")
        if not positive(*self.focal_px):
            raise InputError(f"device: expected focal lengths > 0, got {self.focal_px}")

    @property
    def parameters(self) -> FloatMap:
        """f_x, f_y, c_x, c_y, k₁, k₂, p₁, p₂, k₃, (9,)."""
        return np.array([*self.focal_px, *self.principal_px, *self.distortion], np.float64)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height_px, self.width_px


RIG_PARAMETERS = (
    *(f"camera {name}" for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")),
    *(f"projector {name}" for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")),
    *(f"rotation {axis}" for axis in "xyz"),
    *(f"translation {axis}" for axis in "xyz"),
)
"""Parameters of a rig's covariance, in its order: px, 1, rad, mm. A rotation error ω turns R into
exp(ω) R."""


@dataclass(frozen=True, eq=False, repr=False)
class Rig(Frozen):
    """A calibrated pair of camera and projector."""

    camera: Pinhole
    projector: Pinhole
    T_projector_camera: FloatMap
    """(4, 4) float64, maps points in camera coordinates to projector coordinates; mm."""
    covariance: FloatMap | None = None
    """(24, 24) covariance of ``RIG_PARAMETERS``; None where unknown."""
    residual_px: tuple[float, float] | None = None
    """Root mean square reprojection residual of the calibration, camera and projector, px; None
    where unknown."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""
    structure_px: float = 0.0
    """Errors of projector coordinates that depend on the place in a device's frame, which the
    lenses' model does not hold: root mean square, px. Points near each other share them."""
    blur: CameraBlur | None = None
    """The camera's blur; None where unknown."""
    region: Region | None = None
    """Part of the camera's sensor that its frames show; None where unknown."""
    robot: RobotFrame | None = None
    """Where the camera is on a robot; None where it is on none, or that is unknown."""

    def __post_init__(self) -> None:
        for name in ("T_projector_camera", "covariance"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, unmasked(value, name).astype(np.float64))
        super().__post_init__()
        pose = self.T_projector_camera
        if pose.shape != (4, 4) or not finite(*pose.ravel()):
            raise InputError(f"rig: expected a finite (4, 4) transform, got shape {pose.shape}")
        rotation = pose[:3, :3]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if off > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise InputError("rig: expected a rotation in T_projector_camera, got none")
        if not np.linalg.norm(pose[:3, 3]) > 0:
            raise InputError("rig: expected a baseline > 0, got camera and projector at one place")
        shown = self.region
        if shown is not None and shown.shape != self.camera.shape:
            rows, columns = shown.shape
            raise InputError(
                f"rig: expected a region of the camera's {self.camera.width_px} × "
                f"{self.camera.height_px} px, got {columns} × {rows}"
            )
        if not 0.0 <= self.structure_px < np.inf:
            raise InputError(f"rig: expected structure_px >= 0, got {self.structure_px}")
        n = len(RIG_PARAMETERS)
        covariance = self.covariance
        if covariance is not None and (
            covariance.shape != (n, n) or not np.isfinite(covariance).all()
        ):
            raise InputError(
                f"rig: expected a finite ({n}, {n}) covariance, got {covariance.shape}"
            )

    @property
    def baseline_mm(self) -> float:
        """Distance between the two pupils, mm."""
        return float(np.linalg.norm(self.T_projector_camera[:3, 3]))

    @property
    def projector_centre_mm(self) -> FloatMap:
        """The projector's pupil in camera coordinates, (3,), mm."""
        pose = self.T_projector_camera
        return np.asarray(-pose[:3, :3].T @ pose[:3, 3])
