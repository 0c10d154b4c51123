"""Small pictures of captures, for lists."""

from __future__ import annotations

from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from fringeworks.files.exposures import is_exposures
from fringeworks.files.images import read_frame
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.types import FileProblem

WIDTH_PX, HEIGHT_PX = 144, 108
"""Size of a thumbnail: twice that in the page, for screens with fine pixels."""
MOST_KEPT = 1000
"""Thumbnails that are kept in memory, about 4 kB each."""
QUALITY = 75
"""Of the JPEG file, as is usual for small pictures."""
IMAGES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".webp")
"""Suffixes of frames that a thumbnail is made of."""


def thumbnail(capture: Path) -> bytes:
    """Return a small JPEG of the first frame of a capture.

    Raises
    ------
    FileProblem where the folder is no capture or has no frame that can be read.
    """
    folder = capture / "0" if is_exposures(capture) else capture
    if not (folder / CAPTURE_FILE).is_file():
        raise FileProblem(f"{capture}: expected a capture")
    frames = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGES and _is_own(p))
    if not frames:
        raise FileProblem(f"{capture}: expected frames, got none")
    return _drawn(frames[0], frames[0].stat().st_mtime_ns)


def _is_own(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


@lru_cache(maxsize=MOST_KEPT)
def _drawn(frame: Path, _: int) -> bytes:
    values = np.asarray(read_frame(frame)[0], np.float32)
    if values.ndim == 3:
        values = values.mean(axis=2)
    step = max(1, min(values.shape[0] // HEIGHT_PX, values.shape[1] // WIDTH_PX))
    small = values[::step, ::step]
    low, high = np.nanpercentile(small, (1, 99)) if np.isfinite(small).any() else (0.0, 1.0)
    grey = 255.0 * np.clip((small - low) / max(float(high - low), 1e-12), 0.0, 1.0)
    image = Image.fromarray(np.nan_to_num(grey).astype(np.uint8))
    image.thumbnail((WIDTH_PX, HEIGHT_PX))
    file = BytesIO()
    image.save(file, "JPEG", quality=QUALITY)
    return file.getvalue()
