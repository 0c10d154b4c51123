"""Meshes as files for other programs: STL, OBJ, glTF by trimesh; PLY, VTP and 3MF by our own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.ply import write_ply
from fringeworks.files.provenance import comment_lines
from fringeworks.files.texture import Texture, texture_of, write_textured_obj
from fringeworks.files.threemf import SUFFIX as SUFFIX_3MF
from fringeworks.files.threemf import write_3mf
from fringeworks.files.vtk import VTP, write_mesh_as_vtp
from fringeworks.files.white import eight_bits, white_of
from fringeworks.types import InputError, MissingPackage, TriangleMesh

SUFFIXES = (".stl", ".obj", ".glb", SUFFIX_3MF, ".ply", VTP)
"""Kinds of files that are written."""
TEXTURED = (".obj", ".glb")
"""Kinds that hold a texture."""
METRE = 1e-3
"""m/mm: glTF counts in metres."""


def write_mesh(path: StrPath, mesh: TriangleMesh) -> None:
    """Write a mesh in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : path
        ``.stl`` (binary) and ``.obj`` in mm; ``.glb`` (glTF) in metres, y up and z towards the
        viewer. A mesh with a texture gets it in ``.glb``, and beside ``.obj`` as
        ``NAME.texture.png`` and ``NAME.texture.mtl``, in sRGB; others have the colour of their
        vertices. ``.3mf`` in mm; ``.ply`` and ``.vtp`` (ParaView) in mm, with σ and the mark of
        filled vertices. All but STL keep the colour.
    mesh : TriangleMesh

    Raises
    ------
    FileProblem for another suffix and a folder that cannot be written to; InputError for a mesh
    without triangles; MissingPackage where the package ``trimesh`` (the extra "mesh") is not
    installed, which PLY, VTP and 3MF do not need.
    """
    check_target(path, SUFFIXES)
    if not len(mesh.faces):
        raise InputError(f"{path}: expected triangles to write, got none")
    suffix = Path(path).suffix.lower()
    texture = texture_of(mesh) if suffix in TEXTURED else None
    if texture is not None and suffix == ".obj":
        write_textured_obj(Path(path), mesh, texture)
        return
    with replacing(path) as temporary:
        if suffix == ".ply":
            _write_ply(temporary, mesh)
        elif suffix == VTP:
            write_mesh_as_vtp(temporary, mesh)
        elif suffix == SUFFIX_3MF:
            write_3mf(temporary, mesh.vertices_mm, mesh.faces, _shown(mesh))
        else:
            temporary.write_bytes(_exported(mesh, suffix[1:], texture))


def _exported(mesh: TriangleMesh, kind: str, texture: Texture | None) -> bytes:
    try:
        import trimesh
    except ImportError as error:
        raise MissingPackage(
            "meshes: expected the package trimesh, got none; pip install 'fringeworks[mesh]'"
        ) from error
    vertices = np.asarray(mesh.vertices_mm, np.float64)
    if kind == "glb":
        vertices = vertices * (METRE, -METRE, -METRE)
    if texture is None:
        shown = trimesh.Trimesh(vertices, mesh.faces, vertex_colors=_shown(mesh), process=False)
    else:
        shown = trimesh.Trimesh(vertices, mesh.faces, visual=_visual(texture), process=False)
    content = shown.export(file_type=kind)
    return content.encode() if isinstance(content, str) else bytes(content)


def _visual(texture: Texture) -> Any:
    """A picture on a dull surface, as trimesh has it."""
    from PIL import Image
    from trimesh.visual.material import PBRMaterial
    from trimesh.visual.texture import TextureVisuals

    dull: Any = PBRMaterial
    visual: Any = TextureVisuals
    picture = Image.fromarray(texture.shown)
    material = dull(baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=1.0)
    return visual(uv=texture.uv, material=material)


def _shown(mesh: TriangleMesh) -> NDArray[np.uint8] | None:
    """Red, green and blue of the vertices, (n, 3); None where they are unknown."""
    white = None if mesh.colour is None else white_of(mesh.colour)
    if mesh.colour is None or white is None:
        return None
    return eight_bits(mesh.colour, white)


def _write_ply(path: Path, mesh: TriangleMesh) -> None:
    columns: dict[str, Any] = dict(zip("xyz", mesh.vertices_mm.T, strict=True))
    if mesh.sigma_mm is not None:
        columns["sigma"] = mesh.sigma_mm
    fields = [(name, "<f4") for name in columns]
    shown = _shown(mesh)
    if shown is not None:
        columns |= dict(zip(("red", "green", "blue"), shown.T, strict=True))
    if mesh.filled is not None:
        columns["filled"] = mesh.filled
    fields += [(name, "u1") for name in columns if name not in dict(fields)]
    table = np.empty(len(mesh.vertices_mm), dtype=fields)
    for name, values in columns.items():
        table[name] = values
    comments = ["fringeworks; mesh; unit mm", *comment_lines(mesh.provenance)]
    write_ply(path, [table], len(table), mesh.faces.astype(np.int32), comments)
