"""``calibrate`` and ``measure`` for several cameras and one projector, a path for each camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.decoding import DecodingOptions
from fringeworks.cli.showing import ShowOptions
from fringeworks.cli.words import say_found


def calibrate_cameras(
    folders: list[Path],
    board: str,
    out: Path,
    how: DecodingOptions,
    distortion: int | None,
    show: ShowOptions,
) -> None:
    """Calibrate the cameras, each from its own folder of poses."""
    words = output.Output(out, *show.targets)
    output.check(out, "multi_rig")
    _refuse(show, figure="a calibration of several cameras has no picture")
    known = fw.rig.parse_board(board)
    from fringeworks.files.stack import pose_paths

    steps = sum(len(pose_paths(folder)) for folder in folders) + 1
    with output.progress(steps) as progress:
        poses = [
            ((name, how.named(stack)) for name, stack in fw.files.read_poses(folder, how.plan))
            for folder in folders
        ]
        found = fw.calibrate(poses, known, distortion=distortion, progress=progress, **how.options)
    with output.target(out, ".toml") as place:
        fw.files.write_multi_rig(place, found.rig)
    figures = fw.report.summarise(found)
    output.write_json(show.json_file, figures)
    _say_calibration(words, figures)
    words.wrote(out)


def measure_cameras(
    stacks: list[Path],
    rig_file: Path,
    out: Path | None,
    how: DecodingOptions,
    axis: fw.patterns.Axis | None,
    show: ShowOptions,
) -> None:
    """Measure what several cameras saw, each from its own capture."""
    words = output.Output(out, *show.targets)
    output.check(out, "merged")
    show.check()
    _refuse(show)
    with output.progress() as progress:
        progress("reading …")
        loaded = [how.read_captured(stack) for stack in stacks]
        rig = fw.files.read_multi_rig(rig_file)
        progress("measuring …")
        found = fw.measure(loaded, rig, axis=axis, **how.options)
    if out is not None:
        with output.target(out, ".ply") as place:
            fw.files.write_merged_points(place, found.points, provenance=found.points.provenance)
    figures = fw.report.summarise(found)
    show.write(found, figures, name=stacks[0].name, provenance=found.points.provenance)
    _say_points(words, figures)
    words.wrote(out, show.figure)


def _refuse(show: ShowOptions, *, figure: str = "") -> None:
    """Refuse what results of several cameras do not have."""
    if show.report is not None:
        raise fw.InputError("--report: expected one camera, got several; use --figure and --json")
    if figure and show.figure is not None:
        raise fw.InputError(f"--figure: {figure}; use --json")


def _say_calibration(words: output.Output, figures: dict[str, Any]) -> None:
    for camera in figures["cameras"]:
        x, y, z = camera["place_mm"]
        words.say(
            f"camera {camera['number']}: {len(camera['poses'])} poses, reprojection "
            f"{camera['rms_px']:.3f} px, at ({x:.2f}, {y:.2f}, {z:.2f}) mm"
        )
    words.say(f"projector: reprojection {figures['projector_rms_px']:.3f} px")
    for name, value in figures["predicted_rms_px"].items():
        words.say(f"{name}: predicted by the others to {value:.3f} px rms")
    for why in figures["skipped"].values():
        words.say(f"skipped: {why}")
    if figures["sigma_inflation"] > 1.0:
        words.say(
            f"standard deviations are raised by {figures['sigma_inflation']:.2f}, because poses "
            "disagree by more than their corners explain"
        )


def _say_points(words: output.Output, figures: dict[str, Any]) -> None:
    say_found(words, figures)
    for camera in figures["cameras"]:
        words.say(
            f"camera {camera['number']}: {camera['points']} points, "
            f"{camera['confirmed_by_cameras']} confirmed by another camera"
        )
        for name, pair in camera["pairs"].items():
            if pair["points"]:
                words.say(
                    f"   with {name}: {pair['points']} points, median σ "
                    f"{pair['median_sigma_mm']:.4f} mm, mean weight {pair['mean_weight']:.2f}"
                )
    if figures["points"]:
        words.say(f"{figures['points']} points, median σ {figures['median_sigma_mm']:.4f} mm")
