"""Pairs on disk: a folder with ``capture.toml``, two images, ``.npz`` or MATLAB ``.mat``."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath, write_text
from fringeworks.files.description import Section
from fringeworks.files.folder import FolderInUse, incomplete, replacing_folder
from fringeworks.files.images import holds_counts, read_frame, read_frames, write_frame
from fringeworks.files.limits import inside, is_file, parsing
from fringeworks.files.mat import read_mat
from fringeworks.files.npz import read_npz
from fringeworks.files.provenance import source_of
from fringeworks.types import (
    NUMBERS,
    Axis,
    FileProblem,
    InputError,
    Pair,
    ReferencePlaneGeometry,
)

CAPTURE_FILE = "capture.toml"
"""Description of a capture in its folder. A folder without one is no complete capture."""
MATLAB_NAMES = {"reference": "S", "object": "D"}
"""Variables of the dissertation's MATLAB files."""
LAYOUT = dict.fromkeys(("reference", "object"), f"{NUMBERS} hw") | {
    "black": f"?{NUMBERS} hw",
    "white": f"?{NUMBERS} hw",
    "mask": f"?b{NUMBERS} hw",
    "truth_mm": f"?{NUMBERS} hw",
}
"""Layout of a pair in one ``.npz`` file."""


class FramesSection(Section):
    """``[frames]``: image files, relative to the folder."""

    reference: str | None = None
    """Left out for a single frame."""
    object: str
    black: str | float | None = None
    """The object while the projector shows black; or the camera's black level, counts."""
    white: str | None = None
    """The object while the projector shows white."""


class GeometrySection(Section):
    """``[geometry]``: theory §2; without it results stay in px."""

    distance_mm: float
    baseline_mm: float
    pitch_mm_per_px: float
    sign: Literal[1, -1] = 1
    principal_px: tuple[float, float] | None = None
    """Pixel above which the camera's pupil stands; left out for the middle of the frame."""

    def as_geometry(self) -> ReferencePlaneGeometry:
        """The frozen type."""
        return ReferencePlaneGeometry(**self.as_dict())


class DevicesSection(Section):
    """``[devices]``: who took and lit the frames; a saved response asks for it."""

    camera: str | None = None
    projector: str | None = None


class CaptureFile(Section):
    """The whole of ``capture.toml``; unknown keys are refused."""

    kind: Literal["pair"]
    frames: FramesSection
    axis: Axis | None = None
    """Direction in which the fringes vary; found when left out."""
    mask: str | None = None
    """Image that is non-zero where the object is to be measured."""
    background: str | None = None
    """Image that is non-zero where the reference plane shows; used without a reference frame."""
    truth: str | None = None
    """TIFF of the true height in mm, where it is known."""
    geometry: GeometrySection | None = None
    devices: DevicesSection = DevicesSection()


def read_pair(
    reference: StrPath | None,
    object: StrPath,
    *,
    black: StrPath | float | None = None,
    white: StrPath | None = None,
    geometry: ReferencePlaneGeometry | None = None,
) -> Pair:
    """Read a pair from two files, or a single frame from the object's file.

    Parameters
    ----------
    reference, object : paths
        Images, or ``.mat`` files with the variable S and D respectively, as the dissertation's.
        None as reference makes a single frame.
    black, white : paths, optional
        Images of the object while the projector shows black or white; black may be the camera's
        black level instead, counts.
    geometry : ReferencePlaneGeometry, optional
        Without it, results are displacements in px.

    Raises
    ------
    FileProblem where a file cannot be read; InputError where frames differ in size.
    """
    level, dark = (black, None) if isinstance(black, (int, float)) else (None, black)
    given = {"reference": reference, "object": object, "black": dark, "white": white}
    paths = {name: Path(p) for name, p in given.items() if p is not None}
    # All images are converted to grey as one: to luminance if any is coloured.
    read = read_frames([p for p in paths.values() if not _is_mat(p)], stack=False)
    images = iter(read.frames)
    frames: dict[str, Any] = {}
    for name, p in paths.items():
        variable = MATLAB_NAMES.get(name, name)
        frames[name] = read_mat(p, (variable,))[variable] if _is_mat(p) else next(images)
    for name, frame in frames.items():
        if frame.shape != frames["object"].shape:
            raise InputError(
                f"frames: expected equal sizes, got {_size(frame)} in {paths[name].name} and "
                f"{_size(frames['object'])} in {paths['object'].name}"
            )
    return Pair(
        reference=frames.get("reference"),
        object=frames["object"],
        black=frames.get("black", level),
        white=frames.get("white"),
        geometry=geometry,
        notes=read.notes,
        sources=tuple(source_of(p) for p in paths.values()),
    )


