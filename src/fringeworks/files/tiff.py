"""TIFF files: their directories are walked and bounded before the library tifffile reads them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import tifffile
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.limits import check_bytes, check_frame_size, existing_file, parsing
from fringeworks.types import FileProblem

LOSSY = (6, 7, 34892)
"""Codes of lossy compression: JPEG of TIFF 6.0, JPEG, and lossy JPEG of digital negatives."""
WHITE_IS_ZERO = 0
"""Code of grey levels that count from white to black."""
SEPARATED = 5
"""Code of the colours of print: cyan, magenta, yellow and black."""
PLANES = 2
"""Code of colours that are stored one after the other."""
UNCOMPRESSED = 1
"""Code of no compression."""
DEFLATE = (8, 32946)
"""Codes of zlib's compression, whose output has no size of its own."""
MAX_PAGES = 10_000
"""Largest number of pages. Stacks have some tens; each page costs about 0.1 ms."""
MAX_TAGS = 1000
"""Largest number of entries of a directory; usual ones have 10 to 60."""
TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
"""Bytes of a value by the code of its type; types of BigTIFF follow."""
TYPE_BYTES |= {16: 8, 17: 8, 18: 8}
KINDS: dict[str, Any] = {f"is_{kind}": False for kind in tifffile.TIFF.FILE_FLAGS}
"""Private kinds of TIFF, whose descriptions would decide on shapes and on other files to open: all
are read as plain pages."""
WHOLE_BITS = (8, 16, 32, 64)
"""Depths whose samples are not packed."""


@contextmanager
def opened_tiff(path: Path) -> Iterator[tifffile.TiffFile]:
    """A TIFF file whose directories end and lie inside the file.

    Raises
    ------
    FileProblem for directories that loop, are too many, or lead out of the file.
    """
    with path.open("rb") as file:
        _walk(file, path.stat().st_size)
    with tifffile.TiffFile(path, **KINDS) as opened:
        yield opened


def read_tiff(path: StrPath, *, on_disk: bool = False) -> tuple[NDArray[Any], bool]:
    """The pages of a TIFF file that are like its first.

    Parameters
    ----------
    path : path
    on_disk : bool
        Map the file into memory instead of reading it, where it is neither compressed nor in
        pieces.

    Returns
    -------
    array : (h, w), (h, w, channels) or, of several pages, (n, h, w) and (n, h, w, channels)
    lossy : bool
        Whether the first page is compressed as JPEG.

    Raises
    ------
    FileProblem for a file that cannot be read, holds no image, or too large ones.
    """
    path = existing_file(path, "a TIFF file")
    with parsing(path, "a readable TIFF"), opened_tiff(path) as file:
        series = file.series[0]
        first = file.pages.first
        lossy = int(first.compression) in LOSSY
        check_frame_size(first.imagewidth, first.imagelength)
        if on_disk and series.dataoffset is not None:
            kind = series.dtype.newbyteorder(file.byteorder)
            mapped = np.memmap(path, kind, "r", series.dataoffset, series.shape)
            return _colour_last(mapped, first), lossy
        check_bytes(float(np.prod(series.shape, dtype=float)) * series.dtype.itemsize, "a TIFF")
        for page in series.pages:
            if page is not None:
                _check_page(file, page)
        array = _pixels(path, series)
        if int(first.photometric) == SEPARATED:
            raise FileProblem("expected grey or red, green and blue, got colours of print (CMYK)")
        array = _colour_last(array, first)
        if int(first.photometric) == WHITE_IS_ZERO and array.dtype.kind in "bu":
            array = ~array
        if array.size == 0:
            raise FileProblem("expected a readable TIFF, got one without an image")
        return array, lossy


def _pixels(path: Path, series: tifffile.TiffPageSeries) -> NDArray[Any]:
    """The pages of a series; Pillow reads compressions whose codecs tifffile does not bring."""
    try:
        return np.asarray(series.asarray())
    except ModuleNotFoundError:  # Zstandard needs a module of Python 3.14
        pass
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
    from PIL import Image, UnidentifiedImageError

    pages = []
    try:
        with Image.open(path) as image:
            for page in series.pages:
                image.seek(0 if page is None else page.index)
                pages.append(np.asarray(image).astype(series.dtype.newbyteorder("="), copy=False))
    except UnidentifiedImageError as error:
        name = getattr(series.keyframe.compression, "name", series.keyframe.compression)
        raise FileProblem(
            f"expected a compression that is read, got {name}; pip install imagecodecs, or save it "
            "without compression"
        ) from error
    return np.stack(pages) if len(pages) > 1 else pages[0]


