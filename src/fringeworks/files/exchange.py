"""Results as objects of other packages: data sets of xarray, point clouds of Open3D."""

from __future__ import annotations

import json
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.files.csv_table import REASONS
from fringeworks.files.findings import findings_as_json
from fringeworks.files.placement import PLACEMENT, placement_json
from fringeworks.files.point_table import COLOURS
from fringeworks.files.provenance import KEY, json_line
from fringeworks.files.white import white_of
from fringeworks.surface.cloud import normals
from fringeworks.types import (
    CoordinateMap,
    Decoded,
    HeightMap,
    InputError,
    MissingPackage,
    PointCloud,
    Reason,
)

if TYPE_CHECKING:
    import xarray

PIXELS = ("row", "column")
"""Axes of a map."""
Variable = tuple[tuple[str, ...], Any, dict[str, Any]]
"""Axes, values and attributes."""


def dataset(result: object) -> xarray.Dataset:
    """A height map, a point cloud or projector coordinates as a data set.

    Raises
    ------
    MissingPackage where the package ``xarray`` (the extra "xarray") is not installed.
    """
    try:
        xr = import_module("xarray")
    except ImportError as error:
        raise MissingPackage(
            "a data set: expected the package xarray, got none; pip install 'fringeworks[xarray]'"
        ) from error
    if isinstance(result, HeightMap):
        variables, coordinates, attributes = _heights(result)
    elif isinstance(result, PointCloud):
        variables, coordinates, attributes = _cloud(result)
    elif isinstance(result, Decoded):
        variables, coordinates, attributes = _coordinates(result)
    else:
        raise InputError(f"expected heights, points or coordinates, got {type(result).__name__}")
    first = next(iter(variables.values()))[1]
    for name, length in zip(PIXELS, first.shape[:2], strict=True):
        coordinates[name] = ((name,), np.arange(length), {"units": "px"})
    attributes["findings"] = findings_as_json(result.findings)
    origin = json_line(result.provenance)
    if origin is not None:
        attributes[KEY] = origin
    found: xarray.Dataset = xr.Dataset(variables, coordinates, attributes)
    return found


def _map(values: Any, units: str, long_name: str, *more: str) -> Variable:
    return (*more, *PIXELS), values, {"units": units, "long_name": long_name}


def _reason(values: Any, of: str = "value") -> Variable:
    about = {"long_name": f"why a pixel has no {of}; ok where it has one"}
    flags = {
        "flag_values": np.arange(len(Reason), dtype=np.uint8),
        "flag_meanings": " ".join(REASONS),
    }
    return PIXELS, values, about | flags


def _heights(
    surface: HeightMap,
) -> tuple[dict[str, Variable], dict[str, Variable], dict[str, Any]]:
    unit = surface.unit
    words = {
        "height": "height above the reference plane",
        "displacement": "displacement of the fringes",
    }
    variables = {
        surface.quantity: _map(surface.values, unit, words[surface.quantity]),
        "sigma": _map(surface.sigma, unit, f"standard deviation of the {surface.quantity}"),
        "reason": _reason(surface.reason),
    }
    coordinates: dict[str, Variable] = {}
    attributes: dict[str, Any] = {"method": surface.method}
    if surface.pitch is not None:
        attributes["pitch"] = surface.pitch
        for axis, name, length, sign, towards in (
            ("x", "column", surface.shape[1], 1.0, "right"),
            ("y", "row", surface.shape[0], -1.0, "top"),
        ):
            about = {"units": unit, "long_name": f"place on the plane, towards the {towards}"}
            coordinates[axis] = ((name,), sign * surface.pitch * np.arange(length), about)
    if surface.pupil is not None:
        attributes["pupil"] = list(surface.pupil)
    if surface.converged is not None:
        attributes["converged"] = int(surface.converged)
    return variables, coordinates, attributes


