"""``calibrate`` and ``measure`` for several cameras and one projector, a path for each camera."""

from __future__ import annotations

from pathlib import Path

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.decoding import DecodingOptions
from fringeworks.cli.showing import ShowOptions


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
        poses = [how.poses(folder) for folder in folders]
        found = fw.calibrate(poses, known, distortion=distortion, progress=progress, **how.options)
    with output.target(out, ".toml") as place:
        fw.files.write_multi_rig(place, found.rig)
    figures = fw.report.summarise(found)
    output.write_json(show.json_file, figures)
    words.tell(found, figures)
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
    words.tell(found, figures)
    words.wrote(out, show.figure)


def _refuse(show: ShowOptions, *, figure: str = "") -> None:
    """Refuse what results of several cameras do not have."""
    if show.report is not None:
        raise fw.InputError("--report: expected one camera, got several; use --figure and --json")
    if figure and show.figure is not None:
        raise fw.InputError(f"--figure: {figure}; use --json")
