"""What is shown of points without a frame, and of meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.kinds.surface import itself
from fringeworks.report.page.blocks import Chapter, Picture
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import facts, findings_block, provenance_block, sigma_with_unit
from fringeworks.report.page.surfaces import surface_block
from fringeworks.report.summary import origin, told
from fringeworks.types import Points, TriangleMesh


def figures(points: Points) -> dict[str, Any]:
    """Number of points and their usual σ."""
    sigma = points.sigma_mm
    return {
        "points": len(points.xyz_mm),
        "median_sigma_mm": None if sigma is None else float(np.median(sigma)),
        **told(points),
        **origin(points.provenance),
    }


def chapter(points: Points, context: Context) -> Chapter:
    """The points to turn, and the distribution of z."""
    xyz = points.xyz_mm
    values = figures(points)
    rows = [
        ("points", f"{len(xyz):,}"),
        ("median σ", sigma_with_unit(values["median_sigma_mm"], "mm")),
    ]
    chart = histogram(xyz[:, 2], "z / mm", what="points")
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            *findings_block(values["findings"]),
            surface_block(points, context, "The points.", lambda: chart),
            Picture(chart, "Distribution of z."),
            *provenance_block(points.provenance),
        ),
    )


def vertices(mesh: TriangleMesh) -> Points:
    """The vertices of a mesh, as which it is shown."""
    return Points(
        np.asarray(mesh.vertices_mm, np.float64),
        None if mesh.sigma_mm is None else np.asarray(mesh.sigma_mm, np.float64),
        findings=mesh.findings,
        provenance=mesh.provenance,
        colour=mesh.colour,
    )


describe(Points, Kind(figures, chapter=chapter, surface=itself))
describe(
    TriangleMesh,
    Kind(
        lambda mesh: figures(vertices(mesh)) | {"triangles": len(mesh.faces)},
        chapter=lambda mesh, context: chapter(vertices(mesh), context),
        surface=vertices,
    ),
)
