"""Calibrated rigs of several cameras on disk: a TOML file to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.description import Field, Section
from fringeworks.files.limits import existing_file, parsing
from fringeworks.files.provenance import ProvenanceSection
from fringeworks.files.rig import (
    TOML_SUFFIX,
    DeviceSection,
    PoseSection,
    UncertaintySection,
    covariance_of,
    device_section,
    pinhole_of,
    pose_section,
    toml_text,
    transform_of,
    uncertainty_section,
)
from fringeworks.files.toml import read_toml
from fringeworks.types import FloatMap, InputError, MultiRig, multi_rig_parameters

MAX_CAMERAS = 16
"""Largest number of cameras in a file. The covariance of 16 cameras has 249 rows."""
HEADER = """\
# Several calibrated cameras and one projector (fringeworks). Without [projector] it only codes.
# Pixels: centres on integers. Distortion: Brown's k1, k2, p1, p2, k3, in OpenCV's order.
# Coordinates are those of the first camera (x right, y down, z forward; mm).
# T_projector_camera maps them to the projector's, T_camera_first to those of a further camera.
# [uncertainty]: standard deviations in px, 1, rad (a turn of the device's coordinates about
# their axes) and mm, and their correlation matrix.
"""
"""Comment at the top of the file."""


class CameraSection(DeviceSection):
    """``[[cameras]]``."""

    T_camera_first: PoseSection | None = None
    """Left out for the first camera."""


class MultiRigFile(Section):
    """The whole of the file; unknown keys are refused."""

    kind: Literal["multi-rig"]
    cameras: list[CameraSection] = Field(min_length=1, max_length=MAX_CAMERAS)
    projector: DeviceSection | None = None
    """Left out where it is not calibrated, with its pose."""
    T_projector_camera: PoseSection | None = None
    uncertainty: UncertaintySection | None = None
    provenance: ProvenanceSection | None = None


def write_multi_rig(path: StrPath, rig: MultiRig) -> Path:
    """Write a rig of several cameras as ``.toml``, whole or not at all.

    Raises
    ------
    FileProblem for another suffix, and where the folder cannot be written to.
    """
    path = Path(path)
    check_target(path, (TOML_SUFFIX,))
    write_text(path, format_multi_rig(rig))
    return path


def read_multi_rig(path: StrPath) -> MultiRig:
    """Read a rig of several cameras that ``write_multi_rig`` wrote.

    Parameters
    ----------
    path : Path
        ``.toml``

    Returns
    -------
    MultiRig

    Raises
    ------
    FileProblem for a missing or damaged file, naming the fault.
    """
    path = existing_file(path, "a rig file")
    with parsing(path, "a rig file"):
        return _from_toml(read_toml(path, MultiRigFile))


def format_multi_rig(rig: MultiRig) -> str:
    """A rig of several cameras as TOML."""
    n = len(rig.cameras)
    residuals = rig.residual_px or (None,) * (n + 1)
    calibrated = rig.projector is not None
    cameras: list[dict[str, Any]] = []
    for k, camera in enumerate(rig.cameras):
        section = device_section(camera, residuals[k])
        if k:
            section["T_camera_first"] = pose_section(rig.T_camera_first[k])
        cameras.append(section)
    content: dict[str, Any] = {"kind": "multi-rig"}
    if rig.projector is not None and rig.T_projector_camera is not None:
        content["projector"] = device_section(rig.projector, residuals[n])
        content["T_projector_camera"] = pose_section(rig.T_projector_camera)
    content["cameras"] = cameras
    if rig.covariance is not None:
        names = multi_rig_parameters(n, projector=calibrated)
        content["uncertainty"] = uncertainty_section(rig.covariance, names)
    return toml_text(HEADER, content, rig.provenance)


def _from_toml(content: MultiRigFile) -> MultiRig:
    n = len(content.cameras)
    poses: list[FloatMap] = [np.eye(4)]
    for number, camera in enumerate(content.cameras[1:], 2):
        if camera.T_camera_first is None:
            raise InputError(f"camera {number}: expected its T_camera_first, got none")
        poses.append(transform_of(camera.T_camera_first))
    if content.cameras[0].T_camera_first is not None:
        raise InputError("camera 1: expected no T_camera_first, its coordinates are the rig's")
    covariance = None
    if content.uncertainty is not None:
        names = multi_rig_parameters(n, projector=content.projector is not None)
        covariance = covariance_of(content.uncertainty, names)
    devices = [d for d in (*content.cameras, content.projector) if d is not None]
    known = tuple(d.residual_px for d in devices if d.residual_px is not None)
    of_projector = content.T_projector_camera
    origin = None if content.provenance is None else content.provenance.as_provenance()
    return MultiRig(
        tuple(pinhole_of(camera) for camera in content.cameras),
        None if content.projector is None else pinhole_of(content.projector),
        None if of_projector is None else transform_of(of_projector),
        np.stack(poses),
        covariance,
        known if len(known) == len(devices) else None,
        origin,
    )
