"""Image files: any usual kind becomes one grey frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from fringeworks.files.atomic import StrPath, replacing
from fringeworks.types import FileProblem, InputError

LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
"""Images that Pillow reads."""
TIFF_SUFFIXES = (".tif", ".tiff")
"""Images and stacks that tifffile reads."""


def read_frame(path: StrPath) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Read an image as one grey frame.

    Parameters
    ----------
    path : path of a PNG, JPEG, BMP or TIFF file

    Returns
    -------
    frame : (h, w) array, uint8, uint16 or float, counts as stored
        Colour becomes luminance (BT.601), float32.
    notes : tuple of str
        Each conversion in one sentence.

    Raises
    ------
    FileProblem where the file is missing, empty, truncated, of an unknown kind, holds several
    pages, or has a depth that the reader would reduce.
    """
    path = Path(path)
    if not path.is_file():
        raise FileProblem(f"{path}: expected an image file, got no such file")
    if path.stat().st_size == 0:
        raise FileProblem(f"{path}: expected an image, got an empty file")
    suffix = path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        array = read_tiff(path)
    elif suffix in IMAGE_SUFFIXES:
        array = _read_image(path)
    else:
        known = ", ".join(IMAGE_SUFFIXES + TIFF_SUFFIXES)
        raise FileProblem(f"{path}: expected an image ({known}), got {suffix or 'no suffix'}")
    return _to_grey(path, array)


def read_tiff(path: StrPath, *, on_disk: bool = False) -> NDArray[Any]:
    """The first series of a TIFF file as an array.

    Parameters
    ----------
    path : path
    on_disk : bool
        Map the file into memory instead of reading it, where it is neither compressed nor in
        pieces.

    Raises
    ------
    FileProblem for a file that cannot be read or holds no image.
    """
    try:
        if on_disk:
            try:
                return np.asarray(tifffile.memmap(path, mode="r"))
            except ValueError:  # compressed, or pages apart from each other
                pass
        array = np.asarray(tifffile.imread(path))
    except Exception as error:  # tifffile raises whatever its codecs raise
        raise FileProblem(f"{path}: expected a readable TIFF, got: {error}") from error
    if array.size == 0:
        raise FileProblem(f"{path}: expected a readable TIFF, got one without an image")
    return array


def _read_image(path: Path) -> NDArray[Any]:
    with path.open("rb") as file:
        header = file.read(26)
    if header.startswith(b"\x89PNG") and len(header) == 26 and header[24] == 16 and header[25] & 2:
        raise FileProblem(
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
        raise FileProblem(f"{path}: expected a readable image, got: {reason}") from error
    if array.dtype == np.int32:
        # Pillow returns 16-bit grey PNGs of some writers as 32-bit integers.
        if array.min() < 0 or array.max() > 65535:
            raise FileProblem(f"{path}: expected at most 16 bits per pixel, got 32")
        return array.astype(np.uint16)
    return array


def _to_grey(path: Path, array: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    if array.ndim == 2:
        return (array.astype(np.uint8) * 255 if array.dtype == bool else array), ()
    if array.ndim != 3 or array.shape[2] not in (2, 3, 4):
        raise FileProblem(f"{path}: expected one grey or colour image, got shape {array.shape}")
    if array.shape[2] in (2, 4):
        alpha = array[..., -1]
        if np.ptp(alpha):
            raise FileProblem(f"{path}: expected an opaque image, got one with transparency")
        array = array[..., :-1]
    if array.shape[2] == 1:
        return np.ascontiguousarray(array[..., 0]), ()
    first = array[..., :1]
    if np.array_equal(np.broadcast_to(first, array.shape), array):
        return np.ascontiguousarray(array[..., 0]), (
            f"{path.name}: colour image with equal channels, taken as grey",
        )
    grey = (array.astype(np.float64) @ np.array(LUMINANCE)).astype(np.float32)
    return grey, (f"{path.name}: colour image converted to luminance (BT.601)",)


def write_frame(path: StrPath, frame: NDArray[Any]) -> None:
    """Write a grey frame without loss: uint8 and uint16 as PNG or TIFF, float as TIFF.

    Raises
    ------
    InputError for a suffix that cannot hold the frame; FileProblem where it cannot be written.
    """
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
