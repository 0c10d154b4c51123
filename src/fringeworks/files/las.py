"""Points written as LAS and LAZ files (ASPRS, version 1.4), by the package laspy."""

from __future__ import annotations

import math
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.point_table import COLOURS, NORMAL_AXES, PointTable, fields_of
from fringeworks.files.provenance import json_line
from fringeworks.types import MissingPackage

SUFFIXES = (".las", ".laz")
"""Plain and compressed files."""
METRE = 1e-3
"""m/mm: lengths in LAS files are taken as metres, as its programs do without a reference system."""
COLOURED, PLAIN = 7, 6
"""Numbers of the records of version 1.4 with and without a colour."""
MOST_STEPS = 2**30
"""Steps of a coordinate on either side of the middle: half of what 32 bits hold, so that programs
may move the points a little."""
FINEST_EXPONENT = -10
"""Power of ten of the finest step in metres: 0.1 nm is far below any σ."""
USER = "fringeworks"
"""Name under which the provenance is kept."""
RECORD = 1
"""Number of the record that keeps it."""
MOST_RECORD_BYTES = 65535
"""Length of a record that the format can hold in the header."""
EXTRA = ("sigma", "noise")
"""Fields of lengths that LAS files hold as extra dimensions."""


def need_laspy(suffix: str) -> Any:
    """The package that reads and writes a kind of LAS files.

    Raises
    ------
    MissingPackage where it, or for LAZ the package ``lazrs``, is not installed (the extra
    "export").
    """
    for name, wanted in (("laspy", SUFFIXES), ("lazrs", SUFFIXES[1:])):
        if suffix.lower() in wanted:
            try:
                import_module(name)
            except ImportError as error:
                raise MissingPackage(
                    f"{suffix[1:].upper()} files: expected the package {name}, got none; "
                    "pip install 'fringeworks[export]'"
                ) from error
    return import_module("laspy")


def write_las(path: Path, table: PointTable) -> None:
    """Write points in metres, with σ, noise and normals as extra dimensions, colour of 16 bits.

    Raises
    ------
    MissingPackage as ``need_laspy``.
    """
    laspy = need_laspy(path.suffix)
    points = np.concatenate(list(table.parts("u2", exact=True)))
    names = fields_of(points)
    header = laspy.LasHeader(version="1.4", point_format=COLOURED if "red" in names else PLAIN)
    header.generating_software = USER
    places = [points[name].astype(np.float64) * METRE for name in "xyz"]
    ends = np.array([(p.min(), p.max()) for p in places])
    header.offsets = ends.mean(axis=1)
    reach = max(float(np.ptp(ends, axis=1).max()) / 2.0, 10.0**FINEST_EXPONENT)
    exponent = max(math.ceil(math.log10(reach / MOST_STEPS)), FINEST_EXPONENT)
    header.scales = np.full(3, 10.0**exponent)
    extra = [name for name in (*NORMAL_AXES, *EXTRA) if name in names]
    header.add_extra_dims(
        [laspy.ExtraBytesParams(n, "f4", "m" if n in EXTRA else "unit normal") for n in extra]
    )
    data = laspy.LasData(header)
    data.x, data.y, data.z = places
    for name in extra:
        data[name] = points[name] * np.float32(METRE if name in EXTRA else 1.0)
    for name in COLOURS:
        if name in names:
            data[name] = points[name]
    origin = json_line(table.provenance)
    if origin is not None and len(origin) <= MOST_RECORD_BYTES:
        data.vlrs.append(laspy.VLR(USER, RECORD, "provenance", origin.encode("ascii")))
    data.write(path, do_compress=path.suffix.lower() == ".laz")
