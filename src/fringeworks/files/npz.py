"""NPZ archives: written whole, read without pickles, with their layout checked."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.findings import findings_as_dicts, findings_from_json
from fringeworks.files.limits import check_bytes, existing_file, parsing, told
from fringeworks.files.provenance import from_json, json_line
from fringeworks.types import (
    CameraNoise,
    FileProblem,
    Finding,
    Reason,
    fits_axes,
    layout_words,
    sealed,
)

ARCHIVE_SUFFIX = ".npz"
"""Suffix of an archive."""
SUFFIX = ".npy"
"""Suffix of the members of an archive."""
TEXT = "US"
"""Kinds of arrays that hold text."""
LEVEL = 1
"""Level of compression of archives, 1…9. Measured coordinates hardly compress: with NumPy's level 6
a cloud takes twice the time, and 1 % less space."""
SAMPLE_BYTES = 1 << 16
"""Bytes in the middle of an array by which its compression is chosen: twice the reach of zlib."""
REPEATING = 0.9
"""Share of the space that repeating words must not exceed to be looked for: it takes three times as
long. Coordinates and their σ keep 0.98 to 1.00, brightness of 8 bits 0.7."""
MAX_HEADER = 10_000
"""Bytes of the header of an array; those that NumPy writes have 128."""


def write_npz(path: StrPath, arrays: dict[str, Any], *, compressed: bool = True) -> None:
    """Write arrays as an ``.npz`` archive, whole or not at all."""
    with replacing(path) as temporary:
        write_members(temporary, arrays, compressed=compressed)


def write_members(path: Path, arrays: Mapping[str, Any], *, compressed: bool = True) -> None:
    """Write arrays as an ``.npz`` archive that ``numpy.load`` reads without pickles."""
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", kind, compresslevel=LEVEL) as archive:
        for name, values in arrays.items():
            array = np.asanyarray(values)
            with archive.open(f"{name}{SUFFIX}", "w", force_zip64=True) as member:
                if compressed and not _repeats(array):
                    _seek_no_repeats(member)
                if compressed or not _is_plain(array):
                    np.lib.format.write_array(member, array, allow_pickle=False)
                else:
                    _write_uncopied(member, array)


def _is_plain(array: NDArray[Any]) -> bool:
    """Whether the bytes of an array are those of its file, one after the other."""
    return array.dtype.kind in "biuf" and array.flags.c_contiguous and array.size > 0


def _write_uncopied(member: IO[bytes], array: NDArray[Any]) -> None:
    """Write what ``numpy.lib.format.write_array`` writes, without a copy of the values.

    The service writes a cloud of 1280 × 1024 px in 22 instead of 26 ms of processor time; the rest
    are the check sums of the archive and the file system.
    """
    head = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(member, head)
    member.write(array.reshape(-1).view(np.uint8).data)


def _repeats(array: NDArray[Any]) -> bool:
    """Whether words of an array repeat so often that looking for them pays, by its middle."""
    if array.dtype.kind != "f" or not array.size:
        return True
    some = max(1, SAMPLE_BYTES // array.itemsize)
    sample = array.ravel()[max(0, (array.size - some) // 2) :][:some].tobytes()
    return len(zlib.compress(sample, LEVEL)) < REPEATING * _size_plainly(sample)


def _size_plainly(content: bytes) -> int:
    how = _plainly()
    return len(how.compress(content)) + len(how.flush())


def _plainly() -> Any:
    """A compressor that goes by the frequency of bytes and by runs of one byte only."""
    how = (LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, zlib.Z_RLE)
    return zlib.compressobj(*how)


def _seek_no_repeats(member: Any) -> None:
    """Compress a member without looking for words that repeat.

    Measured floats share their exponents, and little else repeats. Looking for it takes two thirds
    of the time: a cloud of 2.3 million points takes 0.6 s instead of 1.7 s, and 1 % more space.
    """
    # zipfile has no option for it. Should the attribute have another name one day, writing is
    # slower and the file as valid.
    member._compressor = _plainly()


def read_npz(path: StrPath, kind: str, layout: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """The named arrays of an ``.npz`` archive.

    Parameters
    ----------
    path : path
    kind : str
        What the archive should hold, for messages.
    layout : mapping of names to layouts
        A layout has the kinds of the array's type (NumPy's letters) and, after a space, its axes: a
        letter for a length, the same letter for the same length in all arrays, a digit for a fixed
        length. ``"f hw"`` is a map of floats, ``"f"`` a single one, ``"f hw|hw3"`` either of two.
        With a question mark before it, the array may be missing.

    Returns
    -------
    The arrays by name. Others in the archive are not read.

    Raises
    ------
    FileProblem for a missing or damaged archive, and for arrays of other types or shapes.
    """
    path = existing_file(path, f"{kind} (.npz)")
    if path.suffix.lower() != ".npz" and not zipfile.is_zipfile(path):
        raise FileProblem(f"{path}: expected {kind} (.npz), got {path.suffix or 'no suffix'}")
    lengths: dict[str, int] = {}
    with parsing(path, f"{kind} (.npz)"), zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(SUFFIX): info for info in archive.infolist()}
        missing = [n for n, form in layout.items() if n not in members and form[:1] != "?"]
        if missing:
            got = told(", ".join(members)) or "nothing"
            raise FileProblem(f"expected {kind} with an array named {missing[0]}, got {got}")
        needed = sum(members[name].file_size for name in layout if name in members)
        check_bytes(needed, kind)
        arrays = {
            name: _member(archive, members[name], name, form.lstrip("?"), lengths)
            for name, form in layout.items()
            if name in members
        }
        for name, values in arrays.items():
            _check_values(name, values)
        return arrays


def _check_values(name: str, values: NDArray[Any]) -> None:
    """Refuse reasons that there are not, and negative standard deviations."""
    if name.endswith("reason") and (largest := values.max(initial=0)) >= len(Reason):
        raise FileProblem(f"expected {name} of 0 to {len(Reason) - 1}, got {largest}")
    if "sigma" in name and values.dtype.kind == "f" and (values < 0).any():
        raise FileProblem(f"expected {name} of 0 or more, got {np.nanmin(values):.4g}")


def _member(
    archive: zipfile.ZipFile,
    info: zipfile.ZipInfo,
    name: str,
    form: str,
    lengths: dict[str, int],
) -> NDArray[Any]:
    """One array, after its header was compared with its layout and its size."""
    with archive.open(info) as file:
        shape, fortran, dtype = _header(file)
        kinds, _, axes = form.partition(" ")
        fits = any(fits_axes(shape, option, lengths) for option in axes.split("|"))
        if dtype.kind not in kinds or not fits:
            raise FileProblem(
                f"expected {name} as {layout_words(kinds, axes)}, got {dtype} {shape}"
            )
        size = dtype.itemsize * int(np.prod(shape, dtype=object))
        if size > info.file_size:
            raise FileProblem(f"expected {name} of {size} bytes, got {info.file_size}")
        content = file.read(size)
    if len(content) != size:
        raise FileProblem(f"expected {name} of {size} bytes, got {len(content)}")
    return np.ndarray(shape, dtype, content, order="F" if fortran else "C")


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type of an array."""
    version = np.lib.format.read_magic(file)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, fortran, dtype = read(file, max_header_size=MAX_HEADER)
    if dtype.hasobject or any(length < 0 for length in shape):
        raise FileProblem(f"expected plain arrays, got {dtype} {shape}")
    return shape, fortran, dtype


