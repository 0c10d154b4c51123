"""MATLAB files: version 5 is read here, version 7.3 (HDF5) in a process of its own.

The parsers of scipy.io and of the HDF5 library crash or take gigabytes on damaged files. Of version
5 only plain numeric variables are needed, which is a small part of the format ("MAT-File Format",
The MathWorks, level 5).
"""

from __future__ import annotations

import io
import math
import struct
import zlib
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.apart import read_apart
from fringeworks.files.limits import (
    check_bytes,
    check_frame_size,
    existing_file,
    max_bytes,
    parsing,
    read_content,
    told,
)
from fringeworks.types import FileProblem, MissingPackage

HEADER_BYTES = 128
"""Length of the header of version 5."""
HDF5_PLACES = (0, 512, 1024, 2048)
"""Places in a file where HDF5 may begin; MATLAB writes a header of 512 bytes before it."""
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
"""First bytes of HDF5."""
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
"""NumPy's types by the code under which numbers are stored; 13 follows."""
STORED |= {13: "u8"}
MATRIX, COMPRESSED = 14, 15
"""Codes of the elements that hold variables."""
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"}
"""NumPy's types by the class of a numeric variable; those of 64 bits follow. Cells, structures and
text have other classes."""
CLASSES |= {14: "i8", 15: "u8"}
OPAQUE = 17
"""Class of objects, which have another layout."""
COMPLEX = 0x0800
"""Flag of complex numbers."""
FRAMES = "frames"
"""Variable of a stack of frames."""
HEAD_BYTES = 4096
"""Bytes of a variable that hold its class, size and name: names have at most 63 letters."""
CPU_SECONDS = 60
"""Processor time that reading an HDF5 file may take."""


class _Element(NamedTuple):
    """One element of a file: its type and where its content lies."""

    kind: int
    start: int
    size: int
    end: int
    """Where the next element begins."""


def read_mat(path: Path, names: Sequence[str], *, stack: bool = False) -> dict[str, NDArray[Any]]:
    """Real variables of a MATLAB file, version 5 to 7.3.

    Parameters
    ----------
    path : path
    names : sequence of str
        Variables; others are not read.
    stack : bool
        Whether they are (h, w, n) and not (h, w); not of version 7.3.

    Returns
    -------
    Arrays (h, w), or (h, w, n), by name.

    Raises
    ------
    FileProblem for a missing or damaged file, for variables that are missing or no real (h, w)
    array, and for those that take more memory than the limit.
    """
    path = existing_file(path, "a MATLAB file")
    with path.open("rb") as file:
        head = file.read(HDF5_PLACES[-1] + len(HDF5_MAGIC))
    if any(head.startswith(HDF5_MAGIC, place) for place in HDF5_PLACES):
        if stack:
            raise FileProblem(f"{path}: expected frames of version 5 to 7, got 7.3: save with -v7")
        return {name: _from_hdf5(path, name) for name in names}
    content = read_content(path, "a MATLAB file")
    with parsing(path, "a readable .mat"):
        found = _variables(content, names, 3 if stack else 2)
    for name in names:
        if name not in found:
            there = told(", ".join(n for n in found if n)) or "nothing"
            raise FileProblem(f"{path}: expected a variable {name}, got {there}")
    return {name: array for name, array in found.items() if array is not None}


def read_mat_frames(path: Path) -> NDArray[Any]:
    """The frames of a MATLAB file, (n, h, w), from its variable ``frames`` of shape (h, w, n).

    Raises
    ------
    FileProblem as ``read_mat``.
    """
    frames = read_mat(path, [FRAMES], stack=True)[FRAMES]
    return np.ascontiguousarray(np.moveaxis(frames, -1, 0))


def _variables(
    content: bytes, names: Sequence[str], dimensions: int
) -> dict[str, NDArray[Any] | None]:
    """The names of all variables, with the arrays of those that are asked for."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:HEADER_BYTES])
    if order is None:
        raise FileProblem("expected a readable .mat of version 5 to 7.3, got something else")
    found: dict[str, NDArray[Any] | None] = {}
    place = HEADER_BYTES
    while place + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, place)
        body = content[place + 8 : place + 8 + size]
        if len(body) < size:
            raise FileProblem("expected a readable .mat, got one that ends too early")
        # Compressed variables follow each other directly, others at multiples of eight bytes.
        place += 8 + size + (0 if kind == COMPRESSED else -size % 8)
        name, array = _variable(body, order, kind, names, dimensions)
        if name is not None and name not in found:
            found[name] = array
    return found


def _variable(
    body: bytes, order: str, kind: int, names: Sequence[str], dimensions: int
) -> tuple[str | None, NDArray[Any] | None]:
    """Name of a variable, and its values if they are asked for."""
    tagged = struct.pack(f"{order}II", kind, len(body)) + body

    def unpacked(length: int) -> bytes:
        if kind != COMPRESSED:
            return tagged[:length]
        return zlib.decompressobj().decompress(body, length)

    head = unpacked(HEAD_BYTES)
    inner, size = struct.unpack_from(f"{order}II", head)
    flags = _element(head, 8, order)
    word = struct.unpack_from(f"{order}I", head, flags.start)[0]
    if inner != MATRIX or word & 0xFF == OPAQUE:
        return None, None
    shape = _element(head, flags.end, order)
    label = _element(head, shape.end, order)
    name = head[label.start : label.start + label.size].decode("latin-1")
    if name not in names:
        return name, None
    lengths = np.frombuffer(head, f"{order}i4", shape.size // 4, shape.start).tolist()
    if word & 0xFF not in CLASSES or word & COMPLEX or len(lengths) != dimensions:
        form = "(h, w)" if dimensions == 2 else "(h, w, n)"
        raise FileProblem(f"expected {name} as a real {form} array, got shape {told(lengths)}")
    check_frame_size(lengths[1], lengths[0])
    check_bytes(size, f"a variable {name}")
    whole = unpacked(size + 8)
    values = _element(whole, label.end, order)
    stored = np.dtype(order + STORED[values.kind])
    count = math.prod(lengths)
    if min(lengths) < 0 or values.size != count * stored.itemsize:
        sizes = " × ".join(map(str, lengths))
        raise FileProblem(f"expected {sizes} values of {name}, got others")
    frame = np.frombuffer(whole, stored, count, values.start).reshape(lengths, order="F")
    return name, np.ascontiguousarray(frame, CLASSES[word & 0xFF])


def _element(data: bytes, place: int, order: str) -> _Element:
    """The element that begins at a place; short ones have their content beside their type."""
    kind, size = struct.unpack_from(f"{order}II", data, place)
    if kind >> 16:
        return _Element(kind & 0xFFFF, place + 4, kind >> 16, place + 8)
    return _Element(kind, place + 8, size, place + 8 + size + -size % 8)


def _from_hdf5(path: Path, name: str) -> NDArray[Any]:
    """A variable of version 7.3, read by a process that may crash."""
    if find_spec("h5py") is None:
        raise MissingPackage(
            f"{path}: expected the package h5py for a file of MATLAB 7.3, got none; "
            "pip install 'fringeworks[matlab]', or save with -v7 in MATLAB"
        )
    with parsing(path, "a readable .mat"):
        most = max_bytes()
        given = [str(path), name, str(most)]
        content = read_apart("hdf5_process.py", given, most, CPU_SECONDS, "a readable .mat")
        return np.asarray(np.load(io.BytesIO(content), allow_pickle=False))
