"""Maps of other programs: depth, phase or height in the files that people have them in."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.limits import (
    check_bytes,
    check_frame_size,
    existing_file,
    is_file,
    is_folder,
    parsing,
    told,
)
from fringeworks.files.mat import read_mat
from fringeworks.files.npz import read_npz
from fringeworks.types import FileProblem, FloatMap, InputError, positive

QUANTITIES = ("coordinate", "phase", "depth", "displacement", "height")
"""Names of the arrays in an archive of another program, one of which it has."""
SIGMA = "sigma"
"""Name of the array of standard deviations beside it."""
DEPTH_NAMES = ("depth", "depthMap", "depthMapNormalized")
"""Names of the variable in MATLAB files: that which FPP-ML-Bench's loader looks for, and those of
its files."""
MAP_SUFFIXES = (".mat", ".npy", ".npz", ".png", ".tif", ".tiff")
"""Files of maps, in the order in which they are looked for."""


def _npy(path: Path) -> FloatMap:
    with parsing(path, "a readable .npy"):
        # Mapped into memory: the sizes are checked before anything is read.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        return _checked(path, array)


def _mat(path: Path) -> FloatMap:
    problem: FileProblem | None = None
    for name in DEPTH_NAMES:
        try:
            return np.asarray(read_mat(path, (name,))[name], np.float64)
        except FileProblem as error:
            problem = problem or error
    assert problem is not None
    raise problem


def _image(path: Path) -> FloatMap:
    from fringeworks.files.images import read_frame

    return _checked(path, read_frame(path)[0])


def _npz(path: Path) -> FloatMap:
    return read_named_map(path)[0]


def _checked(path: Path, array: NDArray[Any]) -> FloatMap:
    """A map in double precision; ``FileProblem`` for anything else."""
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        raise FileProblem(f"{path}: expected a map (h, w), got {array.dtype} {array.shape}")
    check_frame_size(array.shape[1], array.shape[0])
    check_bytes(8.0 * array.size, "a map")
    return np.array(array, np.float64)


READERS: dict[str, Callable[[Path], FloatMap]] = {
    ".mat": _mat,
    ".npy": _npy,
    ".npz": _npz,
    ".png": _image,
    ".tif": _image,
    ".tiff": _image,
}
"""Readers by suffix."""


def read_map(path: StrPath, *, scale: float = 1.0) -> FloatMap:
    """Read a map of numbers that another program wrote.

    Parameters
    ----------
    path : path
        ``.npy``; ``.npz`` with an array named depth, height, phase, coordinate or displacement;
        ``.mat`` with a variable named depth, depthMap or depthMapNormalized; or an image.
    scale : float > 0
        Factor of the values, such as 1000 for metres.

    Returns
    -------
    (h, w) float64 array.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds no map.
    """
    if not positive(scale):
        raise InputError(f"scale: expected > 0, got {scale}")
    path = existing_file(path, "a map")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise FileProblem(f"{path}: expected one of {known}, got {path.suffix or 'no suffix'}")
    return reader(path) * scale


def named_map(path: Path) -> str | None:
    """Name of the map in an archive of another program; None for files of this package."""
    if path.suffix.lower() != ".npz" or not is_file(path):
        return None
    with parsing(path, "a readable .npz"), zipfile.ZipFile(path) as archive:
        names = {Path(name).stem for name in archive.namelist()}
    known = [name for name in QUANTITIES if name in names]
    return known[0] if known else None


def read_named_map(path: Path) -> tuple[FloatMap, FloatMap | None, str]:
    """Read a map, its σ (None where there is none) and its name from an archive (.npz).

    Raises
    ------
    FileProblem for a damaged archive, and for one that holds none of the names.
    """
    name = named_map(path)
    if name is None:
        raise FileProblem(f"{path}: expected an array named one of {', '.join(QUANTITIES)}")
    found = read_npz(path, "a map", {name: "fiu hw", SIGMA: "?fiu hw"})
    spread = found.get(SIGMA)
    return (
        found[name].astype(np.float64),
        None if spread is None else spread.astype(np.float64),
        name,
    )


def depth_files(folder: StrPath) -> dict[str, Path]:
    """List the maps of a folder by the stems of their names.

    Parameters
    ----------
    folder : path
        A folder of maps, or one with a folder ``depth`` in it, as FPP-ML-Bench's ``test``.

    Raises
    ------
    FileProblem for a folder that is missing or holds no maps.
    """
    path = Path(folder)
    if not is_folder(path):
        raise FileProblem(f"{path}: expected a folder of maps, got none")
    inner = path / "depth"
    place = inner if is_folder(inner) else path
    found: dict[str, Path] = {}
    for suffix in MAP_SUFFIXES:
        for file in sorted(place.glob(f"*{suffix}")):
            found.setdefault(file.stem, file)
    if not found:
        raise FileProblem(f"{told(place)}: expected maps ({', '.join(MAP_SUFFIXES)}), got none")
    return dict(sorted(found.items()))
