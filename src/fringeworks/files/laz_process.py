"""Decompresses the points of a LAZ file to standard output; run by ``apart``.

A damaged file may make the decompressor ask for any amount of memory.
"""

from __future__ import annotations

import sys


def main(path: str, packing: str, start: str, size: str) -> None:
    """Write the points as they lie in a LAS file."""
    import lazrs

    points = bytearray(int(size))
    with open(path, "rb") as file:
        file.seek(int(start))
        if points:
            lazrs.LasZipDecompressor(file, bytes.fromhex(packing)).decompress_many(points)
    sys.stdout.buffer.write(points)
