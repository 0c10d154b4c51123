"""Reading and writing of everything, whatever kind it is."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import StrPath
from fringeworks.files.capture import read_capture
from fringeworks.files.capture_writer import UNFINISHED_FILE
from fringeworks.files.exposures import is_exposures, read_exposures
from fringeworks.files.folder import incomplete
from fringeworks.files.formats import ARCHIVE, CSV, FORMATS, TOML, format_of, main_part
from fringeworks.files.images import TIFF_SUFFIXES
from fringeworks.files.limits import existing_file, is_file, is_folder, parsing, told
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.files.plan import PLAN_FILE
from fringeworks.files.sequence import read_sequence
from fringeworks.files.toml import kind_of
from fringeworks.files.video import VIDEO_SUFFIXES
from fringeworks.types import FileProblem, InputError

CAPTURE_KINDS = ("pair", "stack", "exposures")
"""Kinds that the description in the folder of a capture names."""
MOST_NAMES = 8
"""Names of arrays that a message lists."""


def read(path: StrPath) -> Any:
    """Read whatever a file or folder holds.

    Parameters
    ----------
    path : path
        A capture: its folder, a ``.npz`` or ``.mat`` with two frames, or a TIFF, ``.npy`` or
        ``.npz`` stack, or a video, beside its ``plan.toml``. Frames without a plan: a folder of
        images, a stack in one file, a video, or a Zarr array. One image: ``.png``, ``.jpg``,
        ``.bmp`` or ``.tif``.
        Results: points (``.npz``, ``.ply``, ``.xyz``, ``.pcd``, ``.csv``, ``.e57``, ``.las``,
        ``.laz``), heights (``.tif``, ``.npz``, ``.csv``, ``.x3p``, ``.gsf``), meshes (``.stl``,
        ``.ply``, ``.obj``, ``.off``, ``.glb``, ``.3mf``), drawings (``.step``, ``.stp``, ``.iges``,
        ``.igs``), coordinates (``.npz``, ``.csv``), phases and separated light (``.npz``), figures
        (``.json``).
        Calibrations and settings: rigs (``.toml``, ``.xml``, ``.yml``), responses, geometries of
        the two-frame path (``.toml``, ``.npz``), plans, recipes and set-ups (``.toml``).

    Returns
    -------
    Pair, Stack, tuple of Stack (several exposures), FrameSequence, array (one image), PointCloud,
    Points, HeightMap, TriangleMesh, Decoded, WrappedPhase, LightSeparation, dict (figures), Rig,
    MultiRig, Response, ReferencePlaneGeometry, PixelCalibration, PatternPlan, Recipe or
    StoredSetup: the type that holds most of what the file does. A point cloud is a PointCloud where
    the file has all pixels of the frame: ``.npz``, and ``.pcd``, ``.csv`` and ``.e57`` that were
    written with ``kind="frame"``. A ``.ply`` with triangles is a TriangleMesh, any other one
    Points.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds nothing of these; InputError
    for a ``.ply`` of displacements in px; MissingPackage where a format needs a package that is not
    installed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import fringeworks as fw
    >>> plan = fw.propose(1024, 768, 12)[0].plan
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fw.read(fw.write(Path(folder) / "plan.toml", plan)) == plan
    True
    """
    path = Path(path)
    if is_folder(path):
        return _folder(path)
    path = existing_file(path, "a capture, a result or a calibration")
    suffix = path.suffix.lower()
    by_content = {
        ".ply": _ply,
        ARCHIVE: _archive,
        TOML: _description,
        ".npy": _frames,
        CSV: _table,
        **dict.fromkeys(VIDEO_SUFFIXES, _frames),
        ".mat": FORMATS["pair"].read,
        **dict.fromkeys(TIFF_SUFFIXES, _tiff),
    }
    if suffix in by_content:
        return by_content[suffix](path)
    for one in FORMATS.values():
        if suffix in one.reads:
            return one.read(path)
    known = dict.fromkeys([*by_content, *(s for one in FORMATS.values() for s in one.reads)])
    raise FileProblem(f"{path}: expected one of {', '.join(known)}, got {suffix or 'no suffix'}")


def write(path: StrPath, thing: Any, **options: Any) -> Path:
    """Write a thing in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : path
        PointCloud: ``.ply``, ``.xyz``, ``.npz``, ``.pcd``, ``.mcap``, ``.mat``, ``.csv``, ``.e57``,
        ``.las``, ``.laz``, ``.vtp``, ``.vti``. Points: ``.ply``, ``.xyz``, ``.pcd``, ``.mcap``,
        ``.csv``, ``.e57``, ``.las``, ``.laz``, ``.vtp``. HeightMap: ``.tif``, ``.tiff``, ``.npz``,
        ``.ply``, ``.x3p``, ``.gsf``, ``.csv``, ``.vti``. TriangleMesh: ``.stl``, ``.obj``,
        ``.glb``, ``.3mf``, ``.ply``, ``.vtp``. Decoded: ``.npz``, ``.csv``, ``.vti``, ``.mat``.
        WrappedPhase, LightSeparation: ``.npz``. Rig: ``.toml``, ``.xml``, ``.yml``, ``.yaml``.
        ReferencePlaneGeometry, PlaneCalibration, PixelCalibration: ``.toml``, ``.npz``, the latter
        for those pixel by pixel. MultiRig, Response, PatternPlan, Recipe, Setup, SetupTests,
        StoredSetup: ``.toml``. ndarray: ``.png``, ``.tif``, ``.tiff``, of a frame. dict: ``.json``,
        of figures. Pair, Stack: a folder. Of a Measurement, MultiMeasurement or MergedPart the
        points are written, of a Reconstruction the surface, of a Calibration or MultiCalibration
        the rig.
    thing : one of these
    **options
        Of the function that writes the type: ``kind="mesh"`` for points and heights in ``.ply``,
        ``kind="frame"`` for all pixels of points in ``.pcd``, ``.csv`` and ``.e57``,
        ``force=True`` for folders with other things in them, ``unwrapped`` for a phase,
        ``projector`` and ``camera`` for a Setup. See ``write_points`` and the others.

    Returns
    -------
    The path.

    Raises
    ------
    InputError for a thing of another type, and an option that its format does not have;
    FileProblem for a suffix that the thing cannot be written to, and where the folder cannot be
    written to.

    Examples
    --------
    >>> import tempfile
    >>> import fringeworks as fw
    >>> plan = fw.propose(1280, 800, 8)[0].plan
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     back = fw.read(fw.write(f"{folder}/plan.toml", plan))
    >>> back == plan
    True
    """
    if not isinstance(path, (str, os.PathLike)):
        got = type(path).__name__
        raise InputError(f"path: expected a path, and after it what is written, got a {got} first")
    thing = main_part(thing)
    one = format_of(type(thing))
    if one is None:
        known = ", ".join(name for one in FORMATS.values() for name in one.types)
        raise InputError(f"{path}: expected one of {known}, got {type(thing).__name__}")
    one.write(path, thing, **options)
    return Path(path)


def _folder(path: Path) -> Any:
    """A capture, several exposures, or a sequence of frames without a plan."""
    if is_exposures(path):
        return read_exposures(path)
    described = any(is_file(path / name) for name in (CAPTURE_FILE, UNFINISHED_FILE, PLAN_FILE))
    return read_capture(path) if described or incomplete(path) else read_sequence(path)


def _frames(path: Path) -> Any:
    """A stack in one file with its plan beside it, or a sequence of frames."""
    planned = is_file(path.parent / PLAN_FILE)
    return read_capture(path) if planned else read_sequence(path)


def _tiff(path: Path) -> Any:
    """A height map, one image, or several."""
    from fringeworks.files.surfaces import holds_heights
    from fringeworks.files.tiff import opened_tiff  # 15 ms, for those only who read TIFF

    with parsing(path, "a readable TIFF"), opened_tiff(path) as file:
        heights, pages = holds_heights(file), len(file.pages)
    if heights:
        return FORMATS["surface"].read(path)
    return _frames(path) if pages > 1 else FORMATS["frame"].read(path)


def _ply(path: Path) -> Any:
    """A mesh where there are triangles, otherwise points."""
    from fringeworks.files.ply import holds_faces

    return FORMATS["mesh" if holds_faces(path) else "merged"].read(path)


def _archive(path: Path) -> Any:
    """What the names of the arrays tell."""
    with parsing(path, "an archive (.npz)"), zipfile.ZipFile(path) as archive:
        names = {name.removesuffix(".npy") for name in archive.namelist()}
    for one in FORMATS.values():
        if not names.isdisjoint(one.arrays):
            return _frames(path) if one.name == "stack" else one.read(path)
    known = ", ".join(one.holds for one in FORMATS.values() if one.arrays)
    got = told(", ".join(sorted(names)[:MOST_NAMES])) or "nothing"
    raise FileProblem(f"{path}: expected {known}, got arrays named {got}")


def _table(path: Path) -> Any:
    """What the first line of a table tells; tables of other programs hold points."""
    from fringeworks.files.result_csv import holds

    kind = holds(path)
    one = next((one for one in FORMATS.values() if kind in one.tables), None)
    if one is None:
        known = ", ".join(kind for one in FORMATS.values() for kind in one.tables)
        raise FileProblem(f"{path}: expected a table of {known}, got {told(kind)}")
    return one.read(path)


def _description(path: Path) -> Any:
    """What the kind in a description tells; set-ups name none."""
    kind = kind_of(path) or "setup"
    if kind in CAPTURE_KINDS:
        return _folder(path.parent)
    for one in FORMATS.values():
        if kind in one.kinds:
            return one.read(path)
    known = ", ".join(kind for one in FORMATS.values() for kind in one.kinds)
    raise FileProblem(f"{path}: expected a file of the kind {known}, got {told(repr(kind))}")
