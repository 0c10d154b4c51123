"""Decompresses the points of a LAZ file to standard output; run by ``las_reader``.

A program of its own, with limits: a damaged file may make the decompressor ask for any amount of
memory. It imports nothing of the package. Exit code 2: one line on standard error says what is
wrong.
"""

from __future__ import annotations

import sys

MARGIN_BYTES = 2 << 30
"""Memory beyond the points themselves: Python, NumPy and the decompressor."""
CPU_SECONDS = 120
"""Processor time that reading may take; 10 million points take about 5 s."""


def main(path: str, packing: bytes, start: int, size: int) -> None:
    """Write the points as they lie in a LAS file."""
    try:
        import resource

        memory = MARGIN_BYTES + 3 * size
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits on this system; the caller's time limit remains
    import lazrs

    points = bytearray(size)
    with open(path, "rb") as file:
        file.seek(start)
        if size:
            lazrs.LasZipDecompressor(file, packing).decompress_many(points)
    sys.stdout.buffer.write(points)


def _failed(why: str) -> int:
    print(why, file=sys.stderr)
    return 2


if __name__ == "__main__":
    try:
        main(sys.argv[1], bytes.fromhex(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
    except BaseException as error:  # a panic of the decompressor is none of the usual exceptions
        sys.exit(_failed(f"{error}".replace("\n", " ")))
