"""Points as PCD files, the format of the Point Cloud Library (version 0.7, binary)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.limits import parsing, read_content, told
from fringeworks.types import FileProblem

KINDS = {"f": "F", "u": "U", "i": "I"}
"""Letters of the format by those of NumPy."""
COLOURS = ("red", "green", "blue")
"""Fields that become one."""
DATA = b"DATA binary\n"
"""Last line of the header of binary points."""
HEADER_LIMIT = 1 << 16
"""Bytes in which a header must end. Real ones take one or two thousand."""
NAMES = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
"""Names that the Point Cloud Library gives to fields with other names in PLY files."""


def write_pcd(
    path: Path, points: Iterable[NDArray[Any]], count: int, comments: Sequence[str]
) -> None:
    """Write a binary PCD file.

    Parameters
    ----------
    path : Path
    points : structured arrays of numbers
        In their order; fields red, green and blue become the field ``rgb`` that viewers know.
    count : int
        Number of points in all of them.
    comments : sequence of str
        Lines of the header, ASCII.
    """
    parts = map(_packed, points)
    first = next(parts)
    fields = [first.dtype[name] for name in first.dtype.names or ()]
    header = [
        *(f"# {line}" for line in comments),
        "VERSION 0.7",
        f"FIELDS {' '.join(first.dtype.names or ())}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in fields)}",
        f"TYPE {' '.join(KINDS[kind.kind] for kind in fields)}",
        f"COUNT {' '.join('1' for _ in fields)}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        "DATA binary",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        for part in chain([first], parts):
            file.write(part.data.cast("B"))


def _packed(points: NDArray[Any]) -> NDArray[Any]:
    """The points by the names of PCD, with their colour in one number, 0x00RRGGBB."""
    names = points.dtype.names or ()
    plain = [name for name in names if name not in COLOURS]
    fields = [(NAMES.get(name, name), points.dtype[name].str) for name in plain]
    coloured = "red" in names
    packed = np.empty(points.shape, dtype=[*fields, *([("rgb", "<u4")] if coloured else [])])
    for name in plain:
        packed[NAMES.get(name, name)] = points[name]
    if coloured:
        red, green, blue = (points[name].astype(np.uint32) for name in COLOURS)
        packed["rgb"] = red << 16 | green << 8 | blue
    return packed


def read_pcd(path: Path) -> tuple[NDArray[Any], list[str]]:
    """The points of a binary PCD file, by the names that PLY files give to their fields.

    Returns
    -------
    points : (n,) structured array with x, y, z and what else the file has
    comments : list of str

    Raises
    ------
    FileProblem for a damaged file, and for one of text or compressed points.
    """
    content = read_content(path, "a PCD file")
    with parsing(path, "a PCD file"):
        end = content.find(DATA, 0, HEADER_LIMIT)
        start = end + len(DATA)
        if end < 0:
            raise FileProblem("expected binary points as PCD, got something else")
        lines = content[:end].decode("ascii", "replace").splitlines()
        words = dict(line.split(maxsplit=1) for line in lines if line[:1].isalpha())
        plain = {pcd: ply for ply, pcd in NAMES.items()}
        kinds = {pcd: numpy for numpy, pcd in KINDS.items()}
        columns = [words[name].split() for name in ("FIELDS", "SIZE", "TYPE", "COUNT")]
        if set(columns[3]) != {"1"}:
            raise FileProblem("expected one number in each field, got several")
        fields = [
            (plain.get(name, name), f"<{kinds[kind]}{int(size)}")
            for name, size, kind, _ in zip(*columns, strict=True)
        ]
        count = int(words["POINTS"])
        if not 0 <= count <= len(content):
            raise FileProblem(f"expected {told(count)} points, got a file that is too short")
        packed = np.frombuffer(content, np.dtype(fields), count, start)
        return _unpacked(packed), [line[2:] for line in lines if line.startswith("# ")]


def _unpacked(packed: NDArray[Any]) -> NDArray[Any]:
    """The points with their colour in three fields, as PLY files have it."""
    names = [name for name in packed.dtype.names or () if name != "rgb"]
    fields = [(name, packed.dtype[name].str) for name in names]
    coloured = "rgb" in (packed.dtype.names or ())
    points = np.empty(
        packed.shape, dtype=[*fields, *((name, "u1") for name in COLOURS if coloured)]
    )
    for name in names:
        points[name] = packed[name]
    if coloured:
        # Some programs store the three bytes as a number of single precision.
        word = packed["rgb"].view("<u4") if packed["rgb"].itemsize == 4 else packed["rgb"]
        for shift, name in zip((16, 8, 0), COLOURS, strict=True):
            points[name] = word >> shift & 255
    return points
