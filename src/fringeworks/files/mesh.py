"""Meshes and drawings of other programs: for the virtual rig, and as models."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.cad import CAD_SUFFIXES, Drawn
from fringeworks.files.limits import existing_file, parsing, read_content
from fringeworks.files.mesh_writer import METRE
from fringeworks.files.ply import own_triangles, read_ply
from fringeworks.files.point_readers import check_unit
from fringeworks.files.point_table import COLOURS
from fringeworks.files.points import columns_of
from fringeworks.files.provenance import from_comments
from fringeworks.files.threemf import SUFFIX as SUFFIX_3MF
from fringeworks.files.threemf import read_3mf
from fringeworks.simulate.bodies import Mesh
from fringeworks.surface.closest import numbered
from fringeworks.types import (
    FileProblem,
    Finding,
    FloatMap,
    InputError,
    MissingPackage,
    TriangleMesh,
)

SUFFIXES = (".stl", ".ply", ".obj", ".off", ".glb", SUFFIX_3MF)
"""Kinds of files that are read."""
INWARDS = "the triangles of the model pointed inwards and were turned over"
"""Said of a closed model whose triangles run clockwise as seen from outside."""
MIXED = "neighbouring triangles of the model point to opposite sides: signs may be wrong"
"""Said of a model whose triangles do not all run the same way round."""
OPEN = (
    "the model is not closed: distances beyond its borders have no sure sign, and which side is "
    "outside follows from its triangles alone"
)
"""Said of a model with borders."""


def read_mesh(path: StrPath, *, scale: float = 1.0) -> Mesh:
    """Read triangles from STL, PLY, OBJ or OFF for the virtual rig.

    Parameters
    ----------
    path : Path
    scale : float > 0
        mm per unit of the file.

    Raises
    ------
    FileProblem for a missing or damaged file and one without triangles; MissingPackage where the
    package ``trimesh`` (the extra "mesh") is not installed.
    """
    return Mesh(*_triangles(path, scale))


def read_model(path: StrPath, *, scale: float = 1.0, chord_mm: float | None = None) -> TriangleMesh:
    """Read the model of a part, as a drawing program writes it.

    Parameters
    ----------
    path : Path
        ``.stl`` (binary or text), ``.ply``, ``.obj``, ``.off``, ``.3mf``, whose unit is read, or
        ``.glb``, which is in metres. ``.step``, ``.stp``, ``.iges``, ``.igs``: drawings with faces,
        whose unit is read.
    scale : float > 0
        mm per unit of the file: 25.4 for inches; of files with a unit, a factor.
    chord_mm : float > 0, optional
        Largest distance between a face of a drawing and its triangles, mm; by default 1e-5 of the
        part's size. Distances from planes, cylinders, cones, spheres and tori are exact.

    Returns
    -------
    TriangleMesh. Vertices at one place are one. Triangles of a closed model point outwards;
    findings say where they did not, and where the model is open. Of a drawing, ``nominal`` has its
    faces, and ``face_index`` the face of every triangle.

    Raises
    ------
    FileProblem for a missing or damaged file and one without triangles; MissingPackage where the
    package ``trimesh`` (the extra "mesh") is not installed, or ``cascadio`` (the extra "cad") for
    a drawing.
    """
    drawn = _drawing(path, scale, chord_mm)
    if drawn is None and chord_mm is not None:
        raise InputError(f"chord_mm: expected a drawing ({', '.join(CAD_SUFFIXES)}), got {path}")
    vertices, faces = _triangles(path, scale) if drawn is None else (drawn.vertices, drawn.faces)
    vertices, number = numbered(vertices)
    faces = number[faces]
    kept = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    faces = faces[kept]
    if not len(faces):
        raise FileProblem(f"{path}: expected triangles with an area, got none")
    faces, seen = _outwards(vertices, faces)
    mesh = TriangleMesh(
        vertices, faces.astype(np.uint32), findings=tuple(Finding("model", one) for one in seen)
    )
    if drawn is None:
        return mesh
    notes = tuple(Finding("model", one) for one in drawn.notes)
    return replace(
        mesh,
        findings=(*mesh.findings, *notes),
        face_index=drawn.face_index[kept],
        nominal=drawn.nominal,
        chord_mm=drawn.chord_mm,
    )


def _drawing(path: StrPath, scale: float, chord_mm: float | None) -> Drawn | None:
    """A drawing with faces; None for a file of triangles."""
    if Path(path).suffix.lower() not in CAD_SUFFIXES:
        return None
    if not 0 < scale < np.inf:
        raise InputError(f"scale: expected > 0, got {scale}")
    return Drawn(existing_file(path, "a drawing"), scale, chord_mm)


def read_triangles(path: StrPath) -> TriangleMesh:
    """Read a mesh with all that the file says of it.

    Parameters
    ----------
    path : path
        ``.ply``: the vertices as they are, with σ, colour, and the mark of filled ones. ``.stl``,
        ``.obj``, ``.off``, ``.3mf``, ``.glb``: as ``read_model``.

    Returns
    -------
    TriangleMesh

    Raises
    ------
    InputError for displacements in px, and the errors of ``read_model``. A PLY file that
    fringeworks wrote needs no package.
    """
    path = existing_file(path, "a mesh file")
    if path.suffix.lower() != ".ply":
        return read_model(path)
    table, comments = read_ply(path)
    check_unit(path, comments)
    own = own_triangles(path)
    faces = _triangles(path, 1.0)[1] if own is None else own
    with parsing(path, "a mesh"):
        filled = columns_of(table, ("filled",))
        return TriangleMesh(
            columns_of(table, "xyz"),
            np.asarray(faces, np.uint32),
            columns_of(table, ("sigma",)),
            columns_of(table, COLOURS),
            None if filled is None else filled != 0,
            provenance=from_comments(comments),
        )


def _outwards(
    vertices: FloatMap, faces: NDArray[np.int64]
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Triangles that point outwards, and what to know about them."""
    p, q = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    _, directed = np.unique(p * len(vertices) + q, return_counts=True)
    either = np.minimum(p, q) * len(vertices) + np.maximum(p, q)
    _, shared = np.unique(either, return_counts=True)
    notes = [MIXED] if directed.max() > 1 else []
    if (shared == 1).any():
        return faces, (*notes, OPEN)
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    if not notes and float(np.einsum("nc,nc->", a, np.cross(b, c))) < 0:
        return faces[:, ::-1], (INWARDS,)
    return faces, tuple(notes)


