"""Measured surfaces: height maps over a plane, points in camera coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fringeworks.types.arrays import ByteMap, FloatMap, Reason
from fringeworks.types.checks import finite, positive
from fringeworks.types.displayed import Sectioned
from fringeworks.types.errors import InputError
from fringeworks.types.exchanged import Labelled, exchange
from fringeworks.types.finding import Finding, Noted
from fringeworks.types.frozen import Frozen
from fringeworks.types.provenance import Provenance


@dataclass(frozen=True, eq=False, repr=False)
class HeightMap(Noted, Sectioned, Labelled, Frozen):
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
class PointCloud(Noted, Sectioned, Labelled, Frozen):
    """Points in camera coordinates, one per pixel: x right, y down, z away from the camera."""

    layout = {  # noqa: RUF012
        "xyz_mm": "fiu hw3",
        "sigma_mm": "fiu hw",
        "noise_mm": "fiu hw",
        "reason": "ui hw",
        "residual_px": "?fiu hw",
        "colour": "?fiu hw|hw3",
        "blur_mm": "?fiu hw",
    }

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
    """The part of σ that the camera's blur leaves after ``remove_blur``, with its sign, (h, w), mm:
    one error that all points have in common, times this. None where blur was not removed."""

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
