"""The demonstration: pairs of frames, a photographed pair, and a calibrated virtual rig."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.evaluate.captures import Row
from fringeworks.evaluate.truth_errors import error_map, errors
from fringeworks.files.atomic import StrPath, write_text
from fringeworks.files.folder import FolderWriter, replacing_folder
from fringeworks.files.pair import read_pair, write_pair
from fringeworks.files.surfaces import write_surface
from fringeworks.pipeline.pairs import Reconstruction, reconstruct
from fringeworks.report import figures
from fringeworks.report.drawing import need_plots
from fringeworks.report.tables import format_table
from fringeworks.showcase.demo_rig import rig_demo
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import HeightMap, Pair, made_by
from fringeworks.types.packages import need_opencv

BODIES = ("parabola", "cube", "cylinder")
"""Artificial objects, as in the dissertation."""
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
"""Methods that are compared: the dissertation's best, its exact form, the classic, our default."""
DATA_VARIABLE = "FRINGEWORKS_DATA"
"""Environment variable that names a folder with real captures."""
FULL_SIZE = 1000
"""Frame size at which the virtual rig has its full 1280 × 1024 px."""
MIN_RIG_SCALE = 0.25
"""Smallest scale of the virtual rig at which its boards are still found."""


@dataclass(frozen=True)
class DemoResult:
    """Tables and pictures of the demonstration."""

    rows: tuple[Row, ...]
    """Errors of each method on each artificial object."""
    rig_rows: tuple[Row, ...]
    """Errors of the objects that the calibrated rig measured."""
    pictures: tuple[Path, ...]
    has_photographs: bool
    """Whether a real pair was there to be measured."""


def write_demo(
    out: StrPath,
    *,
    size: int = FULL_SIZE,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> DemoResult:
    """Measure artificial objects by two frames and by a calibrated rig, and a real pair.

    Parameters
    ----------
    out : path
        Folder for tables, pictures, captures and point clouds; new, empty, or an earlier result,
        which is replaced as a whole.
    size : int
        Side of the frames, px.
    force : bool
        Write into a folder with other things in it, too.
    progress : callable
        Called with the name of each step.

    Returns
    -------
    DemoResult
    """
    need_plots("the demonstration")
    need_opencv("the demonstration")
    rows: list[Row] = []
    pictures: list[Path] = []
    origin = made_by("write_demo", options={"size": size})
    with replacing_folder(out, "demo", force=force) as writer:
        for case, settings in CASES.items():
            lines = []
            for body in BODIES:
                progress(f"{body}, {case}")
                scene = standard_scene(body, size=size, **settings)
                results = {name: reconstruct(scene, name) for name in METHODS}
                rows += [_row(body, case, scene, result) for result in results.values()]
                lines.append(_line(body, scene, results))
                if (body, case) == ("parabola", "camera"):
                    write_pair(writer.file("capture"), scene, force=force)
                    write_surface(writer.file("parabola.ply"), results["windowed"].surface)
            sheet = figures.overview(f"{case}: {_describe(settings)}", lines)
            pictures.append(
                figures.save_figure(sheet, writer.file(f"{case}.png"), provenance=origin)
            )
        photographed = _photographed_cone(writer, progress)
        write_text(writer.file("errors.md"), format_table(rows, "markdown"))
        write_text(writer.file("errors.json"), format_table(rows, "json"))
        scale = min(max(size / FULL_SIZE, MIN_RIG_SCALE), 1.0)
        rig_rows, rig_pictures = rig_demo(writer, scale=scale, force=force, progress=progress)
    shown = (*pictures, *photographed, *rig_pictures)
    return DemoResult(tuple(rows), tuple(rig_rows), shown, bool(photographed))


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
    return {"object": body, "case": case, "method": result.surface.method, **found}


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


def _photographed_cone(writer: FolderWriter, progress: Callable[[str], None]) -> list[Path]:
    data = os.environ.get(DATA_VARIABLE)
    cone = Path(data) / "pair_cone" if data else None
    if cone is None or not cone.is_dir():
        return []
    progress("photographed cone")
    pair = read_pair(cone / "reference.jpg", cone / "object.jpg")
    surfaces: dict[str, HeightMap] = {}
    pictures = []
    for name in ("windowed", "gsifa", "fourier"):
        surfaces[name] = reconstruct(pair, name).surface
        sheet = surfaces[name].plot("photographed cone")
        pictures.append(
            figures.save_figure(
                sheet, writer.file(f"cone_{name}.png"), provenance=surfaces[name].provenance
            )
        )
    view = figures.perspective(
        "photographed cone, windowed: displacement", surfaces["windowed"].values, unit="px"
    )
    pictures.append(
        figures.save_figure(
            view,
            writer.file("cone_perspective.png"),
            provenance=surfaces["windowed"].provenance,
        )
    )
    write_surface(writer.file("cone.npz"), surfaces["windowed"])
    return pictures
