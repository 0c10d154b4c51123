"""Measured surfaces: height maps over a plane, points of a camera's pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fringeworks.types.arrays import ByteMap, FloatMap, Reason
from fringeworks.types.checks import finite, positive
from fringeworks.types.displayed import Sectioned
from fringeworks.types.errors import InputError
from fringeworks.types.exchanged import Arrayed, Labelled, exchange
from fringeworks.types.finding import Finding, Noted
from fringeworks.types.frozen import Frozen
from fringeworks.types.placement import CAMERA_FRAME, Placement, pose_sigma_mm
from fringeworks.types.provenance import Provenance
from fringeworks.types.robot import check_pose_covariance, check_rigid


@dataclass(frozen=True, eq=False, repr=False)
class HeightMap(Noted, Sectioned, Labelled, Arrayed, Frozen):
    """Heights above the reference plane, or displacements where the geometry is unknown."""

    layout = {  # noqa: RUF012
        "values": "fiu hw",
        "sigma": "fiu hw",
        "reason": "ui hw",
    }

    values: FloatMap
    """Height towards the camera in mm, or displacement in px; (h, w), NaN where not measured."""
    sigma: FloatMap
    """Standard deviation of the values, (h, w), same unit."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    quantity: Literal["height", "displacement"]
    unit: Literal["mm", "px"]
    pitch: float | None
    """Lateral distance of neighbouring pixels, mm/px; 1 for displacements, whose lateral unit is
    px; None where unknown."""
    method: str = ""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""
    pupil: tuple[float, float, float] | None = None
    """The camera's pupil: pixel (x, y) of its foot on the reference plane, and its distance from
    that plane in mm. Rays run through it. None for heights that stand straight on their pixels, and
    where it is unknown."""
    converged: bool | None = None
    """Whether all iterations of the analysis converged; None where unknown."""
    findings: tuple[Finding, ...] = ()
    """What was found in the frames and in the surface, and what to do about it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pitch is not None and not positive(self.pitch):
            raise InputError(f"pitch: expected > 0, got {self.pitch}")
        if self.pupil is not None and not (
            len(self.pupil) == 3 and finite(*self.pupil) and positive(self.pupil[2])
        ):
            raise InputError(f"pupil: expected x, y and a distance > 0, got {self.pupil}")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.values.shape
        return rows, columns

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a value, 0…1; pixels masked by the caller do not count."""
        wanted = self.reason != Reason.MASKED
        return float(np.mean(~np.isfinite(self.values[wanted]))) if wanted.any() else 1.0


