"""What the studio's workers do: each task calls the library as a command of ``fringeworks`` does.

They run in a worker's process, with a ``Link`` to the page first. What they return is small: files
hold the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fringeworks.devices.listing import list_devices
from fringeworks.devices.opening import open_devices
from fringeworks.evaluate.inspect import inspect
from fringeworks.files.exposures import is_exposures
from fringeworks.files.merged import write_merged_points
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.files.read_write import read, write
from fringeworks.files.rig import read_rig, write_rig
from fringeworks.files.setup import StoredSetup, read_setup, write_setup
from fringeworks.files.toml import kind_of
from fringeworks.pipeline.boards import calibrate_stacks
from fringeworks.pipeline.inputs import capture_of
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.pipeline.stacks import decode_stack, measure
from fringeworks.report.boards import write_board
from fringeworks.report.display import plot
from fringeworks.report.figures import save_figure
from fringeworks.report.page.report import SUFFIXES as REPORTS
from fringeworks.report.page.report import write_report
from fringeworks.report.page.surfaces import is_surface, packed, surface_of
from fringeworks.report.summary import summarise
from fringeworks.scan.capture import capture
from fringeworks.scan.hdr import capture_hdr
from fringeworks.scan.live_calibration import PoseTaker
from fringeworks.scan.setup import SetupStopped, set_up
from fringeworks.scan.turntable import merge_turn
from fringeworks.studio.worker import Link
from fringeworks.types import (
    Decoded,
    HeightMap,
    InputError,
    Pair,
    PointCloud,
    Points,
    TriangleMesh,
)

PICTURE_PX = 960
"""Longer side of a picture to draw areas on, px."""
PIXELS = 2_000_000
"""Pixels of a surface that the page shows; larger ones are thinned, and the page says so."""

_POSES: dict[tuple[str, str], PoseTaker] = {}
"""The judged poses by folder and board: earlier ones are not judged again for every new one."""


def find_devices(link: Link) -> tuple[list[str], list[str]]:
    """Words of the projectors and cameras that are there."""
    link.progress("looking for devices")
    return tuple([d.words for d in found if d.usable] for found in list_devices())  # type: ignore[return-value]


def run_setup(link: Link, target: str, projector: str, camera: str, frames: int) -> dict[str, Any]:
    """Do a set-up and write its files."""
    link.progress("opening the devices")
    shows, films = open_devices(projector, camera)
    with shows, films:
        try:
            found = set_up(shows, films, frames=frames, axes=("x", "y"), progress=link.progress)
        except SetupStopped as stopped:
            save_figure(plot(stopped.tests), Path(target).with_suffix(".png"))
            raise
    save_figure(plot(found), Path(target).with_suffix(".png"))
    write_setup(target, found, projector=projector, camera=camera)
    return summarise(found)


def take_pose(
    link: Link, setup: str, folder: str, board: str, devices: tuple[str, str]
) -> dict[str, Any]:
    """Take one pose of a board, and judge all."""
    poses = poses_of(folder, board)
    stored = read_setup(setup)
    link.progress("opening the devices")
    shows, films = open_devices(*devices)
    with shows, films:
        taken = poses.take(
            shows, films, stored.plan, settings=stored.settings, progress=link.progress
        )
    return {"name": taken.name, "corners": taken.corners, "problem": taken.problem} | _judged(poses)


def draw_board(link: Link, board: str, target: str) -> str:
    """Write a board to print."""
    link.progress("drawing")
    write_board(target, board)
    return Path(target).name


def judge(link: Link, folder: str, board: str) -> dict[str, Any]:
    """Judge the poses that lie in a folder, after one was deleted or the studio was opened."""
    link.progress("finding the board in the poses")
    _POSES.pop((folder, board), None)
    return _judged(poses_of(folder, board))


def poses_of(folder: str, board: str) -> PoseTaker:
    key = folder, board
    if key not in _POSES:
        _POSES[key] = PoseTaker(folder, board)
    return _POSES[key]


def _judged(poses: PoseTaker) -> dict[str, Any]:
    return {"judgement": str(poses.judgement), "enough": poses.judgement.enough}


def run_calibration(link: Link, folder: str, board: str, target: str) -> dict[str, Any]:
    """Calibrate a rig from poses, and write it."""
    found = calibrate_stacks(folder, board, progress=link.progress)
    write_rig(target, found.rig)
    save_figure(plot(found), Path(target).with_suffix(".png"))
    return summarise(found)


def scan(
    link: Link, setup: str, devices: tuple[str, str], target: str, exposures: int, average: int
) -> dict[str, Any]:
    """Take the frames of an object."""
    stored: StoredSetup = read_setup(setup)
    link.progress("opening the devices")
    shows, films = open_devices(*devices)
    common: dict[str, Any] = {"average": average, "progress": link.progress}
    with shows, films:
        if exposures > 1:
            films.configure(stored.settings)
            capture_hdr(shows, films, stored.plan, target, exposures, **common)
        else:
            capture(shows, films, stored.plan, target, settings=stored.settings, **common)
    return {"capture": Path(target).name}


@dataclass(frozen=True)
class Source:
    """What a result is computed from, and how."""

    path: Path
    """A capture, or a file that holds a result."""
    rig: Path | None
    """Rig file, for stacks; None gives their coordinates."""
    method: str
    """For pairs, as the options."""
    options: dict[str, Any]
    recipe: Path | None = None
    """A recipe that says within which area is measured."""


def show(link: Link, source: Source, target: str) -> dict[str, Any]:
    """Compute or read a result, and pack it for the viewer."""
    result = compute(link, source)
    shown = next(iter(result.maps.values())) if isinstance(result, Decoded) else result
    if not is_surface(shown):
        raise InputError(f"{source.path.name}: expected a surface, got another result")
    link.progress("packing the surface")
    known = None if source.rig is None else read_rig(source.rig)
    every = _thinning(shown)
    surface = packed(shown, title=source.path.name, camera=known, every=every)
    Path(target).write_bytes(surface.data)
    return {"figures": summarise(result), "every": every}


def is_stack(folder: Path) -> bool:
    """Whether a capture has the frames of a plan, and is no pair."""
    return is_exposures(folder) or kind_of(folder / CAPTURE_FILE) == "stack"


def compute(link: Link, source: Source) -> Any:
    """The result of a capture, or the one in a file."""
    if source.recipe is not None:
        link.progress("measuring within the area")
        return inspect(_known(source), source.recipe).surface
    if not source.path.is_dir():
        link.progress("reading")
        return read(source.path)
    if not is_stack(source.path):
        link.progress(f"measuring by {source.method}")
        return reconstruct(source.path, source.method, **source.options)
    link.progress("decoding and measuring")
    return decode_stack(source.path) if source.rig is None else measure(source.path, source.rig)


def merge_views(
    link: Link, captures: list[str], rig: str, board: str, step_deg: float, target: str
) -> dict[str, Any]:
    """Measure the views of a part on a turntable, merge them, and write the points."""
    known = read_rig(rig)
    views = []
    for place in captures:
        link.progress(f"measuring {Path(place).name}")
        views.append(measure(place, known).points)
    found = merge_turn(views, known, step_deg=step_deg, board=board or None, progress=link.progress)
    write_merged_points(target, found.points, provenance=found.provenance)
    return {
        "file": Path(target).name,
        "views": len(views),
        "points": len(found.points.xyz_mm),
        "findings": [finding.text for finding in found.findings],
    }


def judge_part(link: Link, source: Source, recipe: str) -> dict[str, Any]:
    """Measure a part, and judge its tolerances."""
    link.progress("measuring the part")
    name = source.path.name
    return summarise(inspect(_known(source), recipe)) | {"source": name}


def _known(source: Source) -> Any:
    """What is inspected: a capture by its path, or the surface in a file."""
    if source.path.is_dir():
        return source.path
    result = read(source.path)
    if not isinstance(result, HeightMap | PointCloud):
        raise InputError(
            f"{source.path.name}: expected heights or points in the order of a frame's pixels, "
            "which areas need; .npz holds them"
        )
    return result


def draw_picture(link: Link, source: Source, target: str) -> dict[str, Any]:
    """Draw what the camera saw of a capture, or the depths of a result, as JPEG."""
    link.progress("drawing")
    values = picture_of(_known(source))
    step = max(1, -(-max(values.shape) // PICTURE_PX))
    part = values[::step, ::step].astype(np.float64)
    low, high = np.nanpercentile(part, (1, 99)) if np.isfinite(part).any() else (0.0, 1.0)
    grey = 255.0 * np.clip((part - low) / max(high - low, 1e-12), 0.0, 1.0)
    image = Image.fromarray(np.nan_to_num(grey).astype(np.uint8))
    image.save(target, "JPEG", quality=90)
    return {"step": step, "size": [values.shape[1], values.shape[0]]}


def picture_of(known: Path | HeightMap | PointCloud) -> NDArray[Any]:
    """The brightness of a capture, or the heights or depths of a result, (h, w)."""
    if isinstance(known, HeightMap):
        return known.values
    if isinstance(known, PointCloud):
        return np.asarray(known.xyz_mm[..., 2])
    found = capture_of(known)
    if isinstance(found, Pair):
        return found.object
    mean = np.mean([np.asarray(frame, np.float32) for frame in found[0].frames], axis=0)
    return np.asarray(mean)


def export(link: Link, source: Source, target: str, kind: str) -> str:
    """Write a result or its report in the format of the target's suffix."""
    result = compute(link, source)
    link.progress("writing")
    path = Path(target)
    if path.suffix in REPORTS:
        write_report(path, {source.path.name: result}, rig=source.rig)
    else:
        part = result if isinstance(result, TriangleMesh) else surface_of(result)
        write(path, part, **({"kind": "mesh"} if kind == "mesh" else {}))
    return path.name


def _thinning(result: Any) -> int:
    """Every how many columns and rows are shown."""
    inner = surface_of(result)
    pixels = len(inner.xyz_mm) if isinstance(inner, Points) else inner.reason.size
    return thinning(pixels, PIXELS)


def thinning(pixels: int, most: int) -> int:
    """Return every how many columns and rows are used so that at most so many pixels are."""
    return max(1, int(np.ceil(np.sqrt(pixels / most))))
