"""What one scan of an artefact says: errors of form, size, spacing and flatness; its place."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringeworks.evaluate.acceptance.positions import ArtefactPlace
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.blur_doubt import with_blur_doubt
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.files.points import cloud_points, read_cloud, read_points
from fringeworks.files.provenance import source_of
from fringeworks.pipeline.inputs import capture_of
from fringeworks.pipeline.stacks import measure
from fringeworks.surface.form import DISCARDED, Form, fit_form, fit_region
from fringeworks.surface.form_report import find_spheres
from fringeworks.types import (
    Area,
    BoolMap,
    FloatMap,
    Frozen,
    InputError,
    Pair,
    PointCloud,
    Points,
    Reason,
    Rig,
    Source,
    fingerprint,
)
from fringeworks.types.certificate import AcceptanceTest, BallBar, PlaneArtefact, TestScan
from fringeworks.types.numbers import number

WRONG_DIAMETER = 0.1
"""Relative error of a diameter from which on a sphere is none of the bar's balls."""
CALIBRATED_SHARE = 0.9
"""Share of the length and width of a plane that is evaluated: pixels at the rim see two surfaces,
and certificates of flatness leave the rim out."""
RIMS = (0.01, 0.99)
"""Shares of the points between which the plane's middle is half way."""
PLANE_REACH = 0.02
"""Distance from the plane that most points lie on, over the artefact's width, up to which points
belong to it: a stand behind it does not."""


@dataclass(frozen=True, eq=False, repr=False)
class PositionResult(Frozen):
    """What one scan says."""

    name: str
    placement: ArtefactPlace
    values_mm: Mapping[str, tuple[float, ...]]
    """PF and PS of both balls and SD, or F; mm. PS and SD are measured less calibrated."""
    sigma_mm: Mapping[str, tuple[float, ...]]
    """Their standard deviations as the scanner states them; NaN where it states none."""
    points: int
    """Points that were evaluated."""
    rejected: float
    """Share of points that lie more than six robust standard deviations off the body: they count,
    but for the 0.3 % that the guideline lets go."""
    inputs: tuple[Source, ...]
    """Raw frames, or the file of points, with their hashes."""


def measure_position(one: TestScan, test: AcceptanceTest, rig: Rig | None) -> PositionResult:
    """Measure the artefact of one scan.

    Raises
    ------
    InputError that names the scan, where it does not show the artefact.
    """
    name = one.name or (Path(one.scan).name if isinstance(one.scan, (str, os.PathLike)) else "scan")
    try:
        surface, inputs = _surface(one, test, rig)
        if one.artefact == "ball bar":
            if test.ball_bar is None:
                raise InputError("scan: expected a test with a ball bar, got none")
            return _of_bar(name, surface, inputs, test.ball_bar, rig)
        if test.plane is None:
            raise InputError("scan: expected a test with a plane, got none")
        return _of_plane(name, surface, inputs, test.plane, test, rig)
    except InputError as problem:
        raise problem.at(name) from problem


def _surface(
    one: TestScan, test: AcceptanceTest, rig: Rig | None
) -> tuple[PointCloud | Points, tuple[Source, ...]]:
    """The points of a scan, and the files that they come from."""
    scan = one.scan
    if isinstance(scan, PointCloud | Points):
        origin = scan.provenance if isinstance(scan, PointCloud) else None
        known = () if origin is None else origin.inputs
        scan = with_blur_doubt(scan, rig)
        return scan, known or (Source("points", fingerprint(scan.xyz_mm)),)
    if Path(scan).is_file():
        read = read_cloud if Path(scan).suffix.lower() == ".npz" else read_points
        return read(scan), (source_of(scan),)
    found = capture_of(scan)
    if isinstance(found, Pair):
        raise InputError("expected frames of a plan, got a pair")
    if rig is None:
        raise InputError("expected a test with a rig for a capture, got none")
    cloud = measure(found, rig, **test.options).points
    return with_blur_doubt(cloud, rig), () if cloud.provenance is None else cloud.provenance.inputs


def _xyz(surface: PointCloud | Points) -> FloatMap:
    found = cloud_points(surface) if isinstance(surface, PointCloud) else surface
    return np.asarray(found.xyz_mm, np.float64)


def _areas(surface: PointCloud | Points, forms: list[Form]) -> list[Area]:
    """The pixels of each body; none for points of no camera."""
    if not isinstance(surface, PointCloud):
        return []
    areas = []
    for form in forms:
        mask: BoolMap = np.zeros(surface.shape, bool)
        rows, columns = np.nonzero(surface.reason == Reason.OK)
        mask[rows[form.region], columns[form.region]] = True
        areas.append(Area(mask=mask))
    return areas


