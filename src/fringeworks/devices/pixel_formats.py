"""Pixel formats of cameras (GenICam's Pixel Format Naming Convention): bytes to grey frames."""

from __future__ import annotations

import re
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import DeviceProblem, InputError
from fringeworks.types.packages import need_opencv

Channel = Literal["luminance", "red", "green", "blue"]
"""What is made of a frame of a colour camera. Luminance has the weights of ITU-R BT.601."""
RAW = "raw"
"""Word for the counts of a mosaic as the sensor has them, without interpolation."""
NAME = re.compile(r"(Mono|Bayer(?:RG|GR|GB|BG))(8|10|12|14|16)(p|Packed)?")
"""Formats that are read: kind, bits, and how samples are packed."""
PACKED = {("10", "p"), ("12", "p"), ("10", "Packed"), ("12", "Packed")}
"""Bits and packing of the formats whose samples do not fill whole bytes."""


WORD = "channel="
"""Begins the word that names the channel, behind the words of a camera and a comma."""


def with_channel(words: str) -> tuple[str, Channel]:
    """Separate the channel of a colour camera from the words after the name of its kind.

    Parameters
    ----------
    words : str
        Which camera, and at the end ``,channel=blue``, where one is named.

    Returns
    -------
    Which camera, and the channel: luminance where none is named.

    Raises
    ------
    DeviceProblem for a channel that is none.

    Examples
    --------
    >>> with_channel("0,channel=blue")
    ('0', 'blue')
    """
    which, channel = with_channel_or_raw(words)
    if channel == "raw":
        raise DeviceProblem(
            "camera: expected genicam or gentl for channel=raw, whose pixel format says the mosaic"
        )
    return which, channel


def with_channel_or_raw(words: str) -> tuple[str, Channel | Literal["raw"]]:
    """The same for a camera that delivers raw frames too."""
    which, _, last = words.rpartition(",")
    if not last.startswith(WORD):
        return words, "luminance"
    if last == WORD + RAW:
        return which, "raw"
    for channel in get_args(Channel):
        if last == WORD + channel:
            return which, channel
    raise DeviceProblem(
        f"camera: expected {WORD} and one of {', '.join(get_args(Channel))}, got {last!r}"
    )


def full_scale(name: str) -> int:
    """Return the largest count of a pixel format, such as 4095 for Mono12p, or 255 for RGB8.

    Raises
    ------
    InputError for a format that is not read.
    """
    samples = "Mono" + name.removeprefix("RGB") if name.startswith("RGB") else name
    return int(2 ** int(_parsed(samples)[1]) - 1)


