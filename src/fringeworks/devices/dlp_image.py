"""Pictures as the DLPC900 takes them: 24 planes of one bit, compressed.

Notes
-----
DLPU018, sections "Pattern Image Header" (Table 2-109) and "Enhanced Run-Length Encoding" (Table
2-115). Bit n of a plane number lies in the last byte of a pixel for n < 8, in the middle one for
n < 16, and in the first one above: the open drivers pycrafter6500 and mcSIM, which were written
against real boards, agree on this order. The guide does not state it.
"""

from __future__ import annotations

import struct
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<4sHHI8sIBBB21s")
"""Signature, columns, rows, bytes of data, reserved, background, reserved, compression, and
reserved."""
ENHANCED = 2
"""Number of the enhanced run-length encoding in the header."""
LEAST_RUN = 4
"""Equal pixels from which on a run pays: a run costs four bytes and breaks a literal, which costs
three bytes for a pixel."""
LEAST_COPY = 2
"""Pixels equal to the line above from which on a copy pays: it costs three bytes or four."""
LONG = 128
"""Count from which on two bytes are needed."""


def encoded(words: NDArray[np.uint32]) -> bytes:
    """Return an image of 24 bit as header and compressed data.

    Parameters
    ----------
    words : (rows, columns) array of values below 2^24

    Examples
    --------
    >>> data = encoded(np.zeros((1080, 1920), np.uint32))
    >>> data[:4], len(data)
    (b'Spld', 6532)
    """
    parts = [_line(row, words[k - 1] if k else None) for k, row in enumerate(words)]
    data = b"".join(parts) + b"\0\1\0"
    data += bytes(-len(data) % 4)
    rows, columns = words.shape
    head = HEADER.pack(b"Spld", columns, rows, len(data), b"\xff" * 8, 0, 0, ENHANCED, 1, bytes(21))
    return head + data


def _count(n: int) -> bytes:
    """A count in one byte, or in two from 128 on: seven bits and a mark, then the others."""
    return bytes((n,)) if n < LONG else bytes((n & 0x7F | 0x80, n >> 7))


def _pixels(words: NDArray[np.uint32]) -> bytes:
    """Three bytes a pixel, the highest bits first."""
    return words.astype(">u4").view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()


def _line(row: NDArray[np.uint32], above: NDArray[np.uint32] | None) -> bytes:
    """One line: copies of the line above, runs of equal pixels, and literals, up to its end."""
    copied = np.zeros(row.size, bool) if above is None else _long(row == above, None, LEAST_COPY)
    repeated = _long(~copied, row, LEAST_RUN)
    kind = np.where(copied, 2, np.where(repeated, 1, 0))
    starts = (kind[1:] != kind[:-1]) | ((kind[1:] == 1) & (row[1:] != row[:-1]))
    bounds = [0, *(np.flatnonzero(starts) + 1).tolist(), row.size]
    parts = []
    for start, end in pairwise(bounds):
        if kind[start] == 2:
            parts.append(b"\0\1" + _count(end - start))
        elif kind[start] == 1 or end - start == 1:
            # A literal of one pixel would read as a copy, so it is a run of one.
            parts.append(_count(end - start) + _pixels(row[start : start + 1]))
        else:
            parts.append(b"\0" + _count(end - start) + _pixels(row[start:end]))
    return b"".join(parts) + b"\0\0"


def _long(
    chosen: NDArray[np.bool_], values: NDArray[np.uint32] | None, least: int
) -> NDArray[np.bool_]:
    """Pixels of stretches of chosen pixels with ``least`` or more, which share one value if any."""
    breaks = chosen[1:] != chosen[:-1]
    if values is not None:
        breaks |= values[1:] != values[:-1]
    bounds = np.concatenate(([0], np.flatnonzero(breaks) + 1, [chosen.size]))
    lengths = np.diff(bounds)
    return np.repeat((lengths >= least) & chosen[bounds[:-1]], lengths)
