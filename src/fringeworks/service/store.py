"""Jobs and results on the disk: a job is in the queue, or its result is there as a whole.

``queue/000007.json`` is an open job, ``results/000007/`` an ended one. A result is written into a
folder of another name, which is renamed when all of it is on the disk.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from fringeworks.files.atomic import TEMPORARY, StrPath, write_text
from fringeworks.service.models import JobInfo
from fringeworks.types import FileProblem

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

QUEUE, RESULTS, CAPTURES, RECIPES = "queue", "results", "captures", "recipes"
"""Folders of a service."""
JOB_FILE = "job.json"
"""What is known of an ended job, in its folder."""
LOCK_FILE = ".lock"
"""Held by the service that uses the folder."""
DIGITS = 6
"""Digits of a job's number in names, so that they sort."""
WHOLE_S = 10.0
"""Longest wait until a result is on the disk, s: a busy disk takes a fraction of a second."""
UNREADABLE = "its entry in the queue could not be read after a restart; request it again"


class Store:
    """The folder of a service.

    Parameters
    ----------
    root : path
    keep : int
        Ended jobs that are kept; older ones are deleted with their frames.

    Raises
    ------
    FileProblem for a folder that cannot be written to, or that another service uses.
    """

    def __init__(self, root: StrPath, keep: int) -> None:
        self.root = Path(os.path.abspath(root))
        self.keep = keep
        try:
            for name in (QUEUE, RESULTS, CAPTURES, RECIPES):
                (self.root / name).mkdir(parents=True, exist_ok=True)
            self._lock = (self.root / LOCK_FILE).open("w")
        except OSError as error:
            raise FileProblem(
                f"{self.root}: expected a folder that can be written to: {error.strerror}"
            ) from error
        if fcntl is not None:
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                self._lock.close()
                raise FileProblem(f"{self.root}: another service uses this folder") from error
        for half in (self.root / RESULTS).glob(f"{TEMPORARY}*"):
            shutil.rmtree(half, ignore_errors=True)
        for half in (self.root / QUEUE).glob(f"{TEMPORARY}*"):
            half.unlink(missing_ok=True)

    def close(self) -> None:
        """Let another service use the folder."""
        self._lock.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def folder(self, number: int) -> Path:
        """Where the result of a job is."""
        return self.root / RESULTS / _name(number)

    def capture(self, number: int) -> Path:
        """Where the frames of a scan are."""
        return self.root / CAPTURES / _name(number)

    def recipe(self, name: str) -> Path:
        """Where a recipe is."""
        return self.root / RECIPES / f"{name}.toml"

    def recipes(self) -> list[str]:
        """Names of the recipes."""
        return sorted(path.stem for path in (self.root / RECIPES).glob("*.toml"))

    def put(self, job: JobInfo) -> None:
        """Write an open job into the queue."""
        write_text(self._entry(job.number), job.model_dump_json())

    def half(self, number: int) -> Path:
        """Where the files of a result are written before it is whole."""
        return self.root / RESULTS / f"{TEMPORARY}{_name(number)}"

    def end(self, job: JobInfo) -> None:
        """Give an ended job its folder, with the files of its result, when all are on the disk.

        Raises
        ------
        FileProblem where that cannot be written.
        """
        half, folder = self.half(job.number), self.folder(job.number)
        if job.state != "done":
            shutil.rmtree(half, ignore_errors=True)
        try:
            half.mkdir(exist_ok=True)
            (half / JOB_FILE).write_text(job.model_dump_json(), encoding="utf-8")
            for path in half.iterdir():
                with path.open("rb") as file:
                    os.fsync(file.fileno())
            _sync(half)
            half.rename(folder)
            _sync(folder.parent)
        except OSError as error:
            raise FileProblem(f"{folder}: could not be written: {error.strerror}") from error
        with suppress(OSError):
            self._entry(job.number).unlink(missing_ok=True)

    def whole(self, number: int) -> Path:
        """Where a result is, after waiting until it is whole.

        Raises
        ------
        FileProblem where that takes too long, as on a full disk.
        """
        until = time.monotonic() + WHOLE_S
        folder = self.folder(number)
        while True:
            coming = self.half(number).is_dir()  # looked at first: it may be renamed meanwhile
            if folder.is_dir():
                return folder
            if not coming or time.monotonic() > until:
                raise FileProblem(f"{folder}: the result is not there")
            time.sleep(WHOLE_S / 1000)

    def ended(self) -> list[JobInfo]:
        """All jobs whose results are there, by number."""
        found = (self._read(folder / JOB_FILE) for folder in self._folders())
        return [job for job in found if job is not None]

    def open_jobs(self) -> list[tuple[int, JobInfo | None]]:
        """Jobs of the queue by number; None for an entry that cannot be read."""
        found = []
        for path in sorted((self.root / QUEUE).glob("*.json")):
            if not re.fullmatch(r"\d+", path.stem):
                continue
            number = int(path.stem)
            if self.folder(number).is_dir():
                path.unlink(missing_ok=True)  # it had ended before the service did
                continue
            found.append((number, self._read(path)))
        return found

    def purge(self) -> list[int]:
        """Delete the oldest results beyond those that are kept; their numbers."""
        old = self._folders()[: -self.keep]
        for folder in old:
            shutil.rmtree(folder, ignore_errors=True)
            shutil.rmtree(self.capture(int(folder.name)), ignore_errors=True)
        return [int(folder.name) for folder in old]

    def _folders(self) -> list[Path]:
        every = (self.root / RESULTS).iterdir()
        found = [p for p in every if p.name.isdecimal() and not p.is_symlink()]
        return sorted(found, key=lambda path: int(path.name))

    def _entry(self, number: int) -> Path:
        return self.root / QUEUE / f"{_name(number)}.json"

    def _read(self, path: Path) -> JobInfo | None:
        try:
            return JobInfo.model_validate(json.loads(path.read_text("utf-8")))
        except (OSError, ValueError, ValidationError):
            return None


def _sync(folder: Path) -> None:
    """Write a folder's names to the disk, where the system can do that."""
    with suppress(OSError):
        place = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(place)
        finally:
            os.close(place)


def _name(number: int) -> str:
    return f"{number:0{DIGITS}d}"
