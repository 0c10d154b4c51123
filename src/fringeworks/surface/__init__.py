"""Height maps and point clouds: triangles, normals, fitted bodies."""
