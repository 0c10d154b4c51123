"""Image files: any usual kind becomes one grey frame."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.files.atomic import StrPath, replacing
from fringeworks.files.bayer_image import BayerImage
from fringeworks.files.best_channels import BEST, Sampled, best_weights, combined, sampled
from fringeworks.files.limits import (
    MAX_LENGTH_PX,
    check_frame_size,
    existing_file,
    parsing,
    read_content,
)
from fringeworks.files.mosaic import plane_of_image
from fringeworks.files.photographs import PHOTOGRAPH_SUFFIXES, RAW_SUFFIXES, read_photograph
from fringeworks.files.scene_colour import LUMINANCE, SceneColour
from fringeworks.signal.bands import row_bands
from fringeworks.types import (
    CameraNoise,
    FileProblem,
    FloatMap,
    FramesContradictPlan,
    Frozen,
    InputError,
    sealed,
)
from fringeworks.types.checks import unmasked

Result = TypeVar("Result")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm")
"""Images that are read without a further package."""
TIFF_SUFFIXES = (".tif", ".tiff")
"""Images and stacks that tifffile reads."""
PNG_LEVEL = 4
"""Level of compression of PNG frames, 0…9. Frames of cameras are written 2.3 times as fast as with
the usual 6, and are 0.5 % larger."""
CHANNELS = "rgb"
"""Letters of the channels of a colour image, in its order."""
CHANNEL_NAMES = {"red": "r", "green": "g", "blue": "b"}
"""Names of single channels, as for light of one colour."""
MAGIC = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"BM": "BMP",
    b"RIFF": "WEBP",
    b"P5": "PNM",
    b"P6": "PNM",
}
"""Names of the kinds that are read, Pillow's where it reads them, by their first bytes."""
TIFF_MAGIC = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
"""First bytes of TIFF and BigTIFF."""
WEBP_PARTS = 12
"""Place of the first part of a WebP file: each has a name of four letters and a size."""
PNM_HEAD = re.compile(rb"P[56]" + rb"(?:\s+(?:#[^\n]*\n\s*)*(\d{1,9}))" * 3 + rb"\s")
"""Head of a binary PGM or PPM: columns, rows and the largest count, with comments between."""
IHDR_SIZE = slice(16, 24)
"""Place of width and height in a PNG: its first chunk begins with them."""
SCAN = b"\xff\xda"
"""Mark before each scan of a JPEG; it occurs nowhere else in compressed data."""
MAX_SCANS = 200
"""Largest number of scans of a JPEG. Progressive ones have about ten; a few bytes of a further one
cost as much time as the whole image."""


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
    clipped: NDArray[np.uint32] | None = None
    """Pixels of a coloured image with a channel at the limit of its type, by their number."""
    channel: str = ""
    """The channel of a colour image that ``grey`` is; empty for all."""
    first_px: tuple[float, float] | None = None
    """Place of the first pixel, where ``grey`` has every second column and row of a mosaic."""

    @property
    def notes(self) -> tuple[str, ...]:
        """The conversion to grey in one sentence."""
        if self.first_px is not None:
            x, y = (f"{2} × {name} + {at:g}" for name, at in zip("xy", self.first_px, strict=True))
            return (
                f"{self.path.name}: pixels of the channel {self.channel} of a raw mosaic; pixel "
                f"x, y is that at column {x}, row {y} of the image",
            )
        if self.channel:
            return (f"{self.path.name}: channel {self.channel} of a colour image",)
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
    saturation: float | None = None
    """Largest count of the files' type, where frames were converted from it to luminance."""
    colour: FloatMap | None = None
    """The scene under even light in red, green and blue, (h, w, 3), counts; None where no weights
    were given, or no image is coloured."""
    colour_noise: tuple[CameraNoise, ...] | None = None
    """Noise of the colour's channels, where it is known."""
    first_px: tuple[float, float] | None = None
    """Place of the first pixel, where the frames have every second column and row of a mosaic."""


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
    (image,) = _read(Path(path), "")
    return image.grey, image.notes


def checked_channels(channels: str | None) -> str:
    """Channels as they were given, empty for none; ``InputError`` for other letters."""
    channels = CHANNEL_NAMES.get(channels or "", channels or "")
    if channels == BEST:
        return channels
    if set(channels) - set(CHANNELS) or len(set(channels)) < len(channels):
        raise InputError(
            "channels: expected some of r, g and b, each once, as g or rgb, or red, green or blue, "
            f"or best, got {channels!r}"
        )
    return channels


