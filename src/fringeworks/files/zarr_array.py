"""Zarr arrays, opened for reading: an optional package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.limits import check_bytes, parsing, told
from fringeworks.types import FileProblem, MissingPackage

INSTALL = "pip install 'fringeworks[batch]'"
"""How Zarr and the other packages of batches are installed."""
ZARR_FILE = "zarr.json"
"""Description of an array or a group, format 3."""


def open_zarr_array(place: str) -> Any:
    """Open an array on disk or at an address that fsspec opens; its frames are read when asked for.

    Raises
    ------
    FileProblem where that is not possible; MissingPackage without the extra ``batch``.
    """
    try:
        import zarr
    except ModuleNotFoundError as error:
        raise MissingPackage(f"{place}: expected zarr, got none: {INSTALL}") from error
    try:
        return zarr.open(place, mode="r")
    except Exception as error:
        raise FileProblem(f"{place}: could not be opened as Zarr: {told(error)}") from error


def holds_counts(array: Any, axes: int) -> bool:
    """Whether an array has so many axes, and whole or real numbers."""
    return len(getattr(array, "shape", ())) == axes and array.dtype.kind in "uf"


def read_entry(place: str, array: Any, index: int) -> NDArray[Any]:
    """One entry along the first axis of an array on disk.

    Raises
    ------
    FileProblem for a damaged array, and for an entry, or a piece in which it is stored, that takes
    more memory than the limit.
    """
    with parsing(Path(place), "a readable array of frames"):
        pieces = getattr(array, "shards", None) or getattr(array, "chunks", None) or (1,)
        for shape in (array.shape[1:], pieces):
            needed = float(np.prod(shape, dtype=float)) * array.dtype.itemsize
            check_bytes(needed, "one entry of an array")
        return np.asarray(array[index])
