"""Calibrated rigs on disk: a TOML file to read, and OpenCV's XML and YAML to exchange."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w

from fringeworks.files.atomic import StrPath, write_text
from fringeworks.files.description import Field, Section
from fringeworks.files.formats import FORMATS, OPENCV_SUFFIXES
from fringeworks.files.limits import MAX_DESCRIPTION_BYTES, existing_file, parsing, read_content
from fringeworks.files.provenance import ProvenanceSection, toml_section
from fringeworks.files.toml import Size, read_toml
from fringeworks.rig.pinhole import check_lens
from fringeworks.types import (
    RIG_PARAMETERS,
    CameraBlur,
    ColourPlane,
    FileProblem,
    FloatMap,
    InputError,
    LensField,
    Pinhole,
    Provenance,
    Region,
    Rig,
    RobotFrame,
    RobotNoise,
)

TOML_SUFFIX = ".toml"
"""Our own rig files."""
ROBOT_PARAMETERS = RIG_PARAMETERS[-6:]
"""Parameters of the covariance of a camera's place on a robot: rotation (rad), translation (mm)."""
REACH_DECIMALS = 3
"""Decimals of the flange's distance from the base, mm: only its order of magnitude is used."""
FIELD_DIGITS = 9
"""Decimals of a field's values, px: far below what corners show."""
HEADER = """\
# A calibrated camera and projector (fringeworks).
# Pixels: centres on integers. Distortion: Brown's k1, k2, p1, p2, k3, in OpenCV's order.
# T_projector_camera maps camera coordinates (x right, y down, z forward; mm) to the projector's.
# [uncertainty]: standard deviations in px, 1, rad (a turn of the projector's coordinates about
# their axes) and mm, and their correlation matrix.
# [camera.field], [projector.field]: what is subtracted from a measured pixel before the lens model,
# px: control points of cubic B-splines over the frame, row by row, and their standard deviations.
# [robot]: the camera on a robot's flange (mount hand) or beside it (mount base), with standard
# deviations in rad and mm, about the axes of flange or base, and the noise of the robot's poses;
# reach_mm is the flange's median distance from the base, which shows a pose in another unit.
# [blur]: variance of the camera's blur by place and distance (docs/rig.md).
"""
"""Comment at the top of a rig file."""


class FieldSection(Section):
    """``[camera.field]`` and ``[projector.field]``: fields of ``LensField``, by component."""

    first_px: tuple[float, float]
    step_px: tuple[float, float]
    columns_px: list[list[float]]
    """Corrections of columns at the control points, row by row."""
    rows_px: list[list[float]]
    """Corrections of rows."""
    columns_sigma_px: list[list[float]]
    rows_sigma_px: list[list[float]]

    def as_field(self) -> LensField:
        """The field that the table describes."""
        control = (self.columns_px, self.rows_px)
        sigma = (self.columns_sigma_px, self.rows_sigma_px)
        widths = {len(row) for table in (*control, *sigma) for row in table}
        if len(widths) != 1 or len({len(table) for table in (*control, *sigma)}) != 1:
            raise InputError("field: expected four tables of the same rows and columns")
        return LensField(
            self.first_px, self.step_px, np.stack(control, axis=-1), np.stack(sigma, axis=-1)
        )


class DeviceSection(Section):
    """``[camera]`` and ``[projector]``."""

    size_px: Size
    """Columns and rows."""
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    residual_px: float | None = Field(default=None, ge=0)
    """Root mean square reprojection residual of the calibration; left out where unknown."""
    region: tuple[int, int, int, int] | None = None
    """First column, first row, columns and rows on the camera's sensor; left out where unknown."""
    plane_px: tuple[float, float] | None = None
    """Column and row of the first pixel in the region, where only every second column and row is
    read, of one colour of a mosaic; left out for all pixels."""
    field: FieldSection | None = None
    """Correction of its pixels; left out where none."""


class PoseSection(Section):
    """``[T_projector_camera]``."""

    rotation: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]
    translation_mm: tuple[float, float, float]


