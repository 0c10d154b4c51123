"""Decodes a video and writes its frames in grey to standard output; run by ``video``.

A program of its own, with limits: decoders print, crash or take gigabytes on damaged files. It
imports nothing of the package. Exit code 2: one line on standard error says what is wrong.
"""

from __future__ import annotations

import os
import sys

MARGIN_BYTES = 4 << 30
"""Memory beyond the frames themselves: Python, OpenCV and the decoder's threads."""
CPU_SECONDS = 300
"""Processor time that decoding may take; a minute of Full HD takes about 20 s."""


def main(path: str, limit: int) -> None:
    """Write height and width as a line, and the frames as bytes."""
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MARGIN_BYTES + limit, MARGIN_BYTES + limit))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits on this system; the caller's time limit remains
    import cv2

    video = cv2.VideoCapture(path)
    shape, total = None, 0
    while True:
        there, frame = video.read()
        if not there:
            break
        grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        total += grey.nbytes
        if total > limit:
            raise ValueError(f"more frames than {limit / 1e9:.3g} GB hold")
        if shape is None:
            shape = grey.shape
            sys.stdout.buffer.write(f"{shape[0]} {shape[1]}\n".encode())
        if grey.shape != shape or grey.dtype.itemsize != 1:
            raise ValueError("frames of several sizes")
        sys.stdout.buffer.write(grey.tobytes())
    if shape is None:
        raise ValueError("no frame could be decoded")


def _failed(why: str) -> int:
    print(why, file=sys.stderr)
    return 2


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]))
    except Exception as error:  # OpenCV raises many kinds for a damaged file
        sys.exit(_failed(f"{error}".replace("\n", " ")))
