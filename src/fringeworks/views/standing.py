"""A closed mesh as it stands on a plate: z up, its lowest point at z = 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from fringeworks.types import FloatMap, InputError, TriangleMesh, sealed

Up = Literal["board", "unseen", "x", "-x", "y", "-y", "z", "-z"]
"""What is up: away from a board, away from the side that no view has seen, or an axis."""
Origin = Literal["plate", "part"]
"""Where the origin goes: below the part's middle on its plate, or nowhere."""
AXES = {f"{sign}{name}": k for k, name in enumerate("xyz") for sign in ("", "-")}
"""Axes by their names."""


def stand_mesh(mesh: TriangleMesh, up: Up = "unseen", *, origin: Origin = "plate") -> TriangleMesh:
    """Turn a closed mesh so that z is up, and put it on its plate.

    Parameters
    ----------
    mesh : TriangleMesh
        In the coordinates of a ``MergedPart``.
    up : "board", "unseen", "x", "-x", "y", "-y", "z" or "-z"
        Direction that becomes z. ``board``: away from the board that the coordinates are those of
        (its z axis points into it). ``unseen``: away from the side that no view has seen, on which
        a part stands.
    origin : "plate" or "part"
        ``plate``: the lowest point gets z = 0, and the middle of the part x = y = 0. ``part``: the
        origin stays where it is.

    Returns
    -------
    TriangleMesh

    Raises
    ------
    InputError for other words, a mesh without vertices, and ``unseen`` where every side was seen.

    Notes
    -----
    The areas of a closed surface add up to zero as vectors. Those of the triangles that were not
    measured therefore point to the side that was not seen.

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, -4]], np.float32)
    >>> faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.uint32)
    >>> stood = stand_mesh(TriangleMesh(corners, faces), "board")
    >>> np.round(stood.vertices_mm[:, 2], 3).tolist()
    [0.0, 0.0, 0.0, 4.0]
    """
    if origin not in ("plate", "part"):
        raise InputError(f"origin: expected plate or part, got {origin!r}")
    vertices = np.asarray(mesh.vertices_mm, np.float64)
    if not len(vertices):
        raise InputError("mesh: expected vertices, got none")
    turn = _turn(_up(mesh, vertices, up))
    placed = vertices @ turn.T
    if origin == "plate":
        low, high = placed.min(axis=0), placed.max(axis=0)
        placed = placed - [*(0.5 * (low + high))[:2], low[2]]
    return replace(mesh, vertices_mm=sealed(placed.astype(np.float32)))


def _up(mesh: TriangleMesh, vertices: FloatMap, up: str) -> FloatMap:
    """The direction that becomes z, of length 1."""
    if up == "board":
        return np.array([0.0, 0.0, -1.0])
    if up in AXES:
        return np.asarray((-1.0 if up[0] == "-" else 1.0) * np.eye(3)[AXES[up]])
    if up != "unseen":
        raise InputError(f"up: expected board, unseen or one of {', '.join(AXES)}, got {up!r}")
    filled = np.zeros(len(vertices), bool) if mesh.filled is None else mesh.filled
    a, b, c = (vertices[mesh.faces[:, k]] for k in range(3))
    unseen = filled[mesh.faces].all(axis=1)
    down = np.cross(b - a, c - a)[unseen].sum(axis=0)
    size = float(np.linalg.norm(down))
    if not size > 0:
        raise InputError("up: expected a side that no view has seen, got none; name an axis")
    return np.asarray(-down / size)


def _turn(up: FloatMap) -> FloatMap:
    """The smallest rotation that brings a direction to z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if np.linalg.norm(axis) < np.finfo(np.float32).eps:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