def read_pair_file(path: StrPath) -> Pair:
    """Read both frames from one ``.npz`` or ``.mat`` file.

    Raises
    ------
    FileProblem for anything missing, unreadable or unknown, naming the file and the field.

    Notes
    -----
    ``.npz``: arrays ``reference`` and ``object``, optionally ``black``, ``white``, ``mask`` and
    ``truth_mm``.
    ``.mat`` (v5 to v7.3): variables S and D, as the dissertation's files hold them.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        names = ("reference", "object")
        arrays = read_npz(path, "a pair of frames", LAYOUT)
    else:
        names = (MATLAB_NAMES["reference"], MATLAB_NAMES["object"])
        arrays = read_mat(path, names)
    with parsing(path, "a pair of frames"):
        return _from_arrays(path, arrays, *names)


def _is_mat(path: Path) -> bool:
    return path.suffix.lower() == ".mat" and is_file(path)


def _size(frame: NDArray[Any]) -> str:
    return f"{frame.shape[1]} × {frame.shape[0]}"


def read_pair_folder(folder: Path, content: CaptureFile) -> Pair:
    """Read a pair as the ``capture.toml`` in its folder describes it."""
    frames = content.frames
    reference, white = (
        None if name is None else inside(folder, name) for name in (frames.reference, frames.white)
    )
    black = inside(folder, frames.black) if isinstance(frames.black, str) else frames.black
    pair = read_pair(reference, inside(folder, frames.object), black=black, white=white)
    geometry = content.geometry
    others = (content.mask, content.background, content.truth)
    paths = [None if name is None else inside(folder, name) for name in others]
    mask, background, truth = (None if path is None else read_frame(path)[0] for path in paths)
    given = [path for path in (*paths, folder / CAPTURE_FILE) if path is not None]
    return Pair(
        reference=pair.reference,
        object=pair.object,
        black=pair.black,
        white=pair.white,
        mask=_fitting("mask", None if mask is None else mask != 0, pair.object),
        background=_fitting(
            "background", None if background is None else background != 0, pair.object
        ),
        axis=content.axis,
        geometry=None if geometry is None else geometry.as_geometry(),
        camera=content.devices.camera,
        projector=content.devices.projector,
        truth_mm=_fitting("truth", truth, pair.object),
        notes=pair.notes,
        sources=(*pair.sources, *(source_of(path) for path in given)),
    )


def _fitting(name: str, values: Any, frame: NDArray[Any]) -> Any:
    if values is not None and values.shape != frame.shape:
        raise InputError(f"{name}: expected shape {frame.shape}, got {values.shape}")
    return values


def _from_arrays(path: Path, arrays: dict[str, Any], reference: str, object: str) -> Pair:
    first, second = arrays[reference], arrays[object]
    if first.shape != second.shape:
        raise InputError(
            f"{path}: expected equal sizes, got {_size(first)} in {reference} and "
            f"{_size(second)} in {object}"
        )
    mask = arrays.get("mask")
    return Pair(
        reference=first,
        object=second,
        black=_fitting("black", arrays.get("black"), first),
        white=_fitting("white", arrays.get("white"), first),
        mask=_fitting("mask", None if mask is None else mask != 0, first),
        truth_mm=_fitting("truth_mm", arrays.get("truth_mm"), first),
        sources=(source_of(path),),
    )


def refuse_over_taken(folder: StrPath, *devices: str | None) -> None:
    """Refuse to replace frames that devices took by frames that none took, as simulated ones.

    Parameters
    ----------
    folder : path
    *devices : str or None
        Names of the camera and the projector that took the new frames, where they are known.

    Raises
    ------
    FolderInUse for a folder whose ``capture.toml`` names a device, where no new one is named.
    """
    path = Path(folder) / CAPTURE_FILE
    if any(devices) or not is_file(path):
        return
    try:
        taken = bool(tomllib.loads(path.read_text("utf-8")).get("devices"))
    except (OSError, ValueError):
        return
    if taken:
        raise FolderInUse(
            f"{folder}: expected a new folder, got one with frames that a camera took, which would "
            "be lost"
        )


def write_pair(folder: StrPath, pair: Pair, *, force: bool = False) -> Path:
    """Write a pair as a folder of images with ``capture.toml``.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    pair : Pair
        Frames of whole counts become PNG, floats TIFF.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.

    Returns
    -------
    Path of ``capture.toml``, which is written last.

    Raises
    ------
    FileProblem where the folder holds other things or cannot be written to, and where the frames
    of devices would be replaced by a pair that names none.
    """
    if not force:
        refuse_over_taken(folder, pair.camera, pair.projector)
    with replacing_folder(folder, "capture", index=(CAPTURE_FILE,), force=force) as writer:
        frames: dict[str, str | float] = {}
        content: dict[str, Any] = {"kind": "pair"} | ({"axis": pair.axis} if pair.axis else {})
        for name in ("reference", "object", "black", "white"):
            frame = getattr(pair, name)
            if isinstance(frame, np.ndarray):
                file = f"{name}.png" if holds_counts(frame) else f"{name}.tif"
                write_frame(writer.file(file), frame)
                frames[name] = file
            elif frame is not None:
                frames[name] = float(frame)
        for name in ("mask", "background"):
            values = getattr(pair, name)
            if values is not None:
                content[name] = f"{name}.png"
                write_frame(writer.file(content[name]), values.astype(np.uint8) * np.uint8(255))
        if pair.truth_mm is not None:
            content["truth"] = "truth.tif"
            write_frame(writer.file("truth.tif"), np.asarray(pair.truth_mm, np.float64))
        content["frames"] = frames
        devices = {"camera": pair.camera, "projector": pair.projector}
        content["devices"] = {name: value for name, value in devices.items() if value is not None}
        if pair.geometry is not None:
            content["geometry"] = geometry_section(pair.geometry)
        text = tomli_w.dumps({name: value for name, value in content.items() if value})
        write_text(writer.file(CAPTURE_FILE), text)
        return writer.folder / CAPTURE_FILE


def geometry_section(geometry: ReferencePlaneGeometry) -> dict[str, Any]:
    """``[geometry]`` of a TOML file."""
    section: dict[str, Any] = {
        "distance_mm": float(geometry.distance_mm),
        "baseline_mm": float(geometry.baseline_mm),
        "pitch_mm_per_px": float(geometry.pitch_mm_per_px),
        "sign": int(geometry.sign),
    }
    if geometry.principal_px is not None:
        section["principal_px"] = [float(v) for v in geometry.principal_px]
    return section


def missing_description(folder: Path, expected: str, instead: str = "") -> FileProblem:
    """The error of a folder that has no description; ``instead`` says what else it holds."""
    why = "; an interrupted write left it incomplete" if incomplete(folder) else ""
    return FileProblem(f"{folder}: expected a file {expected}, got none{why}{instead}")
