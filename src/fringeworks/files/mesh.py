"""Meshes of other programs for the virtual rig, read by trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fringeworks.simulate.bodies import Mesh
from fringeworks.types import InputError

SUFFIXES = (".stl", ".ply", ".obj", ".off")


def read_mesh(path: Path, *, scale: float = 1.0) -> Mesh:
    """Read triangles from STL, PLY, OBJ or OFF.

    Parameters
    ----------
    path : Path
    scale : float > 0
        mm per unit of the file.

    Raises
    ------
    InputError for a missing or damaged file, one without triangles, and where the package
    ``trimesh`` (the extra "mesh") is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a mesh file, got no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected one of {', '.join(SUFFIXES)}, got {path.suffix}")
    if not scale > 0:
        raise InputError(f"scale: expected > 0, got {scale}")
    try:
        import trimesh
    except ImportError as error:
        raise InputError(
            "meshes: expected the package trimesh, got none; pip install 'fringeworks[mesh]'"
        ) from error
    try:
        loaded = trimesh.load_mesh(path, process=False)
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    except Exception as error:  # trimesh raises whatever its readers raise
        raise InputError(f"{path}: expected a readable mesh, got: {error}") from error
    if not len(faces):
        raise InputError(f"{path}: expected triangles, got none")
    return Mesh(scale * vertices, faces)
