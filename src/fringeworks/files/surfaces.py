"""Height maps as files: TIFF, NPZ, PLY, X3P (ISO 25178-72), GSF (Gwyddion), CSV, VTI."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.csv_table import CSV
from fringeworks.files.findings import findings_as_json, findings_from_json
from fringeworks.files.limits import (
    MAX_DESCRIPTION_BYTES,
    check_frame_size,
    existing_file,
    parsing,
    read_content,
    told,
)
from fringeworks.files.npz import TEXT, read_npz
from fringeworks.files.ply import write_ply
from fringeworks.files.point_table import Kind
from fringeworks.files.provenance import KEY, comment_lines, from_json, json_line
from fringeworks.files.vtk import VTI, write_heights_as_vti
from fringeworks.files.x3p import read_x3p, write_x3p
from fringeworks.surface.height_map import height_map_points, height_map_triangles, known_pitch
from fringeworks.types import NUMBERS, FileProblem, HeightMap, InputError, Provenance, Reason

GSF_MAGIC = "Gwyddion Simple Field 1.0"
"""First line of a GSF file."""
LAYOUT = {
    "values": "f hw",
    "sigma": "f hw",
    "reason": "u hw",
    **dict.fromkeys(("quantity", "unit", "method"), TEXT),
    "pitch": NUMBERS,
    KEY: f"?{TEXT}",
    "pupil": "?f 3",
    "converged": "?b",
    "findings": f"?{TEXT}",
}
"""Layout of a height map."""


def write_surface(path: StrPath, surface: HeightMap, *, ply: Kind = "points") -> None:
    """Write a height map in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : path
        ``.tif``/``.tiff``: values on the first page, float32; σ and reasons on two more.
        ``.npz``: everything. ``.ply``: points or mesh with σ. ``.x3p`` (ISO 25178-72): values in
        metres. ``.gsf`` (Gwyddion simple field): values. ``.csv``: a row for every pixel, with its
        place, value, σ and reason. ``.vti`` (ParaView): values, σ and reasons as a raster.
    surface : HeightMap
    ply : "points" or "mesh"

    Raises
    ------
    FileProblem for an unknown suffix and a folder that cannot be written to; InputError for
    ``ply="normals"`` and "frame", which point clouds have, for X3P without a geometry, since that
    format holds lengths only, and for ``.ply``, ``.x3p`` and ``.gsf`` where the pitch is unknown.
    """
    check_target(path, WRITERS)
    if ply in ("normals", "frame"):
        raise InputError(f"ply: expected points or mesh for a height map, got {ply}")
    with replacing(path) as temporary:
        WRITERS[Path(path).suffix.lower()](temporary, surface, ply)


def read_surface(path: StrPath) -> HeightMap:
    """Read a height map.

    Parameters
    ----------
    path : path
        A ``.tif``, ``.npz``, ``.csv``, ``.x3p`` or ``.gsf`` file that ``write_surface`` wrote, or
        X3P and GSF of other programs. Points of a ``.ply`` file are read by ``read_points``.

    Returns
    -------
    HeightMap. X3P and GSF hold no σ: it is NaN; pixels without a value are ``UNDETERMINED``.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds no height map.
    """
    path = existing_file(path, "a height map")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise FileProblem(f"{path}: expected one of {known}, got {path.suffix or 'no suffix'}")
    return reader(path)


def _write_tiff(path: Path, surface: HeightMap, _: Kind) -> None:
    description: dict[str, Any] = {
        "quantity": surface.quantity,
        "unit": surface.unit,
        "pitch": surface.pitch,
        "method": surface.method,
    }
    if surface.pupil is not None:
        description["pupil"] = list(surface.pupil)
    if surface.converged is not None:
        description["converged"] = surface.converged
    if surface.findings:
        description["findings"] = findings_as_json(surface.findings)
    origin = surface.provenance
    if origin is not None:
        description[KEY] = origin.as_dict()
    import tifffile  # 15 ms, for those only who write TIFF

    with tifffile.TiffWriter(path) as pages:
        # Three series: programs that read one image take the values.
        pages.write(surface.values.astype(np.float32), metadata=description)
        pages.write(surface.sigma.astype(np.float32), metadata={"quantity": "sigma"})
        pages.write(surface.reason, metadata={"quantity": "reason"})


def _read_tiff(path: Path) -> HeightMap:
    from fringeworks.files.tiff import opened_tiff  # 15 ms, for those only who read TIFF

    with parsing(path, "a height map as TIFF that fringeworks wrote"), opened_tiff(path) as file:
        content = json.loads(file.pages[0].description)  # type: ignore[union-attr]
        values, sigma, reason = (file.pages[k].asarray() for k in range(3))
        kinds = tuple(array.dtype.kind for array in (values, sigma, reason))
        if kinds != ("f", "f", "u"):
            raise FileProblem(f"expected pages of values, σ and reasons, got {', '.join(kinds)}")
        origin = from_json(json.dumps(content[KEY])) if KEY in content else None
        return _surface(content | {"values": values, "sigma": sigma, "reason": reason}, origin)


def holds_heights(file: Any) -> bool:
    """Whether a TIFF that tifffile has opened is a height map that fringeworks wrote."""
    try:
        content = json.loads(file.pages[0].description)
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and {"quantity", "unit", "pitch"} <= content.keys()


def _write_npz(path: Path, surface: HeightMap, _: Kind) -> None:
    arrays = {field.name: getattr(surface, field.name) for field in dataclasses.fields(HeightMap)}
    arrays["pitch"] = math.nan if surface.pitch is None else float(surface.pitch)
    for name in ("pupil", "converged"):
        if arrays[name] is None:
            del arrays[name]
    arrays["findings"] = findings_as_json(surface.findings)
    origin = json_line(arrays.pop(KEY))
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays | ({} if origin is None else {KEY: origin}))


def _read_npz(path: Path) -> HeightMap:
    content = read_npz(path, "a height map", LAYOUT)
    with parsing(path, "a height map"):
        origin = from_json(str(content[KEY])) if KEY in content else None
        return _surface(content, origin)


def _surface(content: dict[str, Any], origin: Provenance | None) -> HeightMap:
    quantity, unit = str(content["quantity"]), str(content["unit"])
    if quantity not in ("height", "displacement") or unit not in ("mm", "px"):
        raise FileProblem(
            f"expected heights or displacements, got {told(quantity)} in {told(unit)}"
        )
    maps = {name: np.asarray(content[name]) for name in ("values", "sigma", "reason")}
    if len({m.shape for m in maps.values()}) != 1 or maps["values"].ndim != 2:
        raise FileProblem("expected three maps of one shape (h, w), got others")
    return HeightMap(
        **maps,
        quantity="height" if quantity == "height" else "displacement",
        unit="mm" if unit == "mm" else "px",
        pitch=_known_pitch(content["pitch"]),
        method=str(content["method"]),
        provenance=origin,
        pupil=_pupil(content.get("pupil")),
        converged=None if content.get("converged") is None else bool(content["converged"]),
        findings=findings_from_json(str(content.get("findings", "[]"))),
    )


def _known_pitch(value: Any) -> float | None:
    """A pitch as it was written; NaN and null stand for an unknown one."""
    pitch = float("nan") if value is None else float(value)
    if math.isnan(pitch):
        return None
    if not (math.isfinite(pitch) and pitch > 0):
        raise FileProblem(f"expected a pitch > 0, got {pitch}")
    return pitch


def _pupil(given: Any) -> tuple[float, float, float] | None:
    if given is None:
        return None
    x, y, distance = (float(v) for v in np.asarray(given, np.float64))
    if not (np.isfinite([x, y, distance]).all() and distance > 0):
        raise FileProblem(f"expected a pupil at a distance > 0, got {given}")
    return x, y, distance


def _write_ply(path: Path, surface: HeightMap, kind: Kind) -> None:
    xyz, sigma, index = height_map_points(surface)
    vertices = np.empty(len(xyz), dtype=[(name, "<f4") for name in ("x", "y", "z", "sigma")])
    vertices["x"], vertices["y"], vertices["z"] = xyz.T
    vertices["sigma"] = sigma
    comments = [f"fringeworks {surface.method} {surface.quantity}; unit {surface.unit}"]
    comments += comment_lines(surface.provenance)
    triangles = height_map_triangles(surface, index) if kind == "mesh" else None
    write_ply(path, [vertices], len(vertices), triangles, comments)


def _write_gsf(path: Path, surface: HeightMap, _: Kind) -> None:
    rows, columns = surface.shape
    in_mm = surface.unit == "mm"
    lateral = known_pitch(surface, "GSF") * (1e-3 if in_mm else 1.0)
    fields = {
        "XRes": columns,
        "YRes": rows,
        "XReal": f"{columns * lateral:.9g}",
        "YReal": f"{rows * lateral:.9g}",
        "XYUnits": "m" if in_mm else "px",
        "ZUnits": "m" if in_mm else "px",
        "Title": f"{surface.method} {surface.quantity}".strip(),
    }
    origin = json_line(surface.provenance)
    if origin is not None:
        fields["Comment"] = origin
    text = f"{GSF_MAGIC}\n" + "".join(f"{k} = {v}\n" for k, v in fields.items())
    header = text.encode("utf-8")
    # One to four NULs bring the data to a multiple of four bytes.
    header += b"\0" * (4 - len(header) % 4)
    values = surface.values * (1e-3 if in_mm else 1.0)
    path.write_bytes(header + np.ascontiguousarray(values, dtype="<f4").tobytes())


def _read_gsf(path: Path) -> HeightMap:
    content = read_content(path, "a Gwyddion simple field")
    end = content.find(b"\0")
    with parsing(path, "a Gwyddion simple field"):
        magic, *lines = content[: min(end, MAX_DESCRIPTION_BYTES)].decode("utf-8").splitlines()
        fields = {k.strip(): v.strip() for k, _, v in (line.partition("=") for line in lines)}
        if magic != GSF_MAGIC or end < 0:
            raise FileProblem("expected a Gwyddion simple field, got another kind of file")
        rows, columns = int(fields["YRes"]), int(fields["XRes"])
        check_frame_size(columns, rows)
        start = end + 4 - end % 4
        raw = np.frombuffer(content, "<f4", rows * columns, start).reshape(rows, columns)
        in_mm = fields.get("ZUnits", "") == "m"
        scale = 1e3 if in_mm else 1.0
        # A field without its real width has a width of 1 by the format's definition: unknown.
        width = float(fields["XReal"]) if "XReal" in fields else math.nan
        return _without_sigma(
            raw.astype(np.float64) * scale,
            in_mm=in_mm,
            pitch=_known_pitch(width / columns * scale),
            method=fields.get("Title", "").partition(" ")[0],
            origin=from_json(fields.get("Comment")),
        )


def _read_x3p(path: Path) -> HeightMap:
    values, increment, method, origin = read_x3p(path)
    with parsing(path, "a surface as X3P"):
        pitch = _known_pitch(increment)
    return _without_sigma(values, in_mm=True, pitch=pitch, method=method, origin=origin)


def _without_sigma(
    values: Any, *, in_mm: bool, pitch: float | None, method: str, origin: Provenance | None
) -> HeightMap:
    reason = np.where(np.isfinite(values), Reason.OK, Reason.UNDETERMINED).astype(np.uint8)
    return HeightMap(
        values=values,
        sigma=np.full(values.shape, np.nan),
        reason=reason,
        quantity="height" if in_mm else "displacement",
        unit="mm" if in_mm else "px",
        pitch=pitch,
        method=method,
        provenance=origin,
    )


def _write_csv(path: Path, surface: HeightMap, _: Kind) -> None:
    from fringeworks.files.result_csv import write_heights_csv

    write_heights_csv(path, surface)


def _read_csv(path: Path) -> HeightMap:
    from fringeworks.files.result_csv import read_heights_csv

    return read_heights_csv(path)


def _write_x3p(path: Path, surface: HeightMap, _: Kind) -> None:
    write_x3p(path, surface)


def _write_vti(path: Path, surface: HeightMap, _: Kind) -> None:
    write_heights_as_vti(path, surface)


WRITERS: dict[str, Callable[[Path, HeightMap, Kind], None]] = {
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
    ".npz": _write_npz,
    ".ply": _write_ply,
    ".x3p": _write_x3p,
    ".gsf": _write_gsf,
    CSV: _write_csv,
    VTI: _write_vti,
}
"""Writers by suffix."""
READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".npz": _read_npz,
    ".x3p": _read_x3p,
    ".gsf": _read_gsf,
    CSV: _read_csv,
}
"""Readers by suffix."""
