"""The demonstration's second part: a virtual rig calibrated from its board, then measured with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.evaluate.errors import Row
from fringeworks.files.atomic import write_text
from fringeworks.files.points import write_points
from fringeworks.files.rig import write_rig
from fringeworks.files.stack import write_stack
from fringeworks.pipeline import calibrate_stacks
from fringeworks.report import figures
from fringeworks.report.summary import calibration_summary
from fringeworks.report.tables import format_table
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.triangulate import triangulate
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.standard_rig import (
    board_body,
    board_poses,
    bust,
    fringe_plan,
    standard_rig,
    truth_distance,
)
from fringeworks.simulate.virtual_rig import Optics, look, photograph
from fringeworks.stack.decode import decode
from fringeworks.stack.even_light import texture
from fringeworks.stack.frames import Stack
from fringeworks.surface.form import fit_form
from fringeworks.types import FloatMap, PointCloud, Reason, Rig

BOARD = "chessboard:11x8:12"
POSES = 8
RADIUS_MM = 25.0


def write_rig_demo(
    folder: Path, *, scale: float = 1.0, progress: Callable[[str], None] = lambda _: None
) -> tuple[list[Row], list[Path]]:
    """Calibrate the standard rig from photographs of its board; measure a bust, a ball, a plane.

    Parameters
    ----------
    folder : Path
        Existing folder for the rig, one capture, points, pictures and a table.
    scale : float
        Size of the frames over 1280 × 1024.
    progress : callable
        Called with the name of each step.

    Returns
    -------
    Rows of the table, and the paths of the pictures.
    """
    truth = standard_rig(scale=scale)
    found = _calibrated(truth, folder, progress)
    rows: list[Row] = []
    pictures: list[Path] = []
    place = pose(rotation(np.array([0.2, 0.15, 0.0])), np.array([0.0, 0.0, 500.0]))
    scenes = {
        "bust": bust(),
        "sphere": [Body(Sphere(RADIUS_MM), pose(np.eye(3), np.array([5.0, 3.0, 500.0])))],
        "plane": [Body(Plane(150.0, 110.0), place)],
    }
    for k, (name, bodies) in enumerate(scenes.items()):
        progress(f"rig: {name}")
        view, plan = look(truth, bodies), fringe_plan(truth, both=False)
        frames = list(photograph(view, plan, Optics(seed=50 + k)))
        cloud = triangulate(decode(frames, plan), found, colour=texture(frames, plan))
        error = truth_distance(view.points_mm, cloud.xyz_mm)
        rows.append(_row(name, cloud, np.where(view.lit, error, np.nan)))
        if name == "bust":
            write_stack(folder / "bust", frames, plan, truth=view.truth)
        write_points(folder / f"{name}.ply", cloud, kind="mesh")
        sheet = figures.points_sheet(f"{name}, measured by a calibrated virtual rig", cloud)
        pictures.append(figures.save(sheet, folder / f"rig_{name}.png"))
        maps = {"error along the ray": error, "σ": cloud.sigma_mm}
        errors = figures.error_maps(f"{name}: measured minus true", maps)
        pictures.append(figures.save(errors, folder / f"rig_{name}_error.png"))
    write_text(folder / "rig.md", format_table(rows, "markdown"))
    return rows, pictures


def _calibrated(truth: Rig, folder: Path, progress: Callable[[str], None]) -> Rig:
    board, plan = parse_board(BOARD), fringe_plan(truth)

    def stacks() -> Any:
        for k, T in enumerate(board_poses(board, POSES, seed=1)):
            view = look(truth, [board_body(board, T)])
            yield f"pose {k}", Stack(list(photograph(view, plan, Optics(seed=k))), plan)

    calibration = calibrate_stacks(
        stacks(), board, progress=lambda text: progress(f"rig: calibrating, {text}")
    )
    write_rig(folder / "rig.toml", calibration.rig)
    content = calibration_summary(calibration)
    lines = [f"- {f['cause']}: {f['message']}" for f in content["findings"]]
    write_text(folder / "calibration.md", "\n".join(["# Calibration", "", *lines, ""]))
    return calibration.rig


def _row(name: str, cloud: PointCloud, error: FloatMap) -> Row:
    ok = np.isfinite(error)
    row: dict[str, Any] = {
        "object": name,
        "points": int(ok.sum()),
        "median_abs_error_mm": float(np.median(np.abs(error[ok]))),
        "median_sigma_mm": float(np.median(cloud.sigma_mm[ok])),
        "within_1_sigma": float(np.mean(np.abs(error[ok]) < cloud.sigma_mm[ok])),
        "form_deviation_mm": float("nan"),
        "radius_error_mm": float("nan"),
    }
    if name in ("sphere", "plane"):
        points = cloud.xyz_mm[cloud.reason == Reason.OK]
        form = fit_form(points, "sphere" if name == "sphere" else "plane")
        row["form_deviation_mm"] = form.deviation_mm
        if name == "sphere":
            row["radius_error_mm"] = float(form.parameters["radius_mm"]) - RADIUS_MM  # type: ignore[arg-type]
    return row
