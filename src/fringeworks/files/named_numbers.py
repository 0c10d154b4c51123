"""Numbers by name, from files of other programs: OpenCV's YAML and XML, JSON, text of MATLAB."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.formats import OPENCV_SUFFIXES
from fringeworks.files.limits import MAX_DESCRIPTION_BYTES, existing_file, read_content, text_of
from fringeworks.types import FileProblem, InputError
from fringeworks.types.packages import cv2, need_opencv

JSON_SUFFIX = ".json"
MATLAB_SUFFIXES = (".m", ".txt")
"""Text with assignments, or as MATLAB displays variables."""
SUFFIXES = (*OPENCV_SUFFIXES, JSON_SUFFIX, *MATLAB_SUFFIXES)
"""Suffixes of the files that are read here."""
MAX_NESTING = 8
"""Largest depth of tables and lists. Files of rigs have two or three."""
MAX_NUMBERS = 100_000
"""Largest number of numbers that are kept of a file: those of a rig are some hundred, and images or
corners beside them are left."""
MAP_HEAD_BYTES = 4 * MAX_DESCRIPTION_BYTES
"""Bytes of a large file that are searched for maps, which may follow matrices."""
LEAST_MAP_PX = 16
"""Fewest rows and columns of a map. Matrices of rigs have up to 14."""
MAP_SIZE = re.compile(rb"rows\W{1,12}(\d{1,6})\W[\s\S]{0,40}?cols\W{1,12}(\d{1,6})")
"""Rows and columns of a matrix as OpenCV writes it."""
MATRIX_KEYS = {"rows", "cols", "data"}
"""Keys of a matrix as OpenCV writes it."""
ARRAY_KEYS = {"sizes", "dt", "data"}
"""Keys of an array of one dimension or more than two as OpenCV 5 writes it."""
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
"""A number as MATLAB writes it."""
ASSIGNED = re.compile(
    r"(?:^|;)[ \t]*([A-Za-z][\w.]*)[ \t]*[=:][ \t]*(?:\[([^\]]*)\]|(" + NUMBER + r"))", re.MULTILINE
)
"""A name with a matrix in brackets, or with a single number."""
SHOWN = re.compile(
    r"^[ \t]*([A-Za-z][\w.]*)[ \t]*=[ \t]*\n\s*(?:("
    + NUMBER
    + r")[ \t]*\*[ \t]*\n\s*)?((?:[ \t]*"
    + NUMBER
    + r"(?:[ \t]+"
    + NUMBER
    + r")*[ \t]*(?:\n|\Z)\s*)+)",
    re.MULTILINE,
)
"""A matrix as MATLAB displays it: its name, a common factor, and rows."""


def read_numbers(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read all matrices and numbers of a file by their names, nested names with dots.

    Raises
    ------
    InputError for another suffix, and content that is no such file.
    """
    path = existing_file(path, "a rig file")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"expected {', '.join(SUFFIXES)}, got {suffix or 'no suffix'}")
    refuse_maps(path)
    text = text_of(read_content(path, "a rig file", MAX_DESCRIPTION_BYTES))
    found: dict[str, NDArray[np.float64]] = {}
    total = 0
    for name, values in _of_suffix(suffix, text):
        array = _array(values)
        if array is not None and total + array.size <= MAX_NUMBERS:
            found[name] = array
            total += array.size
    return found


def refuse_maps(path: Path) -> None:
    """Refuse a file that holds rectification maps, with a value for each pixel, in place of a rig.

    Raises
    ------
    FileProblem that says what to bring instead.
    """
    if path.stat().st_size <= MAX_DESCRIPTION_BYTES:
        return
    with path.open("rb") as file:
        sizes = [(int(a), int(b)) for a, b in MAP_SIZE.findall(file.read(MAP_HEAD_BYTES))]
    for rows, columns in (size for size in sizes if min(size) >= LEAST_MAP_PX):
        raise FileProblem(
            f"expected camera matrices, got maps of {columns} × {rows} px, as "
            "initUndistortRectifyMap makes them, which hold no rig; bring a file without maps that "
            "has M1, D1, M2, D2, R and T of stereoCalibrate, or, for frames that are rectified "
            "already, P1 and P2 of stereoRectify"
        )