class UncertaintySection(Section):
    """``[uncertainty]``: of the parameters in the order of ``parameters``."""

    parameters: list[str]
    sigma: list[float]
    correlation: list[list[float]]
    structure_px: float = Field(default=0.0, ge=0)
    """Errors of projector coordinates that depend on the place in a frame; left out where none."""


class BlurSection(Section):
    """``[blur]``: fields of ``CameraBlur``."""

    factors_px2: tuple[float, float, float, float, float, float]
    middle_mm: float
    depth_mm: tuple[float, float]
    relative_sigma: float


class RobotNoiseSection(Section):
    """``[robot.noise]``: fields of ``RobotNoise``."""

    translation_mm: float = Field(ge=0)
    rotation_deg: float = Field(ge=0)


class RobotSection(Section):
    """``[robot]``: fields of ``RobotFrame``, with the transform by its name."""

    mount: Literal["hand", "base"]
    poses_as: str = ""
    reach_mm: float | None = None
    T_flange_camera: PoseSection | None = None
    """With the camera in the hand."""
    T_base_camera: PoseSection | None = None
    """With the camera beside the robot."""
    uncertainty: UncertaintySection | None = None
    noise: RobotNoiseSection | None = None

    def as_frame(self) -> RobotFrame:
        """The camera's place that the table describes."""
        both = {"hand": self.T_flange_camera, "base": self.T_base_camera}
        given = both[self.mount]
        other = both["base" if self.mount == "hand" else "hand"]
        name = "T_flange_camera" if self.mount == "hand" else "T_base_camera"
        if given is None or other is not None:
            raise InputError(f"robot: expected {name} alone for the mount {self.mount}")
        u, noise = self.uncertainty, self.noise
        return RobotFrame(
            self.mount,
            transform_of(given),
            None if u is None else covariance_of(u, ROBOT_PARAMETERS),
            None if noise is None else RobotNoise(noise.translation_mm, noise.rotation_deg),
            self.poses_as,
            self.reach_mm,
        )


class RigFile(Section):
    """The whole of a rig file; unknown keys are refused."""

    kind: Literal["rig"]
    camera: DeviceSection
    projector: DeviceSection
    T_projector_camera: PoseSection
    uncertainty: UncertaintySection | None = None
    blur: BlurSection | None = None
    robot: RobotSection | None = None
    provenance: ProvenanceSection | None = None


def write_rig(path: StrPath, rig: Rig) -> Path:
    """Write a rig, whole or not at all: ``.toml``, or ``.xml``/``.yml``/``.yaml`` for OpenCV.

    OpenCV's files have no covariance.

    Raises
    ------
    FileProblem for another suffix, and where the folder cannot be written to. InputError for a rig
    with a field, or on a robot, in a file of OpenCV, which cannot hold it.
    """
    path = Path(path)
    FORMATS["rig"].check(path)
    if path.suffix.lower() == TOML_SUFFIX:
        write_text(path, format_rig(rig))
        return path
    from fringeworks.files.opencv_rig import format_opencv  # only where OpenCV is needed

    write_text(path, format_opencv(rig, path.suffix.lower()))
    return path


