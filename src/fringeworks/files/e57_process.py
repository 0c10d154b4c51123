"""Reads the scans of an E57 file and writes them to standard output; run by ``apart``.

libE57Format is a C++ library, which may crash on damaged files.
"""

from __future__ import annotations

import io
import sys
from typing import Any

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
"""Fields of places."""
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
"""Fields of places as directions and distances."""
OTHERS = (
    *("colorRed", "colorGreen", "colorBlue", "intensity", "rowIndex", "columnIndex"),
    *("cartesianInvalidState", "sphericalInvalidState"),
    *("nor:normalX", "nor:normalY", "nor:normalZ"),
    *("fw:sigma", "fw:noise", "fw:residual", "fw:blur", "fw:reason"),
)
"""Further fields that are read, where a scan has them."""


def main(path: str, most: str) -> None:
    """Write the fields of every scan as an ``.npz`` archive."""
    import numpy as np
    from pye57 import libe57

    file = libe57.ImageFile(path, "r")
    root = file.root()
    scans = root["data3D"]
    arrays: dict[str, Any] = {}
    room = int(most)
    for number in range(len(scans)):
        found = _scan(file, scans[number], room)
        room -= sum(values.nbytes for values in found.values())
        arrays |= {f"{number}/{name}": values for name, values in found.items()}
        arrays[f"{number}/pose"] = _pose(scans[number])
        if _defined(scans[number], "fw:details"):
            arrays[f"{number}/details"] = np.array(scans[number]["fw:details"].value())
    written = io.BytesIO()
    np.savez(written, **arrays)
    sys.stdout.buffer.write(written.getbuffer())


def _scan(file: Any, scan: Any, room: int) -> dict[str, Any]:
    """The fields of a scan."""
    import numpy as np
    from pye57 import libe57

    points = scan["points"]
    count = points.childCount()
    prototype = libe57.StructureNode(points.prototype())
    there = {prototype.get(k).elementName() for k in range(prototype.childCount())}
    there |= {name for name in OTHERS if ":" in name and _defined(prototype, name)}
    place = CARTESIAN if there.issuperset(CARTESIAN) else SPHERICAL
    if not there.issuperset(place):
        raise ValueError("a scan has no places")
    names = [*place, *(name for name in OTHERS if name in there)]
    if count < 0 or count * 8 * len(names) > room:
        raise ValueError(f"{count} points take more memory than the limit")
    arrays = {name: np.zeros(max(count, 1), np.float64) for name in names}
    if count:
        buffers = libe57.VectorSourceDestBuffer()
        for name in names:
            one = libe57.SourceDestBuffer(file, name, arrays[name], count, True, True)
            buffers.append(one)
        reader = points.reader(buffers)
        read = reader.read()
        reader.close()
        if read != count:
            raise ValueError(f"{count} points were announced, {read} are there")
    return {name: values[:count] for name, values in arrays.items()}


def _defined(node: Any, name: str) -> bool:
    """Whether a node has a field of an extension; the library refuses names of unknown ones."""
    try:
        return bool(node.isDefined(name))
    except Exception:
        return False


def _pose(scan: Any) -> Any:
    """Rotation as a quaternion w, x, y, z, and translation in metres, (7,)."""
    import numpy as np

    pose = np.array([1.0, 0, 0, 0, 0, 0, 0])
    if scan.isDefined("pose"):
        for part, names, start in (("rotation", "wxyz", 0), ("translation", "xyz", 4)):
            if scan["pose"].isDefined(part):
                node = scan["pose"][part]
                pose[start : start + len(names)] = [node[name].value() for name in names]
    return pose