def _triangles(path: StrPath, scale: float) -> tuple[FloatMap, NDArray[np.int64]]:
    """Vertices in mm and faces of a file."""
    path = existing_file(path, "a mesh file")
    if path.suffix.lower() not in SUFFIXES:
        known = ", ".join((*SUFFIXES, *CAD_SUFFIXES))
        raise FileProblem(f"{path}: expected one of {known}, got {path.suffix}")
    if not 0 < scale < np.inf:
        raise InputError(f"scale: expected > 0, got {scale}")
    if path.suffix.lower() == SUFFIX_3MF:
        vertices, faces = read_3mf(path)
        with parsing(path, "a readable mesh"):
            return scale * _checked(vertices, faces), faces
    try:
        import trimesh
    except ImportError as error:
        raise MissingPackage(
            "meshes: expected the package trimesh, got none; pip install 'fringeworks[mesh]'"
        ) from error
    content = read_content(path, "a mesh")
    with parsing(path, "a readable mesh"):
        # Without the path, trimesh opens no other file that this one names.
        kind = path.suffix.lower()[1:]
        loaded = trimesh.load_mesh(BytesIO(content), file_type=kind, process=False)
        vertices = np.asarray(loaded.vertices, np.float64)
        faces = np.asarray(loaded.faces, np.int64)
        vertices = _checked(vertices, faces)
        if kind == "glb":
            vertices = vertices / (METRE, -METRE, -METRE)
        return scale * vertices, faces


def _checked(vertices: FloatMap, faces: NDArray[np.int64]) -> FloatMap:
    """The vertices, if the triangles are fit for them."""
    if not faces.size:
        raise FileProblem("expected triangles, got none")
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise FileProblem("expected triangles of vertices with x, y and z, got others")
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise FileProblem("expected triangles of vertices in the file, got others")
    if not np.isfinite(vertices[faces]).all():
        raise FileProblem("expected finite vertices, got NaN or infinity")
    return vertices
