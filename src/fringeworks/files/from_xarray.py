"""Data sets of xarray as results again: the way back of ``to_xarray``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fringeworks.files.exchange import PIXELS
from fringeworks.files.findings import findings_from_json
from fringeworks.files.placement import PLACEMENT, placement_from_json
from fringeworks.files.provenance import KEY, from_json
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    FileProblem,
    HeightMap,
    InputError,
    PointCloud,
)

if TYPE_CHECKING:
    import xarray

AXES: tuple[Axis, Axis] = ("x", "y")
"""Axes of the projector, as variables of coordinates begin."""


def result_of(dataset: xarray.Dataset) -> HeightMap | PointCloud | Decoded:
    """The result that ``to_xarray`` made a data set of, or a part of it.

    Raises
    ------
    InputError where variables are missing, where rows or columns are left out unevenly, and where
    heights would get pixels that are not square.
    """
    for name, make in (
        ("xyz_mm", _cloud),
        ("height", _heights),
        ("displacement", _heights),
        ("x_coordinate_px", _coordinates),
        ("y_coordinate_px", _coordinates),
    ):
        if name in dataset:
            return make(dataset)
    names = ", ".join(map(str, dataset.data_vars)) or "nothing"
    raise InputError(
        "data set: expected xyz_mm, height, displacement, x_coordinate_px or y_coordinate_px, got "
        f"{names}"
    )


def _values(dataset: xarray.Dataset, name: str, *before: str, last: tuple[str, ...] = ()) -> Any:
    """Values of a variable with its axes in the order of a result."""
    if name not in dataset:
        raise InputError(f"data set: expected the variable {name}, got none")
    dims = (*before, *PIXELS, *last)
    if set(dataset[name].dims) != set(dims):
        raise InputError(
            f"data set: expected {name} along {', '.join(dims)}, got "
            f"{', '.join(map(str, dataset[name].dims)) or 'a single value'}"
        )
    return dataset[name].transpose(*dims).to_numpy()


def _known(dataset: xarray.Dataset, name: str, *before: str, last: tuple[str, ...] = ()) -> Any:
    return _values(dataset, name, *before, last=last) if name in dataset else None


def _reason(dataset: xarray.Dataset, name: str = "reason") -> Any:
    # Operations that fill with NaN turn whole numbers into floats.
    values = _values(dataset, name)
    whole = np.nan_to_num(values, nan=-1.0).astype(np.uint8) if values.dtype.kind == "f" else values
    if not np.array_equal(whole, values):
        raise InputError(f"data set: expected {name} as whole numbers, got others")
    return whole


def _about(dataset: xarray.Dataset) -> dict[str, Any]:
    """Findings and provenance."""
    try:
        return {
            "findings": findings_from_json(dataset.attrs.get("findings", "[]")),
            "provenance": from_json(dataset.attrs.get(KEY)),
        }
    except (FileProblem, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"data set: expected findings as JSON, got others: {error}") from error


def _steps(dataset: xarray.Dataset) -> tuple[tuple[float, float], float]:
    """The first column and row that are left of the result, and the step between them, px."""
    first, steps = [], set()
    for name in reversed(PIXELS):
        known = dataset[name].to_numpy() if name in dataset.coords else np.zeros(0)
        places = np.atleast_1d(known).astype(float)
        first.append(float(places[0]) if places.size else 0.0)
        step = np.unique(np.diff(places))
        if step.size > 1 or (step.size and step[0] <= 0):
            raise InputError(f"data set: expected {name}s in even steps that rise, got others")
        steps |= set(step.tolist())
    if len(steps) > 1:
        raise InputError(
            f"data set: expected the same step of rows and columns, got {sorted(steps)}"
        )
    return (first[0], first[1]), float(steps.pop()) if steps else 1.0


def _heights(dataset: xarray.Dataset) -> HeightMap:
    quantity: Literal["height", "displacement"]
    quantity = "height" if "height" in dataset else "displacement"
    (column, row), step = _steps(dataset)
    pitch, pupil = dataset.attrs.get("pitch"), dataset.attrs.get("pupil")
    if pupil is not None:
        x, y, distance = np.asarray(pupil, float)
        pupil = (float((x - column) / step), float((y - row) / step), float(distance))
    converged = dataset.attrs.get("converged")
    return HeightMap(
        _values(dataset, quantity),
        _values(dataset, "sigma"),
        _reason(dataset),
        quantity,
        "mm" if dataset[quantity].attrs.get("units") == "mm" else "px",
        None if pitch is None else float(pitch) * step,
        method=str(dataset.attrs.get("method", "")),
        pupil=pupil,
        converged=None if converged is None else bool(converged),
        **_about(dataset),
    )


def _cloud(dataset: xarray.Dataset) -> PointCloud:
    colours = ("channel",) if "channel" in dataset.dims else ()
    return PointCloud(
        _values(dataset, "xyz_mm", last=("axis",)),
        _values(dataset, "sigma_mm"),
        _values(dataset, "noise_mm"),
        _reason(dataset),
        residual_px=_known(dataset, "residual_px"),
        colour=_known(dataset, "colour", last=colours),
        blur_mm=_known(dataset, "blur_mm"),
        placement=placement_from_json(dataset.attrs.get(PLACEMENT)),
        **_about(dataset),
    )


def _coordinates(dataset: xarray.Dataset) -> Decoded:
    noise = json.loads(dataset.attrs.get("noise", '{"read_counts": 0.0}'))
    maps = {a: _of_axis(dataset, a) for a in AXES if f"{a}_coordinate_px" in dataset}
    return Decoded(maps.get("x"), maps.get("y"), CameraNoise(**noise), **_about(dataset))


def _of_axis(dataset: xarray.Dataset, axis: Axis) -> CoordinateMap:
    coordinate, sigma, modulation, background = (
        _values(dataset, f"{axis}_{name}")
        for name in ("coordinate_px", "sigma_px", "modulation", "background")
    )
    sets = f"{axis}_set"
    repeats = dataset.attrs.get(f"{axis}_repeats_px")
    periods = dataset.coords.get(f"{axis}_period_px")
    return CoordinateMap(
        coordinate,
        sigma,
        modulation,
        background,
        _reason(dataset, f"{axis}_reason"),
        axis,
        () if periods is None else tuple(map(float, np.atleast_1d(periods))),
        phase_rad=_known(dataset, f"{axis}_phase_rad", sets),
        modulations=_known(dataset, f"{axis}_modulations", sets),
        repeats_px=None if repeats is None else float(repeats),
    )
