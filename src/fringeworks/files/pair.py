"""Captures on disk: a folder with ``capture.toml``, two images, ``.npz`` or MATLAB ``.mat``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from fringeworks.files.atomic import make_folder, read_frame, write_frame, write_text
from fringeworks.files.toml import Section, read_toml
from fringeworks.types import Axis, InputError, Pair, ReferencePlaneGeometry

CAPTURE_FILE = "capture.toml"
MATLAB_REFERENCE, MATLAB_OBJECT = "S", "D"


class FramesSection(Section):
    """``[frames]``: image files, relative to the folder."""

    reference: str | None = None
    """Left out for a single frame."""
    object: str


class GeometrySection(Section):
    """``[geometry]``: theory §2; without it results stay in px."""

    distance_mm: float
    baseline_mm: float
    pitch_mm_per_px: float
    sign: Literal[1, -1] = 1


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


def read_capture(path: Path) -> Pair:
    """Read a capture from a folder with ``capture.toml``, a ``.npz`` or a ``.mat`` file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Pair with frames as stored.

    Raises
    ------
    InputError for anything missing, unreadable or unknown, naming the file and the field.

    Notes
    -----
    ``.npz``: arrays ``reference`` and ``object``, optionally ``mask`` and ``truth_mm``.
    ``.mat`` (v5 to v7.3): variables S and D, as the dissertation's files hold them.
    """
    path = Path(path)
    if path.is_dir():
        return _read_folder(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a capture folder, .npz or .mat file, got nothing there")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _from_arrays(path, _load_npz(path), "reference", "object")
    if suffix == ".mat":
        return _from_arrays(path, _load_mat(path), MATLAB_REFERENCE, MATLAB_OBJECT)
    raise InputError(
        f"{path}: expected a capture folder, .npz or .mat file, got {suffix or path.name}"
    )


def read_pair(reference: Path | None, object: Path) -> Pair:
    """A capture from two files, or from the object's alone, without geometry.

    Parameters
    ----------
    reference, object : Path
        Images, or ``.mat`` files with the variable S and D respectively, as the dissertation's.
        No reference makes a single frame.

    Raises
    ------
    InputError where a file cannot be read or the two differ in size.
    """
    if reference is None:
        only, notes = _one_frame(object, MATLAB_OBJECT)
        return Pair(reference=None, object=only, notes=notes)
    first, first_notes = _one_frame(reference, MATLAB_REFERENCE)
    second, second_notes = _one_frame(object, MATLAB_OBJECT)
    if first.shape != second.shape:
        raise InputError(
            f"frames: expected equal sizes, got {_size(first)} in {Path(reference).name} and "
            f"{_size(second)} in {Path(object).name}"
        )
    return Pair(reference=first, object=second, notes=first_notes + second_notes)


def _one_frame(path: Path, variable: str) -> tuple[NDArray[Any], tuple[str, ...]]:
    if Path(path).suffix.lower() == ".mat" and Path(path).is_file():
        return _real_array(path, _load_mat(path), variable), ()
    return read_frame(path)


def _size(frame: NDArray[Any]) -> str:
    return f"{frame.shape[1]} × {frame.shape[0]}"


def _read_folder(folder: Path) -> Pair:
    description = folder / CAPTURE_FILE
    if not description.is_file():
        raise InputError(f"{folder}: expected a file {CAPTURE_FILE}, got none")
    content = read_toml(description, CaptureFile)
    named = content.frames.reference
    pair = read_pair(None if named is None else folder / named, folder / content.frames.object)
    geometry = content.geometry
    mask, background = (
        None if name is None else read_frame(folder / name)[0] != 0
        for name in (content.mask, content.background)
    )
    truth = None if content.truth is None else read_frame(folder / content.truth)[0]
    return Pair(
        reference=pair.reference,
        object=pair.object,
        mask=_fitting("mask", mask, pair.object),
        background=_fitting("background", background, pair.object),
        axis=content.axis,
        geometry=None if geometry is None else ReferencePlaneGeometry(**geometry.model_dump()),
        camera=content.devices.camera,
        projector=content.devices.projector,
        truth_mm=_fitting("truth", truth, pair.object),
        notes=pair.notes,
    )


def _fitting(name: str, values: Any, frame: NDArray[Any]) -> Any:
    if values is not None and values.shape != frame.shape:
        raise InputError(f"{name}: expected shape {frame.shape}, got {values.shape}")
    return values


def _load_npz(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # zipfile and numpy raise many kinds for a damaged archive
        raise InputError(f"{path}: expected a readable .npz, got: {error}") from error


def _load_mat(path: Path) -> dict[str, Any]:
    # Slow to import, and needed for these files only.
    import h5py
    import scipy.io

    try:
        if h5py.is_hdf5(path):
            with h5py.File(path) as file:
                # HDF5 keeps MATLAB's column order: the axes come out swapped.
                return {
                    name: np.asarray(item).T
                    for name, item in file.items()
                    if isinstance(item, h5py.Dataset)
                }
        return dict(scipy.io.loadmat(path))
    except Exception as error:  # scipy.io and h5py raise many kinds for a damaged file
        raise InputError(f"{path}: expected a readable .mat, got: {error}") from error


def _real_array(path: Path, arrays: dict[str, Any], name: str) -> NDArray[Any]:
    if name not in arrays:
        there = ", ".join(key for key in arrays if not key.startswith("__")) or "nothing"
        raise InputError(f"{path}: expected a variable {name}, got {there}")
    frame = arrays[name]
    if not isinstance(frame, np.ndarray) or frame.ndim != 2 or frame.dtype.kind not in "uif":
        kind = f"{getattr(frame, 'dtype', type(frame))} {getattr(frame, 'shape', '')}"
        raise InputError(f"{path}: expected {name} as a real (h, w) array, got {kind}")
    return frame


def _from_arrays(path: Path, arrays: dict[str, Any], reference: str, object: str) -> Pair:
    first, second = (_real_array(path, arrays, name) for name in (reference, object))
    if first.shape != second.shape:
        raise InputError(
            f"{path}: expected equal sizes, got {_size(first)} in {reference} and "
            f"{_size(second)} in {object}"
        )
    mask = arrays.get("mask")
    return Pair(
        reference=first,
        object=second,
        mask=_fitting("mask", None if mask is None else mask != 0, first),
        truth_mm=_fitting("truth_mm", arrays.get("truth_mm"), first),
    )


def write_pair(folder: Path, capture: Pair) -> Path:
    """Write a capture as a folder of images with ``capture.toml``.

    Whole counts become PNG, floats TIFF; the description is written last, so that a folder
    that has one is complete.

    Returns
    -------
    Path of the description.
    """
    folder = make_folder(folder)
    frames = {}
    for name in ("reference", "object"):
        frame = getattr(capture, name)
        if frame is None:
            continue
        frames[name] = f"{name}.png" if frame.dtype in (np.uint8, np.uint16) else f"{name}.tif"
        write_frame(folder / frames[name], frame)
    content: dict[str, Any] = {"kind": "pair"}
    if capture.axis:
        content["axis"] = capture.axis
    for name in ("mask", "background"):
        values = getattr(capture, name)
        if values is not None:
            content[name] = f"{name}.png"
            write_frame(folder / f"{name}.png", values.astype(np.uint8) * np.uint8(255))
    if capture.truth_mm is not None:
        content["truth"] = "truth.tif"
        write_frame(folder / "truth.tif", np.asarray(capture.truth_mm, np.float64))
    content["frames"] = frames
    devices = {"camera": capture.camera, "projector": capture.projector}
    named = {name: value for name, value in devices.items() if value is not None}
    if named:
        content["devices"] = named
    if capture.geometry is not None:
        g = capture.geometry
        content["geometry"] = {
            "distance_mm": g.distance_mm,
            "baseline_mm": g.baseline_mm,
            "pitch_mm_per_px": g.pitch_mm_per_px,
            "sign": g.sign,
        }
    write_text(folder / CAPTURE_FILE, tomli_w.dumps(content))
    return folder / CAPTURE_FILE