def unpacked(content: NDArray[np.uint8], shape: tuple[int, int], name: str) -> NDArray[Any]:
    """Return the samples of a frame as they came from a camera.

    Parameters
    ----------
    content : (n,) uint8 array
        Bytes of the frame; more than needed are ignored.
    shape : (rows, columns)
    name : str
        Pixel format.

    Returns
    -------
    (rows, columns) array, uint8 for 8 bits and uint16 for more; colour filters are not removed.

    Raises
    ------
    InputError for a format that is not read, and for too few bytes.

    Notes
    -----
    ``p``: samples follow each other without gaps, the lowest bit first. ``Packed`` (GigE Vision):
    two samples in three bytes, the middle byte holding the low bits of both.
    """
    _, bits, packing = _parsed(name)
    rows, columns = shape
    samples = rows * columns
    needed = samples if bits == "8" else 2 * samples
    if packing == "p":
        needed = -(-samples * int(bits) // 8)
    elif packing == "Packed":
        needed = -(-samples // 2) * 3
    if content.size < needed:
        raise InputError(
            f"{name}: expected {needed} bytes for {columns} × {rows} px, got {content.size}"
        )
    content = content[:needed]
    if bits == "8":
        return content.reshape(shape).copy()
    if not packing:
        return content.view("<u2").reshape(shape).astype(np.uint16)
    flat = _without_gaps(content, int(bits)) if packing == "p" else _of_triples(content, int(bits))
    return flat[:samples].reshape(shape)


def mosaic_of(name: str) -> str | None:
    """Return the filters of a pixel format as "rggb"; None for one without filters.

    Examples
    --------
    >>> mosaic_of("BayerGB12p")
    'gbrg'
    """
    kind, _, _ = _parsed(name)
    row = kind.removeprefix("Bayer").lower()
    # The second row has the other green beside what the first row lacks.
    return None if kind == "Mono" else row + {"rg": "gb", "gr": "bg", "gb": "rg", "bg": "gr"}[row]


def to_grey(
    raw: NDArray[Any], name: str, channel: Channel | Literal["raw"] = "luminance"
) -> NDArray[Any]:
    """Return a grey frame from the samples of a camera.

    Parameters
    ----------
    raw : (h, w) array
        From ``unpacked``.
    name : str
        Pixel format. Frames of Mono formats are returned as they are.
    channel : str
        What is made of a colour frame: luminance, red, green, blue, or raw for the samples.

    Returns
    -------
    (h, w) array of the type of ``raw``; missing colours are interpolated from the neighbours.

    Raises
    ------
    InputError for an unknown channel or format.
    """
    kind, _, _ = _parsed(name)
    if channel != RAW and channel not in get_args(Channel):
        raise InputError(f"channel: expected one of {get_args(Channel)}, got {channel!r}")
    if kind == "Mono" or channel == RAW:
        return raw
    if channel == "luminance":
        return _interpolated(raw, kind, "GRAY")
    colours = _interpolated(raw, kind, "RGB")
    return np.ascontiguousarray(colours[..., ("red", "green", "blue").index(channel)])


def to_colours(raw: NDArray[Any], name: str) -> NDArray[Any]:
    """Return a frame (h, w, 3) with red, green and blue from the samples of a colour camera.

    Raises
    ------
    DeviceProblem for a Mono format.
    """
    kind, _, _ = _parsed(name)
    if kind == "Mono":
        raise DeviceProblem(
            f"camera: expected a pixel format with colours, such as BayerRG8, got {name}"
        )
    return _interpolated(raw, kind, "RGB")


def _interpolated(raw: NDArray[Any], kind: str, wanted: str) -> NDArray[Any]:
    """The colours or the luminance of the samples behind a mosaic of filters."""
    need_opencv("the frame of a colour camera")
    import cv2

    # OpenCV names a pattern by the second and third pixel of the second row.
    code = {"RG": "BG", "GR": "GB", "GB": "GR", "BG": "RG"}[kind[-2:]]
    return np.asarray(cv2.cvtColor(raw, getattr(cv2, f"COLOR_Bayer{code}2{wanted}")))


def _parsed(name: str) -> tuple[str, str, str]:
    """Kind, bits and packing of a format."""
    match = NAME.fullmatch(name)
    if match is None or (match[3] and (match[2], match[3]) not in PACKED):
        raise InputError(
            "pixel format: expected Mono or Bayer with 8, 10, 12, 14 or 16 bits, such as Mono8, "
            f"Mono12p or BayerRG8; got {name}"
        )
    return match[1], match[2], match[3] or ""


def _without_gaps(content: NDArray[np.uint8], bits: int) -> NDArray[np.uint16]:
    """Samples that follow each other bit by bit, the lowest first."""
    # Five bytes hold four samples of 10 bits, three bytes two samples of 12.
    size, count = (5, 4) if bits == 10 else (3, 2)
    padded = np.zeros(-(-content.size // size) * size, np.uint8)
    padded[: content.size] = content
    group = padded.reshape(-1, size).astype(np.uint64)
    whole = sum(group[:, k] << np.uint64(8 * k) for k in range(size))
    mask = np.uint64(2**bits - 1)
    parts = [(whole >> np.uint64(bits * k)) & mask for k in range(count)]
    return np.stack(parts, axis=1).ravel().astype(np.uint16)


def _of_triples(content: NDArray[np.uint8], bits: int) -> NDArray[np.uint16]:
    """Two samples in three bytes, with their low bits in the middle one."""
    group = content.reshape(-1, 3).astype(np.uint16)
    low = bits - 8
    mask = np.uint16(2**low - 1)
    first = (group[:, 0] << low) | (group[:, 1] & mask)
    second = (group[:, 2] << low) | ((group[:, 1] >> 4) & mask)
    return np.stack((first, second), axis=1).ravel()
