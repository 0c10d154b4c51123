"""Textures of meshes: pictures that lie on triangles, as OBJ and glTF hold them."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import replacing
from fringeworks.files.beside import drop_earlier, name_beside
from fringeworks.files.white import white_of
from fringeworks.types import FloatMap, TriangleMesh

LINEAR_END, SLOPE = 0.0031308, 12.92
"""Light below which sRGB is linear, and its slope there (IEC 61966-2-1)."""
OFFSET, EXPONENT = 0.055, 2.4
"""Offset and exponent of sRGB above."""
MARGIN_PX = 2
"""Pixels around the vertices that a picture keeps, so that viewers may interpolate."""
BAND = 50_000
"""Lines that are written at a time."""
PICTURE, MATERIAL = ".texture.png", ".texture.mtl"
"""What the names of the files beside an OBJ file end with."""
SHINE = "Ka 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\n"
"""A material that shows the picture as it is."""


class Texture(NamedTuple):
    """A picture, and where the vertices lie in it."""

    shown: NDArray[np.uint8]
    """(h, w, 3), sRGB."""
    uv: FloatMap
    """(n, 2): 0…1 from left to right and from bottom to top."""


def texture_of(mesh: TriangleMesh) -> Texture | None:
    """The picture of a mesh, cut to what its vertices need; None where it has none."""
    if mesh.texture is None or mesh.texture_px is None:
        return None
    seen = np.asarray(mesh.texture, np.float64)
    rows, columns = seen.shape[:2]
    place = np.clip(np.asarray(mesh.texture_px, np.float64), 0, (columns - 1, rows - 1))
    column, row = np.rint(place).astype(int).T
    white = white_of(seen[row, column])
    if white is None:
        return None
    left, top = np.maximum(np.floor(place.min(axis=0)).astype(int) - MARGIN_PX, 0)
    right, bottom = np.ceil(place.max(axis=0)).astype(int) + MARGIN_PX + 1
    part = seen[top:bottom, left:right]
    shown = as_srgb(part / white)
    shown = np.stack((shown,) * 3, axis=-1) if shown.ndim == 2 else shown
    height, width = shown.shape[:2]
    across = (place[:, 0] - left + 0.5) / width
    return Texture(shown, np.column_stack((across, 1.0 - (place[:, 1] - top + 0.5) / height)))


def as_srgb(light: FloatMap) -> NDArray[np.uint8]:
    """Light from 0 to 1 as counts of sRGB, which pictures hold and screens show."""
    bounded = np.clip(np.nan_to_num(light), 0.0, 1.0)
    curved = (1.0 + OFFSET) * bounded ** (1.0 / EXPONENT) - OFFSET
    return np.rint(255.0 * np.where(bounded <= LINEAR_END, SLOPE * bounded, curved)).astype(
        np.uint8
    )


def write_textured_obj(path: Path, mesh: TriangleMesh, texture: Texture) -> None:
    """Write an OBJ file in mm, with its material and its picture beside it.

    The picture and the material are written first. Where others of these names lie there, the new
    ones get other names, and the earlier ones are deleted once the OBJ file is there.
    """
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(texture.shown).save(buffer, "PNG")
    picture = _beside(path, PICTURE, buffer.getvalue())
    text = f"# fringeworks\nnewmtl surface\n{SHINE}map_Kd {picture.name}\n"
    material = _beside(path, MATERIAL, text.encode("utf-8"))
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(f"# fringeworks; unit mm\nmtllib {material.name}\nusemtl surface\n")
        file.writelines(_lines("v %.9g %.9g %.9g\n", mesh.vertices_mm))
        file.writelines(_lines("vt %.7g %.7g\n", texture.uv))
        corners = np.repeat(np.asarray(mesh.faces, np.int64) + 1, 2, axis=1)
        file.writelines(_lines("f %d/%d %d/%d %d/%d\n", corners))
    names = [f"{path.stem}{ending}" for ending in (PICTURE, MATERIAL)]
    drop_earlier(path, names, [picture.name, material.name])


def _beside(path: Path, ending: str, content: bytes) -> Path:
    """Write a file that belongs to an OBJ file."""
    digest = hashlib.sha256(content).hexdigest()

    def same(there: Path) -> bool:
        return there.is_file() and there.read_bytes() == content

    place = name_beside(path, f"{path.stem}{ending}", digest, same)
    with replacing(place) as temporary:
        temporary.write_bytes(content)
    return place


def _lines(form: str, rows: NDArray[Any]) -> Iterator[str]:
    for start in range(0, len(rows), BAND):
        part = rows[start : start + BAND]
        yield form * len(part) % tuple(part.ravel().tolist())
