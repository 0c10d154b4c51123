"""Bodies fitted to measured points: form and size errors in the terms of VDI/VDE 2634."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.formats import main_part
from fringeworks.files.points import cloud_points, read_points, surface_points
from fringeworks.files.provenance import source_of
from fringeworks.pipeline.merging import MergedPart
from fringeworks.pipeline.stacks import Measurement
from fringeworks.surface.form import DISCARDED, Form, fit_region
from fringeworks.surface.form_geometry import BodyKind
from fringeworks.surface.form_report import find_spheres
from fringeworks.surface.form_report import report as form_report
from fringeworks.types import (
    BoolMap,
    Finding,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Noted,
    PointCloud,
    Points,
    Provenance,
    Source,
    as_notes,
    fingerprint,
    finite,
    found_before,
    made_by,
)
from fringeworks.types.numbers import number, percent

MIN_POINTS = 10
"""Points that a fit needs: twice the five parameters of a cylinder."""


@dataclass(frozen=True, eq=False, repr=False)
class FormEvaluation(Noted, Frozen):
    """Bodies that were fitted to points, and their errors."""

    forms: tuple[Form, ...]
    """The fits, with the distance of every point."""
    figures: dict[str, Any]
    """Figures of each fit under ``bodies``; for two spheres their spacing and its error; ``notes``
    on the points, the text of the findings."""
    findings: tuple[Finding, ...] = ()
    """What was found about the points."""
    provenance: Provenance | None = None
    """How it was made."""


def fit(
    points: Points | PointCloud | HeightMap | Measurement | MergedPart | FloatMap | StrPath,
    body: BodyKind,
    *,
    diameter_mm: float | None = None,
    count: int = 1,
    spacing_mm: float | None = None,
    within: tuple[float, float, float, float] | None = None,
) -> FormEvaluation:
    """Fit a plane, a sphere, a cylinder or several spheres to points.

    Parameters
    ----------
    points : Points, PointCloud, Measurement, MergedPart, HeightMap or (n, 3) array in mm, or path
        A file of points or a height map. Their common error, such as that of the calibration, is
        part of the radius's σ where they carry it.
    body : "plane", "sphere" or "cylinder"
    diameter_mm : float > 0, optional
        Calibrated diameter: the probing error size PS is measured against it.
    count : int
        Spheres to find; two for their spacing. The region of each is the ball of 1.1 radii around
        its centre.
    spacing_mm : float, optional
        Calibrated distance of two spheres: the error SD is measured against it.
    within : (x, y, z, radius), optional
        Region: the points in this ball, mm; all points by default. The form is evaluated over all
        points of the region but 0.3 %, as VDI/VDE 2634 asks.

    Returns
    -------
    FormEvaluation

    Raises
    ------
    InputError for options that do not fit together, too few points, points in px, a body that is
    not found or that the points do not determine, and a region in which more than a tenth of the
    points lie off the body.

    Examples
    --------
    >>> import numpy as np
    >>> directions = np.random.default_rng(0).normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> found = fit(25.0 * directions + [0.0, 0.0, 500.0], "sphere", diameter_mm=50.0)
    >>> round(found.forms[0].parameters["radius_mm"], 6)
    25.0
    """
    if count < 1 or (count > 1 and body != "sphere"):
        raise InputError(f"count: expected 1, or more for spheres, got {count}")
    if spacing_mm is not None and count != 2:
        raise InputError(f"spacing: expected with two spheres, got it with {count}")
    if spacing_mm is not None and not 0 < spacing_mm < np.inf:
        raise InputError(f"spacing: expected > 0 mm, got {spacing_mm}")
    found, sources = _points_of(main_part(points))
    xyz, common = found.xyz_mm, _common_error(found)
    if within is not None:
        inside = _cut(xyz, within)
        xyz, common = xyz[inside], None if common is None else common[inside]
    rms = 0.0 if common is None else float(np.sqrt(np.mean(common**2)))
    with found_before(found.findings):
        if count == 1:
            forms = [fit_region(xyz, body, common_mm=rms)]
        else:
            forms = find_spheres(xyz, count, common_mm=rms)
    bodies = [form_report(form, diameter_mm=diameter_mm) for form in forms]
    told = _findings(found, common, forms)
    figures: dict[str, Any] = {"bodies": bodies, "notes": [finding.text for finding in told]}
    if count == 2:
        centres = [np.asarray(form.parameters["centre_mm"]) for form in forms]
        figures["sphere_spacing_mm"] = float(np.linalg.norm(centres[0] - centres[1]))
        if spacing_mm is not None:
            figures["sphere_spacing_error_SD_mm"] = figures["sphere_spacing_mm"] - spacing_mm
    options: dict[str, Any] = {"body": body, "diameter_mm": diameter_mm, "count": count}
    options |= {"spacing_mm": spacing_mm, "within": within}
    origin = made_by("fit", options=options, inputs=sources)
    return FormEvaluation(tuple(forms), figures, told, origin)


def _points_of(
    points: Points | PointCloud | HeightMap | FloatMap | StrPath,
) -> tuple[Points, tuple[Source, ...]]:
    if isinstance(points, (str, os.PathLike)):
        return read_points(points), (source_of(points),)
    if isinstance(points, HeightMap):
        points = surface_points(points)
    elif isinstance(points, PointCloud):
        points = cloud_points(points)
    elif not isinstance(points, Points):
        xyz = np.asarray(points)
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise InputError(f"points: expected shape (n, 3), got {xyz.shape}")
        points = Points(xyz, None)
    return points, (Source("points", fingerprint(points.xyz_mm)),)


def _common_error(points: Points) -> FloatMap | None:
    """σ of the error that neighbours have in common, (n,), mm; None where unknown."""
    if points.sigma_mm is None or points.noise_mm is None:
        return None
    common = np.sqrt(np.maximum(points.sigma_mm**2 - points.noise_mm**2, 0.0))
    return common if bool(np.isfinite(common).all()) else None


def _findings(points: Points, common: FloatMap | None, forms: list[Form]) -> tuple[Finding, ...]:
    """What a reader of the figures must know about the points."""
    findings = list(points.findings)
    for form in forms:
        if not form.far.any():
            continue
        share = float(form.far.sum() / form.region.sum())
        most = float(np.abs(form.distance_mm[form.far]).max())
        counted = share > DISCARDED
        seen = (
            f"{percent(share)} of the points lie up to {number(most)} mm off the {form.body} that "
            "the others lie on: dents, bumps or points of something else; "
            + ("they count" if counted else "they are among the discarded 0.3 %: look at them")
        )
        findings.append(Finding("form", seen, figures={"share": share, "largest_mm": most}))
    if common is None and any(form.sigma_mm is not None for form in forms):
        seen = (
            "the points carry no calibration error: the radius's σ is that of their scatter alone"
        )
        findings += as_notes([seen], "standard deviation")
    return tuple(findings)


def _cut(xyz: FloatMap, within: tuple[float, float, float, float]) -> BoolMap:
    """Which points lie in the ball."""
    if len(within) != 4 or not finite(*within) or not within[3] > 0:
        raise InputError(f"within: expected x, y, z and a radius > 0, got {within}")
    inside: BoolMap = np.linalg.norm(xyz - np.asarray(within[:3]), axis=1) <= within[3]
    if inside.sum() < MIN_POINTS:
        raise InputError(f"within: expected {MIN_POINTS} points or more there, got {inside.sum()}")
    return inside
