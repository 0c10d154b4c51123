"""Coordinates, wrapped phases and separated light on disk: an NPZ archive each, or CSV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks._lazy import scipy
from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.csv_table import CSV
from fringeworks.files.limits import parsing
from fringeworks.files.npz import (
    FINDINGS,
    FLOATS,
    MAP,
    NOISE,
    NUMBER,
    ORIGIN,
    REASONS,
    Archive,
    Entry,
    read_npz,
    texts,
)
from fringeworks.files.provenance import json_line
from fringeworks.files.result_csv import read_coordinates_csv, write_coordinates_csv
from fringeworks.files.vtk import VTI, write_coordinates_as_vti
from fringeworks.pair.unwrap import Unwrapped
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.types import Axis, CoordinateMap, Decoded, FileProblem, Reason

MAT = ".mat"
"""Suffix of MATLAB's files."""
COORDINATE_SUFFIXES = (".npz", CSV, VTI, MAT)
"""Suffixes of files of coordinates."""
COORDINATE_ADVICE = (
    "coordinates are written as .npz, .csv, .vti or .mat, and become points with a rig"
)
"""What to do about another suffix."""
LIGHT = Archive(
    LightSeparation,
    "separated light",
    {
        **dict.fromkeys(("direct", "direct_sigma", "indirect", "indirect_sigma"), MAP),
        "reason": REASONS,
        "separation": Entry(
            "f 3",
            lambda values: np.array([float(v) for v in values]),
            lambda values: (float(values[0]), float(values[1]), bool(values[2])),
            ("period_px", "contrast", "has_black"),
        ),
        "findings": FINDINGS,
        "provenance": ORIGIN,
    },
)
"""Archive of separated light."""
PHASE = Archive(
    WrappedPhase,
    "a wrapped phase",
    {
        **dict.fromkeys(("phase_rad", "sigma_rad", "modulation", "background"), MAP),
        "reason": REASONS,
        "shifts_rad": FLOATS,
        "noise": NOISE,
        "findings": FINDINGS,
        "provenance": ORIGIN,
    },
)
"""Archive of a wrapped phase."""
DECODED = Archive(
    Decoded,
    "coordinates",
    {"noise": NOISE, "findings": FINDINGS, "provenance": ORIGIN},
)
"""What both axes of coordinates have in common."""


def _coordinates(sets: str) -> Archive[CoordinateMap]:
    """The archive of one axis; the letter stands for the number of its sets."""
    return Archive(
        CoordinateMap,
        "coordinates",
        {
            **dict.fromkeys(("coordinate_px", "sigma_px", "modulation", "background"), MAP),
            "reason": REASONS,
            "periods_px": replace(FLOATS, layout=f"f {sets}"),
            **dict.fromkeys(("phase_rad", "modulations"), Entry(f"f {sets}hw", lambda v: v)),
            "repeats_px": NUMBER,
        },
    )


AXES: dict[Axis, Archive[CoordinateMap]] = {"x": _coordinates("m"), "y": _coordinates("n")}
"""Maps of each axis; their names in a file begin with it."""


def write_coordinates(path: StrPath, decoded: Decoded) -> Path:
    """Write decoded coordinates, whole or not at all.

    ``.npz`` has arrays ``x_coordinate_px``, ``x_sigma_px``, ``x_modulation``, ``x_background``,
    ``x_reason`` and ``x_periods_px``, the same with ``y_``, for the axes there are; ``noise``
    (read, gain), ``findings`` (JSON) and ``notes``, their text. ``.csv`` has the same as a table
    with a row for every pixel, without the phases of the sets. ``.vti`` is a raster for ParaView.
    ``.mat`` has the arrays of ``.npz`` for MATLAB, and ``reasons``, the names of the
    reasons from 0 on.
    """
    check_target(path, COORDINATE_SUFFIXES, COORDINATE_ADVICE)
    if Path(path).suffix.lower() == CSV:
        with replacing(path) as temporary:
            write_coordinates_csv(temporary, decoded)
        return Path(path)
    if Path(path).suffix.lower() == VTI:
        with replacing(path) as temporary:
            write_coordinates_as_vti(temporary, decoded)
        return Path(path)
    if Path(path).suffix.lower() == MAT:
        with replacing(path) as temporary:
            _write_mat(temporary, decoded)
        return Path(path)
    arrays: dict[str, Any] = {"notes": texts(decoded.notes)}
    for axis, found in decoded.maps.items():
        arrays |= {f"{axis}_{n}": values for n, values in AXES[axis].arrays(found).items()}
    return DECODED.write(path, decoded, **arrays)


