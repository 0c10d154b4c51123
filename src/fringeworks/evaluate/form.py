"""Bodies fitted to measured points: form and size errors in the terms of VDI/VDE 2634."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.points import Points, read_points
from fringeworks.files.provenance import source_of
from fringeworks.surface.form import Form, find_spheres, fit_form
from fringeworks.surface.form import report as form_report
from fringeworks.surface.form_geometry import BodyKind
from fringeworks.types import (
    FloatMap,
    Frozen,
    InputError,
    Provenance,
    Source,
    fingerprint,
    made_by,
)

MIN_POINTS = 10
"""Points that a fit needs: twice the five parameters of a cylinder."""


@dataclass(frozen=True, eq=False, repr=False)
class FormEvaluation(Frozen):
    """Bodies that were fitted to points, and their errors."""

    forms: tuple[Form, ...]
    """The fits, with the distance of every point."""
    figures: dict[str, Any]
    """Figures of each fit under ``bodies``; for two spheres their spacing and its error."""
    provenance: Provenance | None = None
    """How it was made."""


def evaluate_form(
    points: Points | FloatMap | StrPath,
    fit: BodyKind,
    *,
    diameter_mm: float | None = None,
    count: int = 1,
    spacing_mm: float | None = None,
    within: tuple[float, float, float, float] | None = None,
) -> FormEvaluation:
    """Fit a plane, a sphere, a cylinder or several spheres to points.

    Parameters
    ----------
    points : Points, (n, 3) array in mm, or path
    fit : "plane", "sphere" or "cylinder"
    diameter_mm : float > 0, optional
        Calibrated diameter: the probing error size PS is measured against it.
    count : int
        Spheres to find; two for their spacing.
    spacing_mm : float, optional
        Calibrated distance of two spheres: the error SD is measured against it.
    within : (x, y, z, radius), optional
        Use the points in this ball only, mm.

    Returns
    -------
    FormEvaluation

    Raises
    ------
    InputError for options that do not fit together, too few points, and a body that is not found.
    """
    if count < 1 or (count > 1 and fit != "sphere"):
        raise InputError(f"count: expected 1, or more for spheres, got {count}")
    if spacing_mm is not None and count != 2:
        raise InputError(f"spacing: expected with two spheres, got it with {count}")
    xyz, sources = _points_of(points)
    if within is not None:
        xyz = _cut(xyz, within)
    forms = [fit_form(xyz, fit)] if count == 1 else find_spheres(xyz, count)
    bodies = [form_report(form, diameter_mm=diameter_mm) for form in forms]
    figures: dict[str, Any] = {"bodies": bodies}
    if count == 2:
        centres = [np.asarray(form.parameters["centre_mm"]) for form in forms]
        figures["sphere_spacing_mm"] = float(np.linalg.norm(centres[0] - centres[1]))
        if spacing_mm is not None:
            figures["sphere_spacing_error_SD_mm"] = figures["sphere_spacing_mm"] - spacing_mm
    options: dict[str, Any] = {"fit": fit, "diameter_mm": diameter_mm, "count": count}
    options |= {"spacing_mm": spacing_mm, "within": within}
    origin = made_by("evaluate_form", options=options, inputs=sources)
    return FormEvaluation(tuple(forms), figures, origin)


def _points_of(
    points: Points | FloatMap | StrPath,
) -> tuple[FloatMap, tuple[Source, ...]]:
    if isinstance(points, (str, os.PathLike)):
        return read_points(points).xyz_mm, (source_of(points),)
    xyz = points.xyz_mm if isinstance(points, Points) else np.asarray(points)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError(f"points: expected shape (n, 3), got {xyz.shape}")
    return xyz, (Source("points", fingerprint(xyz)),)


def _cut(xyz: FloatMap, within: tuple[float, float, float, float]) -> FloatMap:
    if len(within) != 4 or not within[3] > 0:
        raise InputError(f"within: expected x, y, z and a radius > 0, got {within}")
    inside: FloatMap = xyz[np.linalg.norm(xyz - np.asarray(within[:3]), axis=1) <= within[3]]
    if len(inside) < MIN_POINTS:
        raise InputError(f"within: expected {MIN_POINTS} points or more there, got {len(inside)}")
    return inside
