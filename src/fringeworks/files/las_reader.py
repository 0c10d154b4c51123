"""Points of LAS and LAZ files (ASPRS, versions 1.0 to 1.4), read here: LAS without a package."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.apart import read_apart
from fringeworks.files.las import EXTRA, METRE, RECORD, USER, need_laspy
from fringeworks.files.limits import check_bytes, existing_file, parsing, read_content
from fringeworks.files.point_table import COLOURS, LENGTHS, NORMAL_AXES, fields_of
from fringeworks.files.provenance import from_json
from fringeworks.types import FileProblem, Provenance

MAGIC = b"LASF"
"""First bytes of a file."""
COMPRESSED = 0x80
"""Bit of the number of the record format that compressed files have."""
NUMBER = 0x3F
"""Bits of that number without those of compression."""
SIZES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Bytes of a point by the number of the record format."""
RED = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
"""Where the colour of a point begins, by the number of the record format."""
INTENSITY = 12
"""Where the intensity of a point is."""
RECORD_HEADER = 54
"""Bytes of the header of a record with variable length."""
LAS_SPEC, EXTRA_RECORD, EXTRA_BYTES = "LASF_Spec", 4, 192
"""Name, number and length of the descriptions of extra dimensions."""
LASZIP, LASZIP_RECORD = "laszip encoded", 22204
"""Name and number of the record that describes the compression."""
MOST_LASZIP_BYTES = 1000
"""Largest length of that record; real ones have some 50."""
TYPES = ("", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")
"""Types of extra dimensions by their numbers; 0 is a number of bytes without a meaning."""
SCALED, SHIFTED = 8, 16
"""Options of extra dimensions that have a scale and an offset."""
CPU_SECONDS = 120
"""Processor time that decompression may take; 10 million points take about 5 s."""


class LasPoints(NamedTuple):
    """What a LAS file holds."""

    table: NDArray[Any]
    """(n,), lengths in mm."""
    provenance: Provenance | None


class _Header(NamedTuple):
    """What the beginning of a file says."""

    form: int
    """Number of the record format."""
    packed: bool
    size: int
    """Bytes of a point."""
    points: int
    """Number of points."""
    start: int
    """Where the points begin."""
    scales: NDArray[np.float64]
    offsets: NDArray[np.float64]
    records: dict[tuple[str, int], bytes]
    """Records with variable length, by their names and numbers."""


def read_las(path: Path) -> LasPoints:
    """The points of a LAS or LAZ file of any program, its lengths taken as metres.

    Raises
    ------
    FileProblem for a missing or damaged file; MissingPackage where LAZ lacks the packages ``laspy``
    and ``lazrs`` (the extra "export").
    """
    path = existing_file(path, "a LAS file")
    content = read_content(path, "a LAS file")
    with parsing(path, "a LAS file"):
        header = _header(content)
        check_bytes(float(header.points) * max(header.size, EXTRA_BYTES), "points")
        if header.packed:
            need_laspy(".laz")
            body = _unpacked(path, header)
        else:
            body = content[header.start : header.start + header.points * header.size]
        if len(body) != header.points * header.size:
            raise FileProblem(f"expected {header.points} points, got a file that is too short")
        if not header.points:
            raise FileProblem("expected points, got none")
        kept = header.records.get((USER, RECORD))
        origin = None if kept is None else from_json(kept.decode("ascii", "replace").rstrip("\0"))
        return LasPoints(_table(body, header), origin)


def _header(content: bytes) -> _Header:
    if content[: len(MAGIC)] != MAGIC:
        raise FileProblem("expected a LAS file, got something else")
    minor = content[25]
    header_size, start, records = struct.unpack_from("<HII", content, 94)
    number, size, count = struct.unpack_from("<BHI", content, 104)
    numbers = np.frombuffer(content, "<f8", 6, 131)
    if minor >= 4:
        (count,) = struct.unpack_from("<Q", content, 247)
    form = number & NUMBER
    if form >= len(SIZES) or size < SIZES[form] or not np.isfinite(numbers).all():
        raise FileProblem(f"expected points of the formats 0 to {len(SIZES) - 1}, got {form}")
    found = dict(_records(content, header_size, records))
    packed = bool(number & COMPRESSED)
    return _Header(form, packed, size, count, start, numbers[:3], numbers[3:], found)


def _records(content: bytes, place: int, count: int) -> Iterator[tuple[tuple[str, int], bytes]]:
    """The records with variable length, as many as there are."""
    if count * RECORD_HEADER > len(content):
        raise FileProblem(f"expected {count} records, got a file that is too short")
    for _ in range(count):
        user, number, length = struct.unpack_from("<2x16sHH", content, place)
        name = user.partition(b"\0")[0].decode("ascii", "replace")
        place += RECORD_HEADER
        yield (name, number), content[place : place + length]
        place += length


def _unpacked(path: Path, header: _Header) -> bytes:
    """The points of a compressed file, by a process that may crash."""
    packing = header.records.get((LASZIP, LASZIP_RECORD), b"")
    if not 0 < len(packing) <= MOST_LASZIP_BYTES:
        raise FileProblem("expected a record of the compression, got none")
    size = header.points * header.size
    given = [str(path), packing.hex(), str(header.start), str(size)]
    return read_apart("laz_process.py", given, size, CPU_SECONDS, "a readable LAZ file")


def _table(body: bytes, header: _Header) -> NDArray[Any]:
    """The points as a table."""
    fields: dict[str, tuple[str, int]] = {name: ("<i4", 4 * k) for k, name in enumerate("xyz")}
    fields["brightness"] = ("<u2", INTENSITY)
    if header.form in RED:
        del fields["brightness"]
        fields |= {name: ("<u2", RED[header.form] + 2 * k) for k, name in enumerate(COLOURS)}
    extra = {d.name: d for d in _dimensions(header) if d.name in (*EXTRA, *NORMAL_AXES)}
    fields |= {name: (one.kind, one.place) for name, one in extra.items()}
    form: Any = {
        "names": list(fields),
        "formats": [kind for kind, _ in fields.values()],
        "offsets": [place for _, place in fields.values()],
        "itemsize": header.size,
    }
    raw: NDArray[Any] = np.frombuffer(body, np.dtype(form))
    if "brightness" in fields and not raw["brightness"].any():
        del fields["brightness"]  # every record has an intensity; 0 where a program knows none
    kinds = [(name, "u2" if name in (*COLOURS, "brightness") else "f8") for name in fields]
    table = np.empty(len(raw), kinds)
    for name in fields_of(table):
        table[name] = raw[name]
        if name in extra:
            table[name] = table[name] * extra[name].scale + extra[name].offset
        if name in "xyz":
            axis = "xyz".index(name)
            table[name] = table[name] * header.scales[axis] + header.offsets[axis]
        if name in LENGTHS:
            table[name] /= METRE
    return table


class _Dimension(NamedTuple):
    """An extra dimension of the points."""

    name: str
    kind: str
    place: int
    scale: float
    offset: float


def _dimensions(header: _Header) -> Iterator[_Dimension]:
    """The extra dimensions whose places are known."""
    described = header.records.get((LAS_SPEC, EXTRA_RECORD), b"")
    place = SIZES[header.form]
    for start in range(0, len(described) - EXTRA_BYTES + 1, EXTRA_BYTES):
        number, options, name = struct.unpack_from("<2xBB32s", described, start)
        if number >= len(TYPES):
            return
        kind = TYPES[number]
        length = np.dtype(kind).itemsize if kind else options
        if place + length > header.size:
            return
        scale, offset = (struct.unpack_from("<d", described, start + k)[0] for k in (112, 136))
        if kind:
            yield _Dimension(
                name.partition(b"\0")[0].decode("ascii", "replace"),
                kind,
                place,
                scale if options & SCALED else 1.0,
                offset if options & SHIFTED else 0.0,
            )
        place += length
