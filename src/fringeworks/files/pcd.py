"""Points as PCD files, the format of the Point Cloud Library (version 0.7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.files.limits import check_bytes, parsing, read_content, told
from fringeworks.files.lzf import decompressed
from fringeworks.files.point_table import COLOURS
from fringeworks.types import FileProblem

KINDS = {"f": "F", "u": "U", "i": "I"}
"""Letters of the format by those of NumPy."""
DATA = b"DATA "
"""Beginning of the last line of the header."""
HEADER_LIMIT = 1 << 16
"""Bytes in which a header must end. Real ones take one or two thousand."""
NAMES = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
"""Names that the Point Cloud Library gives to fields with other names in PLY files."""
PADDING = "_"
"""Name of bytes between fields."""
MOST_NUMBERS = 4096
"""Largest number of values in one field: descriptors of the Point Cloud Library have 33 to 1980."""


def write_pcd(
    path: Path,
    points: Iterable[NDArray[Any]],
    shape: tuple[int, int],
    comments: Sequence[str],
    place: NDArray[Any] | None = None,
) -> None:
    """Write a binary PCD file.

    Parameters
    ----------
    path : Path
    points : structured arrays of numbers
        In their order; fields red, green and blue become the field ``rgb`` that viewers know.
    shape : (rows, columns)
        Of the frame whose pixels the points are; one row for others.
    comments : sequence of str
        Lines of the header, ASCII.
    place : (4, 4) array, optional
        Where the camera is in the coordinates of the points, mm; by default they are its own.
    """
    parts = map(_packed, points)
    first = next(parts)
    fields = [first.dtype[name] for name in first.dtype.names or ()]
    rows, columns = shape
    header = [
        *(f"# {line}" for line in comments),
        "VERSION 0.7",
        f"FIELDS {' '.join(first.dtype.names or ())}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in fields)}",
        f"TYPE {' '.join(KINDS[kind.kind] for kind in fields)}",
        f"COUNT {' '.join('1' for _ in fields)}",
        f"WIDTH {columns}",
        f"HEIGHT {rows}",
        f"VIEWPOINT {_viewpoint(place)}",
        f"POINTS {rows * columns}",
        "DATA binary",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        for part in chain([first], parts):
            file.write(part.data.cast("B"))


def _viewpoint(place: NDArray[Any] | None) -> str:
    """Place and turn of the camera as the format has them: x, y, z, and a quaternion, w first."""
    if place is None:
        return "0 0 0 1 0 0 0"
    turn = scipy.spatial.transform.Rotation.from_matrix(place[:3, :3]).as_quat(scalar_first=True)
    return " ".join(f"{value:.9g}" for value in (*place[:3, 3], *turn))


def _packed(points: NDArray[Any]) -> NDArray[Any]:
    """The points by the names of PCD, with their colour in one number, 0x00RRGGBB."""
    names = points.dtype.names or ()
    # The places of an organised cloud are those of its pixels.
    plain = [name for name in names if name not in (*COLOURS, "row", "column")]
    fields = [(NAMES.get(name, name), points.dtype[name].str) for name in plain]
    coloured = "red" in names
    packed = np.empty(points.shape, dtype=[*fields, *([("rgb", "<u4")] if coloured else [])])
    for name in plain:
        packed[NAMES.get(name, name)] = points[name]
    if coloured:
        red, green, blue = (points[name].astype(np.uint32) for name in COLOURS)
        packed["rgb"] = red << 16 | green << 8 | blue
    return packed


class PcdPoints(NamedTuple):
    """What a PCD file holds."""

    table: NDArray[Any]
    """(n,), by the names that PLY files give to the fields."""
    comments: list[str]
    shape: tuple[int, int] | None
    """Rows and columns of an organised cloud; None for another one."""


def read_pcd(path: Path) -> PcdPoints:
    """The points of a PCD file: text, binary or compressed.

    Raises
    ------
    FileProblem for a damaged file.
    """
    content = read_content(path, "a PCD file")
    with parsing(path, "a PCD file"):
        place = content.find(b"\n" + DATA, 0, HEADER_LIMIT)
        start = content.find(b"\n", place + 1) + 1
        if place < 0 or not start:
            raise FileProblem("expected points as PCD, got something else")
        lines = content[:place].decode("ascii", "replace").splitlines()
        words = dict(line.split(maxsplit=1) for line in lines if line[:1].isalpha())
        fields = _fields(words)
        count, columns, rows = (int(words[name]) for name in ("POINTS", "WIDTH", "HEIGHT"))
        if not 0 <= count <= len(content) * MOST_NUMBERS or rows * columns != count or rows < 0:
            raise FileProblem(f"expected {told(rows)} × {told(columns)} points, got {told(count)}")
        check_bytes(float(count) * np.dtype(fields).itemsize, "points")
        form = content[place + 1 + len(DATA) : start].strip().decode("ascii", "replace")
        table = _table(content[start:], form, fields, count)
        comments = [line[2:] for line in lines if line.startswith("# ")]
        return PcdPoints(_unpacked(table), comments, (rows, columns) if rows > 1 else None)


def _fields(words: Mapping[str, str]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Names, types and shapes of the fields; those of padding have names of their own."""
    plain = {pcd: ply for ply, pcd in NAMES.items()}
    kinds = {pcd: numpy for numpy, pcd in KINDS.items()}
    names, sizes, letters = (words[name].split() for name in ("FIELDS", "SIZE", "TYPE"))
    counts = [int(n) for n in words.get("COUNT", "1 " * len(names)).split()]
    if any(not 0 < n <= MOST_NUMBERS for n in counts):
        raise FileProblem(f"expected 1 to {MOST_NUMBERS} numbers in each field, got others")
    return [
        (
            f"{PADDING}{k}" if name == PADDING else plain.get(name, name),
            f"<{kinds[kind]}{int(size)}",
            () if many == 1 else (many,),
        )
        for k, (name, size, kind, many) in enumerate(
            zip(names, sizes, letters, counts, strict=True)
        )
    ]


