"""The frozen types that pass between the stages, with units in the field docs.

``Pair`` (what the camera saw) → ``DisplacementMap`` (displacement per pixel) → ``HeightMap`` (the
surface). Frames are ``(h, w)``, pixel centres lie on integers, x is the column, y the row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Axis = Literal["x", "y"]
FloatMap = NDArray[np.floating[Any]]
BoolMap = NDArray[np.bool_]
ByteMap = NDArray[np.uint8]


class InputError(ValueError):
    """A call that cannot be done: says what was expected and what came."""


def check_fields(settings: object, **expectations: tuple[bool, str]) -> None:
    """Refuse settings of which a field is not as expected: (whether it is, what is expected)."""
    for name, (ok, expected) in expectations.items():
        if not ok:
            raise InputError(f"{name}: expected {expected}, got {getattr(settings, name)}")


class Reason(IntEnum):
    """Why a pixel has no value. ``OK`` where it has one."""

    OK = 0
    MASKED = 1  # excluded by the caller, or not finite in the input
    OUTSIDE = 2  # the matching point lies outside the reference frame
    LOW_MODULATION = 3  # the fringe is too weak against the noise (dark paint)
    SATURATED = 4  # the sensor was at its limit over the whole neighbourhood
    ORDER_AMBIGUOUS = 5  # the fringe order cannot be decided
    OUT_OF_RANGE = 6  # the intensity lies outside the matching part of the reference
    UNDETERMINED = 7  # no window determines the displacement
    BEYOND_GEOMETRY = 8  # no height has this displacement, or no point in front of both devices
    SHADOW = 9  # no light of the projector, that of the fringes is not above the noise
    RAYS_APART = 10  # columns and rows disagree: the two rays pass each other


@dataclass(frozen=True)
class CameraNoise:
    """Variance of a camera count, σ²(I) = read² + gain · I (theory §9)."""

    read_counts: float
    """Standard deviation in the dark, quantisation included; ≥ 0, counts."""
    gain: float = 0.0
    """Shot noise: variance per count; ≥ 0."""

    def __post_init__(self) -> None:
        for name in ("read_counts", "gain"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"noise: expected {name} >= 0, got {value}")


@dataclass(frozen=True)
class ReferencePlaneGeometry:
    """Camera and projector pupils at equal distance over a reference plane (theory §2)."""

    distance_mm: float
    """l, from the reference plane to the line through both pupils; > 0, mm."""
    baseline_mm: float
    """d₀, between the two pupils; > 0, mm."""
    pitch_mm_per_px: float = 1.0
    """Size of a camera pixel on the reference plane; > 0, mm/px."""
    sign: Literal[1, -1] = 1
    """+1 where a raised surface moves the fringes towards larger x (or y), −1 where towards
    smaller: on which side the projector stands."""

    def __post_init__(self) -> None:
        for name in ("distance_mm", "baseline_mm", "pitch_mm_per_px"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"geometry: expected {name} > 0, got {value}")
        if self.sign not in (1, -1):
            raise InputError(f"geometry: expected sign +1 or -1, got {self.sign}")


@dataclass(frozen=True)
class Pair:
    """A reference frame and an object frame, as the camera delivered them."""

    reference: NDArray[Any] | None
    """Fringes on the reference plane, (h, w), uint8, uint16 or float, counts; None where there is
    no such frame: the fringes are then compared with the plain ones of the background."""
    object: NDArray[Any]
    """The same fringes with the object in front, (h, w), counts."""
    mask: BoolMap | None = None
    """True where the object is to be measured, (h, w); None for everywhere."""
    background: BoolMap | None = None
    """True where the reference plane shows in the object frame, (h, w); None to find it. Used
    where there is no reference frame."""
    axis: Axis | None = None
    """Direction in which the fringes vary; None to find it."""
    geometry: ReferencePlaneGeometry | None = None
    """None where unknown: results then stay displacements in px."""
    camera: str | None = None
    """Name of the camera that took it."""
    projector: str | None = None
    """Name of the projector that lit it."""
    truth_mm: FloatMap | None = None
    """True height where it is known (simulations), (h, w), mm."""
    notes: tuple[str, ...] = ()
    """What was done to the frames on reading, such as colour turned to grey."""


@dataclass(frozen=True)
class DisplacementMap:
    """Displacement of the fringes per pixel: d(x) = a + b·s(x − u), theory §2 and §4."""

    displacement_px: FloatMap
    """u along the carrier's axis, (h, w), px; NaN where not measurable."""
    sigma_px: FloatMap
    """Standard deviation of u, (h, w), px; NaN where u is."""
    modulation_ratio: FloatMap
    """Modulation relative to the reference frame, (h, w); NaN where not measured."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    period_px: float
    """Mean fringe period on the reference, px."""
    axis: Axis
    """Direction of the displacement."""
    method: str
    """Name of the method in the registry."""
    tilt_deg: float = 0.0
    """Angle between the direction in which the fringes change and that axis, degrees."""
    iterations: ByteMap | None = None
    """Refinement steps behind each pixel, (h, w), where the method iterates."""
    details: dict[str, Any] = field(default_factory=dict)
    """What the method found out on its way (carrier, noise, regions), for reports."""

    @property
    def phase_rad(self) -> FloatMap:
        """Phase difference φ = 2π u / p, (h, w), rad."""
        return self.displacement_px * (2.0 * np.pi / self.period_px)


@dataclass(frozen=True)
class HeightMap:
    """A surface over the reference plane, or, without a known geometry, a map of displacements."""

    values: FloatMap
    """Height towards the camera in mm, or displacement in px; (h, w), NaN where not measured."""
    sigma: FloatMap
    """Standard deviation of the values, same unit."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    quantity: Literal["height", "displacement"]
    unit: Literal["mm", "px"]
    pitch: float
    """Lateral distance of neighbouring pixels, mm/px, or 1 where unknown."""
    method: str = ""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.values.shape
        return rows, columns

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a value, 0…1, those masked by the caller left out."""
        wanted = self.reason != Reason.MASKED
        return float(np.mean(~np.isfinite(self.values[wanted]))) if wanted.any() else 1.0


@dataclass(frozen=True)
class CoordinateMap:
    """Where on the projector every camera pixel's light comes from, along one axis."""

    coordinate_px: FloatMap
    """Projector coordinate, (h, w), px, centres on integers; NaN where not measurable."""
    sigma_px: FloatMap
    """Standard deviation of the coordinate, (h, w), px; NaN where the coordinate is."""
    modulation: FloatMap
    """B of the fringes with the shortest period, (h, w), counts; NaN where undetermined."""
    background: FloatMap
    """A, mean of the phase frames, (h, w), counts."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    axis: Axis
    """x: projector columns, y: projector rows."""
    periods_px: tuple[float, ...]
    """Periods of the M sets of fringes, projector px, in the plan's order."""
    phase_rad: FloatMap | None = None
    """Wrapped phase of every set, (M, h, w), −π…π rad, where asked for."""
    modulations: FloatMap | None = None
    """B of every set, (M, h, w), counts, where asked for."""
    repeats_px: float | None = None
    """Distance after which coordinates repeat, where they are not absolute."""

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a coordinate, 0…1."""
        return float(np.mean(self.reason != Reason.OK))


@dataclass(frozen=True)
class Decoded:
    """What a stack of frames says about projector coordinates."""

    x: CoordinateMap | None
    """Along projector columns, where the plan has fringes or a code along x."""
    y: CoordinateMap | None
    """Along projector rows."""
    noise: CameraNoise
    """Noise of the camera that the standard deviations come from."""
    notes: tuple[str, ...] = ()
    """What was found out or decided on the way."""
    details: dict[str, Any] = field(default_factory=dict)
    """Figures per axis: disagreement of the sets, shifts that were estimated."""

    @property
    def maps(self) -> dict[Axis, CoordinateMap]:
        """The maps there are, by axis."""
        both: dict[Axis, CoordinateMap | None] = {"x": self.x, "y": self.y}
        return {axis: found for axis, found in both.items() if found is not None}


@dataclass(frozen=True)
class Pinhole:
    """A camera, or a projector as an inverse camera: pinhole with lens distortion (theory §8)."""

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

    def __post_init__(self) -> None:
        if self.width_px < 2 or self.height_px < 2:
            raise InputError(
                f"device: expected 2 × 2 px or more, got {self.width_px} × {self.height_px}"
            )
        values = (*self.focal_px, *self.principal_px, *self.distortion)
        if len(values) != 9 or not np.isfinite(values).all():
            raise InputError(f"device: expected nine finite numbers, got {values}")
        if min(self.focal_px) <= 0:
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
"""What a rig's covariance is of: px, 1, rad, mm. A rotation error ω turns R into exp(ω) R."""


