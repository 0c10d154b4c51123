"""Sets of the sample data, made as the release makes them: tests read what a user would fetch."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fringeworks.files.sample_sets import FOLDER
from tests.shared import shared


@shared
def made(name: str, base: str) -> str:
    """Make a set below a folder, at the size that the release has; the set's folder."""
    from release import sample_data as builder

    place = Path(base) / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=base) as folder:
        new = Path(folder) / name
        new.mkdir()
        builder.SETS[name](new, builder.SCALE)
        new.rename(place / name)
    return str(place / name)
