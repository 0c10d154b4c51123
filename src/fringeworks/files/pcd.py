"""Points as PCD files, the format of the Point Cloud Library (version 0.7, binary)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = {"f": "F", "u": "U", "i": "I"}
"""Letters of the format by those of NumPy."""
COLOURS = ("red", "green", "blue")
"""Fields that become one."""
NAMES = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}
"""Names that the Point Cloud Library gives to fields with other names in PLY files."""


def write_pcd(
    path: Path, points: Iterable[NDArray[Any]], count: int, comments: Sequence[str]
) -> None:
    """Write a binary PCD file.

    Parameters
    ----------
    path : Path
    points : structured arrays of numbers
        In their order; fields red, green and blue become the field ``rgb`` that viewers know.
    count : int
        Number of points in all of them.
    comments : sequence of str
        Lines of the header, ASCII.
    """
    parts = map(_packed, points)
    first = next(parts)
    fields = [first.dtype[name] for name in first.dtype.names or ()]
    header = [
        *(f"# {line}" for line in comments),
        "VERSION 0.7",
        f"FIELDS {' '.join(first.dtype.names or ())}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in fields)}",
        f"TYPE {' '.join(KINDS[kind.kind] for kind in fields)}",
        f"COUNT {' '.join('1' for _ in fields)}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        "DATA binary",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        for part in chain([first], parts):
            file.write(part.data.cast("B"))


def _packed(points: NDArray[Any]) -> NDArray[Any]:
    """The points by the names of PCD, with their colour in one number, 0x00RRGGBB."""
    names = points.dtype.names or ()
    plain = [name for name in names if name not in COLOURS]
    fields = [(NAMES.get(name, name), points.dtype[name].str) for name in plain]
    coloured = "red" in names
    packed = np.empty(points.shape, dtype=[*fields, *([("rgb", "<u4")] if coloured else [])])
    for name in plain:
        packed[NAMES.get(name, name)] = points[name]
    if coloured:
        red, green, blue = (points[name].astype(np.uint32) for name in COLOURS)
        packed["rgb"] = red << 16 | green << 8 | blue
    return packed
