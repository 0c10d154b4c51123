"""Several exposures of one scene on disk: a folder with a capture for each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w

from fringeworks.files.atomic import StrPath, write_text
from fringeworks.files.capture_writer import UNFINISHED_FILE, refuse_unfinished
from fringeworks.files.description import Field, Section
from fringeworks.files.folder import FolderWriter, replacing_folder
from fringeworks.files.limits import inside, is_file, is_folder, parsing
from fringeworks.files.pair import CAPTURE_FILE, missing_description
from fringeworks.files.stack import read_stack
from fringeworks.files.toml import kind_of, read_toml
from fringeworks.stack.frames import Stack
from fringeworks.types import CameraSettings, FileProblem, InputError

KIND = "exposures"
"""Kind of a description that lists several exposures."""
MOST_EXPOSURES = 64
"""Largest number of exposures that a description may list; scans use two to five."""


class ExposureSection(Section):
    """``[[exposures]]``: one capture, and what its camera was set to."""

    folder: str
    """Folder of the capture, relative to the description."""
    exposure_ms: float | None = Field(default=None, gt=0)
    gain_db: float | None = None


class ExposuresFile(Section):
    """``capture.toml`` of several exposures; unknown keys are refused."""

    kind: Literal["exposures"]
    exposures: Annotated[list[ExposureSection], Field(min_length=1, max_length=MOST_EXPOSURES)]


class ExposuresWriter:
    """Hands out the folders of the exposures; see ``writing_exposures``."""

    def __init__(self, writer: FolderWriter, sections: Sequence[dict[str, Any]]) -> None:
        self._writer = writer
        self._names: list[str] = [section["folder"] for section in sections]

    def folder(self, number: int) -> Path:
        """Return the folder that the capture of an exposure is written to."""
        name = self._names[number]
        if self._writer.keeps(name):
            return self._writer.folder / name
        return self._writer.file(name)

    def is_begun(self, number: int) -> bool:
        """Whether frames of an exposure were taken before an interrupted scan was resumed."""
        name = self._names[number]
        folder = self._writer.folder / name
        begun = any(is_file(folder / file) for file in (UNFINISHED_FILE, CAPTURE_FILE))
        return self._writer.keeps(name) and begun


@contextmanager
def writing_exposures(
    folder: StrPath,
    settings: Sequence[CameraSettings],
    *,
    resume: bool = False,
    force: bool = False,
) -> Iterator[ExposuresWriter]:
    """Write several exposures of one scene, each as a capture in a folder 0, 1, … of its own.

    ``capture.toml``, which lists the captures, is written at the end. Until then the folder holds
    ``unfinished.toml``, and reading it says that the scan was interrupted.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    settings : sequence of CameraSettings
        One for each exposure.
    resume : bool
        Keep what an interrupted scan with the same settings has written. A complete one is left as
        it is.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.

    Raises
    ------
    InputError for no settings, or others than those of the interrupted scan; FileProblem where the
    folder cannot be written to, or there is nothing to resume.
    """
    if not 1 <= len(settings) <= MOST_EXPOSURES:
        raise InputError(f"settings: expected 1 to {MOST_EXPOSURES}, got {len(settings)}")
    sections = [_section(number, one) for number, one in enumerate(settings)]
    content = {"kind": KIND, "exposures": sections}
    kept = _kept(Path(folder), content) if resume else ()
    with replacing_folder(folder, KIND, index=(CAPTURE_FILE,), force=force, kept=kept) as writer:
        if not kept:
            write_text(writer.file(UNFINISHED_FILE), tomli_w.dumps(content))
        yield ExposuresWriter(writer, sections)
        if CAPTURE_FILE in kept:
            return
        write_text(writer.file(CAPTURE_FILE), tomli_w.dumps(content))
        writer.remove(UNFINISHED_FILE)


class GrowingExposures:
    """Hands out folders for captures, however many come; see ``growing_exposures``."""

    def __init__(self, writer: FolderWriter) -> None:
        self._writer = writer
        self.sections: list[dict[str, Any]] = []

    def add(self, settings: CameraSettings) -> Path:
        """Return the folder that the next capture is written to.

        Raises
        ------
        InputError for more captures than a description may list.
        """
        number = len(self.sections)
        if number >= MOST_EXPOSURES:
            raise InputError(f"captures: expected at most {MOST_EXPOSURES}, got more")
        self.sections.append(_section(number, settings))
        return self._writer.file(str(number))


@contextmanager
def growing_exposures(folder: StrPath, *, force: bool = False) -> Iterator[GrowingExposures]:
    """Write captures of one scene one after another, until the caller has enough.

    ``capture.toml``, which lists the captures, is written at the end; ``read_exposures`` reads the
    folder.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.

    Raises
    ------
    FileProblem where the folder cannot be written to.
    """
    with replacing_folder(folder, KIND, index=(CAPTURE_FILE,), force=force) as writer:
        growing = GrowingExposures(writer)
        yield growing
        content = {"kind": KIND, "exposures": growing.sections}
        write_text(writer.file(CAPTURE_FILE), tomli_w.dumps(content))


def series_to_resume(folder: StrPath) -> list[CameraSettings]:
    """Return the settings of a scan with several exposures that was begun in a folder.

    Raises
    ------
    FileProblem where there is none.
    """
    return [
        CameraSettings(exposure_ms=one.exposure_ms, gain_db=one.gain_db)
        for one in _begun(Path(folder)).exposures
    ]


def is_exposures(path: StrPath) -> bool:
    """Whether a path is a folder with several exposures of one scene, complete or not."""
    return any(kind_of(Path(path) / name) == KIND for name in (CAPTURE_FILE, UNFINISHED_FILE))


def read_exposures(folder: StrPath) -> tuple[Stack, ...]:
    """Read several exposures of one scene.

    Parameters
    ----------
    folder : path
        With a ``capture.toml`` of the kind "exposures", as ``capture_hdr`` writes it.

    Returns
    -------
    The stack of every exposure, in the order of the description.

    Raises
    ------
    FileProblem for anything missing, unreadable or unknown, naming the file, and for captures of
    different plans or frame sizes.
    """
    folder = Path(folder)
    refuse_unfinished(folder)
    description = folder / CAPTURE_FILE
    if not is_file(description):
        raise missing_description(folder, CAPTURE_FILE)
    with parsing(folder, "several exposures of a scene"):
        content = read_toml(description, ExposuresFile)
        stacks = tuple(read_stack(inside(folder, one.folder)) for one in content.exposures)
    first = stacks[0]
    for one, stack in zip(content.exposures, stacks, strict=True):
        if stack.plan != first.plan or stack.frames[0].shape != first.frames[0].shape:
            raise FileProblem(
                f"{folder / one.folder}: expected the plan and the frame size of the other "
                "exposures, got others"
            )
    return stacks


def _section(number: int, settings: CameraSettings) -> dict[str, Any]:
    known = {"exposure_ms": settings.exposure_ms, "gain_db": settings.gain_db}
    return {"folder": str(number)} | {n: float(v) for n, v in known.items() if v is not None}


def _kept(folder: Path, content: dict[str, Any]) -> tuple[str, ...]:
    """Names in the folder of an interrupted scan that are kept."""
    before = _begun(folder)
    if before.as_dict() != ExposuresFile.checked(content).as_dict():
        raise InputError(
            f"{folder}: expected the settings of the captures that are there "
            f"({_told(before.exposures)}), got {_told(content['exposures'])}"
        )
    names = [one.folder for one in before.exposures]
    described = [name for name in (CAPTURE_FILE, UNFINISHED_FILE) if is_file(folder / name)]
    return (*described, *(name for name in names if is_folder(folder / name)))


def _begun(folder: Path) -> ExposuresFile:
    """The description of a scan that was begun, complete or not."""
    for name in (CAPTURE_FILE, UNFINISHED_FILE):
        if is_file(folder / name):
            return read_toml(folder / name, ExposuresFile)
    raise FileProblem(f"{folder}: expected an interrupted capture to resume, got none")


def _told(exposures: Sequence[ExposureSection] | Sequence[dict[str, Any]]) -> str:
    sections = [ExposureSection.checked(one) for one in exposures]
    return ", ".join(f"{one.exposure_ms} ms and {one.gain_db} dB" for one in sections)
