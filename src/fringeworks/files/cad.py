"""Drawings as STEP and IGES, read by the package cascadio: triangles, and nominal faces."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import util
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.apart import read_apart
from fringeworks.files.limits import parsing, read_content
from fringeworks.files.part21 import face_names, parse_part21
from fringeworks.types import FileProblem, FloatMap, InputError, MissingPackage, NominalFace

STEP_SUFFIXES = (".step", ".stp")
"""Suffixes of STEP files."""
CAD_SUFFIXES = (*STEP_SUFFIXES, ".iges", ".igs")
"""Suffixes of drawings with faces."""
CHORD_SHARE = 1e-5
"""Largest distance between a free-form face and its triangles, as a share of the part's size: 1 µm
for 100 mm. Fringe projection reaches a σ of about 1e-4 of the size, and a tenth of it is wanted."""
ROUND_CHORD_SHARE = 5e-5
"""The same for drawings without free-form faces: their distances are exact (``MeshDistance``), and
coarser triangles are found faster."""
FIRST_CHORD = 0.01
"""Chord error of the first reading, which finds the size of the part, as a share of each edge."""
ANGLE_RAD = 0.2
"""Largest angle between neighbouring triangles of a face, rad: below the 15° above which
``MeshDistance`` takes an edge for a sharp one."""
CPU_SECONDS = 300
"""Processor time that the reading of a drawing may take; one of 10,000 faces takes a minute."""
MOST_BYTES = 2 << 30
"""Largest size of the triangles of a drawing: 50 million of them."""
METRE_MM = 1000.0
"""Millimetres per metre: triangles of STEP files and all nominal forms are in metres."""
NO_NAMES = "the names of the faces in the drawing could not be told apart: they have numbers only"
"""Said where the file lists other faces than the geometry kernel."""


class Drawn:
    """Triangles and faces of a drawing."""

    def __init__(self, path: Path, scale: float, chord_mm: float | None) -> None:
        need_cascadio()
        if chord_mm is not None and not 0 < chord_mm < math.inf:
            raise InputError(f"chord_mm: expected > 0 mm, got {chord_mm}")
        kind = "step" if path.suffix.lower() in STEP_SUFFIXES else "iges"
        self.chord_mm = chord_mm
        """Largest distance between a face and its triangles, mm."""
        if chord_mm is None:
            rough, _, _, faces = _triangles(path, kind, FIRST_CHORD, relative=True)
            free = any(face.kind == "free-form" for face in faces)
            share = CHORD_SHARE if free else ROUND_CHORD_SHARE
            self.chord_mm = share * scale * float(np.linalg.norm(np.ptp(rough, axis=0)))
        assert self.chord_mm is not None
        vertices, self.faces, self.face_index, nominal = _triangles(
            path, kind, self.chord_mm / scale, relative=False
        )
        self.vertices: FloatMap = scale * vertices
        """(n, 3), mm."""
        self.notes: tuple[str, ...] = ()
        """What to know about the drawing."""
        self.nominal = tuple(_scaled(one, scale) for one in nominal)
        if kind == "step":
            self._name(path)

    def _name(self, path: Path) -> None:
        """Give the faces the names of the file, where it lists as many."""
        with parsing(path, "a STEP file"):
            text = read_content(path, "a STEP file").decode("utf-8", "replace")
            named = face_names(parse_part21(text))
        if not any(name for _, name in named):
            return
        if len(named) != len(self.nominal):
            self.notes = (NO_NAMES,)
            return
        pairs = zip(self.nominal, named, strict=True)
        self.nominal = tuple(replace(face, name=name) for face, (_, name) in pairs)


def need_cascadio() -> None:
    """Refuse drawings where the packages that read them are not installed.

    Raises
    ------
    MissingPackage
    """
    for package in ("cascadio", "trimesh"):
        if util.find_spec(package) is None:
            raise MissingPackage(
                f"STEP and IGES: expected the package {package}, got none; "
                "pip install 'fringeworks[cad]'"
            )


def _triangles(
    path: Path, kind: str, chord_mm: float, *, relative: bool
) -> tuple[FloatMap, NDArray[np.int64], NDArray[np.int32], list[NominalFace]]:
    """Vertices in mm of the file's own unit, triangles, their faces, and the nominal forms."""
    import trimesh

    # Triangles of IGES files come in mm, those of STEP files in metres.
    unit = METRE_MM if kind == "step" else 1.0
    given = [str(path.resolve()), kind, repr(chord_mm), "relative" if relative else "absolute"]
    with parsing(path, "a readable drawing (STEP or IGES)"):
        content = read_apart(
            "cad_process.py",
            [*given, str(ANGLE_RAD)],
            MOST_BYTES,
            CPU_SECONDS,
            "a readable drawing (STEP or IGES)",
        )
        if not content:
            raise FileProblem("expected a drawing with faces, got none")
        scene = trimesh.load_scene(BytesIO(content), file_type="glb", process=False)
        return _joined(scene, unit)


def _joined(
    scene: Any, unit: float
) -> tuple[FloatMap, NDArray[np.int64], NDArray[np.int32], list[NominalFace]]:
    """All parts of a drawing in its coordinates."""
    vertices, faces, index, nominal = [], [], [], list[NominalFace]()
    corners = 0
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        mesh = scene.geometry[name]
        turn, shift = pose[:3, :3], unit * pose[:3, 3]
        vertices.append(unit * np.asarray(mesh.vertices, np.float64) @ turn.T + shift)
        faces.append(np.asarray(mesh.faces, np.int64) + corners)
        index.append(np.asarray(mesh.face_attributes["brep_index"], np.int32) + len(nominal))
        found = mesh.metadata["cascadio"]["brep_faces"]
        nominal += [_face(one, len(nominal) + k, turn, shift) for k, one in enumerate(found, 1)]
        corners += len(mesh.vertices)
    if not faces:
        raise FileProblem("expected a drawing with faces, got none")
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(index), nominal


def _face(found: dict[str, Any], number: int, turn: FloatMap, shift: FloatMap) -> NominalFace:
    """The nominal form of a face, in mm."""
    kind = str(found["type"])
    if kind not in ("plane", "cylinder", "cone", "sphere", "torus"):
        return NominalFace(number, "free-form")
    place = next(found[key] for key in ("origin", "apex", "center") if key in found)
    origin = turn @ (METRE_MM * np.asarray(place, np.float64)) + shift
    axis = turn @ np.asarray(found.get("normal", found.get("axis", (0.0, 0.0, 1.0))), np.float64)
    axis = axis / np.linalg.norm(axis)
    radius = found.get("major_radius", found.get("radius"))
    tube, angle = found.get("minor_radius"), found.get("semi_angle")
    return NominalFace(
        number,
        kind,  # type: ignore[arg-type]  # one of those above
        "",
        (float(origin[0]), float(origin[1]), float(origin[2])),
        (float(axis[0]), float(axis[1]), float(axis[2])),
        None if radius is None else METRE_MM * float(radius),
        None if tube is None else METRE_MM * float(tube),
        None if angle is None else abs(math.degrees(float(angle))),
    )


def _scaled(face: NominalFace, scale: float) -> NominalFace:
    x, y, z = face.origin_mm
    return replace(
        face,
        origin_mm=(scale * x, scale * y, scale * z),
        radius_mm=None if face.radius_mm is None else scale * face.radius_mm,
        tube_mm=None if face.tube_mm is None else scale * face.tube_mm,
    )
