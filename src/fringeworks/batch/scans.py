"""What a batch measures: folders of captures, and arrays of frames, here or at an address."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.capture_writer import UNFINISHED_FILE
from fringeworks.files.limits import is_file, is_folder, read_content
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.files.plan import PLAN_FILE
from fringeworks.files.zarr_array import (
    INSTALL,
    ZARR_FILE,
    holds_counts,
    open_zarr_array,
    read_entry,
)
from fringeworks.stack.frames import Stack
from fringeworks.types import FileProblem, InputError, MissingPackage, Recipe

FRAME_AXES = 4
"""Dimensions of an array of scans: scan or time, frame, row, column."""


@dataclass(frozen=True)
class Scan:
    """One capture of a batch."""

    name: str
    """Name in the summary, unique in the batch."""
    place: str
    """Folder of the capture, or the array; a path or an address that fsspec opens."""
    index: int | None = None
    """Place along the array's first axis; None for a folder."""


def find_scans(source: StrPath) -> list[Scan]:
    """Return the scans of a batch, in the order of their names.

    Parameters
    ----------
    source : path or address
        A folder with a folder for each capture, those that are empty or unfinished among them, so
        that no part is lost without a word; a Zarr array (scan, frame, row, column); or the
        address of either that fsspec opens, such as ``s3://bucket/line-1``.

    Raises
    ------
    FileProblem for anything else; MissingPackage where an array or an address needs the extra
    ``batch``.
    """
    text = str(source)
    if "://" in text:
        return _at_address(text)
    folder = Path(source)
    if is_file(folder / ZARR_FILE):
        return _of_array(text)
    if not is_folder(folder):
        raise FileProblem(f"{folder}: expected a folder of captures or a Zarr array, got none")
    found = [place for place in _folders(folder) if _is_scan(place)]
    if not any(is_ready(str(place)) for place in found):
        raise FileProblem(f"{folder}: expected folders with {CAPTURE_FILE}, got none")
    return [Scan(place.name, str(place)) for place in found]


def _folders(folder: Path) -> list[Path]:
    """Folders in a folder, by name, but for hidden ones."""
    return sorted(p for p in folder.iterdir() if is_folder(p) and not p.name.startswith("."))


def _is_scan(folder: Path) -> bool:
    """Whether a folder is a capture, or one whose frames are missing."""
    described = is_ready(str(folder)) or is_file(folder / UNFINISHED_FILE)
    return described or not any(folder.iterdir())


def is_ready(place: str) -> bool:
    """Whether a capture is complete, as far as its folder tells; addresses are."""
    folder = Path(place)
    names = (CAPTURE_FILE, PLAN_FILE)
    unfinished = is_file(folder / UNFINISHED_FILE)
    return "://" in place or (any(is_file(folder / n) for n in names) and not unfinished)


def passed_over(source: StrPath) -> tuple[str, ...]:
    """Names of the folders in a folder of captures that are none."""
    folder = Path(source)
    if "://" in str(source) or is_file(folder / ZARR_FILE) or not is_folder(folder):
        return ()
    return tuple(place.name for place in _folders(folder) if not _is_scan(place))


def _at_address(address: str) -> list[Scan]:
    try:
        import fsspec
    except ModuleNotFoundError as error:
        raise MissingPackage(f"{address}: expected fsspec, got none: {INSTALL}") from error
    try:
        files, root = fsspec.core.url_to_fs(address)
        if files.exists(f"{root}/zarr.json"):
            return _of_array(address)
        captures = sorted(files.glob(f"{root.rstrip('/')}/*/{CAPTURE_FILE}"))
    except (OSError, ValueError, ImportError) as error:
        raise FileProblem(f"{address}: could not be opened: {error}") from error
    if not captures:
        raise FileProblem(f"{address}: expected folders with {CAPTURE_FILE}, got none")
    places = [str(path).rsplit("/", 1)[0] for path in captures]
    return [Scan(place.rsplit("/", 1)[1], files.unstrip_protocol(place)) for place in places]


def _of_array(place: str) -> list[Scan]:
    array = opened_array(place)
    return [Scan(f"{k:06d}", place, k) for k in range(array.shape[0])]


def opened_array(place: str) -> Any:
    """Open an array of frames.

    Raises
    ------
    FileProblem for arrays of other dimensions or types; MissingPackage without the extra.
    """
    array = open_zarr_array(place)
    if not holds_counts(array, FRAME_AXES):
        shape = getattr(array, "shape", ())
        raise FileProblem(
            f"{place}: expected an array of counts (scan, frame, row, column), got shape {shape}"
        )
    return array


@contextmanager
def local(scan: Scan) -> Iterator[Path | Any]:
    """Lend a scan as a folder on this machine, or as an array of frames (frame, row, column)."""
    if scan.index is not None:
        yield read_entry(scan.place, opened_array(scan.place), scan.index)
    elif "://" not in scan.place:
        yield Path(scan.place)
    else:
        import fsspec

        with TemporaryDirectory(prefix="fringeworks-batch-") as place:
            files, root = fsspec.core.url_to_fs(scan.place)
            target = Path(place) / "capture"
            try:
                files.get(root, str(target), recursive=True)
            except (OSError, ValueError) as error:
                raise FileProblem(f"{scan.place}: could not be read: {error}") from error
            yield target
            shutil.rmtree(target, ignore_errors=True)


def taken(scan: Scan) -> str:
    """When the frames of a scan were written, in UTC (ISO 8601); empty where nothing tells it.

    It is the latest date of its files; files at an address and arrays have none.
    """
    if scan.index is not None or "://" in scan.place:
        return ""
    try:
        latest = max((p.stat().st_mtime for p in Path(scan.place).iterdir()), default=None)
    except OSError:
        return ""
    if latest is None:
        return ""
    return datetime.fromtimestamp(latest, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def content_hash(lent: Path | Any) -> str:
    """Return the SHA-256 of what a scan holds: names and bytes of its files, or its frames."""
    digest = hashlib.sha256()
    if isinstance(lent, Path):
        for path in sorted(p for p in lent.rglob("*") if is_file(p)):
            content = read_content(path, "a capture's file")
            digest.update(f"{path.relative_to(lent).as_posix()}\0{len(content)}\0".encode())
            digest.update(content)
    else:
        digest.update(f"{lent.shape}{lent.dtype.str}".encode())
        digest.update(np.ascontiguousarray(lent).data)
    return digest.hexdigest()


def stack_of_array(frames: Any, recipe: Recipe) -> Stack:
    """Return the frames of an array as a stack, with the recipe's plan.

    Raises
    ------
    InputError for a recipe without a plan.
    """
    if recipe.plan is None:
        raise InputError("recipe: expected a plan for an array of frames, got none")
    return Stack(list(frames), recipe.plan)
