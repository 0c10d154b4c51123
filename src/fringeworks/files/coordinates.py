"""Decoded projector coordinates on disk: one ``.npz`` with maps named by axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target
from fringeworks.files.findings import findings_as_json, findings_from_json
from fringeworks.files.limits import parsing
from fringeworks.files.npz import TEXT, read_npz, write_npz
from fringeworks.files.provenance import KEY, from_json, json_line
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    FileProblem,
    sealed,
)

MAPS = ("coordinate_px", "sigma_px", "modulation", "background", "reason")
"""Maps that every axis has."""
OPTIONAL = ("phase_rad", "modulations", "repeats_px")
"""What an axis may have besides."""
LAYOUT = {"noise": "f 2", "findings": TEXT, KEY: f"?{TEXT}"} | {
    f"{axis}_{name}": layout
    for axis, sets in (("x", "m"), ("y", "n"))
    for name, layout in {
        **dict.fromkeys(MAPS, "?f hw"),
        "reason": "?u hw",
        "periods_px": f"?f {sets}",
        "phase_rad": f"?f {sets}hw",
        "modulations": f"?f {sets}hw",
        "repeats_px": "?f",
    }.items()
}
"""Layout of a file."""


def check_coordinate_target(path: StrPath) -> None:
    """Refuse a file that ``write_coordinates`` cannot write, before anything is computed."""
    check_target(path, (".npz",))


def write_coordinates(path: StrPath, decoded: Decoded) -> Path:
    """Write decoded coordinates, whole or not at all.

    Arrays ``x_coordinate_px``, ``x_sigma_px``, ``x_modulation``, ``x_background``, ``x_reason``
    and ``x_periods_px``, the same with ``y_``, for the axes there are; ``noise`` (read, gain),
    ``findings`` (JSON) and ``notes``, their text.
    """
    check_coordinate_target(path)
    noise = decoded.noise
    arrays: dict[str, Any] = {
        "noise": np.array([noise.read_counts, noise.gain]),
        "notes": np.array(decoded.notes, dtype=np.str_),
        "findings": np.array(findings_as_json(decoded.findings)),
    }
    for axis, found in decoded.maps.items():
        arrays[f"{axis}_periods_px"] = np.array(found.periods_px)
        for name in (*MAPS, *OPTIONAL):
            value = getattr(found, name)
            if value is not None:
                arrays[f"{axis}_{name}"] = value
    origin = json_line(decoded.provenance)
    if origin is not None:
        arrays[KEY] = origin
    # Measured maps hardly compress, and compressing them takes longer than decoding.
    write_npz(path, arrays, compressed=False)
    return Path(path)


def read_coordinates(path: StrPath) -> Decoded:
    """Read decoded coordinates.

    Raises
    ------
    FileProblem where there is no such file, or it holds no coordinates.
    """
    path = Path(path)
    arrays = read_npz(path, "coordinates", LAYOUT)
    with parsing(path, "coordinates"):
        read_counts, gain = (float(v) for v in arrays["noise"])
        findings = findings_from_json(str(arrays["findings"]))
        x, y = _axis(arrays, "x"), _axis(arrays, "y")
        if x is None and y is None:
            raise FileProblem("expected coordinates along x or y, got neither")
        origin = from_json(str(arrays[KEY])) if KEY in arrays else None
        return Decoded(x, y, CameraNoise(read_counts, gain), findings, provenance=origin)


def _axis(arrays: dict[str, Any], axis: Axis) -> CoordinateMap | None:
    if f"{axis}_coordinate_px" not in arrays:
        return None
    optional: dict[str, Any] = {name: arrays.get(f"{axis}_{name}") for name in OPTIONAL}
    repeats = optional.pop("repeats_px")
    return CoordinateMap(
        **{name: sealed(arrays[f"{axis}_{name}"]) for name in MAPS},
        axis=axis,
        periods_px=tuple(float(p) for p in arrays[f"{axis}_periods_px"]),
        repeats_px=None if repeats is None else float(repeats),
        **optional,
    )
