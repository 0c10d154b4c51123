"""Calibrations of the two-frame path on disk: a TOML file, and maps of every pixel."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w

from fringeworks.files.atomic import replacing, write_text
from fringeworks.files.pair import GeometrySection
from fringeworks.files.toml import Section, read_toml
from fringeworks.pair.plane_calibration import PixelCalibration
from fringeworks.types import InputError, ReferencePlaneGeometry


class PlaneFile(Section):
    """The whole of a geometry file; unknown keys are refused."""

    kind: Literal["reference-plane"]
    geometry: GeometrySection
    """As in ``capture.toml``: mm, mm/px."""


def write_geometry(path: Path, geometry: ReferencePlaneGeometry) -> Path:
    """Write a geometry as TOML, whole or not at all."""
    section: dict[str, Any] = {
        "distance_mm": float(geometry.distance_mm),
        "baseline_mm": float(geometry.baseline_mm),
        "pitch_mm_per_px": float(geometry.pitch_mm_per_px),
        "sign": geometry.sign,
    }
    write_text(path, tomli_w.dumps({"kind": "reference-plane", "geometry": section}))
    return Path(path)


def read_geometry(path: Path) -> ReferencePlaneGeometry:
    """Read what ``write_geometry`` wrote; ``InputError`` names the file and its fault."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a geometry file (TOML), got no such file")
    return ReferencePlaneGeometry(**read_toml(path, PlaneFile).geometry.model_dump())


def write_pixels(path: Path, calibration: PixelCalibration) -> Path:
    """Write a calibration of every pixel as ``.npz``, whole or not at all."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise InputError(f"{path}: expected .npz, got {path.suffix or 'no suffix'}")
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            slope=calibration.slope,
            bend=calibration.bend,
            heights_mm=np.array(calibration.heights_mm),
        )
    return path


def read_pixels(path: Path) -> PixelCalibration:
    """Read what ``write_pixels`` wrote; ``InputError`` names the file."""
    try:
        with np.load(path, allow_pickle=False) as data:
            low, high = (float(v) for v in data["heights_mm"])
            return PixelCalibration(data["slope"], data["bend"], (low, high))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: expected a calibration as .npz, got: {error}") from error