def _cloud(
    cloud: PointCloud,
) -> tuple[dict[str, Variable], dict[str, Variable], dict[str, Any]]:
    place = "place in camera coordinates: x right, y down, z away from the camera"
    if cloud.placement is not None:
        place = f"place in coordinates of {cloud.frame}"
    variables: dict[str, Variable] = {
        "xyz_mm": ((*PIXELS, "axis"), cloud.xyz_mm, {"units": "mm", "long_name": place}),
        "sigma_mm": _map(cloud.sigma_mm, "mm", "standard deviation along the camera's ray"),
        "noise_mm": _map(cloud.noise_mm, "mm", "part of it that is independent between pixels"),
        "reason": _reason(cloud.reason, "point"),
    }
    coordinates: dict[str, Variable] = {"axis": (("axis",), list("xyz"), {})}
    attributes: dict[str, Any] = {}
    if cloud.placement is not None:
        attributes[PLACEMENT] = placement_json(cloud.placement)
    if cloud.residual_px is not None:
        words = "distance from the epipolar line"
        variables["residual_px"] = _map(cloud.residual_px, "px", words)
    if cloud.blur_mm is not None:
        words = "common error that the camera's blur leaves"
        variables["blur_mm"] = _map(cloud.blur_mm, "mm", words)
    if cloud.colour is not None:
        coloured = cloud.colour.ndim == 3
        about = {"units": "counts", "long_name": "colour" if coloured else "brightness"}
        axes = (*PIXELS, "channel") if coloured else PIXELS
        variables["colour"] = (axes, cloud.colour, about)
        if coloured:
            coordinates["channel"] = (("channel",), list(COLOURS), {})
    return variables, coordinates, attributes


def _coordinates(
    decoded: Decoded,
) -> tuple[dict[str, Variable], dict[str, Variable], dict[str, Any]]:
    variables: dict[str, Variable] = {}
    coordinates: dict[str, Variable] = {}
    noise = {"read_counts": decoded.noise.read_counts, "gain": decoded.noise.gain}
    attributes: dict[str, Any] = {"noise": json.dumps(noise)}
    for axis, found in decoded.maps.items():
        variables |= {f"{axis}_{name}": one for name, one in _of_axis(found).items()}
        periods = (f"{axis}_set",), list(found.periods_px), {"units": "px"}
        coordinates[f"{axis}_period_px"] = periods
        if found.repeats_px is not None:
            attributes[f"{axis}_repeats_px"] = found.repeats_px
    return variables, coordinates, attributes


def _of_axis(found: CoordinateMap) -> dict[str, Variable]:
    across = "column" if found.axis == "x" else "row"
    variables = {
        "coordinate_px": _map(found.coordinate_px, "px", f"projector {across}"),
        "sigma_px": _map(found.sigma_px, "px", f"standard deviation of the projector {across}"),
        "modulation": _map(found.modulation, "counts", "modulation of the shortest period"),
        "background": _map(found.background, "counts", "mean of the phase frames"),
        "reason": _reason(found.reason, "coordinate"),
    }
    sets = f"{found.axis}_set"
    if found.phase_rad is not None:
        variables["phase_rad"] = _map(found.phase_rad, "rad", "wrapped phase of a set", sets)
    if found.modulations is not None:
        variables["modulations"] = _map(found.modulations, "counts", "modulation of a set", sets)
    return variables


def open3d_cloud(cloud: PointCloud) -> Any:
    """The measured points as a point cloud of Open3D, in mm.

    Raises
    ------
    MissingPackage where the package ``open3d`` is not installed.
    """
    try:
        open3d = import_module("open3d")
    except ImportError as error:
        raise MissingPackage(
            "a point cloud of Open3D: expected the package open3d, got none; pip install open3d"
        ) from error
    ok = cloud.reason == Reason.OK
    columns = {
        "positions": cloud.xyz_mm[ok],
        "normals": np.nan_to_num(normals(cloud)[ok]),
        "sigma": cloud.sigma_mm[ok][:, None],
        "noise": cloud.noise_mm[ok][:, None],
    }
    if cloud.colour is not None:
        seen = np.asarray(cloud.colour, np.float64)[ok]
        white = white_of(seen)
        if white is not None:
            shown = np.clip(np.nan_to_num(seen) / white, 0.0, 1.0)
            shown = np.stack((shown,) * 3, axis=-1) if shown.ndim == 1 else shown
            columns["colors"] = shown
    found = open3d.t.geometry.PointCloud()
    for name, values in columns.items():
        tensor = open3d.core.Tensor(np.ascontiguousarray(values, np.float32))
        found.point[name] = tensor
    return found