def _table(body: bytes, form: str, fields: list[Any], count: int) -> NDArray[Any]:
    """The points, from text, from rows of binary numbers, or from compressed columns."""
    kind = np.dtype(fields)
    if form == "binary":
        return np.frombuffer(body, kind, count)
    if form == "ascii":
        numbers = [name for name, _, shape in fields for _ in range(int(np.prod(shape, dtype=int)))]
        rows = np.loadtxt(body.decode("ascii").splitlines(), np.float64, max_rows=count, ndmin=2)
        if rows.shape != (count, len(numbers)):
            raise FileProblem(f"expected {count} × {len(numbers)} numbers, got {rows.shape}")
        table = np.empty(count, kind)
        for name in kind.names or ():
            found = rows[:, [k for k, one in enumerate(numbers) if one == name]]
            table[name] = found.reshape(table[name].shape)
        return table
    if form != "binary_compressed":
        raise FileProblem(f"expected DATA ascii, binary or binary_compressed, got {told(form)}")
    packed, size = (int(n) for n in np.frombuffer(body, "<u4", 2))
    if size != count * kind.itemsize or packed > len(body) - 8:
        raise FileProblem(f"expected {count * kind.itemsize} bytes of points, got {size}")
    columns, place = decompressed(body[8 : 8 + packed], size), 0
    table = np.empty(count, kind)
    for name in kind.names or ():
        one = kind[name]
        found = np.frombuffer(columns[place : place + one.itemsize * count], one.base)
        table[name] = found.reshape(table[name].shape)
        place += one.itemsize * count
    return table


def _unpacked(packed: NDArray[Any]) -> NDArray[Any]:
    """The points with their colour in three fields, as PLY files have it, and without padding."""
    every = [n for n in packed.dtype.names or () if packed.dtype[n].shape == ()]
    word = next((name for name in ("rgb", "rgba") if name in every), None)
    names = [name for name in every if name != word and not name.startswith(PADDING)]
    fields = [(name, packed.dtype[name].str) for name in names]
    colours = () if word is None else COLOURS
    points = np.empty(packed.shape, dtype=[*fields, *((name, "u1") for name in colours)])
    for name in names:
        points[name] = packed[name]
    if word is not None:
        # Some programs store the three bytes as a number of single precision.
        stored = packed[word]
        known = np.ascontiguousarray(stored).view("<u4") if stored.itemsize == 4 else stored
        for shift, name in zip((16, 8, 0), COLOURS, strict=True):
            points[name] = known.astype(np.uint64) >> np.uint64(shift) & np.uint64(255)
    return points
