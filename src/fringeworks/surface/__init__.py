"""Surfaces: normals, triangles and heights of point clouds; points of height maps; fitted forms."""
