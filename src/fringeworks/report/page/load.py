"""Results from files, whatever kind they are."""

from __future__ import annotations

import json
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import StrPath
from fringeworks.files.coordinates import read_coordinates
from fringeworks.files.light import read_light
from fringeworks.files.limits import existing_file, is_folder, parsing, read_content
from fringeworks.files.points import read_cloud, read_points
from fringeworks.files.rig import OPENCV_SUFFIXES, read_rig
from fringeworks.files.setup import read_setup
from fringeworks.files.surfaces import read_surface
from fringeworks.files.wrapped import read_phase
from fringeworks.types import FileProblem

READERS: dict[str, Callable[[Path], Any]] = {
    ".ply": read_points,
    ".xyz": read_points,
    ".tif": read_surface,
    ".tiff": read_surface,
    ".x3p": read_surface,
    ".gsf": read_surface,
    **dict.fromkeys(OPENCV_SUFFIXES, read_rig),
}
"""Readers by suffix, where the suffix tells what a file holds."""
ARCHIVES: dict[str, Callable[[Path], Any]] = {
    "xyz_mm": read_cloud,
    "x_coordinate_px": read_coordinates,
    "y_coordinate_px": read_coordinates,
    "phase_rad": read_phase,
    "indirect_sigma": read_light,
    "values": read_surface,
}
"""Readers by the name of an array that an archive holds."""


def load_result(path: StrPath) -> Any:
    """Read a result of fringeworks.

    Parameters
    ----------
    path : path
        Points (``.ply``, ``.xyz``, ``.npz``), heights (``.tif``, ``.npz``, ``.x3p``, ``.gsf``),
        coordinates, a phase or separated light (``.npz``), a rig (``.toml``, ``.xml``, ``.yml``), a
        set-up (``.toml``), or the numerical results that a command wrote with ``--json``.

    Returns
    -------
    Points, PointCloud, HeightMap, Decoded, WrappedPhase, LightSeparation, Rig, StoredSetup, or a
    dictionary.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds no result.
    """
    if is_folder(Path(path)):
        raise FileProblem(
            f"{path}: expected a result, got a folder; measure or reconstruct a capture first"
        )
    path = existing_file(path, "a result")
    suffix = path.suffix.lower()
    if suffix in READERS:
        return READERS[suffix](path)
    if suffix == ".npz":
        return _archive(path)
    if suffix == ".toml":
        return _description(path)
    if suffix == ".json":
        return _figures(path)
    known = ", ".join([*READERS, ".npz", ".toml", ".json"])
    raise FileProblem(f"{path}: expected one of {known}, got {suffix or 'no suffix'}")


def _archive(path: Path) -> Any:
    with parsing(path, "a result (.npz)"), zipfile.ZipFile(path) as archive:
        names = {name.removesuffix(".npy") for name in archive.namelist()}
    for name, reader in ARCHIVES.items():
        if name in names:
            return reader(path)
    raise FileProblem(
        f"{path}: expected points, heights, coordinates, a phase or separated light, got arrays "
        f"named {', '.join(sorted(names)[:8]) or 'nothing'}"
    )


def _description(path: Path) -> Any:
    with parsing(path, "a rig or set-up file"):
        content = tomllib.loads(read_content(path, "a rig or set-up file").decode())
    kind = content.get("kind", "setup")
    if kind not in ("rig", "setup"):
        raise FileProblem(f"{path}: expected a rig or a set-up, got a file of the kind {kind!r}")
    return read_rig(path) if kind == "rig" else read_setup(path)


def _figures(path: Path) -> dict[str, Any]:
    with parsing(path, "numerical results (JSON)"):
        content = json.loads(read_content(path, "numerical results (JSON)"))
        # Half a surrogate pair is no letter, and no page can hold it.
        json.dumps(content, ensure_ascii=False).encode("utf-8")
        if not isinstance(content, dict):
            raise FileProblem("expected the numerical results of a command, got another JSON value")
        return content
