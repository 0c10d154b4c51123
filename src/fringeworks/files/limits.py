"""What a file may cost: foreign files are checked before they are believed.

A file can declare more than it holds, lead out of its folder, or make a parser run for hours. The
readers of this room therefore bound every size before they use it, and turn whatever a parser
raises into one sentence.
"""

from __future__ import annotations

import codecs
import logging
import math
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.types import MOST_PX, FileProblem, InputError, positive

DEFAULT_MAX_GB = 2.0
"""Memory that the content of one file may take, 10⁹ bytes. A stack of 100 frames of 12 Mpx with 8
bits has 1.2 GB. Uncompressed stacks stay on disk and do not count."""
MEGABYTE = 1 << 20
"""Bytes of a MB in messages."""
MAX_DESCRIPTION_BYTES = MEGABYTE
"""Size of a description (TOML, XML, YAML), bytes. Real ones have 1 to 100 kB, the largest those of
responses. Parsers in Python take about a second for this size."""
MAX_LENGTH_PX = MOST_PX
"""Largest number of columns or rows of an image in a file."""
FLOAT_BYTES = 8
"""Bytes of a pixel of a frame that is analysed, in double precision."""
TOLD_LETTERS = 200
"""Letters of a foreign text that a message repeats: enough to recognise it."""
MESSAGE_LETTERS = 1000
"""Letters of a message: room for the labels of some tens of missing frames."""

for _name in ("tifffile", "trimesh", "PIL"):
    # Without a handler, Python prints the warnings of these packages to stderr. A program that
    # configures logging still receives them.
    logging.getLogger(_name).addHandler(logging.NullHandler())


@dataclass(frozen=True)
class _Limits:
    """How far files are trusted."""

    max_bytes: float = DEFAULT_MAX_GB * 1e9
    outside: bool = False


USUAL = _Limits()
"""Limits outside of ``file_limits``."""
_limits: ContextVar[_Limits] = ContextVar("fringeworks_file_limits", default=USUAL)


@contextmanager
def file_limits(*, max_gb: float = DEFAULT_MAX_GB, outside: bool = False) -> Iterator[None]:
    """Change how far the files that are read inside a ``with`` block are trusted.

    Parameters
    ----------
    max_gb : float > 0
        Memory that the content of one file may take, 10⁹ bytes. A frame counts with 8 bytes per
        pixel, because frames are analysed in double precision.
    outside : bool
        Whether a ``capture.toml`` may name files outside its own folder.

    Raises
    ------
    InputError for a limit that is no positive number.

    Examples
    --------
    >>> with file_limits(max_gb=16):
    ...     pass  # stack = read_stack("huge.npz")
    """
    if not (positive(max_gb)):
        raise InputError(f"max_gb: expected > 0, got {max_gb}")
    token = _limits.set(_Limits(max_gb * 1e9, outside))
    try:
        yield
    finally:
        _limits.reset(token)


def max_bytes() -> int:
    """The memory that the content of one file may take, bytes."""
    return int(_limits.get().max_bytes)


def check_bytes(needed: float, what: str) -> None:
    """Refuse content that takes more memory than the limit, before it is read."""
    limit = max_bytes()
    if not 0 <= needed <= limit:
        raise FileProblem(
            f"expected {what} of at most {limit / 1e9:.3g} GB, got {needed / 1e9:.3g} GB; raise "
            "the limit of memory if you trust the file"
        )


def check_frame_size(columns: int, rows: int) -> None:
    """Refuse a frame without pixels, and one that takes more memory than the limit."""
    if columns < 1 or rows < 1:
        raise FileProblem(f"expected an image of 1 × 1 px or more, got {columns} × {rows}")
    check_bytes(float(columns) * rows * FLOAT_BYTES, f"an image ({columns} × {rows} px)")


def existing_file(path: StrPath, expected: str) -> Path:
    """The path of a file that is there.

    Raises
    ------
    FileProblem for a missing file, and for a name that no file can have.
    """
    path = Path(path)
    if not is_file(path):
        seen = "a folder" if is_folder(path) else "no such file"
        raise FileProblem(f"{told(path)}: expected {expected}, got {seen}")
    return path


