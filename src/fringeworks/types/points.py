"""Points and meshes without a frame: what files hold, and what several views become."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.arrays import BoolMap, FloatMap
from fringeworks.types.checks import unmasked
from fringeworks.types.errors import InputError
from fringeworks.types.finding import Finding, Noted
from fringeworks.types.frozen import Frozen
from fringeworks.types.nominal import NominalFace
from fringeworks.types.provenance import Provenance


@dataclass(frozen=True, eq=False, repr=False)
class Points(Noted, Frozen):
    """Points without their place in a frame, as a file or several merged views have them."""

    layout = {  # noqa: RUF012
        "xyz_mm": "fiu n3",
        "sigma_mm": "?fiu n",
        "noise_mm": "?fiu n",
        "normals": "?fiu n3",
        "colour": "?fiu n|n3",
    }

    xyz_mm: FloatMap
    """(n, 3), mm."""
    sigma_mm: FloatMap | None
    """Standard deviation, (n,), mm; None where unknown."""
    noise_mm: FloatMap | None = None
    """The part of σ that is independent from point to point, (n,), mm; None where unknown."""
    findings: tuple[Finding, ...] = ()
    """What was found about the points."""
    provenance: Provenance | None = None
    """How they were made; None where unknown."""
    normals: FloatMap | None = None
    """Unit normals that point out of the surface, (n, 3); None where unknown."""
    colour: FloatMap | None = None
    """Brightness (n,) or colour (n, 3) of the surface, counts; None where unknown."""


@dataclass(frozen=True, eq=False, repr=False)
class TriangleMesh(Noted, Frozen):
    """A surface of triangles, as of a part that was measured or drawn.

    Raises
    ------
    InputError for arrays of wrong shapes, vertices that are not finite, faces whose vertices are
    missing, and a texture without the places of the vertices in it.
    """

    vertices_mm: FloatMap
    """(n, 3), mm."""
    faces: NDArray[np.uint32]
    """(m, 3), rows of ``vertices_mm``, anticlockwise as seen from outside."""
    sigma_mm: FloatMap | None = None
    """Standard deviation of every vertex along its normal, (n,), mm; None where unknown."""
    colour: FloatMap | None = None
    """Brightness (n,) or colour (n, 3) of every vertex, counts; None where unknown."""
    filled: BoolMap | None = None
    """(n,): True for vertices that fill a hole and were not measured; None where there are none."""
    findings: tuple[Finding, ...] = ()
    """What was found about the mesh."""
    provenance: Provenance | None = None
    """How it was made; None where unknown."""
    texture: FloatMap | None = None
    """A picture of the surface in linear light, (h, w) or (h, w, 3), counts; None where there is
    none."""
    texture_px: FloatMap | None = None
    """Where the vertices lie in it: column and row, (n, 2), px; None without a texture."""
    face_index: NDArray[np.int32] | None = None
    """Place in ``nominal`` of the face that every triangle belongs to, (m,); None where the file
    has no faces."""
    nominal: tuple[NominalFace, ...] = ()
    """Faces of the drawing; empty where the file has triangles only."""
    chord_mm: float | None = None
    """Largest distance between a face and its triangles, mm; None where the file has triangles
    only."""

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices_mm)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise InputError(f"mesh: expected finite vertices (n, 3), got shape {vertices.shape}")
        faces = unmasked(self.faces, "faces")
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "ui":
            raise InputError(
                f"mesh: expected faces (m, 3) of whole numbers, got {faces.dtype} {faces.shape}"
            )
        if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise InputError(
                f"mesh: expected corners from 0 to {len(vertices) - 1}, got {faces.min()} to "
                f"{faces.max()}"
            )
        for name in ("sigma_mm", "colour", "filled"):
            values = getattr(self, name)
            if values is not None and (not np.ndim(values) or len(values) != len(vertices)):
                raise InputError(
                    f"mesh: expected {name} of {len(vertices)} vertices, got {np.shape(values)}"
                )
        self._check_texture()
        self._check_nominal(len(faces))
        object.__setattr__(self, "faces", faces.astype(np.uint32))
        super().__post_init__()

    def _check_nominal(self, count: int) -> None:
        index = self.face_index
        if index is None:
            return
        known = np.ndim(index) == 1 and len(index) == count and np.asarray(index).dtype.kind in "ui"
        if not known or (count and not (0 <= np.min(index) <= np.max(index) < len(self.nominal))):
            raise InputError(
                f"mesh: expected the places of {count} triangles among {len(self.nominal)} faces, "
                f"got face_index of shape {np.shape(index)}"
            )

    def _check_texture(self) -> None:
        if self.texture is None and self.texture_px is None:
            return
        picture = np.asarray(self.texture).shape
        place = np.asarray(self.texture_px)
        if len(picture) not in (2, 3) or 0 in picture or picture[2:] not in ((), (3,)):
            raise InputError(f"mesh: expected a texture (h, w) or (h, w, 3), got shape {picture}")
        known = place.dtype.kind in "fiu" and place.shape == (len(self.vertices_mm), 2)
        if not known or not np.isfinite(place).all():
            raise InputError(
                f"mesh: expected texture_px of {len(self.vertices_mm)} finite places, got "
                f"{place.dtype} {place.shape}"
            )