def read_rig(
    path: StrPath,
    *,
    camera_size: tuple[int, int] | None = None,
    projector_size: tuple[int, int] | None = None,
    unit_mm: float | None = None,
) -> Rig:
    """Read a rig that ``write_rig``, OpenCV or a program with OpenCV wrote.

    Parameters
    ----------
    path : Path
        ``.toml``, or ``.xml``, ``.yml``, ``.yaml`` of OpenCV, with the names of fringeworks,
        SLStudio, SLMaster, sltk, scan3d-capture, procam-calibration or OpenCV's samples.
    camera_size, projector_size : (columns, rows), optional
        For files of OpenCV that do not say them.
    unit_mm : float > 0, optional
        Unit of length of a file of OpenCV, mm: 1000 for metres. By default 1.

    Raises
    ------
    FileProblem for a missing or damaged file, naming the fault.
    """
    path = existing_file(path, "a rig file")
    with parsing(path, "a rig file"):
        if path.suffix.lower() in (".npz", ".npy"):
            raise FileProblem(
                f"expected .toml or {', '.join(OPENCV_SUFFIXES)}, got {path.suffix}; write_rig "
                "writes a Rig of its camera matrices; maps for undistortion hold no rig"
            )
        if path.suffix.lower() in OPENCV_SUFFIXES:
            from fringeworks.files.named_numbers import refuse_maps
            from fringeworks.files.opencv_rig import parse_opencv  # only where OpenCV is needed

            refuse_maps(path)
            content = read_content(path, "a rig file", MAX_DESCRIPTION_BYTES)
            rig = parse_opencv(content, camera_size=camera_size, projector_size=projector_size)
            rig = _in_mm(rig, 1.0 if unit_mm is None else unit_mm)
        elif unit_mm is not None:
            raise InputError("unit_mm: expected with a file of OpenCV, got it with one in mm")
        else:
            rig = _from_toml(read_toml(path, RigFile))
        for name, device, given in (
            ("camera", rig.camera, camera_size),
            ("projector", rig.projector, projector_size),
        ):
            check_lens(device, name)
            if given not in (None, (device.width_px, device.height_px)):
                raise InputError(
                    f"{name}_size: expected {device.width_px} × {device.height_px} as the file "
                    f"says, got {' × '.join(map(str, given or ()))}"
                )
        return rig


def _in_mm(rig: Rig, unit_mm: float) -> Rig:
    """The rig with its translation in mm."""
    if not 0 < unit_mm < np.inf:
        raise InputError(f"unit_mm: expected > 0, got {unit_mm}")
    T = rig.T_projector_camera.copy()
    T[:3, 3] *= unit_mm
    return replace(rig, T_projector_camera=T)


def format_rig(rig: Rig) -> str:
    """A rig as TOML."""
    camera_px, projector_px = rig.residual_px or (None, None)
    content: dict[str, Any] = {
        "kind": "rig",
        "camera": device_section(rig.camera, camera_px),
        "projector": device_section(rig.projector, projector_px),
        "T_projector_camera": pose_section(rig.T_projector_camera),
    }
    if rig.region is not None:
        content["camera"]["region"] = list(astuple(rig.region)[:4])
        if isinstance(rig.region, ColourPlane):
            content["camera"]["plane_px"] = list(rig.region.first_px)
    if rig.covariance is not None:
        content["uncertainty"] = uncertainty_section(rig.covariance, RIG_PARAMETERS)
        if rig.structure_px > 0:
            content["uncertainty"]["structure_px"] = rig.structure_px
    if rig.blur is not None:
        content["blur"] = {
            "factors_px2": _floats(rig.blur.factors_px2),
            "middle_mm": float(rig.blur.middle_mm),
            "depth_mm": _floats(rig.blur.depth_mm),
            "relative_sigma": float(rig.blur.relative_sigma),
        }
    if rig.robot is not None:
        content["robot"] = _robot_section(rig.robot)
    return toml_text(HEADER, content, rig.provenance)


def _robot_section(robot: RobotFrame) -> dict[str, Any]:
    """The camera's place on a robot as a table of a rig file."""
    section: dict[str, Any] = {"mount": robot.mount}
    if robot.poses_as:
        section["poses_as"] = robot.poses_as
    if robot.reach_mm is not None:
        section["reach_mm"] = round(float(robot.reach_mm), REACH_DECIMALS)
    section[robot.name] = pose_section(robot.T_mount_camera)
    if robot.covariance is not None:
        section["uncertainty"] = uncertainty_section(robot.covariance, ROBOT_PARAMETERS)
    if robot.noise is not None:
        section["noise"] = {
            "translation_mm": float(robot.noise.translation_mm),
            "rotation_deg": float(robot.noise.rotation_deg),
        }
    return section


def device_section(device: Pinhole, residual_px: float | None) -> dict[str, Any]:
    """A device as a table of a rig file."""
    section: dict[str, Any] = {
        "size_px": [device.width_px, device.height_px],
        "focal_px": _floats(device.focal_px),
        "principal_px": _floats(device.principal_px),
        "distortion": _floats(device.distortion),
    }
    if residual_px is not None:
        section["residual_px"] = float(residual_px)
    if device.field is not None:
        section["field"] = _field_section(device.field)
    return section


