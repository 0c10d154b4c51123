"""PLY files: vertices with properties, and triangles."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.limits import parsing, read_content, told
from fringeworks.types import FileProblem

PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    **{f"int{8 * n}": f"i{n}" for n in (1, 2, 4)},
    **{f"uint{8 * n}": f"u{n}" for n in (1, 2, 4)},
    "float32": "f4",
    "float64": "f8",
}
"""Types of properties, in both spellings that programs use."""
WRITTEN = {"<f4": "float", "|u1": "uchar"}
"""Types that are written."""
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
"""Byte order by the name of the format."""
FACE = np.dtype([("n", "u1"), ("index", "<i4", (3,))])
"""A triangle in a file."""
FACES = re.compile(rb"\nelement face 0*([1-9]\d{0,9})\s")
"""The line that gives the number of faces."""
OWN = b"ply\nformat binary_little_endian 1.0\n"
"""Beginning of a file that is written here."""
LISTS = b"\nproperty list uchar int vertex_indices\n"
"""The line that describes its faces."""
HEADER_LIMIT = 1 << 16
"""Bytes in which a header must end. Real ones take one or two thousand."""


def write_ply(
    path: Path,
    vertices: Iterable[NDArray[Any]],
    count: int,
    triangles: NDArray[np.int32] | None,
    comments: Sequence[str],
) -> None:
    """Write a binary PLY file.

    Parameters
    ----------
    path : Path
    vertices : structured arrays, float32 and uint8 fields
        In their order; each is written before the next one is asked for.
    count : int
        Number of vertices in all of them.
    triangles : (m, 3) int32 array, optional
        Rows of ``vertices``; None for a file of points.
    comments : sequence of str
        Lines of the header, ASCII.
    """
    parts = iter(vertices)
    first = next(parts)
    fields = [(name, first.dtype[name].str) for name in first.dtype.names or ()]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comments),
        f"element vertex {count}",
        *(f"property {WRITTEN[kind]} {name}" for name, kind in fields),
    ]
    faces = np.empty(0, dtype=FACE)
    if triangles is not None:
        faces = np.empty(len(triangles), dtype=FACE)
        faces["n"], faces["index"] = 3, triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with path.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        for part in chain([first], parts):
            file.write(part.data.cast("B"))
        file.write(faces.data.cast("B"))


def read_ply(path: Path) -> tuple[NDArray[Any], list[str]]:
    """The vertices of a PLY file of any program.

    Returns
    -------
    vertices : (n,) structured array with x, y, z and what else the file has
    comments : list of str

    Raises
    ------
    FileProblem for a damaged file, and for one that does not begin with vertices.
    """
    content = read_content(path, "a PLY file")
    with parsing(path, "a whole PLY file"):
        return _vertices(content)


def _vertices(content: bytes) -> tuple[NDArray[Any], list[str]]:
    """Vertices and comments, after the header was compared with the size of the file."""
    end = content.find(b"end_header", 0, HEADER_LIMIT)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or start == 0:
        raise FileProblem("expected a PLY file, got something else")
    text = content[:end].decode("ascii", "replace").splitlines()
    lines = [line.split() for line in text]
    form = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    elements = [k for k, line in enumerate(lines) if line[:1] == ["element"]]
    if form not in ORDERS or not elements or lines[elements[0]][1:2] != ["vertex"]:
        raise FileProblem("expected a PLY file with vertices first, got another")
    count = int(lines[elements[0]][2])
    last = elements[1] if len(elements) > 1 else len(lines)
    properties = [x for x in lines[elements[0] + 1 : last] if x[:1] == ["property"]]
    fields = [(name, (ORDERS[form] or "<") + PLY_TYPES[kind]) for _, kind, name in properties]
    # A vertex takes one byte or more, in text two.
    if not 0 <= count <= len(content) or not {"x", "y", "z"} <= {name for name, _ in fields}:
        got = told(", ".join(name for name, _ in fields))
        raise FileProblem(f"expected {told(count)} vertices with x, y, z, got {got}")
    if form == "ascii":
        rows = content[start:].decode("ascii").split("\n")[:count]
        table = np.array([tuple(row.split()[: len(fields)]) for row in rows], dtype=fields)
    else:
        table = np.frombuffer(content, np.dtype(fields), count, start)
    if len(table) != count:
        raise FileProblem(f"expected {count} vertices, got {len(table)}")
    return table, [line[8:] for line in text if line.startswith("comment ")]


def holds_faces(path: Path) -> bool:
    """Whether a PLY file has faces."""
    content = read_content(path, "a PLY file")
    return bool(FACES.search(content, 0, max(0, content.find(b"end_header", 0, HEADER_LIMIT))))


def own_triangles(path: Path) -> NDArray[np.int32] | None:
    """The triangles of a PLY file as ``write_ply`` writes them, (m, 3); None for other programs'
    ways to write them."""
    content = read_content(path, "a PLY file")
    with parsing(path, "a whole PLY file"):
        end = content.find(b"end_header\n", 0, HEADER_LIMIT)
        found = FACES.search(content, 0, end)
        if found is None or not content.startswith(OWN) or LISTS not in content[:end]:
            return None
        faces = np.empty(int(found[1]), dtype=FACE)
        if faces.nbytes > len(content):
            raise FileProblem(f"expected {len(faces)} triangles, got fewer")
        faces = np.frombuffer(content, FACE, len(faces), len(content) - faces.nbytes)
        return faces["index"] if bool((faces["n"] == 3).all()) else None
