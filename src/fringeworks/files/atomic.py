"""Files appear whole or not at all; images of any usual kind become one grey frame."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from fringeworks.types import InputError

LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
TIFF_SUFFIXES = (".tif", ".tiff")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its name when the block ends without error.

    Raises
    ------
    InputError where the folder does not exist or cannot be written to.
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.stem}-", suffix=target.suffix
        )
    except OSError as error:
        raise InputError(f"{target}: expected a writable folder, got: {error.strerror}") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except OSError as error:
        raise InputError(f"{target}: could not be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def check_target(path: Path, suffixes: Iterable[str]) -> None:
    """Refuse a result file of unknown kind or in no folder, before anything is computed for it."""
    path = Path(path)
    known = tuple(suffixes)
    if path.suffix.lower() not in known:
        raise InputError(
            f"{path}: expected {'one of ' if len(known) > 1 else ''}{', '.join(known)}, "
            f"got {path.suffix or 'no suffix'}"
        )
    if not path.parent.is_dir():
        raise InputError(f"{path}: expected a writable folder, got none at {path.parent}")


def make_folder(path: Path) -> Path:
    """Make an output folder where there is none; ``InputError`` where that is not possible."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder that can be written to, got: {error.strerror}"
        ) from error
    if not os.access(folder, os.W_OK):
        raise InputError(f"{folder}: expected a folder that can be written to, got a read-only one")
    return folder


def read_frame(path: Path) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Read an image as one grey frame.

    Parameters
    ----------
    path : Path to a PNG, JPEG, BMP or TIFF file.

    Returns
    -------
    frame : (h, w) array, uint8, uint16 or float, counts as stored
        Colour becomes luminance (BT.601), float32.
    notes : tuple of str
        What was converted, one sentence each.

    Raises
    ------
    InputError where the file is missing, empty, truncated, of an unknown kind, holds several
    pages, or a depth that the reader would cut down.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected an image file, got no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: expected an image, got an empty file")
    suffix = path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        array = _read_tiff(path)
    elif suffix in IMAGE_SUFFIXES:
        array = _read_image(path)
    else:
        known = ", ".join(IMAGE_SUFFIXES + TIFF_SUFFIXES)
        raise InputError(f"{path}: expected an image ({known}), got {suffix or 'no suffix'}")
    return _to_grey(path, array)


def _read_tiff(path: Path) -> NDArray[Any]:
    try:
        array = np.asarray(tifffile.imread(path))
    except Exception as error:  # tifffile raises whatever its codecs raise
        raise InputError(f"{path}: expected a readable TIFF, got: {error}") from error
    if array.size == 0:
        raise InputError(f"{path}: expected a readable TIFF, got one without an image")
    return array


def _read_image(path: Path) -> NDArray[Any]:
    with path.open("rb") as file:
        header = file.read(26)
    if header.startswith(b"\x89PNG") and len(header) == 26 and header[24] == 16 and header[25] & 2:
        raise InputError(
            f"{path}: expected 8 bits per colour or a grey PNG, got 16-bit colour "
            "(its lower bits would be lost); save it as TIFF"
        )
    try:
        with Image.open(path) as image:
            if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV"):
                return np.asarray(image.convert("RGB"))
            if image.mode == "1":
                return np.asarray(image.convert("L"))
            array = np.asarray(image)
    except (OSError, SyntaxError, ValueError) as error:
        reason = str(error).replace(str(path), "").strip(" '\"") or type(error).__name__
        raise InputError(f"{path}: expected a readable image, got: {reason}") from error
    if array.dtype == np.int32:
        # Pillow hands 16-bit grey PNGs of some writers out as 32-bit integers.
        if array.min() < 0 or array.max() > 65535:
            raise InputError(f"{path}: expected at most 16 bits per pixel, got 32")
        return array.astype(np.uint16)
    return array


def _to_grey(path: Path, array: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    if array.ndim == 2:
        return (array.astype(np.uint8) * 255 if array.dtype == bool else array), ()
    if array.ndim != 3 or array.shape[2] not in (2, 3, 4):
        raise InputError(f"{path}: expected one grey or colour image, got shape {array.shape}")
    if array.shape[2] in (2, 4):
        alpha = array[..., -1]
        if np.ptp(alpha):
            raise InputError(f"{path}: expected an opaque image, got one with transparency")
        array = array[..., :-1]
    if array.shape[2] == 1:
        return np.ascontiguousarray(array[..., 0]), ()
    first = array[..., :1]
    if np.array_equal(np.broadcast_to(first, array.shape), array):
        return np.ascontiguousarray(array[..., 0]), (
            f"{path.name}: colour image with equal channels, taken as grey",
        )
    grey = (array.astype(np.float64) @ np.array(LUMINANCE)).astype(np.float32)
    return grey, (f"{path.name}: colour image turned to luminance (BT.601)",)


def write_frame(path: Path, frame: NDArray[Any]) -> None:
    """Write a grey frame: uint8 and uint16 as PNG or TIFF, float as TIFF; lossless."""
    path = Path(path)
    suffix = path.suffix.lower()
    with replacing(path) as temporary:
        if suffix in TIFF_SUFFIXES:
            tifffile.imwrite(temporary, np.ascontiguousarray(frame))
        elif suffix == ".png" and frame.dtype in (np.uint8, np.uint16):
            Image.fromarray(np.ascontiguousarray(frame)).save(temporary)
        else:
            raise InputError(
                f"{path}: expected .tif, or .png for 8 and 16 bit, got {suffix} for {frame.dtype}"
            )