@dataclass(frozen=True, eq=False)
class Rig:
    """A calibrated pair of camera and projector."""

    camera: Pinhole
    projector: Pinhole
    T_projector_camera: FloatMap
    """(4, 4), maps points in camera coordinates to projector coordinates; mm."""
    covariance: FloatMap | None = None
    """(24, 24) covariance of ``RIG_PARAMETERS``; None where unknown."""
    residual_px: tuple[float, float] = (0.0, 0.0)
    """Root mean square reprojection residual of the calibration, camera and projector, px."""

    def __post_init__(self) -> None:
        pose = np.asarray(self.T_projector_camera, np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(f"rig: expected a finite (4, 4) transform, got shape {pose.shape}")
        rotation = pose[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise InputError("rig: expected a rotation in T_projector_camera, got none")
        if not np.linalg.norm(pose[:3, 3]) > 0:
            raise InputError("rig: expected a baseline > 0, got camera and projector at one place")
        object.__setattr__(self, "T_projector_camera", pose)
        if self.covariance is not None:
            covariance = np.asarray(self.covariance, np.float64)
            n = len(RIG_PARAMETERS)
            if covariance.shape != (n, n) or not np.isfinite(covariance).all():
                raise InputError(
                    f"rig: expected a finite ({n}, {n}) covariance, got {covariance.shape}"
                )
            object.__setattr__(self, "covariance", covariance)

    @property
    def baseline_mm(self) -> float:
        """Distance between the two pupils, mm."""
        return float(np.linalg.norm(self.T_projector_camera[:3, 3]))

    @property
    def projector_centre_mm(self) -> FloatMap:
        """The projector's pupil in camera coordinates, (3,), mm."""
        pose = self.T_projector_camera
        return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in camera coordinates, one per pixel: x right, y down, z away from the camera."""

    xyz_mm: FloatMap
    """(h, w, 3), mm; NaN where not measured."""
    sigma_mm: FloatMap
    """Standard deviation along the camera's ray, pixel noise and calibration; (h, w), mm."""
    noise_mm: FloatMap
    """The part of it that comes from pixel noise, and differs from pixel to pixel; (h, w), mm."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    residual_px: FloatMap | None = None
    """Where both axes were decoded: distance of the projector's point from the epipolar line,
    (h, w), projector px."""
    colour: FloatMap | None = None
    """Brightness (h, w) or colour (h, w, 3) of the surface, counts."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.reason.shape
        return rows, columns

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a point, 0…1."""
        return float(np.mean(self.reason != Reason.OK))


def count_reasons(reason: ByteMap) -> dict[str, int]:
    """Pixels per reason, by lower-case name, those that occur only.

    >>> count_reasons(np.array([[0, 0, 3]], np.uint8))
    {'ok': 2, 'low_modulation': 1}
    """
    counts = np.bincount(reason.ravel(), minlength=len(Reason))
    return {Reason(code).name.lower(): int(n) for code, n in enumerate(counts) if n}
