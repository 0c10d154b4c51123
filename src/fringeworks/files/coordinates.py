"""Decoded projector coordinates on disk: one ``.npz`` with maps named by axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import check_target, replacing
from fringeworks.types import Axis, CameraNoise, CoordinateMap, Decoded, InputError

MAPS = ("coordinate_px", "sigma_px", "modulation", "background", "reason")
OPTIONAL = ("phase_rad", "modulations", "repeats_px")


def check_coordinate_target(path: Path) -> None:
    """``files.check_target`` for the kinds that are written here."""
    check_target(path, (".npz",))


def write_coordinates(path: Path, decoded: Decoded) -> Path:
    """Write decoded coordinates, whole or not at all.

    Arrays ``x_coordinate_px``, ``x_sigma_px``, ``x_modulation``, ``x_background``, ``x_reason``
    and ``x_periods_px``, the same with ``y_``, for the axes there are; ``noise`` (read, gain) and
    ``notes``.
    """
    check_coordinate_target(path)
    noise = decoded.noise
    arrays: dict[str, Any] = {
        "noise": np.array([noise.read_counts, noise.gain]),
        "notes": np.array(decoded.notes, dtype=np.str_),
    }
    for axis, found in decoded.maps.items():
        arrays[f"{axis}_periods_px"] = np.array(found.periods_px)
        for name in (*MAPS, *OPTIONAL):
            value = getattr(found, name)
            if value is not None:
                arrays[f"{axis}_{name}"] = value
    with replacing(Path(path)) as temporary, temporary.open("wb") as file:
        # Measured maps hardly compress, and compressing them takes longer than decoding.
        np.savez(file, **arrays)
    return Path(path)


def read_coordinates(path: Path) -> Decoded:
    """Read decoded coordinates.

    Raises
    ------
    InputError where there is no such file, or it is none of these.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a file of coordinates (.npz), got no such file")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        read_counts, gain = (float(v) for v in arrays["noise"])
        notes = tuple(str(note) for note in arrays["notes"])
        x, y = _axis(arrays, "x"), _axis(arrays, "y")
    except Exception as error:  # zipfile and numpy raise many kinds for a damaged archive
        raise InputError(f"{path}: expected a file of coordinates, got: {error}") from error
    if x is None and y is None:
        raise InputError(f"{path}: expected coordinates along x or y, got neither")
    return Decoded(x, y, CameraNoise(read_counts, gain), notes)


def _axis(arrays: dict[str, Any], axis: Axis) -> CoordinateMap | None:
    if f"{axis}_coordinate_px" not in arrays:
        return None
    optional: dict[str, Any] = {name: arrays.get(f"{axis}_{name}") for name in OPTIONAL}
    repeats = optional.pop("repeats_px")
    return CoordinateMap(
        **{name: arrays[f"{axis}_{name}"] for name in MAPS},
        axis=axis,
        periods_px=tuple(float(p) for p in arrays[f"{axis}_periods_px"]),
        repeats_px=None if repeats is None else float(repeats),
        **optional,
    )
