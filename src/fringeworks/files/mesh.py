"""Meshes of other programs for the virtual rig, read by the package trimesh."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.limits import existing_file, parsing, read_content
from fringeworks.simulate.bodies import Mesh
from fringeworks.types import FileProblem, InputError, MissingPackage

SUFFIXES = (".stl", ".ply", ".obj", ".off")
"""Kinds of files that are read."""


def read_mesh(path: StrPath, *, scale: float = 1.0) -> Mesh:
    """Read triangles from STL, PLY, OBJ or OFF.

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
    path = existing_file(path, "a mesh file")
    if path.suffix.lower() not in SUFFIXES:
        raise FileProblem(f"{path}: expected one of {', '.join(SUFFIXES)}, got {path.suffix}")
    if not scale > 0:
        raise InputError(f"scale: expected > 0, got {scale}")
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
        if not faces.size:
            raise FileProblem("expected triangles, got none")
        if not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise FileProblem("expected triangles of vertices in the file, got others")
        if not np.isfinite(vertices[faces]).all():
            raise FileProblem("expected finite vertices, got NaN or infinity")
        return Mesh(scale * vertices, faces)
