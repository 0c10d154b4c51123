"""The demonstration: three bodies, ideal and as a camera sees them, and a photographed pair."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.evaluate.errors import Row, error_map, errors
from fringeworks.files.atomic import make_folder, write_text
from fringeworks.files.pair import read_pair, write_pair
from fringeworks.files.surfaces import write_surface
from fringeworks.pipeline import Reconstruction, reconstruct
from fringeworks.report import figures
from fringeworks.report.tables import format_table
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import HeightMap, Pair

BODIES = ("parabola", "cube", "cylinder")
CASES: dict[str, dict[str, Any]] = {
    "ideal": {},
    "camera": {
        "gamma": 2.2,
        "noise": 2.0,
        "bits": 8,
        "painted": True,
        "fringes": 20,
        "height_mm": 50.0,
        "seed": 1,
    },
}
"""Settings of the standard scene: ideal, and with projector response, noise, 8 bit and paint."""
METHODS = ("gsifa", "exact", "fourier", "windowed")
DATA_VARIABLE = "FRINGEWORKS_DATA"
COLUMNS = (
    "object",
    "case",
    "method",
    "mean_abs_error_mm",
    "std_error_mm",
    "max_abs_error_mm",
    "edge_mean_abs_error_mm",
    "inner_mean_abs_error_mm",
    "failed_fraction",
    "within_1_sigma",
    "seconds",
)


def write_demo(
    out: Path, *, size: int = 1000, progress: Callable[[str], None] = lambda _: None
) -> tuple[list[Row], list[Path]]:
    """Measure three bodies, ideal and as a camera sees them; and a real cone where there is one.

    Parameters
    ----------
    out : Path
        Folder for tables, pictures, one capture and one point cloud.
    size : int
        Side of the frames, px.
    progress : callable
        Called with the name of each step.

    Returns
    -------
    Rows of the error table, and the paths of the pictures.
    """
    folder = make_folder(out)
    rows: list[Row] = []
    pictures: list[Path] = []
    for case, settings in CASES.items():
        lines = []
        for body in BODIES:
            progress(f"{body}, {case}")
            scene = standard_scene(body, size=size, **settings)
            results = {name: reconstruct(scene, name) for name in METHODS}
            rows += [_row(body, case, scene, result) for result in results.values()]
            lines.append(_line(body, scene, results))
            if (body, case) == ("parabola", "camera"):
                write_pair(folder / "capture", scene)
                write_surface(folder / "parabola.ply", results["windowed"].surface)
        title = f"{case}: {_describe(settings)}"
        sheet = figures.overview(title, lines)
        pictures.append(figures.save(sheet, folder / f"{case}.png"))
    pictures += _photographed_cone(folder, progress)
    write_text(folder / "errors.md", format_table(rows, "markdown"))
    write_text(folder / "errors.json", format_table(rows, "json"))
    return rows, pictures


def _describe(settings: dict[str, Any]) -> str:
    if not settings:
        return "γ = 1, no noise, not quantised"
    return (
        f"γ = {settings['gamma']:g}, noise {settings['noise']:g} counts, "
        f"{settings['bits']} bit, painted, {settings['fringes']} fringes"
    )


def _row(body: str, case: str, scene: Pair, result: Reconstruction) -> Row:
    assert scene.truth_mm is not None
    found = asdict(errors(result.surface, scene.truth_mm))
    row = {"object": body, "case": case, "method": result.surface.method, **found}
    row["seconds"] = result.seconds
    return {name: row[name] for name in COLUMNS}


def _line(
    body: str, scene: Pair, results: dict[str, Reconstruction]
) -> list[tuple[str, np.ndarray, str]]:
    assert scene.truth_mm is not None
    line = [(body, scene.object, "frame")]
    for name in ("windowed", "gsifa"):
        line.append((f"{name}: height", results[name].surface.values, "height"))
    for name in ("windowed", "gsifa", "fourier"):
        line.append((f"{name}: error", error_map(results[name].surface, scene.truth_mm), "error"))
    return line


def _photographed_cone(folder: Path, progress: Callable[[str], None]) -> list[Path]:
    data = os.environ.get(DATA_VARIABLE)
    cone = Path(data) / "pair_cone" if data else None
    if cone is None or not cone.is_dir():
        return []
    progress("photographed cone")
    capture = read_pair(cone / "reference.jpg", cone / "object.jpg")
    surfaces: dict[str, HeightMap] = {}
    pictures = []
    for name in ("windowed", "gsifa", "fourier"):
        surfaces[name] = reconstruct(capture, name).surface
        sheet = figures.surface_sheet(f"photographed cone, {name}", surfaces[name])
        pictures.append(figures.save(sheet, folder / f"cone_{name}.png"))
    view = figures.perspective(
        "photographed cone, windowed: displacement", surfaces["windowed"].values, unit="px"
    )
    pictures.append(figures.save(view, folder / "cone_perspective.png"))
    write_surface(folder / "cone.npz", surfaces["windowed"])
    return pictures
