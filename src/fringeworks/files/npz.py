"""NPZ archives: written whole, read without pickles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, replacing
from fringeworks.types import FileProblem


def write_npz(path: StrPath, arrays: dict[str, Any], *, compressed: bool = True) -> None:
    """Write arrays as an ``.npz`` archive, whole or not at all."""
    save = np.savez_compressed if compressed else np.savez
    with replacing(path) as temporary, temporary.open("wb") as file:
        save(file, allow_pickle=False, **arrays)


def read_npz(path: StrPath, kind: str) -> dict[str, Any]:
    """All arrays of an ``.npz`` archive.

    Parameters
    ----------
    path : path
    kind : str
        What the archive should hold, for messages.

    Raises
    ------
    FileProblem for a missing or damaged archive.
    """
    path = Path(path)
    if not path.is_file():
        raise FileProblem(f"{path}: expected {kind} (.npz), got no such file")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # zipfile and numpy raise many kinds for a damaged archive
        raise FileProblem(f"{path}: expected {kind} (.npz), got: {error}") from error