def _weighted(cloud: PointCloud, area: Area, rig: Rig | None) -> Form:
    """The sphere of an area as recipes fit it: blur moves the last pixels before a rim by far more
    than noise moves the others, so that they count by their σ."""
    part = area_points(cloud, area, rig)
    return fit_region(part.points, "sphere", sigma_mm=1.0 / part.weights)


def _sigma(
    quantity: str, surface: PointCloud | Points, areas: list[Area], rig: Rig | None
) -> float:
    """σ that the scanner states for a quantity; NaN where it states none."""
    if not areas or not isinstance(surface, PointCloud):
        return float(np.nan)
    try:
        return MEASURED[quantity](*(area_points(surface, area, rig) for area in areas)).sigma
    except InputError:
        return float(np.nan)


def _of_bar(
    name: str,
    surface: PointCloud | Points,
    inputs: tuple[Source, ...],
    bar: BallBar,
    rig: Rig | None,
) -> PositionResult:
    forms = find_spheres(_xyz(surface), 2)
    found = [2.0 * float(np.asarray(form.parameters["radius_mm"])) for form in forms]
    wanted = bar.diameters_mm
    off = [np.abs(np.subtract(found, way)).sum() for way in (wanted, wanted[::-1])]
    if off[1] < off[0]:
        forms, found = forms[::-1], found[::-1]
    for measured, calibrated in zip(found, wanted, strict=True):
        if abs(measured - calibrated) > WRONG_DIAMETER * calibrated:
            raise InputError(
                f"ball bar: expected balls of {number(wanted[0])} and {number(wanted[1])} mm, got "
                f"spheres of {number(found[0])} and {number(found[1])} mm"
            )
    areas = _areas(surface, forms)
    if isinstance(surface, PointCloud):
        forms = [_weighted(surface, area, rig) for area in areas]
        found = [2.0 * float(np.asarray(form.parameters["radius_mm"])) for form in forms]
    centres = np.array([form.parameters["centre_mm"] for form in forms])
    region = np.concatenate([form.far[form.region] for form in forms])
    spread = tuple(form.spread_mm(1.0 - DISCARDED) for form in forms)
    apart = float(np.linalg.norm(centres[0] - centres[1]))
    return PositionResult(
        name,
        ArtefactPlace("ball bar", name, centres),
        {
            "PF": spread,
            "PS": tuple(f - w for f, w in zip(found, wanted, strict=True)),
            "SD": (apart - bar.length_mm,),
        },
        {
            "PF": (float(np.nan),) * 2,
            "PS": tuple(_sigma("sphere_diameter", surface, [a], rig) for a in areas)
            or (float(np.nan),) * 2,
            "SD": (_sigma("sphere_spacing", surface, areas, rig),),
        },
        int(region.size),
        float(region.mean()),
        inputs,
    )


def _calibrated(xyz: FloatMap, rough: Form, plane: PlaneArtefact) -> BoolMap:
    """Points of the plane's calibrated area, which ends before its rim."""
    near = np.abs(rough.distance_mm) <= PLANE_REACH * min(plane.size_mm)
    axes = np.linalg.svd(xyz[near] - xyz[near].mean(axis=0), full_matrices=False)[2][:2]
    places = xyz @ axes.T
    middle = np.quantile(places[near], RIMS, axis=0).mean(axis=0)
    half = 0.5 * CALIBRATED_SHARE * np.sort(np.array(plane.size_mm))[::-1]
    return np.asarray(near & (np.abs(places - middle) <= half).all(axis=1), bool)


def _of_plane(
    name: str,
    surface: PointCloud | Points,
    inputs: tuple[Source, ...],
    plane: PlaneArtefact,
    test: AcceptanceTest,
    rig: Rig | None,
) -> PositionResult:
    xyz = _xyz(surface)
    rough = fit_form(xyz, "plane")
    region = _calibrated(xyz, rough, plane)
    fitted = fit_region(xyz[region], "plane")
    middle = xyz[region].mean(axis=0)
    normal = np.asarray(fitted.parameters["normal"], np.float64)
    normal = -normal if normal @ middle > 0 else normal
    arm = 0.25 * test.volume.diagonal_mm
    along = np.linalg.svd(xyz[region] - middle, full_matrices=False)[2][0]
    whole = Form("plane", fitted.parameters, rough.distance_mm, region, None, region, ~region)
    return PositionResult(
        name,
        ArtefactPlace("plane", name, middle + arm * np.array([np.zeros(3), normal, along])),
        {"F": (fitted.spread_mm(1.0 - DISCARDED),)},
        {"F": (_sigma("flatness", surface, _areas(surface, [whole]), rig),)},
        int(region.sum()),
        float(fitted.far.mean()),
        inputs,
    )