def read_frames(
    paths: Sequence[Path],
    *,
    stack: bool,
    channels: str = "",
    weights: Mapping[int, float] | None = None,
    mosaic: str = "",
    grey: bool = False,
) -> ReadFrames:
    """Read images that belong together as grey frames.

    If one image is coloured, all become luminance (BT.601), float32, also those without colour.

    Parameters
    ----------
    paths : sequence of paths
    stack : bool
        Whether they are the frames of a stack. All must have counts of one type then. A pixel with
        a channel at the limit of its type gets that limit as luminance, because the mean of clipped
        and other channels does not show that it is saturated.
    channels : str
        Channels of colour images that are a frame each, as "g" or "rgb"; "best" for the combination
        of all with the least noise; empty for luminance.
    weights : mapping, optional
        Weights of the images, by their numbers, whose mean is the scene under even light.
    mosaic : str
        Filters of raw frames, as "rggb": of the channel, only its own pixels are read.
    grey : bool
        Whether grey images are taken as they are, also where channels are named.

    Returns
    -------
    ReadFrames

    Raises
    ------
    FramesContradictPlan where a frame of a stack has another depth than the first, naming both
    files; FileProblem as ``read_frame``.
    """
    # Luminance is among the frames unless channels are named.
    if channels == BEST:
        return _least_noise(paths, weights or {})
    colours = SceneColour(weights or {}, len(paths), own_light=bool(channels))
    images = _read_all(paths, channels, colours, mosaic, grey)
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
        first_px=images[0].first_px if images else None,
        **_seen_colour(colours, () if channels else [image.grey for image in images]),
    )


def _seen_colour(colours: SceneColour, light: Sequence[NDArray[Any]]) -> dict[str, Any]:
    noise, colour = colours.noise(), colours.colour(light)
    return {"colour_noise": noise, "colour": None if colour is None else sealed(colour)}


def _least_noise(paths: Sequence[Path], even: Mapping[int, float]) -> ReadFrames:
    """Frames of colour images, by the combination of their channels with the least noise.

    Each image is read twice: for the weights, and for its frame. All of them at once would take
    several times the memory of the frames.
    """
    lossy = []

    def look(path: Path, number: int) -> Sampled:
        del number
        array, compressed = _colour_image(path, CHANNELS)
        lossy.append(compressed)
        return sampled(array)

    seen = _on_all(paths, look)
    for path, one in zip(paths, seen, strict=True):
        if one.kind != seen[0].kind or one.shape[:2] != seen[0].shape[:2]:
            raise FramesContradictPlan(
                f"{path}: expected counts as in {paths[0].name}, {seen[0].kind} "
                f"{seen[0].shape[:2]}, got {one.kind} {one.shape[:2]}"
            )
    weights = best_weights(seen)
    colours = SceneColour(even, len(paths), own_light=False, shares=weights.tolist())

    def combine(path: Path, number: int) -> NDArray[Any]:
        array, _ = _colour_image(path, CHANNELS)
        colours.add(number, array, coloured=True)
        return sealed(combined(array, weights))

    words = ", ".join(f"{w:.2f} {name}" for w, name in zip(weights, CHANNELS, strict=True))
    kind, frames = seen[0].kind, tuple(_on_all(paths, combine))
    return ReadFrames(
        frames,
        (f"frames are the combination of channels with the least noise: {words}",),
        1.0 if kind.kind in "ui" else None,
        any(lossy),
        float(np.iinfo(kind).max) if kind.kind in "ui" else None,
        **_seen_colour(colours, frames),
    )


def _as_luminance(image: _Image, *, mark_clipped: bool) -> _Image:
    """An image of a set in which at least one is coloured."""
    grey = image.grey.astype(np.float32, copy=False)
    if mark_clipped and image.clipped is not None:
        grey.reshape(-1)[image.clipped] = np.float32(np.iinfo(image.kind).max)
    return image._replace(grey=grey, coloured=True)


def _read_all(
    paths: Sequence[Path], channels: str, colours: SceneColour, mosaic: str, grey: bool
) -> list[_Image]:
    """Read images on all processors: decoding leaves the interpreter to others for a part of its
    time."""

    def read(path: Path, number: int) -> list[_Image]:
        return _read(path, channels, number, colours, mosaic, grey)

    return [image for images in _on_all(paths, read) for image in images]


