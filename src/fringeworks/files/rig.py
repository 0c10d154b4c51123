"""Calibrated rigs on disk: a TOML file to read, and OpenCV's XML and YAML to exchange."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import tomli_w
from pydantic import Field

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.provenance import (
    KEY,
    ProvenanceSection,
    comment_lines,
    from_comments,
    toml_section,
)
from fringeworks.files.toml import Section, read_toml
from fringeworks.types import RIG_PARAMETERS, FileProblem, FloatMap, InputError, Pinhole, Rig

OPENCV_SUFFIXES = (".xml", ".yml", ".yaml")
"""Files of OpenCV's FileStorage."""
TOML_SUFFIX = ".toml"
"""Our own rig files."""
HEADER = """\
# A calibrated camera and projector (fringeworks).
# Pixels: centres on integers. Distortion: Brown's k1, k2, p1, p2, k3, in OpenCV's order.
# T_projector_camera maps camera coordinates (x right, y down, z forward; mm) to the projector's.
# [uncertainty]: standard deviations in px, 1, rad (a turn of the projector's coordinates about
# their axes) and mm, and their correlation matrix.
"""
"""Comment at the top of a rig file."""
NAMES = {
    "camera_matrix": ("camera_matrix", "cam_int", "cam_K", "K1", "M1", "cameraMatrix1"),
    "camera_distortion": ("camera_distortion", "cam_dist", "cam_kc", "D1", "distCoeffs1"),
    "projector_matrix": ("projector_matrix", "proj_int", "proj_K", "K2", "M2", "cameraMatrix2"),
    "projector_distortion": ("projector_distortion", "proj_dist", "proj_kc", "D2", "distCoeffs2"),
    "rotation": ("rotation", "R", "roration"),
    "translation": ("translation", "T"),
}
"""Names of OpenCV files: ours first, then those of other programs and of OpenCV's samples."""


class DeviceSection(Section):
    """``[camera]`` and ``[projector]``."""

    size_px: tuple[int, int]
    """Columns and rows."""
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    residual_px: float | None = Field(default=None, ge=0)
    """Root mean square reprojection residual of the calibration; left out where unknown."""


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


class RigFile(Section):
    """The whole of a rig file; unknown keys are refused."""

    kind: Literal["rig"]
    camera: DeviceSection
    projector: DeviceSection
    T_projector_camera: PoseSection
    uncertainty: UncertaintySection | None = None
    provenance: ProvenanceSection | None = None


def write_rig(path: StrPath, rig: Rig) -> Path:
    """Write a rig, whole or not at all: ``.toml``, or ``.xml``/``.yml``/``.yaml`` for OpenCV.

    OpenCV's files have no covariance.

    Raises
    ------
    FileProblem for another suffix, and where the folder cannot be written to.
    """
    path = Path(path)
    check_rig_target(path)
    write_text(path, format_rig(rig) if path.suffix.lower() == TOML_SUFFIX else _opencv(path, rig))
    return path


def check_rig_target(path: StrPath) -> None:
    """Refuse a file that ``write_rig`` cannot write, before anything is computed for it."""
    check_target(path, (TOML_SUFFIX, *OPENCV_SUFFIXES))


def read_rig(path: StrPath, *, projector_size: tuple[int, int] | None = None) -> Rig:
    """Read a rig that ``write_rig`` or OpenCV wrote.

    Parameters
    ----------
    path : Path
        ``.toml``, or ``.xml``, ``.yml``, ``.yaml`` of OpenCV.
    projector_size : (columns, rows), optional
        For files of OpenCV that do not say it.

    Raises
    ------
    FileProblem for a missing or damaged file, naming the fault.
    """
    path = Path(path)
    if not path.is_file():
        raise FileProblem(f"{path}: expected a rig file, got no such file")
    try:
        if path.suffix.lower() in OPENCV_SUFFIXES:
            rig = _from_opencv(path, projector_size)
        else:
            rig = _from_toml(read_toml(path, RigFile))
        size = (rig.projector.width_px, rig.projector.height_px)
        if projector_size not in (None, size):
            raise InputError(
                f"projector_size: expected {size[0]} × {size[1]} as the file says, got "
                f"{' × '.join(map(str, projector_size or ()))}"
            )
        return rig
    except InputError as error:
        text = str(error)
        raise FileProblem(text if str(path) in text else f"{path}: {text}") from error


def format_rig(rig: Rig) -> str:
    """A rig as TOML."""
    content: dict[str, Any] = {"kind": "rig"}
    for k, (name, device) in enumerate((("camera", rig.camera), ("projector", rig.projector))):
        content[name] = {
            "size_px": [device.width_px, device.height_px],
            "focal_px": _floats(device.focal_px),
            "principal_px": _floats(device.principal_px),
            "distortion": _floats(device.distortion),
        }
        if rig.residual_px is not None:
            content[name]["residual_px"] = float(rig.residual_px[k])
    T = rig.T_projector_camera
    content["T_projector_camera"] = {
        "rotation": [_floats(row) for row in T[:3, :3]],
        "translation_mm": _floats(T[:3, 3]),
    }
    if rig.covariance is not None:
        sigma = np.sqrt(np.diag(rig.covariance))
        safe = np.where(sigma > 0, sigma, 1.0)
        correlation = rig.covariance / np.outer(safe, safe)
        content["uncertainty"] = {
            "parameters": list(RIG_PARAMETERS),
            "sigma": _floats(sigma),
            "correlation": [[round(float(c), 12) for c in row] for row in correlation],
        }
    content |= toml_section(rig.provenance)
    # A line for each row of numbers.
    rows = re.compile(r"\[\s*((?:[^][,\"]+,\s*)+)\]")
    return HEADER + rows.sub(
        lambda row: f"[{', '.join(part.strip() for part in row[1].split(',') if part.strip())}]",
        tomli_w.dumps(content),
    )