def _field_section(field: LensField) -> dict[str, Any]:
    """A field as a table of a rig file."""
    tables = {
        name: [[round(float(v), FIELD_DIGITS) for v in row] for row in values]
        for name, values in (
            ("columns_px", field.control_px[..., 0]),
            ("rows_px", field.control_px[..., 1]),
            ("columns_sigma_px", field.sigma_px[..., 0]),
            ("rows_sigma_px", field.sigma_px[..., 1]),
        )
    }
    return {"first_px": _floats(field.first_px), "step_px": _floats(field.step_px)} | tables


def pose_section(T: FloatMap) -> dict[str, Any]:
    """A transform (4, 4) as a table of a rig file."""
    return {
        "rotation": [_floats(row) for row in T[:3, :3]],
        "translation_mm": _floats(T[:3, 3]),
    }


def uncertainty_section(covariance: FloatMap, parameters: Sequence[str]) -> dict[str, Any]:
    """A covariance as a table of a rig file."""
    sigma = np.sqrt(np.diag(covariance))
    safe = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(safe, safe)
    return {
        "parameters": list(parameters),
        "sigma": _floats(sigma),
        "correlation": [[round(float(c), 12) for c in row] for row in correlation],
    }


def toml_text(header: str, content: dict[str, Any], provenance: Provenance | None) -> str:
    """A rig file: a line for each row of numbers."""
    content |= toml_section(provenance)
    rows = re.compile(r"\[\s*((?:[^][,\"]+,\s*)+)\]")
    return header + rows.sub(
        lambda row: f"[{', '.join(part.strip() for part in row[1].split(',') if part.strip())}]",
        tomli_w.dumps(content),
    )


def _floats(values: Any) -> list[float]:
    return [float(v) for v in values]


def _from_toml(content: RigFile) -> Rig:
    covariance = None
    if content.uncertainty is not None:
        covariance = covariance_of(content.uncertainty, RIG_PARAMETERS)
    camera_px, projector_px = content.camera.residual_px, content.projector.residual_px
    # One of the two alone does not say how well rays meet.
    residual = None if camera_px is None or projector_px is None else (camera_px, projector_px)
    origin = None if content.provenance is None else content.provenance.as_provenance()
    return Rig(
        pinhole_of(content.camera),
        pinhole_of(content.projector),
        transform_of(content.T_projector_camera),
        covariance,
        residual,
        origin,
        0.0 if content.uncertainty is None else content.uncertainty.structure_px,
        None if content.blur is None else CameraBlur(**content.blur.as_dict()),
        _region_of(content.camera),
        None if content.robot is None else content.robot.as_frame(),
    )


def _region_of(camera: DeviceSection) -> Region | None:
    """The part of the sensor that a rig file names."""
    if camera.region is None or camera.plane_px is None:
        return None if camera.region is None else Region(*camera.region)
    return ColourPlane(*camera.region, camera.plane_px)


def pinhole_of(device: DeviceSection) -> Pinhole:
    """The device that a table of a rig file describes."""
    return Pinhole(
        *device.size_px,
        device.focal_px,
        device.principal_px,
        device.distortion,
        None if device.field is None else device.field.as_field(),
    )


def transform_of(pose: PoseSection) -> FloatMap:
    """The transform (4, 4) that a table of a rig file describes, mm."""
    T = np.eye(4)
    T[:3, :3] = pose.rotation
    T[:3, 3] = pose.translation_mm
    return T


def covariance_of(u: UncertaintySection, parameters: Sequence[str]) -> FloatMap:
    """The covariance that a table of a rig file describes, of these parameters."""
    if u.parameters != list(parameters):
        raise InputError(f"uncertainty.parameters: expected {', '.join(parameters)}, in this order")
    n = len(parameters)
    if len(u.sigma) != n or [len(row) for row in u.correlation] != [n] * n:
        raise InputError(f"uncertainty: expected {n} sigmas and {n} × {n} correlations")
    sigma = np.array(u.sigma)
    if not (np.isfinite(sigma).all() and (sigma >= 0).all()):
        raise InputError("uncertainty.sigma: expected values >= 0")
    return np.asarray(np.array(u.correlation) * np.outer(sigma, sigma))
