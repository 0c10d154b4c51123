"""When photographs were taken, by their EXIF time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

SUFFIXES = (".jpg", ".jpeg")
"""Images whose EXIF Pillow reads."""
EXIF_PART, ORIGINAL, SUBSECOND = 0x8769, 0x9003, 0x9291
"""Tags of the EXIF part, DateTimeOriginal and SubSecTimeOriginal (CIPA DC-008)."""


def times_of(paths: Sequence[Path]) -> list[tuple[str, float]] | None:
    """Date and time with its fraction of a second of every image, in a form that sorts; None where
    one has none, or two have the same."""
    from PIL import Image

    if any(path.suffix.lower() not in SUFFIXES for path in paths):
        return None
    found = []
    for path in paths:
        try:
            with Image.open(path) as image:
                part = image.getexif().get_ifd(EXIF_PART)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            return None  # reading the image says what is wrong with it
        when = str(part.get(ORIGINAL, "")).strip("\0 ")
        digits = str(part.get(SUBSECOND, "")).strip("\0 ")
        if not when[:4].isdigit():
            return None
        found.append((when, float(f"0.{digits}") if digits.isdecimal() else 0.0))
    return found if len(set(found)) == len(found) else None