def _on_all(paths: Sequence[Path], read: Callable[[Path, int], Result]) -> list[Result]:
    """What a function makes of each file and its number, on all processors."""
    # Limits on files belong to the context of the caller.
    contexts = [copy_context() for _ in paths]
    # Raw photographs take several times the memory of a frame while they are read.
    raw = any(path.suffix.lower() in RAW_SUFFIXES for path in paths)
    with ThreadPoolExecutor(1 if raw else max(1, min(len(paths), os.cpu_count() or 1))) as pool:
        return list(pool.map(lambda n: contexts[n].run(read, paths[n], n), range(len(paths))))


def _read(
    path: Path,
    channels: str,
    number: int = 0,
    colours: SceneColour | None = None,
    mosaic: str = "",
    grey: bool = False,
) -> list[_Image]:
    """The frames of an image file: one for each of the channels, or its grey one."""
    array, lossy = _image(path)
    with parsing(path, "an image"):
        if mosaic:
            return [_plane(path, array, channels, mosaic, lossy)]
        if not channels or (grey and array.ndim == 2):
            one = _to_grey(path, array, lossy)
            if colours is not None:
                colours.add(number, array, coloured=one.coloured)
            return [one]
        _check_coloured(array, channels)
        if colours is not None:
            colours.add(number, array, coloured=True)
        parts = [_channel(array, CHANNELS.index(letter)) for letter in channels]
        return [
            _Image(path, part, array.dtype, array.shape[2], False, lossy, channel=letter)
            for part, letter in zip(parts, channels, strict=True)
        ]


def _image(path: Path) -> tuple[NDArray[Any] | BayerImage, bool]:
    """The counts of an image in a type that frames have, and whether it is lossily compressed."""
    path = existing_file(path, "an image file")
    if path.stat().st_size == 0:
        raise FileProblem(f"{path}: expected an image, got an empty file")
    array, lossy = _counts_of(path)
    if isinstance(array, np.ndarray) and array.dtype == bool:
        array = array.astype(np.uint8) * np.uint8(255)
    with parsing(path, "an image"):
        if array.dtype.kind not in "uif":
            raise FileProblem(f"expected counts, got {array.dtype}")
        if isinstance(array, np.ndarray):
            array = _as_counts(array.astype(array.dtype.newbyteorder("="), copy=False))
    return array, lossy


def _colour_image(path: Path, channels: str) -> tuple[NDArray[Any] | BayerImage, bool]:
    """The counts of a colour image, and whether it is lossily compressed."""
    array, lossy = _image(path)
    with parsing(path, "an image"):
        _check_coloured(array, channels)
    return array, lossy


def _check_coloured(array: NDArray[Any] | BayerImage, channels: str) -> None:
    if array.ndim != 3 or array.shape[2] < len(CHANNELS):
        raise FileProblem(f"expected a colour image for its channels {channels}, got a grey one")


def _plane(
    path: Path, array: NDArray[Any] | BayerImage, channel: str, mosaic: str, lossy: bool
) -> _Image:
    """The pixels of one channel of a raw frame."""
    plane, first = plane_of_image(array, mosaic, channel)
    # A mean of two pixels is no whole count, as luminance is none.
    mean = plane.dtype != array.dtype
    limit = np.iinfo(array.dtype).max if array.dtype.kind in "ui" else None
    full = np.flatnonzero(plane == limit).astype(np.uint32) if mean and limit else None
    return _Image(path, plane, array.dtype, 1, mean, lossy, full, channel, first)


def _counts_of(path: Path) -> tuple[NDArray[Any] | BayerImage, bool]:
    """What an image file holds, and whether it is lossily compressed."""
    suffix = _suffix_by_content(path)
    if suffix in TIFF_SUFFIXES:
        from fringeworks.files.tiff import read_tiff  # 15 ms, for those only who read TIFF

        return read_tiff(path)
    if suffix in IMAGE_SUFFIXES:
        return _read_image(path)
    if suffix in PHOTOGRAPH_SUFFIXES:
        content = read_content(path, "a photograph")
        with parsing(path, "a readable photograph"):
            return read_photograph(content, suffix)
    known = ", ".join(IMAGE_SUFFIXES + TIFF_SUFFIXES + PHOTOGRAPH_SUFFIXES)
    raise FileProblem(f"{path}: expected an image ({known}), got {suffix or 'no suffix'}")


