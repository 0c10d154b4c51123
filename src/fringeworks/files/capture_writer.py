"""Captures that are written frame by frame, and finished later if they were interrupted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath, replacing, write_text
from fringeworks.files.description import Field, Section
from fringeworks.files.folder import FolderInUse, FolderWriter, foreign_names, replacing_folder
from fringeworks.files.images import CHANNELS, holds_counts, read_frame, write_frame
from fringeworks.files.limits import is_file
from fringeworks.files.pair import CAPTURE_FILE, DevicesSection, refuse_over_taken
from fringeworks.files.plan import PLAN_FILE, format_plan, frame_names
from fringeworks.files.toml import read_toml
from fringeworks.patterns.plan import LightColour, PatternPlan
from fringeworks.stack.grey_card import check_gains
from fringeworks.types import CameraSettings, FileProblem, FramesContradictPlan, InputError, Region

Gain = Annotated[float, Field(gt=0)]
"""Factor of a colour, above 0."""
UNFINISHED_FILE = "unfinished.toml"
"""In a folder whose frames are not all taken yet: what the capture will be."""
TRUTH_FILE = "truth.npz"
"""What is known about a simulated scene, in the folder of its frames."""
SUFFIXES = (".png", ".tif")
"""Of frames with whole counts and with others."""


class SettingsSection(Section):
    """``[settings]``: how the frames were taken."""

    exposure_ms: float | None = Field(default=None, gt=0)
    gain_db: float | None = None
    pixel_format: str | None = None
    region: tuple[int, int, int, int] | None = None
    """First column and row, columns, rows."""
    averaged: int = Field(default=1, ge=1)
    """Number of frames that each frame is the mean of."""


class UnfinishedFile(Section):
    """``unfinished.toml``: how the frames of a capture are taken; unknown keys are refused."""

    saturation: float | None = Field(default=None, gt=0)
    """Counts from which on a sample is not trusted."""
    white_balance: tuple[Gain, Gain, Gain] | None = None
    """Gains of red, green and blue."""
    mosaic: str | None = None
    """Filters of raw frames, as "rggb", or "file" for raw photographs: of the channel, only its own
    pixels are read."""
    devices: DevicesSection = DevicesSection()
    settings: SettingsSection = SettingsSection()


class StackFile(UnfinishedFile):
    """``capture.toml`` of a stack; unknown keys are refused."""

    kind: Literal["stack"]
    plan: str = PLAN_FILE
    """Plan file, relative to the folder."""
    frames: list[str] | str | None = None
    """Images in the order of the plan, or one TIFF stack; where left out, all images, by the labels
    in their names or by name."""
    channels: str | None = None
    """Channels of colour images that are a frame each, as "g" or "rgb"; luminance by default."""
    channel: LightColour | None = None
    """The same for a single channel."""


class CaptureWriter:
    """Writes the frames of one capture; see ``writing_capture``."""

    def __init__(self, writer: FolderWriter, plan: PatternPlan, stems: list[str]) -> None:
        self._writer = writer
        self._plan = plan
        self._stems = stems
        self._names = {n: name for n, stem in enumerate(stems) if (name := self._there(stem))}

    def _there(self, stem: str) -> str | None:
        found = [stem + suffix for suffix in SUFFIXES if self._writer.keeps(stem + suffix)]
        return found[0] if found else None

    @property
    def missing(self) -> list[int]:
        """Numbers of the frames that are not written yet."""
        return [n for n in range(len(self._stems)) if n not in self._names]

    @property
    def names(self) -> list[str]:
        """Names of the written frames, in the order of the plan."""
        return [self._names[n] for n in sorted(self._names)]

    def add(self, number: int, frame: NDArray[Any]) -> None:
        """Write the frame of a picture of the plan: whole counts as PNG, floats as TIFF.

        Raises
        ------
        FramesContradictPlan for a number that the plan does not have.
        """
        if not 0 <= number < len(self._stems):
            raise FramesContradictPlan(f"frames: the plan has {len(self._stems)}, got more")
        deep = frame.ndim == len(CHANNELS) and frame.dtype != np.uint8  # PNG of Pillow has 8 bits
        name = self._stems[number] + SUFFIXES[0 if holds_counts(frame) and not deep else 1]
        write_frame(self._writer.file(name), frame)
        self._names[number] = name

    def add_truth(self, truth: Mapping[str, NDArray[Any]]) -> None:
        """Write what is known about a simulated scene."""
        with replacing(self._writer.file(TRUTH_FILE)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **truth)


@contextmanager
def writing_capture(
    folder: StrPath,
    plan: PatternPlan,
    *,
    camera: str | None = None,
    projector: str | None = None,
    settings: CameraSettings | None = None,
    averaged: int = 1,
    saturation: float | None = None,
    white_balance: Sequence[float] | None = None,
    mosaic: str | None = None,
    resume: bool = False,
    force: bool = False,
) -> Iterator[CaptureWriter]:
    """Write a capture frame by frame.

    Every frame is on the disk when ``CaptureWriter.add`` returns. ``capture.toml``, which makes
    the folder a capture, is written at the end, when all frames are there. Until then the folder
    holds ``unfinished.toml``, and reading it says that frames are missing.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    plan : PatternPlan
    camera, projector : str, optional
        Names of the devices.
    settings : CameraSettings, optional
        How the frames are taken.
    averaged : int
        Number of frames that each frame is the mean of.
    saturation : float, optional
        Counts from which on a sample is not trusted.
    white_balance : (red, green, blue), optional
        Gains of the colour of points.
    mosaic : str, optional
        Filters of raw frames, as "rggb".
    resume : bool
        Keep the frames of a capture that was interrupted. Its plan, devices and settings must be
        the same. A complete capture is left as it is.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.

    Raises
    ------
    FramesContradictPlan at the end, where frames are missing; FileProblem where the folder cannot
    be written to, there is nothing to resume, or the frames of devices would be replaced by those
    of none.
    """
    stems = frame_names(plan, "")
    content = _description(camera, projector, settings, averaged, saturation)
    if white_balance is not None:
        content = {"white_balance": list(check_gains(white_balance)), **content}
    content = content if mosaic is None else {"mosaic": mosaic, **content}
    kept = _kept(Path(folder), content, plan, stems) if resume else ()
    if not (resume or force):
        refuse_over_taken(folder, camera, projector)
    index = (CAPTURE_FILE, PLAN_FILE)
    with replacing_folder(folder, "capture", index=index, force=force, kept=kept) as writer:
        if not kept:
            write_text(writer.file(UNFINISHED_FILE), tomli_w.dumps(content))
            write_text(writer.file(PLAN_FILE), format_plan(plan))
        capture = CaptureWriter(writer, plan, stems)
        yield capture
        if CAPTURE_FILE in kept:
            return
        if capture.missing:
            labels = plan.picture_labels()
            raise FramesContradictPlan(
                f"frames: the plan has {len(labels)}, got {len(capture.names)}; "
                f"missing: {', '.join(labels[n] for n in capture.missing)}"
            )
        described = {"kind": "stack", "plan": PLAN_FILE, "frames": capture.names} | content
        write_text(writer.file(CAPTURE_FILE), tomli_w.dumps(described))
        writer.remove(UNFINISHED_FILE)


def refuse_replacing(folder: StrPath) -> None:
    """Refuse to take frames into the folder of a finished capture: nobody can take those again.

    Raises
    ------
    FolderInUse for a folder with a ``capture.toml``.
    """
    if is_file(Path(folder) / CAPTURE_FILE):
        raise FolderInUse(
            f"{folder}: expected a new folder, got one with a finished capture, whose frames would "
            "be lost"
        )


def settings_to_resume(folder: StrPath) -> CameraSettings:
    """Return the camera's settings of a capture that was begun in a folder.

    Raises
    ------
    FileProblem where there is none.
    """
    return settings_of(_begun(Path(folder)).settings)


def refuse_unfinished(folder: Path) -> None:
    """Refuse to read a capture whose frames are not all taken."""
    if is_file(folder / UNFINISHED_FILE) and not is_file(folder / CAPTURE_FILE):
        raise FileProblem(
            f"{folder}: expected a complete capture, got one that was interrupted: finish it with "
            "resume, or capture it anew"
        )


def settings_of(section: SettingsSection) -> CameraSettings:
    """The settings in a file."""
    region = None if section.region is None else Region(*section.region)
    return CameraSettings(section.exposure_ms, section.gain_db, region, section.pixel_format)


def settings_table(settings: CameraSettings, averaged: int = 1) -> dict[str, Any]:
    """The content of ``[settings]``; the inverse of ``settings_of``."""
    region = settings.region
    return _known(
        exposure_ms=settings.exposure_ms,
        gain_db=settings.gain_db,
        pixel_format=settings.pixel_format,
        region=None
        if region is None
        else [region.x_px, region.y_px, region.width_px, region.height_px],
        averaged=averaged if averaged != 1 else None,
    )


def _description(
    camera: str | None,
    projector: str | None,
    settings: CameraSettings | None,
    averaged: int,
    saturation: float | None,
) -> dict[str, Any]:
    """What ``capture.toml`` says beside the names of plan and frames."""
    devices = _known(camera=camera, projector=projector)
    how = settings_table(settings or CameraSettings(), averaged)
    return _known(saturation=saturation, devices=devices or None, settings=how or None)


def _known(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _kept(
    folder: Path, content: dict[str, Any], plan: PatternPlan, stems: list[str]
) -> tuple[str, ...]:
    """Names of the files of an earlier capture that are kept."""
    wanted = UnfinishedFile.checked(content).as_dict(given_only=True)
    before = _begun(folder).as_dict(given_only=True)
    before = {name: before[name] for name in before if name not in ("kind", "plan", "frames")}
    if before != wanted:
        raise InputError(
            f"{folder}: expected the settings of the capture that is there ({_told(before)}), got "
            f"others ({_told(wanted)})"
        )
    if not is_file(folder / PLAN_FILE):
        raise FileProblem(
            f"{folder}: expected {PLAN_FILE} of the capture that is there, got no such file: "
            "capture it anew"
        )
    if (folder / PLAN_FILE).read_text("utf-8") != format_plan(plan):
        raise InputError(f"{folder}: expected the plan of the capture that is there, got another")
    foreign = set(foreign_names(folder))
    names = [stem + suffix for stem in stems for suffix in SUFFIXES]
    there = [n for n in names if n not in foreign and _whole(folder / n)]
    described = [name for name in (CAPTURE_FILE, UNFINISHED_FILE) if is_file(folder / name)]
    return (*described, PLAN_FILE, *there)


def _whole(path: Path) -> bool:
    """Whether a frame is there and can be read; one that cannot is taken again."""
    try:
        read_frame(path)
    except FileProblem:
        return False
    return True


def _begun(folder: Path) -> UnfinishedFile:
    """The description of a capture that was begun, complete or not."""
    for name, kind in ((CAPTURE_FILE, StackFile), (UNFINISHED_FILE, UnfinishedFile)):
        if is_file(folder / name):
            return read_toml(folder / name, kind)
    raise FileProblem(f"{folder}: expected an interrupted capture to resume, got none")


def _told(values: dict[str, Any]) -> str:
    parts = [
        f"{name} = {value}"
        for section in values.values()
        for name, value in (section.items() if isinstance(section, dict) else [("", section)])
    ]
    return ", ".join(parts) or "none"
