"""Calibrations of the two-frame path on disk: a TOML file, or maps of every pixel as NPZ."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import tomli_w

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.limits import existing_file, parsing
from fringeworks.files.npz import TEXT, read_npz, write_npz
from fringeworks.files.pair import GeometrySection, geometry_section
from fringeworks.files.provenance import KEY, ProvenanceSection, from_json, json_line, toml_section
from fringeworks.files.toml import Section, read_toml
from fringeworks.rig.calibration.planes import PixelCalibration, PlaneCalibration
from fringeworks.types import ReferencePlaneGeometry

GEOMETRY_SUFFIX, PIXELS_SUFFIX = ".toml", ".npz"
"""Suffixes of a geometry, and of a calibration of every pixel."""
LAYOUT = {
    "slope": "f hw",
    "bend": "f hw",
    "heights_mm": "f 2",
    "pitch_mm_per_px": "?f",
    KEY: f"?{TEXT}",
}
"""Layout of a calibration of every pixel."""


class PlaneFile(Section):
    """The whole of a geometry file; unknown keys are refused."""

    kind: Literal["reference-plane"]
    geometry: GeometrySection
    """As in ``capture.toml``: mm, mm/px."""
    provenance: ProvenanceSection | None = None


def check_reference_plane_target(path: StrPath) -> None:
    """Refuse a file that ``write_reference_plane`` cannot write, before anything is computed."""
    check_target(path, (GEOMETRY_SUFFIX, PIXELS_SUFFIX))


def write_reference_plane(
    path: StrPath,
    calibration: ReferencePlaneGeometry | PlaneCalibration | PixelCalibration,
) -> Path:
    """Write a calibration of the two-frame path, whole or not at all.

    Parameters
    ----------
    path : path
        ``.toml`` for a geometry, ``.npz`` for a calibration of every pixel.
    calibration : ReferencePlaneGeometry, PlaneCalibration or PixelCalibration

    Raises
    ------
    FileProblem for a suffix that does not fit, and where the folder cannot be written to.
    """
    path = Path(path)
    if not isinstance(calibration, PixelCalibration):
        check_target(path, (GEOMETRY_SUFFIX,))
        origin = None
        if isinstance(calibration, PlaneCalibration):
            origin, calibration = calibration.provenance, calibration.geometry
        content = {"kind": "reference-plane", "geometry": geometry_section(calibration)}
        write_text(path, tomli_w.dumps(content | toml_section(origin)))
        return path
    check_target(path, (PIXELS_SUFFIX,))
    arrays = {
        "slope": calibration.slope,
        "bend": calibration.bend,
        "heights_mm": np.array(calibration.heights_mm),
    }
    if calibration.pitch_mm_per_px is not None:
        arrays["pitch_mm_per_px"] = np.array(float(calibration.pitch_mm_per_px))
    line = json_line(calibration.provenance)
    write_npz(path, arrays if line is None else arrays | {KEY: np.array(line)})
    return path


def read_reference_plane(path: StrPath) -> ReferencePlaneGeometry | PixelCalibration:
    """Read a calibration that ``write_reference_plane`` wrote.

    Raises
    ------
    FileProblem that names the file and its fault.
    """
    path = existing_file(path, "a calibration (.toml or .npz)")
    if path.suffix.lower() != PIXELS_SUFFIX:
        with parsing(path, "a geometry"):
            return read_toml(path, PlaneFile).geometry.as_geometry()
    arrays = read_npz(path, "a calibration of every pixel", LAYOUT)
    with parsing(path, "a calibration of every pixel"):
        low, high = (float(v) for v in arrays["heights_mm"])
        pitch = float(arrays["pitch_mm_per_px"]) if "pitch_mm_per_px" in arrays else None
        origin = from_json(str(arrays[KEY])) if KEY in arrays else None
        return PixelCalibration(arrays["slope"], arrays["bend"], (low, high), origin, pitch)