def _channel(array: NDArray[Any] | BayerImage, number: int) -> NDArray[Any]:
    """One channel of a colour image."""
    if isinstance(array, BayerImage):
        return array.channel(number)
    return np.ascontiguousarray(array[..., number])


def _suffix_by_content(path: Path) -> str:
    """The suffix of an image; by its content where a TIFF has another suffix, or the reverse."""
    suffix = path.suffix.lower()
    if suffix not in IMAGE_SUFFIXES + TIFF_SUFFIXES:
        return suffix
    with path.open("rb") as file:
        head = file.read(max(len(magic) for magic in (*MAGIC, *TIFF_MAGIC)))
    if suffix in TIFF_SUFFIXES:
        return ".png" if head.startswith(tuple(MAGIC)) else suffix
    return ".tif" if head.startswith(TIFF_MAGIC) else suffix


def _as_counts(array: NDArray[Any]) -> NDArray[Any]:
    """Counts of other types as a type that frames have, where this loses nothing."""
    if array.dtype == np.float16:
        return array.astype(np.float32)
    other = array.dtype.kind in "ui" and array.dtype.name not in ("uint8", "uint16")
    if other and array.size and array.min() >= 0 and array.max() <= np.iinfo(np.uint16).max:
        return array.astype(np.uint16)
    return array


def _read_image(path: Path) -> tuple[NDArray[Any], bool]:
    """The counts of an image, and whether it is lossily compressed."""
    content = read_content(path, "an image")
    with parsing(path, "a readable image"):
        array, lossy = _decoded(content)
        if array.dtype == np.int32:
            # Pillow returns 16-bit grey PNGs of some writers as 32-bit integers.
            if array.min() < 0 or array.max() > 65535:
                raise FileProblem("expected at most 16 bits per pixel, got 32")
            array = array.astype(np.uint16)
        return array, lossy


def _decoded(content: bytes) -> tuple[NDArray[Any], bool]:
    """Decode an image of a known kind; its size is known before its pixels are unpacked."""
    kind = next((name for magic, name in MAGIC.items() if content.startswith(magic)), None)
    if kind is None:
        raise FileProblem(
            "expected a readable image (PNG, JPEG, BMP, WebP, PGM or PPM), got something else"
        )
    if kind == "PNM":
        return _pnm(content), False
    if kind == "PNG" and content[24:25] == b"\x10" and content[25] & 2:
        raise FileProblem(
            "expected 8 bits per colour or a grey PNG, got 16-bit colour (its lower bits would be "
            "lost); save it as TIFF"
        )
    if kind == "JPEG" and content.count(SCAN) > MAX_SCANS:
        raise FileProblem(f"expected a JPEG of at most {MAX_SCANS} scans, got more")
    if kind == "PNG":
        grey = _grey_png(content)
        if grey is not None:
            return grey, False
    from PIL import Image

    # The class of this kind itself: Image.open would try all of some forty kinds.
    Image.preinit()
    if kind == "WEBP":
        from PIL import WebPImagePlugin  # noqa: F401  (the usual kinds do not include it)
    lossy = kind == "JPEG" or (kind == "WEBP" and _lossy_webp(content))
    with Image.OPEN[kind][0](BytesIO(content), "") as image:
        _check_size(*image.size)
        several = int(getattr(image, "n_frames", 1))
        if several > 1:
            raise FileProblem(f"expected one image, got {several} in one file")
        if image.mode in ("P", "CMYK", "YCbCr", "LAB", "HSV"):
            return np.asarray(image.convert("RGB")), lossy
        if image.mode == "1":
            return np.asarray(image.convert("L")), lossy
        return np.asarray(image), lossy


def _lossy_webp(content: bytes) -> bool:
    """Whether a WebP file is lossily compressed: its picture is a part VP8L otherwise."""
    at = WEBP_PARTS
    while at + 8 <= len(content):
        name, size = content[at : at + 4], int.from_bytes(content[at + 4 : at + 8], "little")
        if name in (b"VP8 ", b"VP8L"):
            return name == b"VP8 "
        at += 8 + size + size % 2
    return True


