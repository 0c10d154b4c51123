"""Surfaces packed for the viewer: a header in JSON and deflated blocks of numbers."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.reason_words import REASON_WORDS
from fringeworks.report.viewer.coding import CODES, Blocks, coded, logarithms
from fringeworks.report.viewer.content import Content, content_of
from fringeworks.report.viewer.framing import framing
from fringeworks.report.viewer.placing import ALLOWED_SIGMAS, place_points
from fringeworks.types import (
    CoordinateMap,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Pinhole,
    PointCloud,
    Points,
    Reason,
    Rig,
    TriangleMesh,
    unmasked,
)
from fringeworks.types.placement import Placement

MAGIC = b"FWSURF2\n"
"""First bytes of a packed surface; the digit is the version of the format."""
MAX_NOTES = 200
"""Notes that travel with a surface: more are not read. The page says how many there are."""
MAX_TITLE = 200
"""Letters of a title that are kept: it is one line."""
WHITE_PERCENTILE = 99.8
"""Brightness that becomes white, percent of the pixels below it: highlights do not darken the
rest."""
MOST_MODEL_FACES = 400_000
"""Triangles of a drawing that a page shows: 7 MB, which turn without a graphics card as well."""
RATIOS = ("albedo", "walls")
"""Layers whose numbers have no unit."""
FINE_STEPS = 65535
"""Steps over the range of deviations where no σ gives their precision: 16 bits."""


@dataclass(frozen=True, eq=False, repr=False)
class PackedSurface(Frozen):
    """A surface as the viewer reads it."""

    data: bytes
    """Magic, length of the header, header, blocks."""
    header: dict[str, Any] = field(default_factory=dict)
    """What the header says: size, units, codes, reasons, notes, places of the blocks."""


def pack_surface(
    result: Measurement | Reconstruction | PointCloud | HeightMap | CoordinateMap | Points,
    *,
    camera: Rig | Pinhole | None = None,
    modulation: FloatMap | None = None,
    texture: FloatMap | None = None,
    deviation: FloatMap | None = None,
    limits: tuple[float, float] | None = None,
    model: TriangleMesh | None = None,
    flags: Sequence[tuple[int, int, str]] = (),
    title: str = "",
    notes: tuple[str, ...] = (),
    own_notes: bool = True,
    every: int = 1,
) -> PackedSurface:
    """Pack a surface for the viewer, with every point within an eighth of its σ.

    Parameters
    ----------
    result : Measurement, Reconstruction, PointCloud, HeightMap, CoordinateMap or Points
    camera : Rig or Pinhole, optional
        The camera of a point cloud: its points then need one number each. By default it is fitted
        to the points. Clouds that no camera sees are packed with three numbers per point.
    modulation : (h, w) array, optional
        Modulation, counts; from the result where that holds it.
    texture : (h, w) or (h, w, 3) array, optional
        Brightness or colour, counts; from the result where that holds it. Shown in 8 bits.
    deviation : (h, w) array, optional
        Signed deviation from a nominal surface, in the surface's unit. The page opens on it.
    limits : (low, high), optional
        Ends of the deviation's colour scale; by default those of nearly all values.
    model : TriangleMesh, optional
        The nominal surface, in the result's coordinates: it is shown behind the points. Meshes of
        more than 400,000 triangles are left out, which a note says.
    flags : (row, column, text) each
        Labels on pixels.
    title : str
        Name of the surface; plain text.
    notes : tuple of str
        Added to the result's own notes; plain text.
    own_notes : bool
        False where the page that holds the viewer lists the result's findings itself.
    every : int ≥ 1
        Use every k-th column and row only, for frames that are too large.

    Returns
    -------
    PackedSurface

    Raises
    ------
    InputError for maps of other shapes, another camera than the cloud's, more than 8 million
    pixels, and anything that is no surface.

    Notes
    -----
    A cloud in the order of a camera's pixels becomes its depths: the page computes the rays from
    the camera model. Depths are rounded to σ/4, with σ per pixel as an 8-bit logarithm that never
    exceeds it, predicted from the neighbours to the left and above, and deflated. Modulation is an
    8-bit logarithm, brightness 8 bits, reasons are deflated as they are. Points without a raster,
    or without σ, are stored in single precision.

    Examples
    --------
    >>> values = np.array([[0.0, 1.0], [2.0, np.nan]], np.float32)
    >>> reason = np.array([[0, 0], [0, 9]], np.uint8)
    >>> surface = HeightMap(values, np.full((2, 2), 0.1), reason, "height", "mm", 0.5)
    >>> packed = pack_surface(surface, title="four pixels")
    >>> packed.header["size"], packed.header["points"]["coding"]
    ([2, 2], 'z')
    """
    content = content_of(result, camera, every)
    given = {"modulation": modulation, "texture": texture, "deviation": deviation}
    parts = {
        name: _part(name, values, result, every)
        for name, values in given.items()
        if values is not None
    }
    more: tuple[str, ...] = ()
    if model is not None and len(model.faces) > MOST_MODEL_FACES:
        more = (f"The drawing is not shown: it has {len(model.faces):,} triangles.",)
    content = replace(
        content,
        maps={**content.maps, **parts},
        notes=(*(content.notes if own_notes else ()), *more, *notes),
        title=title[:MAX_TITLE],
    )
    return _packed(content, _Added(limits, model, tuple(flags), every))


@dataclass(frozen=True)
class _Added:
    """What stands in a surface beside its maps."""

    limits: tuple[float, float] | None = None
    model: TriangleMesh | None = None
    flags: tuple[tuple[int, int, str], ...] = ()
    every: int = 1

    def header(self, blocks: Blocks, columns: int) -> dict[str, Any]:
        """Its part of the header."""
        every = self.every
        found: dict[str, Any] = {
            "flags": [[(r // every) * columns + c // every, text] for r, c, text in self.flags]
        }
        if self.model is not None and len(self.model.faces) <= MOST_MODEL_FACES:
            vertices = np.ascontiguousarray(self.model.vertices_mm, "<f4")
            faces = np.ascontiguousarray(self.model.faces, "<u4")
            found["model"] = {
                "vertices": blocks.add(vertices.tobytes()),
                "faces": blocks.add(faces.tobytes()),
            }
        return found


def _part(name: str, values: FloatMap, result: object, every: int) -> FloatMap:
    """The used pixels of a map that belongs to a result."""
    part = unmasked(values, name)
    while isinstance(result, Measurement | Reconstruction):
        result = result.points if isinstance(result, Measurement) else result.surface
    shape = getattr(result, "reason", np.empty(0)).shape
    shapes = [shape, (*shape, 3)] if name == "texture" else [shape]
    if len(shape) != 2 or part.shape not in shapes or part.dtype.kind not in "fiub":
        raise InputError(
            f"{name}: expected numbers of shape {' or '.join(map(str, shapes))}, got {part.dtype} "
            f"{part.shape}"
        )
    return part[::every, ::every].astype(np.float64)


def _packed(content: Content, added: _Added) -> PackedSurface:
    blocks = Blocks()
    measured = content.measured
    rows, columns = content.reason.shape
    header: dict[str, Any] = {
        "title": content.title,
        "kind": content.kind,
        "size": [columns, rows],
        "raster": content.raster,
        "unit": content.unit,
        "lateral_unit": content.lateral_unit,
        "metric": content.metric,
        "count": int(measured.sum()),
        **_placed(content.placement),
        "notes": _notes(content.notes),
        "note_count": len(content.notes),
        **framing(content),
        "reasons": [REASON_WORDS[reason]._asdict() for reason in Reason],
        "reason": blocks.add(content.reason.tobytes()),
    }
    codes, table = logarithms(content.sigma, bounded=True)
    low = np.where(codes >= 0, table[np.maximum(codes, 0)], np.nan)
    if (content.sigma[measured] == 0).any():
        low[measured & (content.sigma == 0)] = 0.0
    header["sigma"] = _coded_bytes(blocks, codes, table)
    header |= place_points(blocks, content.points, measured, low, content.lattice)
    header["layers"] = [
        _layer(blocks, name, values, content, low) for name, values in content.maps.items()
    ]
    for layer in header["layers"]:
        if layer["name"] == "deviation":
            header["first"] = "deviation"
            layer |= {} if added.limits is None else {"range": list(added.limits)}
    header |= added.header(blocks, columns)
    text = json.dumps(header, ensure_ascii=False, allow_nan=False).encode()
    data = b"".join([MAGIC, struct.pack("<I", len(text)), text, *blocks.parts])
    return PackedSurface(data, header)


def _placed(placement: Placement | None) -> dict[str, Any]:
    """Where the camera stands in the coordinates of the points; nothing in its own."""
    if placement is None:
        return {}
    return {"placed": [placement.frame, placement.T_frame_camera.ravel().tolist()]}


def _notes(notes: tuple[str, ...]) -> list[str]:
    """The first notes, and how many more there are."""
    more = len(notes) - MAX_NOTES
    return [*map(str, notes[:MAX_NOTES]), *([f"… and {more} more notes"] if more > 0 else [])]


def _coded_bytes(blocks: Blocks, codes: NDArray[np.int64], table: FloatMap) -> dict[str, Any]:
    """Write the codes of an 8-bit logarithm; −1 is no number."""
    symbols, _ = coded(np.where(codes >= 0, codes, np.nan), 1.0, 0.0)
    first, ratio = float(table[0]), float(table[1] / table[0])
    return {"factor": 1.0, "first": first, "ratio": ratio, "blocks": [blocks.add_planes(symbols)]}


def _layer(
    blocks: Blocks, name: str, values: FloatMap, content: Content, low_sigma: FloatMap
) -> dict[str, Any]:
    """Write a map and return its header."""
    if name == "modulation":
        codes, table = logarithms(values.astype(np.float64), bounded=False)
        return {"name": name, "unit": "counts", **_coded_bytes(blocks, codes, table)}
    if name == "deviation":
        return {
            "name": name,
            "unit": content.unit,
            **_deviation(blocks, values, content, low_sigma),
        }
    finite = values[np.isfinite(values)]
    white = float(np.percentile(finite, WHITE_PERCENTILE)) if finite.size else 1.0
    first = min(0.0, float(finite.min())) if finite.size else 0.0
    step = max(white - first, float(np.finfo(np.float32).tiny)) / (CODES - 1)
    channels = values[..., None] if values.ndim == 2 else values
    clipped = np.clip(channels, first, white)
    if channels.shape[-1] > 1:
        clipped = clipped - first  # the page shows colours as bytes
    places = [
        blocks.add_planes(coded(clipped[..., k], step, 0.0)[0]) for k in range(channels.shape[-1])
    ]
    unit = "" if name in RATIOS else "counts"
    return {"name": name, "unit": unit, "factor": step, "blocks": places}


def _deviation(
    blocks: Blocks, values: FloatMap, content: Content, low_sigma: FloatMap
) -> dict[str, Any]:
    """Write deviations as exactly as points: in steps of σ/4, or of 1/65535 of their range."""
    values = np.where(content.measured, values, np.nan)
    finite = values[np.isfinite(values)]
    reach = float(np.ptp(finite)) if finite.size else 0.0
    fixed = (reach or 1.0) / FINE_STEPS
    positive = low_sigma > 0
    if positive.any():
        smallest = low_sigma[positive].min()
        factor = 2.0 * ALLOWED_SIGMAS
        steps = factor * np.where(positive, low_sigma, smallest)
        try:
            symbols, _ = coded(values, steps, 0.0)
            places = [blocks.add_planes(symbols)]
            return {"factor": factor, "of_sigma": True, "blocks": places}
        except InputError:
            pass  # σ spans too little of the range: the fixed step below is finer than a picture
    symbols, _ = coded(values, fixed, 0.0)
    return {"factor": fixed, "blocks": [blocks.add_planes(symbols)]}
