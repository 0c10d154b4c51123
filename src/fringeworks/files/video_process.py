"""Decodes a video and writes its frames in grey to standard output; run by ``apart``.

Decoders print, crash or take gigabytes on damaged files.
"""

from __future__ import annotations

import os
import sys


def main(path: str, most: str) -> None:
    """Write height and width as a line, and the frames as bytes."""
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    import cv2

    limit = int(most)
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
