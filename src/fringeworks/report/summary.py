"""The numerical results, ready for JSON."""

from __future__ import annotations

from functools import singledispatch
from importlib import import_module
from typing import Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.pipeline.stacks import Measurement
from fringeworks.signal.response import Response
from fringeworks.stack.light_separation import LightSeparation
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.types import (
    Decoded,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Points,
    Provenance,
    Reason,
    count_reasons,
)

ELSEWHERE = {
    "fringeworks.pipeline.pairs.Reconstruction": "pair_summary",
    "fringeworks.rig.calibration.planes.PlaneCalibration": "pair_summary",
    "fringeworks.rig.calibration.planes.PixelCalibration": "pair_summary",
    "fringeworks.rig.calibration.calibrate.Calibration": "calibration_summary",
    "fringeworks.rig.calibration.drift.RigCheck": "calibration_summary",
    "fringeworks.evaluate.deviation.Deviation": "evaluation_summary",
    "fringeworks.rig.calibration.cameras.MultiCalibration": "camera_summary",
    "fringeworks.pipeline.cameras.MultiMeasurement": "camera_summary",
    "fringeworks.evaluate.form.FormEvaluation": "evaluation_summary",
    "fringeworks.evaluate.inspect.Inspection": "evaluation_summary",
    "fringeworks.scan.setup.SetupTests": "setup_summary",
}
"""Results whose summaries are in other modules of this room. These import rooms that take time to
import and that other results do not need."""


def summarise(result: object) -> dict[str, Any]:
    """The numerical results of a chain, ready for JSON.

    Parameters
    ----------
    result : Reconstruction, Measurement, Decoded, WrappedPhase, LightSeparation, Calibration,
        MultiCalibration, RigCheck, PlaneCalibration, PixelCalibration, Response, FormEvaluation,
        Inspection, Deviation, HeightMap, PointCloud, Points, MultiMeasurement or SetupTests

    Returns
    -------
    Dictionary of JSON values. Timings are not in it: equal runs give equal numbers.

    Raises
    ------
    InputError for anything else.
    """
    for kind in type(result).__mro__:
        module = ELSEWHERE.get(f"{kind.__module__}.{kind.__qualname__}")
        if module is not None:
            import_module(f"{__package__}.{module}")
    return summary(result)


@singledispatch
def summary(result: object) -> dict[str, Any]:
    """``summarise`` for results whose modules were imported."""
    raise InputError(f"result: expected a result of fringeworks, got {type(result).__name__}")


def told(result: Any) -> dict[str, Any]:
    """The findings of a result as part of a summary, and their text."""
    return {"findings": findings_as_dicts(result.findings), "notes": list(result.notes)}


def origin(provenance: Provenance | None) -> dict[str, Any]:
    """The provenance as part of a summary; nothing where there is none."""
    return {} if provenance is None else {"provenance": provenance.as_dict()}


@summary.register
def _(surface: HeightMap) -> dict[str, Any]:
    return of_heights(surface) | {
        "converged": surface.converged,
        **told(surface),
        **origin(surface.provenance),
    }


@summary.register
def _(decoded: Decoded) -> dict[str, Any]:
    axes = {}
    for axis, found in decoded.maps.items():
        ok = found.reason == Reason.OK
        values, sigma = found.coordinate_px[ok], found.sigma_px[ok]
        axes[axis] = {
            "periods_px": list(found.periods_px),
            "repeats_px": found.repeats_px,
            "failed_fraction": found.failed_fraction,
            "reasons": count_reasons(found.reason),
            "minimum_px": float(values.min()) if values.size else None,
            "maximum_px": float(values.max()) if values.size else None,
            "median_sigma_px": float(np.median(sigma)) if sigma.size else None,
            "median_modulation": float(np.median(found.modulation[ok])) if ok.any() else None,
            **decoded.details.get(axis, {}),
        }
    some = next(iter(decoded.maps.values()))
    return {
        "shape": list(some.coordinate_px.shape),
        "noise": {"read_counts": decoded.noise.read_counts, "gain": decoded.noise.gain},
        "axes": axes,
        **told(decoded),
        **origin(decoded.provenance),
    }