def _floats(values: Any) -> list[float]:
    return [float(v) for v in values]


def _from_toml(content: RigFile) -> Rig:
    devices = [
        Pinhole(*d.size_px, d.focal_px, d.principal_px, d.distortion)
        for d in (content.camera, content.projector)
    ]
    T = np.eye(4)
    T[:3, :3] = content.T_projector_camera.rotation
    T[:3, 3] = content.T_projector_camera.translation_mm
    covariance = None
    if content.uncertainty is not None:
        u = content.uncertainty
        if tuple(u.parameters) != RIG_PARAMETERS:
            raise InputError(
                f"uncertainty.parameters: expected {', '.join(RIG_PARAMETERS)}, in this order"
            )
        n = len(RIG_PARAMETERS)
        if len(u.sigma) != n or [len(row) for row in u.correlation] != [n] * n:
            raise InputError(f"uncertainty: expected {n} sigmas and {n} × {n} correlations")
        sigma = np.array(u.sigma)
        if not (np.isfinite(sigma).all() and (sigma >= 0).all()):
            raise InputError("uncertainty.sigma: expected values >= 0")
        covariance = np.array(u.correlation) * np.outer(sigma, sigma)
    camera_px, projector_px = content.camera.residual_px, content.projector.residual_px
    # One of the two alone does not say how well rays meet.
    residual = None if camera_px is None or projector_px is None else (camera_px, projector_px)
    origin = None if content.provenance is None else content.provenance.as_provenance()
    return Rig(devices[0], devices[1], T, covariance, residual, origin)


def _opencv(path: Path, rig: Rig) -> str:
    kind = (
        cv2.FILE_STORAGE_FORMAT_XML
        if path.suffix.lower() == ".xml"
        else (cv2.FILE_STORAGE_FORMAT_YAML)
    )
    storage = cv2.FileStorage("", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    for name, device in (("camera", rig.camera), ("projector", rig.projector)):
        storage.write(f"{name}_size", np.array([[device.width_px, device.height_px]], np.int32))
        storage.write(f"{name}_matrix", _matrix(device))
        storage.write(f"{name}_distortion", np.array([device.distortion]))
    storage.write("rotation", rig.T_projector_camera[:3, :3].copy())
    storage.write("translation", rig.T_projector_camera[:3, 3:].copy())
    # OpenCV limits the length of a string.
    storage.startWriteStruct(KEY, cv2.FileNode_SEQ)
    for line in comment_lines(rig.provenance):
        storage.write("", line)
    storage.endWriteStruct()
    return str(storage.releaseAndGetString())


def _matrix(device: Pinhole) -> FloatMap:
    K = np.eye(3)
    K[[0, 1], [0, 1]] = device.focal_px
    K[:2, 2] = device.principal_px
    return K


def _from_opencv(path: Path, projector_size: tuple[int, int] | None) -> Rig:
    try:
        storage = cv2.FileStorage(
            path.read_text("utf-8"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        )
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        raise InputError("expected XML or YAML of OpenCV's FileStorage, got none") from error
    found = _matrices(storage)
    devices = []
    for name in ("camera", "projector"):
        size = _size_of(storage, name) or (projector_size if name == "projector" else None)
        if size is None:
            raise InputError(f"missing {name}_size: columns and rows of the {name}")
        devices.append(_pinhole(name, found, size))
    T = np.eye(4)
    # The nearest rotation: files hold a few digits only.
    u, _, v = np.linalg.svd(found["rotation"].reshape(3, 3))
    T[:3, :3], T[:3, 3] = u @ v, found["translation"].ravel()
    node = storage.getNode(KEY)
    origin = from_comments(node.at(k).string() for k in range(node.size()))
    return Rig(devices[0], devices[1], T, provenance=origin)


def _matrices(storage: Any) -> dict[str, FloatMap]:
    """The matrices of a file by our names."""
    found: dict[str, FloatMap] = {}
    for name, known in NAMES.items():
        nodes = [storage.getNode(k) for k in known]
        values = [n.mat() for n in nodes if not n.empty() and n.isMap()]
        if not values or values[0] is None:
            raise InputError(f"missing matrix {name} (or {', '.join(known[1:])})")
        found[name] = np.asarray(values[0], np.float64)
    shapes = {"camera_matrix": 9, "projector_matrix": 9, "rotation": 9, "translation": 3}
    for name, size in shapes.items():
        if found[name].size != size:
            raise InputError(f"{name}: expected {size} values, got {found[name].size}")
    return found


def _pinhole(name: str, found: dict[str, FloatMap], size: tuple[int, int]) -> Pinhole:
    K, d = found[f"{name}_matrix"].reshape(3, 3), found[f"{name}_distortion"].ravel()
    if d.size > 5 and np.any(d[5:]):
        raise InputError(f"{name}_distortion: expected five coefficients or fewer, got {d.size}")
    k = np.zeros(5)
    k[: min(5, d.size)] = d[:5]
    return Pinhole(
        *size,
        (float(K[0, 0]), float(K[1, 1])),
        (float(K[0, 2]), float(K[1, 2])),
        (float(k[0]), float(k[1]), float(k[2]), float(k[3]), float(k[4])),
    )


def _size_of(storage: Any, name: str) -> tuple[int, int] | None:
    """Columns and rows; files of other programs have rows and columns of the camera at most."""
    node = storage.getNode(f"{name}_size")
    if not node.empty():
        columns, rows = (int(n) for n in node.mat().ravel()[:2])
        return columns, rows
    node = storage.getNode("img_shape")
    if name == "camera" and not node.empty():
        height, width = (int(n) for n in node.mat().ravel()[:2])
        return width, height
    return None