def is_file(path: Path) -> bool:
    """Whether there is such a file; False for a name that no file can have."""
    return os.path.isfile(path)


def is_folder(path: Path) -> bool:
    """Whether there is such a folder; False for a name that no folder can have."""
    return os.path.isdir(path)


def _opened(path: str, flags: int) -> int:
    """Open a file without waiting: a pipe that nobody writes to would wait for ever."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def beyond(what: str, size: int, limit: int) -> str:
    """Say that something has more bytes than a limit of whole MB, and how many MB."""
    got = math.ceil(100 * size / MEGABYTE) / 100
    return f"expected {what} of at most {limit // MEGABYTE} MB, got {got:g} MB"


def read_content(path: Path, what: str, limit: int | None = None) -> bytes:
    """The bytes of a file that is no larger than the limit.

    Parameters
    ----------
    path : path
    what : str
        For messages.
    limit : int, optional
        Bytes; that of ``file_limits`` by default.

    Raises
    ------
    FileProblem for a larger file, and where it cannot be read.
    """
    try:
        with open(path, "rb", opener=_opened) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise FileProblem(f"{told(path)}: expected a file, got something else")
            size = about.st_size
            if limit is None:
                check_bytes(size, what)
            elif size > limit:
                raise FileProblem(f"{told(path)}: {beyond(what, size, limit)}")
            return file.read(size)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        if is_folder(path):
            raise FileProblem(f"{told(path)}: expected {what}, got a folder") from error
        why = getattr(error, "strerror", None) or error
        raise FileProblem(f"{told(path)}: could not be read: {why}") from error


def text_of(content: bytes) -> str:
    """The text of a file in UTF-8, UTF-16 or UTF-32, with or without a byte order mark.

    Raises
    ------
    FileProblem for other encodings, such as the code pages of Windows.
    """
    if content.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        encoding = "utf-32"
    elif content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif content[:1] and content[1:2] == b"\x00":  # a Latin letter in two bytes
        encoding = "utf-16-le"
    elif content[:1] == b"\x00" and content[1:2]:
        encoding = "utf-16-be"
    else:
        encoding = "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise FileProblem(
            f"expected text in UTF-8, got byte 0x{content[error.start]:02x} at place {error.start},"
            " which is not UTF-8; save the file as UTF-8"
        ) from error


def inside(folder: Path, name: str) -> Path:
    """The path of a file that a description in a folder names.

    Raises
    ------
    FileProblem where it lies outside the folder, unless ``file_limits`` allows that.
    """
    path = folder / name
    try:
        leads_out = not path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:
        raise FileProblem(f"{folder}: expected the name of a file, got {told(name)}") from error
    if leads_out and not _limits.get().outside:
        raise FileProblem(
            f"{folder}: expected files inside this folder, got {told(name)}; allow files outside "
            "if you trust the description"
        )
    return path


def told(value: object, letters: int = TOLD_LETTERS) -> str:
    """A foreign text for a message: on one line, and short."""
    text = " ".join(str(value).split())
    return text if len(text) <= letters else f"{text[: letters - 1]}…"


@contextmanager
def parsing(path: Path, expected: str) -> Iterator[None]:
    """Read foreign bytes: whatever goes wrong becomes one sentence, and nothing is printed.

    Parameters
    ----------
    path : path
    expected : str
        What the file should be, for messages.

    Raises
    ------
    FileProblem in place of any other error. An ``InputError`` keeps its text, with the path before
    it; its subclasses stay what they are.
    """
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    except InputError as error:
        text = told(error, MESSAGE_LETTERS)
        if str(path) not in text and type(error) in (InputError, FileProblem):
            raise FileProblem(f"{told(path)}: {text}") from error
        if text == str(error):
            raise
        raise type(error)(text) from error
    except Exception as error:  # parsers raise whatever their libraries raise
        why = told(error).replace(str(path), "").strip(" '\":") or type(error).__name__
        raise FileProblem(f"{told(path)}: expected {expected}, got: {why}") from error