@dataclass(frozen=True, eq=False, repr=False)
class PointCloud(Noted, Sectioned, Labelled, Arrayed, Frozen):
    """Points, one per pixel of the camera.

    They are in camera coordinates (x right, y down, z away from the camera), or in others, which
    ``placement`` then names.
    """

    layout = {  # noqa: RUF012
        "xyz_mm": "fiu hw3",
        "sigma_mm": "fiu hw",
        "noise_mm": "fiu hw",
        "reason": "ui hw",
        "residual_px": "?fiu hw",
        "colour": "?fiu hw|hw3",
        "blur_mm": "?fiu hw",
    }
    main = "xyz_mm"

    xyz_mm: FloatMap
    """(h, w, 3), mm; NaN where not measured."""
    sigma_mm: FloatMap
    """Standard deviation along the camera's ray, of pixel noise, calibration and blur; (h, w),
    mm."""
    noise_mm: FloatMap
    """The part of σ that comes from pixel noise, independent from pixel to pixel; (h, w), mm."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    residual_px: FloatMap | None = None
    """Where both axes were decoded: distance of the projector's point from the epipolar line,
    (h, w), projector px."""
    colour: FloatMap | None = None
    """Brightness (h, w) or colour (h, w, 3) of the surface, counts."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""
    findings: tuple[Finding, ...] = ()
    """What was found in the frames and in the points, and what to do about it."""
    blur_mm: FloatMap | None = None
    """The part of σ that the camera's blur leaves after ``remove_blur``, or that an unknown blur
    has, with its sign, (h, w), mm: one error that all points have in common, times this. None where
    blur was not removed and σ does not hold it."""
    placement: Placement | None = None
    """The coordinates that the points are in; None for camera coordinates. ``sigma_mm`` then also
    holds the error of the transform, in its worst direction; all points have it in common."""

    @property
    def frame(self) -> str:
        """Name of the coordinates that the points are in, such as "camera" or "base"."""
        return CAMERA_FRAME if self.placement is None else self.placement.frame

    def transformed(
        self, T: FloatMap, *, frame: str, covariance: FloatMap | None = None
    ) -> PointCloud:
        """Return the points in other coordinates, such as those of a robot's base.

        Parameters
        ----------
        T : (4, 4) array
            Maps the present coordinates to the new ones, mm.
        frame : str
            Name of the new coordinates, such as "base".
        covariance : (6, 6) array, optional
            Covariance of the error of ``T``: rotation ω (rad) and shift v (mm) about the new axes
            turn R into exp(ω) R and t into t + v. By default ``T`` is exact.

        Returns
        -------
        PointCloud
            With the same pixels. The error of ``T`` is part of ``sigma_mm``, in its worst direction
            and common to all points; ``noise_mm``, independent from pixel to pixel, stays.

        Raises
        ------
        InputError for a matrix that is no rotation with a translation, a wrong covariance, and a
        name that is empty or "camera".

        Examples
        --------
        >>> import numpy as np
        >>> import fringeworks as fw
        >>> xyz = np.full((1, 2, 3), 100.0, np.float32)
        >>> s = np.full((1, 2), 0.01, np.float32)
        >>> cloud = fw.PointCloud(xyz, s, s, np.zeros((1, 2), np.uint8))
        >>> T = np.eye(4)
        >>> T[2, 3] = 1000.0
        >>> moved = cloud.transformed(T, frame="base")
        >>> moved.frame, moved.xyz_mm[0, 0].tolist()
        ('base', [100.0, 100.0, 1100.0])
        """
        T, known = check_rigid(T, "T"), check_pose_covariance(covariance, "covariance")
        if self.placement is None:
            placement = Placement(frame, T, known)
        else:
            placement = self.placement.then(T, frame, known)
        xyz, sigma = np.empty_like(self.xyz_mm), self.sigma_mm
        if known is not None:
            sigma = np.empty_like(self.sigma_mm)
        with np.errstate(invalid="ignore", over="ignore"):
            for row, points in enumerate(self.xyz_mm):
                arms = points.astype(np.float64) @ T[:3, :3].T
                xyz[row] = arms + T[:3, 3]
                if known is not None:
                    sigma[row] = np.hypot(self.sigma_mm[row], pose_sigma_mm(known, arms))
        return replace(self, xyz_mm=xyz, sigma_mm=sigma, placement=placement)

    def in_camera(self) -> PointCloud:
        """Return the points in camera coordinates, as they were measured; σ stays as it is."""
        if self.placement is None:
            return self
        T = self.placement.T_frame_camera
        xyz = np.empty_like(self.xyz_mm)
        with np.errstate(invalid="ignore", over="ignore"):
            for row, points in enumerate(self.xyz_mm):
                xyz[row] = (points.astype(np.float64) - T[:3, 3]) @ T[:3, :3]
        return replace(self, xyz_mm=xyz, placement=None)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.reason.shape
        return rows, columns

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a point, 0…1; pixels outside of a chosen area do not count."""
        wanted = self.reason[self.reason != Reason.MASKED]
        return float(np.mean(wanted != Reason.OK)) if wanted.size else 1.0

    def to_open3d(self) -> Any:
        """Return the measured points as a point cloud of the package Open3D.

        Returns
        -------
        ``open3d.t.geometry.PointCloud``, in mm and camera coordinates, with the point attributes
        positions, normals towards the camera (0 where unknown), sigma, noise, and colors from 0 to
        1 where the colour is known. Its ``to_legacy()`` gives the ``open3d.geometry.PointCloud``,
        which has no σ.

        Raises
        ------
        MissingPackage where the package ``open3d`` is not installed. It takes 400 MB, so that none
        of the extras has it.
        """
        return exchange().open3d_cloud(self)


def need_camera_frame(cloud: PointCloud, use: str) -> None:
    """Refuse points that are not in camera coordinates.

    Raises
    ------
    InputError that says what they were for.
    """
    if cloud.placement is not None:
        raise InputError(
            f"cloud: expected points in camera coordinates for {use}, got those of "
            f"{cloud.placement.frame}; take them before they are transformed, or in_camera()"
        )