def _write_mat(path: Path, decoded: Decoded) -> None:
    arrays: dict[str, Any] = {"reasons": np.array([one.name.lower() for one in Reason], object)}
    for axis, found in decoded.maps.items():
        arrays |= {f"{axis}_{n}": v for n, v in AXES[axis].arrays(found).items() if v is not None}
    if decoded.noise is not None:
        arrays["noise"] = np.array([decoded.noise.read_counts, decoded.noise.gain])
    if decoded.provenance is not None:
        arrays["provenance"] = str(json_line(decoded.provenance))
    scipy.io.savemat(path, arrays, do_compression=True, oned_as="column")


def read_coordinates(path: StrPath) -> Decoded:
    """Read decoded coordinates, of ``.npz`` or ``.csv``.

    Raises
    ------
    FileProblem where there is no such file, or it holds no coordinates.
    """
    path = Path(path)
    if path.suffix.lower() == CSV:
        return read_coordinates_csv(path)
    layout = DECODED.layout | {
        f"{axis}_{name}": f"?{form.lstrip('?')}"
        for axis, archive in AXES.items()
        for name, form in archive.layout.items()
    }
    arrays = read_npz(path, DECODED.holds, layout)
    with parsing(path, DECODED.holds):
        x, y = _axis("x", arrays), _axis("y", arrays)
        if x is None and y is None:
            raise FileProblem("expected coordinates along x or y, got neither")
        return Decoded(x, y, **DECODED.fields(arrays))


def _axis(axis: Axis, arrays: dict[str, Any]) -> CoordinateMap | None:
    start = f"{axis}_"
    own = {n.removeprefix(start): values for n, values in arrays.items() if n.startswith(start)}
    if "coordinate_px" not in own:
        return None
    return CoordinateMap(axis=axis, **AXES[axis].fields(own))


def write_phase(path: StrPath, wrapped: WrappedPhase, unwrapped: Unwrapped | None = None) -> Path:
    """Write a wrapped phase as ``.npz``, whole or not at all.

    Arrays ``phase_rad``, ``sigma_rad``, ``modulation``, ``background``, ``reason``, ``shifts_rad``,
    ``noise`` (read, gain) and ``findings`` (JSON); with an unwrapped phase also ``unwrapped_rad``,
    ``region`` and ``converged``.
    """
    if unwrapped is None:
        return PHASE.write(path, wrapped)
    more = {"unwrapped_rad": unwrapped.phase, "region": unwrapped.region}
    return PHASE.write(path, wrapped, converged=np.array(unwrapped.converged), **more)


def read_phase(path: StrPath) -> WrappedPhase:
    """Read a wrapped phase.

    Raises
    ------
    FileProblem where there is no such file, or it holds no wrapped phase.
    """
    return PHASE.read(path)


def write_light(path: StrPath, light: LightSeparation) -> Path:
    """Write direct and indirect light as ``.npz``, whole or not at all.

    Arrays ``direct``, ``direct_sigma``, ``indirect``, ``indirect_sigma`` (counts), ``reason``,
    ``separation`` (period in projector px, contrast, 1 with a black frame) and ``findings`` (JSON).
    """
    return LIGHT.write(path, light)


def read_light(path: StrPath) -> LightSeparation:
    """Read direct and indirect light.

    Raises
    ------
    FileProblem where there is no such file, or it holds no separated light.
    """
    return LIGHT.read(path)
