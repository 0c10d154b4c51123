"""The demonstration's second part: a virtual rig calibrated from its board, then measured with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.evaluate.captures import Row
from fringeworks.files.atomic import write_text
from fringeworks.files.folder import FolderWriter
from fringeworks.files.points import write_points
from fringeworks.files.rig import write_rig
from fringeworks.files.stack import write_stack
from fringeworks.pipeline.boards import calibrate_stacks
from fringeworks.pipeline.stacks import Measurement, measure
from fringeworks.report import figures
from fringeworks.report.maps import draw_sheet
from fringeworks.report.page.report import write_report
from fringeworks.report.sheets import Panel, Sheet
from fringeworks.report.summary import summarise
from fringeworks.report.tables import format_table
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import (
    board_body,
    board_poses,
    bust,
    fringe_plan,
    standard_rig,
    truth_distance,
)
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.frames import Stack
from fringeworks.surface.form import fit_form
from fringeworks.types import FloatMap, PointCloud, Reason, Rig

BOARD = "chessboard:11x8:12"
"""Board of the calibration: it fills two thirds of the standard rig's field of 200 mm."""
POSES = 8
"""Poses of the board; more take longer and improve the demonstration little."""
RADIUS_MM = 25.0
"""Radius of the ball: the 50 mm that VDI/VDE 2634 artefacts of this field have."""
FIRST_SEED = 50
"""Seed of the first scene's noise, away from those of the board's poses."""


def rig_demo(
    writer: FolderWriter,
    *,
    scale: float = 1.0,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Row], list[Path]]:
    """Calibrate the standard rig from photographs of its board; measure a bust, a ball, a plane.

    Parameters
    ----------
    writer : FolderWriter
        Of the folder for the rig, one capture, points, pictures and a table.
    scale : float
        Size of the frames over 1280 × 1024.
    force : bool
        Write into a folder with other things in it, too.
    progress : callable
        Called with the name of each step.

    Returns
    -------
    Rows of the table, and the paths of the pictures.
    """
    truth = standard_rig(scale=scale)
    calibration = _calibrated(truth, writer, progress)
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
        stack = Stack(list(photograph(view, plan, Optics(seed=FIRST_SEED + k))), plan)
        measured = measure(stack, calibration.rig)
        error = truth_distance(view.points_mm, measured.points.xyz_mm)
        rows.append(_row(name, measured.points, np.where(view.lit, error, np.nan)))
        if name == "bust":
            write_stack(writer.file("bust"), stack.frames, plan, truth=view.truth, force=force)
            pictures.append(_report(writer, measured, calibration))
        write_points(writer.file(f"{name}.ply"), measured.points, kind="mesh")
        pictures += _pictures(writer, name, measured.points, error)
    write_text(writer.file("rig.md"), format_table(rows, "markdown"))
    return rows, pictures


def _report(writer: FolderWriter, measured: Measurement, calibration: Calibration) -> Path:
    """The report of the bust and of the calibration that it was measured with."""
    results = {"Bust": measured, "Calibration": calibration}
    written = write_report(
        writer.file("bust.html"),
        results,
        title="A bust, measured by a calibrated virtual rig",
        rig=calibration.rig,
    )
    return written.paths[0]


def _pictures(
    writer: FolderWriter, name: str, cloud: PointCloud, error: FloatMap
) -> Iterator[Path]:
    """Pictures of the points, and of their errors beside σ."""
    maps = [
        Panel("error along the ray", error, "signed", "mm"),
        Panel("standard deviation σ", cloud.sigma_mm, "sigma", "mm"),
    ]
    errors = Sheet(f"{name}: measured minus true, and what σ says", "", maps, columns=2)
    drawn = {
        f"rig_{name}.png": cloud.plot(f"{name}, measured by a calibrated virtual rig"),
        f"rig_{name}_error.png": draw_sheet(errors),
    }
    for file, figure in drawn.items():
        yield figures.save_figure(figure, writer.file(file), provenance=cloud.provenance)


def _calibrated(truth: Rig, writer: FolderWriter, progress: Callable[[str], None]) -> Calibration:
    board, plan = parse_board(BOARD), fringe_plan(truth)

    def stacks() -> Iterator[tuple[str, Stack]]:
        for k, T in enumerate(board_poses(board, POSES, seed=1)):
            view = look(truth, [board_body(board, T)])
            yield f"pose {k}", Stack(list(photograph(view, plan, Optics(seed=k))), plan)

    calibration = calibrate_stacks(
        stacks(), board, progress=lambda text: progress(f"rig: calibrating, {text}")
    )
    write_rig(writer.file("rig.toml"), calibration.rig)
    findings = summarise(calibration)["findings"]
    lines = [f"- {f['text']}" for f in findings]
    text = "\n".join(["# Calibration", "", *lines, ""])
    write_text(writer.file("calibration.md"), text)
    return calibration


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