@dataclass(frozen=True)
class Entry:
    """An array of an archive, and how a field of a result becomes it."""

    layout: str
    """As for ``read_npz``."""
    pack: Callable[[Any], Any] = np.asarray
    """Makes the array of the field; None leaves the array out."""
    unpack: Callable[[Any], Any] = sealed
    """Makes the field of the array."""
    fields: tuple[str, ...] = ()
    """Fields that the array holds, where it holds several; by default the one of its own name."""


def texts(values: Iterable[str]) -> NDArray[Any]:
    """Texts as an array."""
    return np.array(list(values), dtype=np.str_)


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _findings(findings: Sequence[Finding]) -> NDArray[Any]:
    return np.array(json.dumps(findings_as_dicts(findings)))


MAP, REASONS = Entry("f hw"), Entry("u hw")
"""A map of floats, and why pixels have no value."""
FLOATS = Entry("f n", np.array, _floats)
"""A few numbers."""
NUMBER = Entry("?f", lambda value: None if value is None else np.array(float(value)), float)
"""A number that may be unknown."""
NOISE = Entry(
    "f 2", lambda n: np.array([n.read_counts, n.gain]), lambda v: CameraNoise(*_floats(v))
)
"""Noise of a camera."""
FINDINGS = Entry(TEXT, _findings, lambda text: findings_from_json(str(text)))
"""Findings as JSON."""
ORIGIN = Entry(f"?{TEXT}", json_line, lambda text: from_json(str(text)))
"""The provenance as JSON."""

Thing = TypeVar("Thing")


@dataclass(frozen=True)
class Archive(Generic[Thing]):
    """How results of one type lie in an NPZ archive: its arrays by name."""

    kind: type[Thing]
    holds: str
    """What an archive holds, for messages."""
    entries: Mapping[str, Entry]

    @property
    def layout(self) -> dict[str, str]:
        """Layout of the arrays."""
        return {name: entry.layout for name, entry in self.entries.items()}

    def arrays(self, thing: Thing) -> dict[str, Any]:
        """The arrays of a result."""
        found = {
            name: entry.pack(
                [getattr(thing, field) for field in entry.fields]
                if entry.fields
                else getattr(thing, name)
            )
            for name, entry in self.entries.items()
        }
        return {name: array for name, array in found.items() if array is not None}

    def fields(self, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of a result, from its arrays."""
        fields: dict[str, Any] = {}
        for name in arrays.keys() & self.entries.keys():
            entry = self.entries[name]
            value = entry.unpack(arrays[name])
            fields |= zip(entry.fields, value, strict=True) if entry.fields else {name: value}
        return fields

    def write(self, path: StrPath, thing: Thing, **more: Any) -> Path:
        """Write a result, whole or not at all; further arrays that are not read may go with it."""
        check_target(path, (ARCHIVE_SUFFIX,))
        # Measured maps hardly compress, and compressing them takes longer than measuring.
        write_npz(path, self.arrays(thing) | more, compressed=False)
        return Path(path)

    def read(self, path: StrPath) -> Thing:
        """Read a result.

        Raises
        ------
        FileProblem where there is no such file, or it holds something else.
        """
        path = Path(path)
        arrays = read_npz(path, self.holds, self.layout)
        with parsing(path, self.holds):
            return self.kind(**self.fields(arrays))