@summary.register
def _(wrapped: WrappedPhase) -> dict[str, Any]:
    ok = wrapped.reason == Reason.OK
    return {
        "shape": list(wrapped.phase_rad.shape),
        "shifts_deg": np.degrees(wrapped.shifts_rad).round(9).tolist(),
        "noise": {"read_counts": wrapped.noise.read_counts, "gain": wrapped.noise.gain},
        "failed_fraction": wrapped.failed_fraction,
        "reasons": count_reasons(wrapped.reason),
        "median_sigma_rad": float(np.median(wrapped.sigma_rad[ok])) if ok.any() else None,
        "median_modulation": float(np.median(wrapped.modulation[ok])) if ok.any() else None,
        **told(wrapped),
        **origin(wrapped.provenance),
    }


@summary.register
def _(light: LightSeparation) -> dict[str, Any]:
    ok = light.reason == Reason.OK
    maps = ("direct", "direct_sigma", "indirect", "indirect_sigma")
    medians = {
        f"median_{name}": float(np.median(getattr(light, name)[ok])) if ok.any() else None
        for name in maps
    }
    return {
        "shape": list(light.reason.shape),
        "period_px": light.period_px,
        "contrast": light.contrast,
        "has_black": light.has_black,
        "indirect_share": light.indirect_share if ok.any() else None,
        **medians,
        "failed_fraction": light.failed_fraction,
        "reasons": count_reasons(light.reason),
        **told(light),
        **origin(light.provenance),
    }


@summary.register
def _(result: Measurement) -> dict[str, Any]:
    return summary(result.points)


@summary.register
def _(cloud: PointCloud) -> dict[str, Any]:
    return _of_cloud(cloud) | told(cloud) | origin(cloud.provenance)


@summary.register
def _(points: Points) -> dict[str, Any]:
    sigma = points.sigma_mm
    return {
        "points": len(points.xyz_mm),
        "median_sigma_mm": None if sigma is None else float(np.median(sigma)),
        **told(points),
        **origin(points.provenance),
    }


@summary.register
def _(response: Response) -> dict[str, Any]:
    return {
        "camera": response.camera,
        "projector": response.projector,
        "gamma": response.gamma,
        "steps": response.steps,
        "residual_rad": response.residual_rad,
        **origin(response.provenance),
    }


def of_heights(surface: HeightMap) -> dict[str, Any]:
    """The figures of a height map, without its findings and its origin."""
    finite = np.isfinite(surface.values)
    values, sigma = surface.values[finite], surface.sigma[finite]
    return {
        "method": surface.method,
        "quantity": surface.quantity,
        "unit": surface.unit,
        "shape": list(surface.shape),
        "failed_fraction": surface.failed_fraction,
        "reasons": count_reasons(surface.reason),
        "minimum": float(values.min()) if values.size else None,
        "maximum": float(values.max()) if values.size else None,
        "median": float(np.median(values)) if values.size else None,
        "median_sigma": float(np.median(sigma)) if sigma.size else None,
    }


def _median(values: FloatMap) -> float:
    """Median of values that may be overwritten, which saves a copy."""
    return float(np.median(values, overwrite_input=True))


def _of_cloud(cloud: PointCloud) -> dict[str, Any]:
    ok = cloud.reason == Reason.OK
    count = int(np.count_nonzero(ok))
    some = count > 0
    # One axis at a time: minima along rows of three take far longer.
    axes = [cloud.xyz_mm[..., k] for k in range(3)]
    return {
        "shape": list(cloud.shape),
        "points": count,
        "failed_fraction": cloud.failed_fraction,
        "reasons": count_reasons(cloud.reason),
        "minimum_mm": [float(v.min(where=ok, initial=np.inf)) for v in axes] if some else None,
        "maximum_mm": [float(v.max(where=ok, initial=-np.inf)) for v in axes] if some else None,
        "median_sigma_mm": _median(cloud.sigma_mm[ok]) if some else None,
        "median_noise_mm": _median(cloud.noise_mm[ok]) if some else None,
        "residual_rms_px": None
        if cloud.residual_px is None or not some
        else float(np.sqrt(np.mean(cloud.residual_px[ok].astype(np.float64) ** 2))),
    }
