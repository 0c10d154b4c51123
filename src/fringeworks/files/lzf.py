"""LZF, the compression of PCD files: decompression only."""

from __future__ import annotations

from fringeworks.types import FileProblem

SHORT = 32
"""First control byte that is not the length of plain bytes."""
LONG = 7
"""Length of a repetition that another byte adds to."""


def decompressed(content: bytes, size: int) -> bytes:
    """Content that M. Lehmann's library LZF has compressed.

    Parameters
    ----------
    content : bytes
    size : int
        Length of what comes out.

    Raises
    ------
    FileProblem where another length comes out; IndexError for content that ends too early.
    """
    out = bytearray()
    place, end = 0, len(content)
    while place < end and len(out) < size:
        control = content[place]
        place += 1
        if control < SHORT:
            out += content[place : place + control + 1]
            place += control + 1
            continue
        length = control >> 5
        if length == LONG:
            length += content[place]
            place += 1
        start = len(out) - ((control & 31) << 8) - content[place] - 1
        place += 1
        length += 2
        if start < 0:
            raise FileProblem("expected compressed points, got a damaged part")
        piece = out[start : start + length]
        while len(piece) < length:  # the repetition overlaps what it repeats
            piece += piece[: length - len(piece)]
        out += piece
    if len(out) != size:
        raise FileProblem(f"expected {size} bytes of compressed points, got {len(out)}")
    return bytes(out)
