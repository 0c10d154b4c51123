"""Results as layers of napari: values, σ and reasons as images, points with σ as their colour."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.read_write import read
from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.types import (
    BoolMap,
    Decoded,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Points,
    Reason,
)

Layer = tuple[Any, dict[str, Any], str]
"""Data of a layer, its options, and its kind."""
MOST_POINTS = 200_000
"""Points that are shown: napari draws them one by one, and more make turning them slow. A cloud
with more is thinned evenly; the file has all."""
POINT_MM = 0.5
"""Size of a point on the screen, mm, where nothing tells how dense they are."""
SPAN = (2.0, 98.0)
"""Percentiles between which colours run: a few far points would leave one colour to all others."""


def reader_of(path: str | list[str]) -> Callable[[str | list[str]], list[Layer]] | None:
    """Return what reads a file; None where it holds nothing that can be shown.

    Parameters
    ----------
    path : str, or list of str
        As napari calls it; of several files the first decides.
    """
    first = path[0] if isinstance(path, list) else path
    try:
        layers_of(read(first))
    except InputError:
        return None
    return read_layers


def read_layers(path: str | list[str]) -> list[Layer]:
    """Read files as layers."""
    paths = path if isinstance(path, list) else [path]
    return [layer for one in paths for layer in layers_of(read(one), Path(one).stem)]


def layers_of(result: object, name: str = "") -> list[Layer]:
    """Return a result as layers.

    Parameters
    ----------
    result : HeightMap, PointCloud, Points, Decoded, Reconstruction or Measurement
    name : str
        Begins the layers' names.

    Returns
    -------
    list of (data, options, kind)
        A map becomes images of values, σ and reasons. Points become a layer of points in napari's
        order (z, y, x), in mm, coloured by σ, with σ and noise as features.

    Raises
    ------
    InputError for anything else.
    """
    if isinstance(result, Reconstruction):
        result = result.surface
    if isinstance(result, Measurement):
        result = result.points
    begin = f"{name} " if name else ""
    if isinstance(result, HeightMap):
        pitch = result.pitch or 1.0
        unit = result.unit
        return [
            _image(result.values, f"{begin}{result.quantity} / {unit}", pitch, "viridis"),
            _image(result.sigma, f"{begin}σ / {unit}", pitch, "magma", visible=False),
            _reasons(result.reason, f"{begin}reasons", pitch),
        ]
    if isinstance(result, PointCloud):
        measured = result.reason == Reason.OK
        known = {"sigma_mm": result.sigma_mm[measured], "noise_mm": result.noise_mm[measured]}
        return [
            _points(result.xyz_mm[measured], known, f"{begin}points"),
            _image(result.xyz_mm[..., 2], f"{begin}depth / mm", 1.0, "viridis", visible=False),
            _image(result.sigma_mm, f"{begin}σ / mm", 1.0, "magma", visible=False),
            _reasons(result.reason, f"{begin}reasons", 1.0),
        ]
    if isinstance(result, Points):
        known = {"sigma_mm": result.sigma_mm, "noise_mm": result.noise_mm}
        kept = {key: values for key, values in known.items() if values is not None}
        return [_points(result.xyz_mm, kept, f"{begin}points")]
    if isinstance(result, Decoded):
        return [layer for axis in result.maps for layer in _coordinates(result, axis, begin)]
    raise InputError(
        f"layers: expected heights, points or coordinates, got {type(result).__name__}"
    )


def _coordinates(decoded: Decoded, axis: Any, begin: str) -> list[Layer]:
    found = decoded.maps[axis]
    return [
        _image(found.coordinate_px, f"{begin}{axis} / px", 1.0, "viridis"),
        _image(found.sigma_px, f"{begin}σ of {axis} / px", 1.0, "magma", visible=False),
        _reasons(found.reason, f"{begin}reasons of {axis}", 1.0),
    ]


def _span(values: FloatMap) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = (float(v) for v in np.percentile(known, SPAN))
    return (low, high) if high > low else None


def _image(
    values: FloatMap, name: str, pitch: float, colours: str, *, visible: bool = True
) -> Layer:
    options: dict[str, Any] = {
        "name": name,
        "scale": (pitch, pitch),
        "colormap": colours,
        "visible": visible,
    }
    span = _span(values)
    if span is not None:
        options["contrast_limits"] = span
    return np.asarray(values, np.float32), options, "image"


def _reasons(reason: Any, name: str, pitch: float) -> Layer:
    """Why pixels have no value, as labels; 0, the background, is what was measured."""
    words = {"index": [one.value for one in Reason], "reason": [one.name.lower() for one in Reason]}
    options = {
        "name": name,
        "scale": (pitch, pitch),
        "features": words,
        "visible": False,
        "opacity": 0.5,
    }
    return np.asarray(reason, np.uint8), options, "labels"


def _points(xyz: FloatMap, known: dict[str, FloatMap], name: str) -> Layer:
    shown = _thinned(len(xyz))
    features = {key: np.asarray(values)[shown] for key, values in known.items()}
    options: dict[str, Any] = {
        "name": name,
        "features": features,
        "size": POINT_MM,
        "border_width": 0.0,
    }
    span = _span(features["sigma_mm"]) if "sigma_mm" in features else None
    if span is not None:
        options |= {
            "face_color": "sigma_mm",
            "face_colormap": "plasma",
            "face_contrast_limits": span,
            # Small points are mostly border: it has the same colours.
            "border_color": "sigma_mm",
            "border_colormap": "plasma",
            "border_contrast_limits": span,
        }
    return np.asarray(xyz, np.float32)[shown][:, ::-1], options, "points"


def _thinned(count: int) -> BoolMap | slice:
    """Evenly chosen points, at most ``MOST_POINTS``."""
    return slice(None, None, -(-count // MOST_POINTS)) if count > MOST_POINTS else slice(None)
