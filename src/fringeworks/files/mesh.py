"""Meshes of other programs for the virtual rig, read by the package trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fringeworks.files.atomic import StrPath
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
    path = Path(path)
    if not path.is_file():
        raise FileProblem(f"{path}: expected a mesh file, got no such file")
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
    try:
        loaded = trimesh.load_mesh(path, process=False)
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    except Exception as error:  # trimesh raises whatever its readers raise
        raise FileProblem(f"{path}: expected a readable mesh, got: {error}") from error
    if not len(faces):
        raise FileProblem(f"{path}: expected triangles, got none")
    return Mesh(scale * vertices, faces)
