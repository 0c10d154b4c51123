"""Sample data of the release: a small simulated set for each way to measure, fetched once."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from fringeworks.files.limits import is_file, is_folder, told
from fringeworks.types import FileProblem, InputError, MissingPackage

SampleName = Literal["pair", "stack", "board", "views", "batch"]
SAMPLES = ("pair", "stack", "board", "views", "batch")
"""Names of the sets."""
FOLDER = "fringeworks-samples-1"
"""Name of the archive without its suffix, with the version of the data."""
ARCHIVE = f"{FOLDER}.zip"
"""The archive of the release."""
ADDRESS = f"https://github.com/fringeworks/fringeworks/releases/download/v0.1.0/{ARCHIVE}"
"""Where the release has it."""
SHA256 = "2d60b047aa33962bdf67ffe594d43b1d56cc771f7c40ed789e6d48b4ef6d5fee"
"""Hash of the archive; ``python -m release.sample_data --write-hash`` stores it."""
VARIABLE = "FRINGEWORKS_SAMPLES"
"""Environment variable with the folder that holds the archive, for computers without a network."""


def sample_data(name: SampleName) -> Path:
    """Return the folder of a set of sample data; fetch the data where they are not there yet.

    Parameters
    ----------
    name : str
        "pair": two frames with the truth. "stack": a bust and the rig. "board": a chessboard in
        eight poses. "views": a part from four sides and the rig. "batch": five parts and the rig.

    Returns
    -------
    Path of a folder. Captures lie in folders in it; those of stacks have their truth beside them.

    Raises
    ------
    InputError for another name. FileProblem where the archive cannot be fetched, or is not that of
    this version. MissingPackage where it is to be fetched without the package ``pooch`` (the extra
    "data").

    Notes
    -----
    The archive of the release is fetched once into the user's cache, and checked by its hash.
    Without a network, put it into a folder and name that in the environment variable
    ``FRINGEWORKS_SAMPLES``.
    """
    if name not in SAMPLES:
        raise InputError(f"sample data: expected one of {', '.join(SAMPLES)}, got {name!r}")
    given = os.environ.get(VARIABLE)
    folder = _unpacked(_given(Path(given)) if given else _fetched())
    return folder / name


def _given(folder: Path) -> Path:
    """The archive in a folder that the user names."""
    archive = folder / ARCHIVE
    if not is_file(archive) and not is_folder(folder / FOLDER):
        raise FileProblem(f"{VARIABLE}: expected {ARCHIVE} in {told(folder)}, got no such file")
    return archive


def _fetched() -> Path:
    """The archive in the user's cache."""
    try:
        pooch: Any = import_module("pooch")
    except ModuleNotFoundError as error:
        raise MissingPackage(
            "sample data: expected the package pooch to fetch them, got none; pip install "
            f"'fringeworks[data]', or name the folder with {ARCHIVE} in {VARIABLE}"
        ) from error
    cache = Path(pooch.os_cache("fringeworks"))
    if is_folder(cache / FOLDER):
        return cache / ARCHIVE
    try:
        found = pooch.retrieve(ADDRESS, f"sha256:{SHA256}", fname=ARCHIVE, path=cache)
    except (OSError, ValueError) as error:
        raise FileProblem(
            f"sample data: {ADDRESS} could not be fetched ({type(error).__name__}); download it by "
            f"other means, and name its folder in the environment variable {VARIABLE}"
        ) from error
    return Path(found)


def _unpacked(archive: Path) -> Path:
    """The folder of an archive's content beside it, made where it is missing."""
    folder = archive.with_name(FOLDER)
    if is_folder(folder):
        return folder
    content = archive.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if digest != SHA256:
        raise FileProblem(
            f"{archive}: expected the archive of this version (sha256 {SHA256[:12]}…), got another "
            f"({digest[:12]}…); download it again"
        )
    try:
        with (
            tempfile.TemporaryDirectory(dir=archive.parent) as place,
            zipfile.ZipFile(archive) as z,
        ):
            z.extractall(Path(place) / FOLDER)
            _moved(Path(place) / FOLDER, folder)
    except OSError as error:
        raise FileProblem(
            f"{archive}: could not be unpacked beside it: {error.strerror}"
        ) from error
    return folder


def _moved(made: Path, folder: Path) -> None:
    """Give a whole folder its final name, unless another process was quicker."""
    try:
        made.rename(folder)
    except OSError:
        if not is_folder(folder):
            raise
