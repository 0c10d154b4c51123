"""Meshes as 3MF files (3MF Consortium, core specification 1.3), with colour by its materials."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.limits import check_bytes, parsing, read_content, told
from fringeworks.types import FileProblem, FloatMap

SUFFIX = ".3mf"
"""Suffix of the files."""
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
"""Name space of the core specification."""
MATERIALS = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
"""Name space of colours."""
MODEL = "3D/3dmodel.model"
"""Where the model lies in the archive."""
RELATION = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
"""Kind of the relation that leads to it."""
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
"""Kinds of the files in the archive."""
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/{MODEL}" Id="rel0" Type="{RELATION}"/></Relationships>\n'
)
"""The relation that leads to the model."""
TIMELESS = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the archive, the earliest that ZIP knows: equal results are equal files."""
UNITS = {
    "micron": 1e-3,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1e3,
}
"""Millimetres of the units of models."""
MODELS = (MODEL, "3D/3DModel.model", "3d/3dmodel.model")
"""Where the model lies where the relations do not say."""
BAND = 50_000
"""Vertices or triangles that are written at a time."""
MOST_PARTS = 10_000
"""Largest number of parts of a model, with those that are repeated."""


def write_3mf(path: Path, vertices: FloatMap, faces: NDArray[Any], colours: Any = None) -> None:
    """Write one mesh in millimetres.

    Parameters
    ----------
    path : Path
    vertices : (n, 3) array, mm
    faces : (m, 3) array of whole numbers
    colours : (n, 3) uint8 array, optional
        Red, green and blue of the vertices.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in (("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)):
            archive.writestr(zipfile.ZipInfo(name, TIMELESS), content, zipfile.ZIP_DEFLATED)
        entry = zipfile.ZipInfo(MODEL, TIMELESS)
        entry.compress_type = zipfile.ZIP_DEFLATED
        with archive.open(entry, "w", force_zip64=True) as file:
            for text in _model(vertices, faces, colours):
                file.write(text.encode("ascii"))


def _model(vertices: FloatMap, faces: NDArray[Any], colours: Any) -> Iterator[str]:
    """The text of the model, piece by piece."""
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}" xmlns:m="{MATERIALS}">\n'
    yield '<metadata name="Application">fringeworks</metadata>\n<resources>\n'
    triangles = np.asarray(faces, np.int64)
    line = '<triangle v1="%d" v2="%d" v3="%d"/>\n'
    if colours is not None:
        known, number = np.unique(np.asarray(colours), axis=0, return_inverse=True)
        yield '<m:colorgroup id="1">\n'
        yield from _lines('<m:color color="#%02X%02X%02X"/>\n', known)
        yield "</m:colorgroup>\n"
        triangles = np.column_stack((triangles, number.ravel()[triangles]))
        line = '<triangle v1="%d" v2="%d" v3="%d" pid="1" p1="%d" p2="%d" p3="%d"/>\n'
    shown = "" if colours is None else ' pid="1" pindex="0"'
    yield f'<object id="2" type="model"{shown}>\n<mesh>\n<vertices>\n'
    yield from _lines('<vertex x="%.9g" y="%.9g" z="%.9g"/>\n', np.asarray(vertices, np.float64))
    yield "</vertices>\n<triangles>\n"
    yield from _lines(line, triangles)
    yield "</triangles>\n</mesh>\n</object>\n</resources>\n"
    yield '<build><item objectid="2"/></build>\n</model>\n'


def _lines(form: str, rows: NDArray[Any]) -> Iterator[str]:
    for start in range(0, len(rows), BAND):
        part = rows[start : start + BAND]
        yield form * len(part) % tuple(part.ravel().tolist())


def read_3mf(path: Path) -> tuple[FloatMap, NDArray[np.int64]]:
    """Vertices in mm (n, 3) and triangles (m, 3) of all parts that a model builds.

    Raises
    ------
    FileProblem for a damaged file, and for one without triangles.
    """
    content = read_content(path, "a 3MF file")
    with parsing(path, "a mesh as 3MF"), zipfile.ZipFile(BytesIO(content)) as archive:
        member = archive.getinfo(_place(archive))
        check_bytes(member.file_size, "a model")
        with archive.open(member) as file:
            return _Model(file).built()


def _place(archive: zipfile.ZipFile) -> str:
    """Name of the model in the archive."""
    names = archive.namelist()
    found = next((name for name in MODELS if name in names), None)
    if found is None:
        found = next((name for name in names if PurePosixPath(name).suffix == ".model"), None)
    if found is None:
        raise FileProblem(f"expected a model, got {told(', '.join(names[:8])) or 'nothing'}")
    return found


class _Model:
    """Objects of a model, read as they come."""

    def __init__(self, file: IO[bytes]) -> None:
        self._meshes: dict[str, tuple[FloatMap, NDArray[np.int64]]] = {}
        self._parts: dict[str, list[tuple[str, FloatMap]]] = {}
        self._items: list[tuple[str, FloatMap]] = []
        self._scale = 1.0
        self._used = 0
        vertices: list[float] = []
        corners: list[int] = []
        current = ""
        for event, element in ET.iterparse(_Plain(file), ("start", "end")):
            tag = element.tag.rpartition("}")[2]
            given = element.attrib
            if event == "start":
                if tag == "model":
                    self._scale = UNITS[given.get("unit", "millimeter")]
                elif tag == "object":
                    current = given["id"]
                    vertices, corners = [], []
                continue
            if tag == "vertex":
                vertices += (float(given["x"]), float(given["y"]), float(given["z"]))
            elif tag == "triangle":
                corners += (int(given["v1"]), int(given["v2"]), int(given["v3"]))
            elif tag == "component":
                self._parts.setdefault(current, []).append(_placed(given))
            elif tag == "item":
                self._items.append(_placed(given))
            elif tag == "object" and corners:
                self._meshes[current] = _mesh(vertices, corners)
            if tag in ("vertex", "triangle", "vertices", "triangles", "object"):
                element.clear()

    def built(self) -> tuple[FloatMap, NDArray[np.int64]]:
        """The parts that are built, one after the other."""
        start = np.eye(4)[:, :3]
        items = self._items or [(name, start) for name in self._meshes]
        found = [mesh for name, pose in items for mesh in self._of(name, pose, 0)]
        if not found:
            raise FileProblem("expected triangles, got none")
        counts = np.cumsum([0, *(len(v) for v, _ in found[:-1])])
        faces = [f + n for (_, f), n in zip(found, counts, strict=True)]
        vertices = np.concatenate([v for v, _ in found]) * self._scale
        return vertices, np.concatenate(faces)

    def _of(
        self, name: str, pose: FloatMap, depth: int
    ) -> Iterator[tuple[FloatMap, NDArray[np.int64]]]:
        """The meshes of an object, at their places."""
        self._used += 1
        if self._used > MOST_PARTS or depth > len(self._parts):
            raise FileProblem(f"expected at most {MOST_PARTS} parts, got more")
        if name in self._meshes:
            vertices, faces = self._meshes[name]
            yield vertices @ pose[:3] + pose[3], faces
        for part, inner in self._parts.get(name, ()):
            whole = np.vstack((inner[:3] @ pose[:3], inner[3] @ pose[:3] + pose[3]))
            yield from self._of(part, whole, depth + 1)


class _Plain:
    """A file of XML without entities, which could grow without limit."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._last = b""

    def read(self, size: int = -1) -> bytes:
        """Some bytes."""
        found = self._file.read(size)
        seen = self._last + found
        if b"<!ENTITY" in seen or b"<!DOCTYPE" in seen:
            raise FileProblem("expected a model without entities, got some")
        self._last = found[-len("<!DOCTYPE") :]
        return found


def _placed(given: dict[str, str]) -> tuple[str, FloatMap]:
    """An object and where it is placed: rows of a matrix (4, 3) that multiplies from the right."""
    numbers = [float(v) for v in given.get("transform", "").split()]
    if numbers and (len(numbers) != 12 or not np.isfinite(numbers).all()):
        raise FileProblem(f"expected a transform of 12 numbers, got {len(numbers)}")
    pose = np.array(numbers).reshape(4, 3) if numbers else np.eye(4)[:, :3]
    return given["objectid"], pose


def _mesh(vertices: Sequence[float], corners: Sequence[int]) -> tuple[FloatMap, NDArray[np.int64]]:
    return (
        np.array(vertices, np.float64).reshape(-1, 3),
        np.array(corners, np.int64).reshape(-1, 3),
    )
