"""The picture of every result: what ``.plot()`` returns and ``--figure`` writes."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from fringeworks.evaluate.captures import CaptureComparison
from fringeworks.evaluate.deviation import Deviation
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.cameras import MultiMeasurement
from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.calibration_picture import calibration_picture
from fringeworks.report.camera_picture import cameras_picture
from fringeworks.report.comparison_picture import comparison_picture
from fringeworks.report.deviation_picture import deviation_picture
from fringeworks.report.drawing import Figure, need_plots
from fringeworks.report.maps import UNMEASURED_WORDS, Panel, percent, sheet
from fringeworks.report.plan_picture import plan_picture
from fringeworks.report.profile_picture import profile_picture
from fringeworks.report.setup_figures import setup_sheet
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.scan.setup import SetupTests
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.surface.cloud import normals
from fringeworks.types import (
    CoordinateMap,
    Decoded,
    DisplacementMap,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Profile,
)

SIGMA = "standard deviation σ"
"""Title of every panel of standard deviations."""
REASONS = "measured, or why not"
"""Title of every panel of reasons."""
LIGHT = (-0.5, -0.5, -0.7)
"""Direction towards the lamp of a shaded surface, in camera coordinates: from the upper left, as
pictures of relief are lit by custom."""


def plot(result: object, name: str | None = None) -> Figure:
    """Draw a result as one picture.

    Parameters
    ----------
    result : HeightMap, PointCloud, DisplacementMap, CoordinateMap, Decoded, WrappedPhase,
        LightSeparation, Profile, PatternPlan, Calibration, CaptureComparison, Deviation,
        Reconstruction, Measurement or MultiMeasurement
    name : str, optional
        Name of the object or capture, put before the title.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    InputError for anything else; MissingPackage without the extra ``plots``.
    """
    need_plots("a picture")
    return _drawn(result, name)


@singledispatch
def _drawn(result: object, name: str | None = None) -> Figure:
    what = f"{name}: " if name else ""
    raise InputError(f"{what}expected a result of fringeworks, got {type(result).__name__}")


def _titled(name: str | None, title: str) -> str:
    return f"{name}: {title[0].lower()}{title[1:]}" if name else title


def _facts(measured: float, sigma: FloatMap, unit: str, *more: str) -> str:
    """Size, share of measured pixels and usual σ in one line."""
    height, width = sigma.shape
    found = sigma[np.isfinite(sigma)]
    usual = f"median σ {np.median(found):.2g} {unit}" if found.size else ""
    words = UNMEASURED_WORDS if measured < 1.0 else ""
    parts = (f"{width} × {height} px", f"{percent(measured)} measured", usual, *more, words)
    return "   ·   ".join(part for part in parts if part)


@_drawn.register
def _(surface: HeightMap, name: str | None = None) -> Figure:
    return _of_surface(surface, name)


def _of_surface(surface: HeightMap, name: str | None, *more: Panel) -> Figure:
    heights = surface.quantity == "height"
    title = "Height above the reference plane" if heights else "Displacement of the fringes"
    method = f"method {surface.method}" if surface.method else ""
    pitch = f"{surface.pitch:.3g} mm/px" if heights and surface.pitch is not None else ""
    return sheet(
        _titled(name, title),
        _facts(1.0 - surface.failed_fraction, surface.sigma, surface.unit, pitch, method),
        [
            Panel(surface.quantity, surface.values, "values", surface.unit),
            Panel(SIGMA, surface.sigma, "sigma", surface.unit),
            Panel(REASONS, surface.reason, "reasons"),
            *more,
        ],
        columns=3,
        findings=surface.warnings,
    )


@_drawn.register
def _(found: DisplacementMap, name: str | None = None) -> Figure:
    return sheet(
        _titled(name, f"Displacement of the fringes along {found.axis}"),
        _facts(
            float(np.mean(np.isfinite(found.displacement_px))),
            found.sigma_px,
            "px",
            f"fringe period {found.period_px:.4g} px",
            f"method {found.method}",
        ),
        [
            Panel("displacement", found.displacement_px, "values", "px"),
            Panel(SIGMA, found.sigma_px, "sigma", "px"),
            Panel("modulation, object over reference", found.modulation_ratio, "grey", "ratio"),
            Panel(REASONS, found.reason, "reasons"),
            *_edges(found),
        ],
        columns=2,
    )


def _edges(found: DisplacementMap) -> list[Panel]:
    """Albedo and walls, where the method has found any."""
    panels = []
    if found.albedo is not None:
        panels.append(Panel("albedo, object over reference", found.albedo, "grey", "ratio"))
    if found.walls is not None:
        panels.append(Panel("walls beside cliffs", found.walls, "grey", "1"))
    return panels


@_drawn.register
def _(cloud: PointCloud, name: str | None = None) -> Figure:
    return _of_points(cloud, name)


@_drawn.register
def _(result: Measurement, name: str | None = None) -> Figure:
    return _of_points(result.points, name)


@_drawn.register
def _(result: Reconstruction, name: str | None = None) -> Figure:
    return _of_surface(result.surface, name, *_edges(result.displacement))


def _of_points(cloud: PointCloud, name: str | None) -> Figure:
    lamp = np.asarray(LIGHT) / np.linalg.norm(LIGHT)
    return sheet(
        _titled(name, "Points before the camera"),
        _facts(1.0 - cloud.failed_fraction, cloud.sigma_mm, "mm"),
        [
            Panel("depth z from the camera", cloud.xyz_mm[..., 2], "depth", "mm"),
            Panel("shape, lit from the upper left", normals(cloud) @ lamp, "grey", "brightness"),
            Panel(SIGMA + " along the ray", cloud.sigma_mm, "sigma", "mm"),
            Panel(REASONS, cloud.reason, "reasons"),
        ],
        columns=2,
        findings=cloud.findings,
    )


def _coordinate_panels(found: CoordinateMap) -> list[Panel]:
    what = "column" if found.axis == "x" else "row"
    return [
        Panel(f"projector {what} {found.axis}", found.coordinate_px, "values", "projector px"),
        Panel(SIGMA, found.sigma_px, "sigma", "projector px"),
        Panel("modulation", found.modulation, "grey", "counts"),
        Panel(REASONS, found.reason, "reasons"),
    ]


@_drawn.register
def _(found: CoordinateMap, name: str | None = None) -> Figure:
    what = "column" if found.axis == "x" else "row"
    return sheet(
        _titled(name, f"The projector {what} that lights each camera pixel"),
        _facts(1.0 - found.failed_fraction, found.sigma_px, "projector px"),
        _coordinate_panels(found),
        columns=2,
    )


@_drawn.register
def _(decoded: Decoded, name: str | None = None) -> Figure:
    maps = list(decoded.maps.values())
    facts = "\n".join(
        (f"{'columns' if found.axis == 'x' else 'rows'}: " if len(maps) > 1 else "")
        + _facts(1.0 - found.failed_fraction, found.sigma_px, "projector px")
        for found in maps
    )
    return sheet(
        _titled(name, "The projector pixel that lights each camera pixel"),
        facts,
        [panel for found in maps for panel in _coordinate_panels(found)],
        columns=4 if len(maps) > 1 else 2,
        findings=decoded.findings,
    )


@_drawn.register
def _(wrapped: WrappedPhase, name: str | None = None) -> Figure:
    return sheet(
        _titled(name, "Phase of the fringes, wrapped to −π … π"),
        _facts(1.0 - wrapped.failed_fraction, wrapped.sigma_rad, "rad"),
        [
            Panel("wrapped phase", wrapped.phase_rad, "phase", "rad"),
            Panel(SIGMA, wrapped.sigma_rad, "sigma", "rad"),
            Panel("modulation", wrapped.modulation, "grey", "counts"),
            Panel(REASONS, wrapped.reason, "reasons"),
        ],
        columns=2,
    )


@_drawn.register
def _(light: LightSeparation, name: str | None = None) -> Figure:
    total = light.direct + np.maximum(light.indirect, 0.0)
    share = np.full(total.shape, np.nan)
    np.divide(light.indirect, total, out=share, where=total > 0.0)
    return sheet(
        _titled(name, "Light straight from the projector, and by way of other surfaces"),
        _facts(
            1.0 - light.failed_fraction,
            light.indirect_sigma,
            "counts",
            f"indirect share of all light {percent(light.indirect_share)}",
            f"fringe period {light.period_px:.4g} projector px",
        ),
        [
            Panel("direct light", light.direct, "grey", "counts"),
            Panel("indirect light", light.indirect, "grey", "counts"),
            Panel("indirect over all light", share, "values", "1"),
            Panel(
                "standard deviation σ of the indirect light",
                light.indirect_sigma,
                "sigma",
                "counts",
            ),
            Panel(REASONS, light.reason, "reasons"),
        ],
        columns=3,
    )


@_drawn.register
def _(profile: Profile, name: str | None = None) -> Figure:
    (x0, y0), (x1, y1) = profile.pixels[0], profile.pixels[-1]
    title = f"{profile.quantity} from pixel ({x0}, {y0}) to pixel ({x1}, {y1})"
    return profile_picture(_titled(name, title[0].upper() + title[1:]), profile)


@_drawn.register
def _(found: CaptureComparison, name: str | None = None) -> Figure:
    title = _titled(name, f"Methods compared on {found.name}")
    return comparison_picture(title, found)


@_drawn.register
def _(found: Deviation, name: str | None = None) -> Figure:
    return deviation_picture(_titled(name, "Deviation from the model"), found)


@_drawn.register
def _(plan: PatternPlan, name: str | None = None) -> Figure:
    return plan_picture(_titled(name, "The light of every frame, in the order of projection"), plan)


@_drawn.register
def _(result: MultiMeasurement, name: str | None = None) -> Figure:
    return cameras_picture(_titled(name, "Points of several cameras"), result)


@_drawn.register
def _(calibration: Calibration, name: str | None = None) -> Figure:
    return calibration_picture(_titled(name, "Calibration of camera and projector"), calibration)


@_drawn.register
def _(tests: SetupTests, name: str | None = None) -> Figure:  # noqa: ARG001, it names its devices
    return setup_sheet(tests)