def _pnm(content: bytes) -> NDArray[Any]:
    """Decode a binary PGM (h, w) or PPM (h, w, 3), with counts as they are stored."""
    head = PNM_HEAD.match(content)
    if head is None:
        raise FileProblem("expected the head of a binary PGM or PPM, got something else")
    width, height, largest = (int(number) for number in head.groups())
    if not 0 < largest <= 65535:
        raise FileProblem(f"expected a largest count of 1 to 65535, got {largest}")
    _check_size(width, height)
    kind = np.dtype(">u2" if largest > 255 else np.uint8)
    channels = 1 if content.startswith(b"P5") else 3
    count = width * height * channels
    if len(content) - head.end() < count * kind.itemsize:
        raise FileProblem("expected a whole image, got a part of it")
    values = np.frombuffer(content, kind, count, head.end()).astype(kind.newbyteorder("="))
    return values.reshape((height, width) if channels == 1 else (height, width, channels))


def _grey_png(content: bytes) -> NDArray[Any] | None:
    """Decode a PNG of one channel of 8 or 16 bits, (h, w); None for other PNG.

    Frames are of this kind. The kernel takes 0.7 of Pillow's time, without the interpreter's lock.
    """
    size = content[IHDR_SIZE]
    if len(size) < 8:
        return None
    width, height = struct.unpack(">II", size)
    _check_size(width, height)
    values = _core.read_grey_png(content)
    return None if values is None else values.reshape(height, width)


def _check_size(width: int, height: int) -> None:
    check_frame_size(width, height)
    if max(width, height) > MAX_LENGTH_PX:
        raise FileProblem(f"expected at most {MAX_LENGTH_PX} px along a side, got more")


def _to_grey(path: Path, array: NDArray[Any] | BayerImage, lossy: bool) -> _Image:
    kind = array.dtype
    if isinstance(array, np.ndarray):
        if array.ndim == 2:
            return _Image(path, array, kind, 1, False, lossy)
        array = _opaque(path, array)
    channels = array.shape[2]
    # In bands: photographs of 24 MP would need several times their memory at once.
    bands = [band.rows for band in row_bands(array.shape[:2], channels * np.dtype(float).itemsize)]
    if all((part[..., :1] == part[..., 1:]).all() for part in (array[b] for b in bands)):
        return _Image(path, _channel(array, 0), kind, channels, False, lossy)
    grey = np.empty(array.shape[:2], np.float32)
    limit = np.iinfo(kind).max if kind.kind in "ui" else None
    full: list[NDArray[np.uint32]] = []
    for b in bands:
        part = array[b]
        grey[b] = part.astype(np.float64) @ np.array(LUMINANCE)
        if limit is not None:
            at_limit = np.flatnonzero((part == limit).any(axis=2)) + b.start * part.shape[1]
            full.append(at_limit.astype(np.uint32))
    clipped = np.concatenate(full) if full else np.zeros(0, np.uint32)
    return _Image(path, grey, kind, channels, True, lossy, clipped if clipped.size else None)


def _opaque(path: Path, array: Any) -> NDArray[Any]:
    """The counts of an image without its transparency, which it must not have."""
    if array.ndim != 3 or array.shape[2] not in (2, 3, 4):
        raise FileProblem(f"{path}: expected one grey or colour image, got shape {array.shape}")
    if array.shape[2] in (2, 4):
        alpha = array[..., -1]
        if np.ptp(alpha):
            raise FileProblem(f"{path}: expected an opaque image, got one with transparency")
        array = array[..., :-1]
    return np.asarray(array)


def holds_counts(frame: NDArray[Any]) -> bool:
    """Whether a frame has 8-bit or 16-bit counts, which PNG holds without loss."""
    return frame.dtype.name in ("uint8", "uint16")


def write_frame(path: StrPath, frame: NDArray[Any]) -> None:
    """Write a frame without loss: uint8 and uint16 as PNG or TIFF, float as TIFF; colour as well.

    Raises
    ------
    InputError for a suffix that cannot hold the frame; FileProblem where it cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    native = np.ascontiguousarray(unmasked(frame, "frame"), frame.dtype.newbyteorder("="))
    with replacing(path) as temporary:
        if suffix in TIFF_SUFFIXES:
            import tifffile

            colour = native.ndim == len(CHANNELS)
            tifffile.imwrite(temporary, native, photometric="rgb" if colour else "minisblack")
        elif suffix == ".png" and holds_counts(frame):
            from PIL import Image

            Image.fromarray(native).save(temporary, compress_level=PNG_LEVEL)
        else:
            raise InputError(
                f"{path}: expected .tif, or .png for 8 and 16 bit, got {suffix} for {frame.dtype}"
            )
