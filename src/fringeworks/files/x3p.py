"""X3P files (ISO 25178-72): heights in metres in a ZIP archive with an XML description."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.files.limits import MAX_DESCRIPTION_BYTES, beyond, check_frame_size, parsing
from fringeworks.files.provenance import from_json, json_line
from fringeworks.surface.height_map import known_pitch
from fringeworks.types import FileProblem, FloatMap, HeightMap, InputError, Provenance

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

NAMESPACE = "http://www.opengps.eu/2008/ISO5436_2"
"""Name space of the description, as the standard gives it."""
DATA, DESCRIPTION, CHECKSUM = "bindata/data.bin", "main.xml", "md5checksum.hex"
"""Files of the archive."""
TIMELESS = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the archive, the earliest that ZIP knows: equal results are equal files."""
DATA_TYPES = {"D": "<f8", "F": "<f4", "L": "<i4", "I": "<i2"}
"""Types of heights by the standard's letters."""


def write_x3p(path: Path, surface: HeightMap) -> None:
    """Write heights; NaN where not measured.

    Raises
    ------
    InputError for displacements in px and for an unknown pitch, since the format holds lengths
    only.
    """
    if surface.unit != "mm":
        raise InputError(
            "X3P: expected heights in mm, got displacements in px; give the geometry, or write "
            ".tif, .npz or .gsf"
        )
    data = np.ascontiguousarray(surface.values * 1e-3, dtype="<f8").tobytes()
    description = _description(surface, hashlib.md5(data, usedforsecurity=False).hexdigest())
    checksum = hashlib.md5(description, usedforsecurity=False).hexdigest()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (
            (DESCRIPTION, description),
            (DATA, data),
            (CHECKSUM, f"{checksum} *{DESCRIPTION}\n".encode()),
        ):
            entry = zipfile.ZipInfo(name, TIMELESS)
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)


def read_x3p(path: Path) -> tuple[FloatMap, float, str, Provenance | None]:
    """Heights in mm (h, w) float64, pitch in mm/px, method and provenance of an X3P file.

    Raises
    ------
    FileProblem for a damaged file, and for one that holds no regular grid.
    """
    with parsing(path, "a surface as X3P"), zipfile.ZipFile(path) as archive:
        root = _root(archive)
        axes = {name: root.find(f".//{name}") for name in ("CX", "CY", "CZ")}
        columns, rows, layers = (
            int(root.findtext(f".//Size{name}") or 0) for name in ("X", "Y", "Z")
        )
        check_frame_size(columns, rows)
        pitch = float(_text(axes["CX"], "Increment"))
        kind = DATA_TYPES[_text(axes["CZ"], "DataType")]
        scale = float(_text(axes["CZ"], "Increment") or 1.0) if kind[1] == "i" else 1.0
        member = archive.getinfo(root.findtext(".//PointDataLink") or DATA)
        held = member.file_size // np.dtype(kind).itemsize
        if layers != 1 or held != rows * columns:
            raise FileProblem(f"expected {rows} × {columns} heights of one layer, got {held}")
        values = np.frombuffer(archive.read(member), kind)
        heights = values.reshape(rows, columns).astype(np.float64) * scale * 1e3
        origin = from_json(root.findtext(".//Comment"))
        return heights, pitch * 1e3, root.findtext(".//ProbingSystem/Identification") or "", origin


def _root(archive: zipfile.ZipFile) -> ET.Element:
    """The description, if it is short and defines no entities, which could grow without limit."""
    member = archive.getinfo(DESCRIPTION)
    if member.file_size > MAX_DESCRIPTION_BYTES:
        raise FileProblem(beyond("a description", member.file_size, MAX_DESCRIPTION_BYTES))
    text = archive.read(member)
    if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
        raise FileProblem("expected a description without entities, got some")
    import xml.etree.ElementTree as ET  # 6 ms, for those only who read X3P

    return ET.fromstring(text)


def _text(parent: ET.Element | None, tag: str) -> str:
    return "" if parent is None else (parent.findtext(tag) or "")


def _tree(parent: ET.Element, content: dict[str, Any]) -> None:
    import xml.etree.ElementTree as ET

    for tag, value in content.items():
        child = ET.SubElement(parent, tag)
        if isinstance(value, dict):
            _tree(child, value)
        else:
            child.text = str(value)


def _axis(kind: str, increment: float) -> dict[str, Any]:
    return {"AxisType": kind, "DataType": "D", "Increment": repr(increment), "Offset": "0"}


def _description(surface: HeightMap, checksum: str) -> bytes:
    import xml.etree.ElementTree as ET

    ET.register_namespace("p", NAMESPACE)
    root = ET.Element(f"{{{NAMESPACE}}}ISO5436_2")
    rows, columns = surface.shape
    pitch = known_pitch(surface, "X3P") * 1e-3
    origin = surface.provenance
    # A date that is unknown is left out.
    date = {"Date": origin.date} if origin is not None and origin.date else {}
    axes = {"CX": _axis("I", pitch), "CY": _axis("I", pitch), "CZ": _axis("A", 1.0)}
    _tree(
        root,
        {
            "Record1": {"Revision": "ISO5436 - 2000", "FeatureType": "SUR", "Axes": axes},
            "Record2": {
                **date,
                "Creator": "fringeworks",
                "Instrument": {
                    "Manufacturer": "fringeworks",
                    "Model": "fringe projection",
                    "Serial": "not available",
                    "Version": "not available" if origin is None else origin.version,
                },
                "ProbingSystem": {"Type": "NonContacting", "Identification": surface.method},
                "Comment": json_line(origin) or "heights above the reference plane",
            },
            "Record3": {
                "MatrixDimension": {"SizeX": columns, "SizeY": rows, "SizeZ": 1},
                "DataLink": {"PointDataLink": DATA, "MD5ChecksumPointData": checksum},
            },
            "Record4": {"ChecksumFile": CHECKSUM},
        },
    )
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))
