"""Surfaces: normals, triangles and heights of point clouds; points of height maps; fitted forms."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
