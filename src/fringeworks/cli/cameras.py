"""``calibrate`` and ``measure`` for several cameras and one projector, a path for each camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
    from fringeworks.pipeline.photographs import holds_photographs

    if all(holds_photographs(folder) for folder in folders):
        with output.progress() as progress:
            alone = fw.calibrate(folders, known, distortion=distortion, progress=progress)
        _write_calibration(alone, out, words, show)
        return
    steps = sum(len(pose_paths(folder)) for folder in folders) + 1
    with output.progress(steps) as progress:
        poses = [how.poses(folder) for folder in folders]
        found = fw.calibrate(poses, known, distortion=distortion, progress=progress, **how.options)
    _write_calibration(found, out, words, show)


def _write_calibration(
    found: fw.rig.MultiCalibration, out: Path, words: output.Output, show: ShowOptions
) -> None:
    """Write and print a calibration of several cameras."""
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
        rig = _rig_of(rig_file, loaded)
        progress("measuring …")
        found = fw.measure(loaded, rig, axis=axis, **how.options)
    if out is not None:
        with output.target(out, ".ply") as place:
            fw.files.write_merged_points(place, found.points, provenance=found.points.provenance)
    figures = fw.report.summarise(found)
    show.write(found, figures, name=stacks[0].name, provenance=found.points.provenance)
    words.tell(found, figures)
    words.wrote(out, show.figure)


def _rig_of(rig_file: Path, loaded: list[Any]) -> fw.rig.MultiRig:
    """The rig of several cameras; of another program's file with the size of the frames."""
    if rig_file.suffix.lower() == ".toml":
        return fw.files.read_multi_rig(rig_file)
    sizes = []
    for one in loaded:
        rows, columns = (one if isinstance(one, fw.Stack) else one[0]).frames[0].shape[:2]
        sizes.append((columns, rows))
    return fw.files.read_stereo_rig(rig_file, camera_sizes=sizes)


def convert_stereo(
    sources: list[Path],
    out: Path,
    size: tuple[int, int] | None,
    unit_mm: float | None,
    *,
    rectified: bool,
) -> None:
    """Write two cameras of another program's files as a rig without a projector."""
    from fringeworks.rig.point_findings import unit_findings

    words = output.Output(out)
    output.check(out, "multi_rig")
    with output.target(out, ".toml") as place:
        found = fw.files.read_stereo_rig(
            *sources,
            camera_sizes=None if size is None else (size, size),
            unit_mm=unit_mm,
            rectified=rectified,
        )
        fw.files.write_multi_rig(place, found)
    words.found(unit_findings(fw.rig.camera_pair(found, 0, 1)))
    words.wrote(out)


def _refuse(show: ShowOptions, *, figure: str = "") -> None:
    """Refuse what results of several cameras do not have."""
    if show.report is not None:
        raise fw.InputError("--report: expected one camera, got several; use --figure and --json")
    if figure and show.figure is not None:
        raise fw.InputError(f"--figure: {figure}; use --json")
