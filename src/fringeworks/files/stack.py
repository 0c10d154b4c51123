"""Stacks of frames on disk: a folder of images with its plan, a TIFF stack, .npy or .npz."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tifffile
import tomli_w
from numpy.typing import NDArray

from fringeworks.files.atomic import (
    IMAGE_SUFFIXES,
    TIFF_SUFFIXES,
    make_folder,
    read_frame,
    replacing,
    write_frame,
    write_text,
)
from fringeworks.files.pair import CAPTURE_FILE, DevicesSection
from fringeworks.files.plan import PLAN_FILE, read_plan, write_plan
from fringeworks.files.toml import Section, read_toml
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Stack
from fringeworks.types import InputError

TRUTH_FILE = "truth.npz"
"""What is known about a simulated scene, beside its frames."""


class StackFile(Section):
    """``capture.toml`` of a stack; unknown keys are refused."""

    kind: Literal["stack"]
    plan: str = PLAN_FILE
    """Plan file, relative to the folder."""
    frames: list[str] | str | None = None
    """Images in the order of the plan, or one TIFF stack; all images by name where left out."""
    saturation: float | None = None
    """Counts from which on a sample is not trusted."""
    devices: DevicesSection = DevicesSection()


def read_stack(path: Path, plan: Path | None = None) -> Stack:
    """Read a stack of frames.

    Parameters
    ----------
    path : Path
        A folder of images with ``plan.toml`` (or with ``capture.toml`` of the kind "stack"), or a
        TIFF stack, ``.npy`` or ``.npz`` with (n, h, w).
    plan : Path, optional
        Plan file; for folders that have none, and for files.

    Raises
    ------
    InputError for anything missing, unreadable or unknown, naming the file.
    """
    path = Path(path)
    if path.is_dir():
        return _read_folder(path, plan)
    if not path.is_file():
        raise InputError(f"{path}: expected a folder or a stack of frames, got nothing there")
    if plan is None:
        beside = path.parent / PLAN_FILE
        if not beside.is_file():
            raise InputError(
                f"{path}: expected --plan, or a file {PLAN_FILE} beside it; got neither"
            )
        plan = beside
    return Stack(_read_file(path), read_plan(plan))


def write_stack(
    folder: Path,
    frames: Iterable[NDArray[Any]],
    plan: PatternPlan,
    *,
    camera: str | None = None,
    projector: str | None = None,
    truth: Mapping[str, NDArray[Any]] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write frames as a folder of images with their plan; it is complete when it has one.

    Parameters
    ----------
    folder : Path
    frames : iterable of (h, w) arrays
        In the order of the plan: whole counts become PNG, floats TIFF.
    plan : PatternPlan
    camera, projector : str, optional
        Names of the devices.
    truth : mapping of arrays, optional
        Of a simulation, written as ``truth.npz`` beside the frames.
    progress : callable
        Called with the label of each frame.

    Raises
    ------
    InputError where the number of frames is not the plan's, or the folder cannot be written to.
    """
    folder = make_folder(folder)
    labels = plan.labels()
    digits = len(str(len(labels) - 1))
    count = 0
    for count, frame in enumerate(frames, 1):
        if count > len(labels):
            raise InputError(f"frames: the plan has {len(labels)}, got more")
        suffix = ".png" if frame.dtype in (np.uint8, np.uint16) else ".tif"
        progress(labels[count - 1])
        name = f"{count - 1:0{digits}d}-{labels[count - 1]}{suffix}"
        write_frame(folder / name, frame)
    if count != len(labels):
        raise InputError(f"frames: the plan has {len(labels)}, got {count}")
    if truth is not None:
        with replacing(folder / TRUTH_FILE) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **truth)
    named = {"camera": camera, "projector": projector}
    devices = {name: value for name, value in named.items() if value is not None}
    content = {"kind": "stack", "plan": PLAN_FILE} | ({"devices": devices} if devices else {})
    write_text(folder / CAPTURE_FILE, tomli_w.dumps(content))
    write_plan(folder / PLAN_FILE, plan)
    return folder


def _read_folder(folder: Path, plan: Path | None) -> Stack:
    description = folder / CAPTURE_FILE
    content = (
        read_toml(description, StackFile) if description.is_file() else StackFile(kind="stack")
    )
    layout = read_plan(folder / content.plan if plan is None else plan)
    named = content.frames
    if isinstance(named, str):
        frames: Sequence[NDArray[Any]] = _read_file(folder / named)
        notes: list[str] = []
    else:
        paths = _images(folder) if named is None else [folder / name for name in named]
        _refuse_missing(paths, layout, folder)
        frames, notes = [], []
        for path in paths:
            frame, said = read_frame(path)
            frames.append(frame)
            notes += said
        notes = notes[:1] + ([f"and so are {len(notes) - 1} others"] if len(notes) > 1 else [])
    devices = content.devices
    return Stack(
        frames, layout, content.saturation, devices.camera, devices.projector, tuple(notes)
    )


def _images(folder: Path) -> list[Path]:
    """Images of a folder by name, numbers by their value."""
    suffixes = IMAGE_SUFFIXES + TIFF_SUFFIXES
    found = [p for p in folder.iterdir() if p.suffix.lower() in suffixes and p.is_file()]
    if len(found) == 1 and found[0].suffix.lower() in TIFF_SUFFIXES:
        raise InputError(
            f"{folder}: expected one image per frame, got one TIFF; name it as the capture itself"
        )
    return sorted(
        found,
        key=lambda p: [
            (0, int(part), "") if part.isdigit() else (1, 0, part)
            for part in re.split(r"(\d+)", p.name)
        ],
    )


def _refuse_missing(paths: list[Path], plan: PatternPlan, folder: Path) -> None:
    labels = plan.labels()
    if len(paths) != len(labels):
        short = len(paths) < len(labels)
        missing = f"; missing: {', '.join(labels[len(paths) :])}" if short else ""
        raise InputError(
            f"{folder}: the plan has {len(labels)} frames, got {len(paths)} images{missing}"
        )


def _read_file(path: Path) -> Sequence[NDArray[Any]]:
    suffix = path.suffix.lower()
    try:
        if suffix in TIFF_SUFFIXES:
            stack = _read_tiff(path)
        elif suffix == ".npy":
            stack = np.load(path, mmap_mode="r", allow_pickle=False)
        elif suffix == ".npz":
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                names = archive.files
                if "frames" not in names:
                    got = ", ".join(names) or "nothing"
                    raise InputError(f"{path}: expected an array named frames, got {got}")
                stack = archive["frames"]
        else:
            raise InputError(f"{path}: expected .tif, .npy or .npz, got {suffix or path.name}")
    except InputError:
        raise
    except Exception as error:  # tifffile, zipfile and numpy raise many kinds for damaged files
        raise InputError(f"{path}: expected a readable stack, got: {error}") from error
    if stack.ndim != 3:
        raise InputError(f"{path}: expected frames of shape (n, h, w), got {stack.shape}")
    return list(stack)


def _read_tiff(path: Path) -> NDArray[Any]:
    try:
        return np.asarray(tifffile.memmap(path, mode="r"))
    except ValueError:  # compressed, or pages apart from each other
        return np.asarray(tifffile.imread(path))
