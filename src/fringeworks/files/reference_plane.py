"""Calibrations of the two-frame path on disk: a TOML file, or maps of every pixel as NPZ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import tomli_w

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.description import Section
from fringeworks.files.limits import existing_file, parsing
from fringeworks.files.npz import FLOATS, MAP, NUMBER, ORIGIN, Archive, write_npz
from fringeworks.files.pair import GeometrySection, geometry_section
from fringeworks.files.provenance import KEY, ProvenanceSection, toml_section
from fringeworks.files.toml import read_toml
from fringeworks.rig.calibration.planes import PixelCalibration, PlaneCalibration
from fringeworks.types import ReferencePlaneGeometry

GEOMETRY_SUFFIX, PIXELS_SUFFIX = ".toml", ".npz"
"""Suffixes of a geometry, and of a calibration of every pixel."""
PIXELS = Archive(
    PixelCalibration,
    "a calibration of every pixel",
    {
        "slope": MAP,
        "bend": MAP,
        "heights_mm": replace(FLOATS, layout="f 2"),
        "pitch_mm_per_px": NUMBER,
        KEY: ORIGIN,
    },
)
"""A calibration of every pixel."""


class PlaneFile(Section):
    """The whole of a geometry file; unknown keys are refused."""

    kind: Literal["reference-plane"]
    geometry: GeometrySection
    """As in ``capture.toml``: mm, mm/px."""
    provenance: ProvenanceSection | None = None


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
    write_npz(path, PIXELS.arrays(calibration))
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
    return PIXELS.read(path)
