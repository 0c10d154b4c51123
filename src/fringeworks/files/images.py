"""Image files: any usual kind becomes one grey frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from fringeworks.files.atomic import StrPath, replacing
from fringeworks.types import BoolMap, FileProblem, FramesContradictPlan, Frozen, InputError, sealed

LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
"""Images that Pillow reads."""
TIFF_SUFFIXES = (".tif", ".tiff")
"""Images and stacks that tifffile reads."""
LOSSY_FORMATS = ("JPEG", "MPO")
"""Pillow's names of lossily compressed images. MPO is the JPEG of some phones and cameras."""
LOSSY_TIFF = (6, 7, 34892)
"""TIFF codes of lossy compression: JPEG of TIFF 6.0, JPEG, and lossy JPEG of digital negatives."""


class _Image(NamedTuple):
    """One image as it was read."""

    path: Path
    grey: NDArray[Any]
    """(h, w), native byte order; counts as stored, or float32 luminance of a colour image."""
    kind: np.dtype[Any]
    """Type of the counts in the file."""
    channels: int
    """1 for a grey image."""
    coloured: bool
    """Whether the channels differ somewhere."""
    lossy: bool
    """Whether the file is lossily compressed."""
    clipped: BoolMap | None = None
    """Where a channel of a coloured image is at the limit of its type, (h, w)."""

    @property
    def notes(self) -> tuple[str, ...]:
        """The conversion to grey in one sentence."""
        if self.channels == 1:
            return ()
        if self.coloured:
            return (f"{self.path.name}: colour image converted to luminance (BT.601)",)
        return (f"{self.path.name}: colour image with equal channels, taken as grey",)


@dataclass(frozen=True, eq=False, repr=False)
class ReadFrames(Frozen):
    """Images that belong together, as grey frames."""

    frames: tuple[NDArray[Any], ...]
    """(h, w) arrays, counts."""
    notes: tuple[str, ...]
    """The conversion of each image that was converted."""
    count_step: float | None
    """Smallest difference between two counts of the files, 1 for whole counts; None for floats."""
    lossy: bool
    """Whether a file is lossily compressed, such as a JPEG."""
    saturation: float | None
    """Largest count of the files' type, where frames were converted from it to luminance."""


def read_frame(path: StrPath) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Read an image as one grey frame; ``read_stack`` and ``read_pair`` convert several as one.

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
    image = _read(Path(path))
    return image.grey, image.notes


def read_frames(paths: Sequence[Path], *, stack: bool) -> ReadFrames:
    """Read images that belong together as grey frames.

    If one image is coloured, all become luminance (BT.601), float32, also those without colour.

    Parameters
    ----------
    paths : sequence of paths
    stack : bool
        Whether they are the frames of a stack. All must have counts of one type then. A pixel with
        a channel at the limit of its type gets that limit as luminance, because the mean of clipped
        and other channels does not show that it is saturated.

    Returns
    -------
    ReadFrames

    Raises
    ------
    FramesContradictPlan where a frame of a stack has another depth than the first, naming both
    files; FileProblem as ``read_frame``.
    """
    images = [_read(path) for path in paths]
    for image in images:
        if stack and image.kind != images[0].kind:
            raise FramesContradictPlan(
                f"{image.path}: expected counts of the type in {images[0].path.name}, "
                f"{images[0].kind}, got {image.kind}"
            )
    whole = all(image.kind.kind in "ui" for image in images)
    converted = any(image.coloured for image in images)
    if converted:
        images = [_as_luminance(image, mark_clipped=stack) for image in images]
    return ReadFrames(
        tuple(sealed(image.grey) for image in images),
        tuple(note for image in images for note in image.notes),
        1.0 if whole else None,
        any(image.lossy for image in images),
        float(np.iinfo(images[0].kind).max) if stack and converted and whole else None,
    )


def _as_luminance(image: _Image, *, mark_clipped: bool) -> _Image:
    """An image of a set in which at least one is coloured."""
    grey = image.grey.astype(np.float32, copy=False)
    if mark_clipped and image.clipped is not None:
        grey = np.where(image.clipped, np.float32(np.iinfo(image.kind).max), grey)
    return image._replace(grey=grey, coloured=True)