def _colour_last(array: NDArray[Any], page: Any) -> NDArray[Any]:
    """The pixels with their colours along the last axis, also where the file has planes of them."""
    planes = int(page.planarconfig) == PLANES and page.samplesperpixel > 1
    return np.moveaxis(array, -3, -1) if planes else array


def _check_page(file: tifffile.TiffFile, page: Any) -> None:
    """Refuse a page whose pieces are missing or larger than the page."""
    size, counts, offsets = file.filehandle.size, page.databytecounts, page.dataoffsets
    if not counts or len(counts) != len(offsets):
        raise FileProblem("expected an image in whole pieces, got an incomplete one")
    if min(counts) < 1 or any(o + n > size for o, n in zip(offsets, counts, strict=True)):
        raise FileProblem("expected the whole image in the file, got a part of it")
    first = page.keyframe
    plain = int(first.compression) == UNCOMPRESSED and first.bitspersample in WHOLE_BITS
    if plain and sum(counts) < first.nbytes:
        raise FileProblem(f"expected {first.nbytes} bytes of image, got {sum(counts)}")
    if int(first.compression) in DEFLATE:
        for offset, count in zip(offsets, counts, strict=True):
            file.filehandle.seek(offset)
            # A few bytes can unpack to gigabytes: no more than the page may have is unpacked.
            unpacked = zlib.decompressobj()
            unpacked.decompress(file.filehandle.read(count), _piece_bytes(first) + 1)
            if unpacked.unconsumed_tail:
                raise FileProblem("expected pieces no larger than the image, got a larger one")


def _piece_bytes(page: Any) -> int:
    """Bytes of a strip or tile, unpacked."""
    pixels = int(np.prod(page.chunks, dtype=object))
    padding = int(page.imagelength) * int(page.samplesperpixel)
    return (pixels * int(page.bitspersample) + 7) // 8 + padding


def _walk(file: BinaryIO, size: int) -> None:
    """Follow the directories of a TIFF file to their end."""
    head = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    version = struct.unpack(f"{order}H", head[2:4])[0] if order and len(head) >= 8 else 0
    if version not in (42, 43):
        raise FileProblem("expected a readable TIFF, got something else")
    big = version == 43
    offset = struct.unpack(f"{order}{'Q' if big else 'I'}", head[8:16] if big else head[4:8])[0]
    seen: set[int] = set()
    while offset:
        if offset in seen or len(seen) >= MAX_PAGES:
            raise FileProblem(
                f"expected at most {MAX_PAGES} pages one after the other, got more or a loop"
            )
        seen.add(offset)
        offset = _directory(file, offset, size, f"{order}", big)
    if not seen:
        raise FileProblem("expected a readable TIFF, got one without an image")


def _directory(file: BinaryIO, offset: int, size: int, order: str, big: bool) -> int:
    """Check the entries of one directory; the place of the next one, 0 at the end."""
    word, entry = ("Q", "HHQ") if big else ("I", "HHI")
    count_bytes, entry_bytes, word_bytes = (8, 20, 8) if big else (2, 12, 4)
    file.seek(min(offset, size))
    head = file.read(count_bytes)
    if len(head) < count_bytes:
        raise FileProblem("expected a readable TIFF, got a directory beyond its end")
    count = struct.unpack(f"{order}{'Q' if big else 'H'}", head)[0]
    if not 0 < count <= MAX_TAGS:
        raise FileProblem(f"expected 1 to {MAX_TAGS} entries in a directory, got {count}")
    body = file.read(count * entry_bytes + word_bytes)
    if len(body) < count * entry_bytes + word_bytes:
        raise FileProblem("expected a readable TIFF, got a part of a directory")
    for k in range(count):
        _, kind, values = struct.unpack_from(order + entry, body, k * entry_bytes)
        if values * TYPE_BYTES.get(kind, 1) > size:
            raise FileProblem("expected a readable TIFF, got an entry beyond its end")
    return int(struct.unpack_from(order + word, body, count * entry_bytes)[0])