def _of_suffix(suffix: str, text: str) -> Iterator[tuple[str, Any]]:
    """Names and values of a text, by the kind of its file."""
    if suffix == JSON_SUFFIX:
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError("expected JSON, got something else") from error
        return _flat("", content, 0)
    if suffix in MATLAB_SUFFIXES:
        return _matlab(text)
    return _opencv(text)


def _flat(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Names and values of nested tables."""
    if not isinstance(value, dict):
        yield name, value
    elif value.keys() >= MATRIX_KEYS:
        yield name, _matrix(value["rows"], value["cols"], value["data"])
    elif value.keys() >= ARRAY_KEYS:
        yield name, value["data"]
    elif depth < MAX_NESTING:
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else str(key), inner, depth + 1)


def _matrix(rows: Any, columns: Any, data: Any) -> Any:
    """Data as rows and columns; None where they do not fit."""
    flat = _array(data)
    if flat is None or not (isinstance(rows, int) and isinstance(columns, int)):
        return None
    fits = rows > 0 and columns > 0 and rows * columns == flat.size
    return flat.reshape(rows, columns) if fits else None


def _array(values: Any) -> NDArray[np.float64] | None:
    """Numbers as an array; None for anything else."""
    if isinstance(values, (str, bool)) or values is None:
        return None
    try:
        array = np.asarray(values)
        return array.astype(np.float64) if array.dtype.kind in "iuf" else None
    except (ValueError, TypeError, OverflowError):
        return None


def _matlab(text: str) -> Iterator[tuple[str, Any]]:
    """Names and values of a text of MATLAB."""
    plain = re.sub(r"\.\.\.[^\n]*\n", " ", text.replace("\r\n", "\n"))
    plain = re.sub(r"%[^\n]*", "", plain)
    for match in SHOWN.finditer(plain):
        factor = _number(match[2]) if match[2] else 1.0
        rows = [_row(line) for line in match[3].splitlines() if line.strip()]
        yield match[1], _scaled(rows, factor)
    for match in ASSIGNED.finditer(plain):
        if match[3] is not None:
            yield match[1], _number(match[3])
        else:
            lines = [line for line in re.split(r"[;\n]", match[2]) if line.strip()]
            yield match[1], _scaled([_row(line) for line in lines], 1.0)


def _scaled(rows: list[list[float] | None], factor: float) -> Any:
    """Rows times a factor; None where they are no matrix."""
    if not rows or any(row is None or len(row) != len(rows[0] or []) for row in rows):
        return None
    return factor * np.array(rows, np.float64)


def _row(line: str) -> list[float] | None:
    """The numbers of a row; None for anything else."""
    parts = line.replace(",", " ").split()
    if not all(re.fullmatch(NUMBER, part) for part in parts):
        return None
    return [_number(part) for part in parts]


def _number(text: str) -> float:
    return float(text.lower().replace("d", "e"))


def _opencv(text: str) -> Iterator[tuple[str, Any]]:
    """Names and values of YAML or XML of OpenCV, or of plain YAML that it can read."""
    need_opencv("a rig file of OpenCV")
    if not text.lstrip().startswith(("%YAML", "<")):
        text = f"%YAML:1.0\n---\n{text.removeprefix('---')}"
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        yield from _flat("", _plain(storage.root(), 0), 0)
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        raise InputError("expected XML or YAML of OpenCV's FileStorage, got none") from error


def _plain(node: Any, depth: int) -> Any:
    """A node of OpenCV's as tables, lists and numbers."""
    if depth > MAX_NESTING:
        return None
    if node.isMap():
        return {key: _plain(node.getNode(key), depth + 1) for key in node.keys()}  # noqa: SIM118
    if node.isSeq():
        count = min(node.size(), MAX_NUMBERS)
        return [_plain(node.at(k), depth + 1) for k in range(count)]
    if node.isInt():
        return int(node.real())
    return float(node.real()) if node.isReal() else None