def _read(path: Path) -> _Image:
    if not path.is_file():
        raise FileProblem(f"{path}: expected an image file, got no such file")
    if path.stat().st_size == 0:
        raise FileProblem(f"{path}: expected an image, got an empty file")
    suffix = path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        array, lossy = read_tiff(path), is_lossy_tiff(path)
    elif suffix in IMAGE_SUFFIXES:
        array, lossy = _read_image(path)
    else:
        known = ", ".join(IMAGE_SUFFIXES + TIFF_SUFFIXES)
        raise FileProblem(f"{path}: expected an image ({known}), got {suffix or 'no suffix'}")
    if array.dtype == bool:
        array = array.astype(np.uint8) * np.uint8(255)
    return _to_grey(path, array.astype(array.dtype.newbyteorder("="), copy=False), lossy)


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


def is_lossy_tiff(path: StrPath) -> bool:
    """Whether the first page of a readable TIFF file is compressed as JPEG."""
    with tifffile.TiffFile(path) as file:
        return int(file.pages.first.compression) in LOSSY_TIFF


def _read_image(path: Path) -> tuple[NDArray[Any], bool]:
    """The counts of an image, and whether it is lossily compressed."""
    with path.open("rb") as file:
        header = file.read(26)
    if header.startswith(b"\x89PNG") and len(header) == 26 and header[24] == 16 and header[25] & 2:
        raise FileProblem(
            f"{path}: expected 8 bits per colour or a grey PNG, got 16-bit colour "
            "(its lower bits would be lost); save it as TIFF"
        )
    try:
        with Image.open(path) as image:
            lossy = image.format in LOSSY_FORMATS
            if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV"):
                return np.asarray(image.convert("RGB")), lossy
            if image.mode == "1":
                return np.asarray(image.convert("L")), lossy
            array = np.asarray(image)
    except (OSError, SyntaxError, ValueError) as error:
        reason = str(error).replace(str(path), "").strip(" '\"") or type(error).__name__
        raise FileProblem(f"{path}: expected a readable image, got: {reason}") from error
    if array.dtype == np.int32:
        # Pillow returns 16-bit grey PNGs of some writers as 32-bit integers.
        if array.min() < 0 or array.max() > 65535:
            raise FileProblem(f"{path}: expected at most 16 bits per pixel, got 32")
        array = array.astype(np.uint16)
    return array, lossy


def _to_grey(path: Path, array: NDArray[Any], lossy: bool) -> _Image:
    kind = array.dtype
    if array.ndim == 2:
        return _Image(path, array, kind, 1, False, lossy)
    if array.ndim != 3 or array.shape[2] not in (2, 3, 4):
        raise FileProblem(f"{path}: expected one grey or colour image, got shape {array.shape}")
    if array.shape[2] in (2, 4):
        alpha = array[..., -1]
        if np.ptp(alpha):
            raise FileProblem(f"{path}: expected an opaque image, got one with transparency")
        array = array[..., :-1]
    channels = array.shape[2]
    if np.array_equal(np.broadcast_to(array[..., :1], array.shape), array):
        return _Image(path, np.ascontiguousarray(array[..., 0]), kind, channels, False, lossy)
    grey = (array.astype(np.float64) @ np.array(LUMINANCE)).astype(np.float32)
    limit = np.iinfo(kind).max if kind.kind in "ui" else None
    clipped = None if limit is None else np.asarray((array == limit).any(axis=2))
    return _Image(path, grey, kind, channels, True, lossy, clipped)


def holds_counts(frame: NDArray[Any]) -> bool:
    """Whether a frame has 8-bit or 16-bit counts, which PNG holds without loss."""
    return frame.dtype.name in ("uint8", "uint16")


def write_frame(path: StrPath, frame: NDArray[Any]) -> None:
    """Write a grey frame without loss: uint8 and uint16 as PNG or TIFF, float as TIFF.

    Raises
    ------
    InputError for a suffix that cannot hold the frame; FileProblem where it cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    native = np.ascontiguousarray(frame, frame.dtype.newbyteorder("="))
    with replacing(path) as temporary:
        if suffix in TIFF_SUFFIXES:
            tifffile.imwrite(temporary, native)
        elif suffix == ".png" and holds_counts(frame):
            Image.fromarray(native).save(temporary)
        else:
            raise InputError(
                f"{path}: expected .tif, or .png for 8 and 16 bit, got {suffix} for {frame.dtype}"
            )
