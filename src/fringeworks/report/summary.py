"""The numerical results, ready for JSON."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from fringeworks.evaluate.form import FormEvaluation
from fringeworks.evaluate.inspect import Inspection
from fringeworks.files.findings import findings_as_dicts
from fringeworks.files.points import Points
from fringeworks.pair.plane_calibration import PixelCalibration, PlaneCalibration
from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.setup_summary import setup_figures
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.rig.calibration.verdict import verdict
from fringeworks.scan.setup import SetupTests
from fringeworks.signal.response import Response
from fringeworks.stack.wrapped import WrappedPhase
from fringeworks.types import (
    RIG_PARAMETERS,
    Decoded,
    HeightMap,
    InputError,
    PointCloud,
    Provenance,
    Reason,
    count_reasons,
)


@singledispatch
def summarise(result: object) -> dict[str, Any]:
    """The numerical results of a chain, ready for JSON.

    Parameters
    ----------
    result : Reconstruction, Measurement, Decoded, WrappedPhase, Calibration, PlaneCalibration,
        PixelCalibration, Response, FormEvaluation, Inspection, HeightMap,
        PointCloud, Points or SetupTests

    Returns
    -------
    Dictionary of JSON values. Timings are not in it: equal runs give equal numbers.

    Raises
    ------
    InputError for anything else.
    """
    raise InputError(f"result: expected a result of fringeworks, got {type(result).__name__}")


def _origin(provenance: Provenance | None) -> dict[str, Any]:
    return {} if provenance is None else {"provenance": provenance.as_dict()}


@summarise.register
def _(result: Reconstruction) -> dict[str, Any]:
    figures = _of_heights(result.surface)
    return figures | {
        "axis": result.displacement.axis,
        "period_px": result.displacement.period_px,
        "tilt_deg": result.displacement.tilt_deg,
        "converged": result.converged,
        "findings": findings_as_dicts(result.findings),
        "notes": list(result.notes),
        **_origin(result.surface.provenance),
    }


@summarise.register
def _(surface: HeightMap) -> dict[str, Any]:
    return _of_heights(surface) | {
        "converged": surface.converged,
        "findings": findings_as_dicts(surface.findings),
        **_origin(surface.provenance),
    }


@summarise.register
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
        "notes": list(decoded.notes),
        **_origin(decoded.provenance),
    }


@summarise.register
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
        "notes": list(wrapped.notes),
        **_origin(wrapped.provenance),
    }


@summarise.register
def _(calibration: Calibration) -> dict[str, Any]:
    rig = calibration.rig
    assert rig.covariance is not None
    assert rig.residual_px is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    offset = rig.T_projector_camera[:3, 3]
    values = [*rig.camera.parameters, *rig.projector.parameters]
    gradient = np.concatenate((np.zeros(21), offset / rig.baseline_mm))
    camera, projector = coverage(calibration)
    judged = verdict(calibration)
    return {
        "parameters": {
            name: {"value": float(value), "sigma": float(s)}
            for name, value, s in zip(RIG_PARAMETERS, values, sigma, strict=False)
        },
        "baseline_mm": rig.baseline_mm,
        "baseline_sigma_mm": float(np.sqrt(gradient @ rig.covariance @ gradient)),
        "camera_rms_px": rig.residual_px[0],
        "projector_rms_px": rig.residual_px[1],
        "camera_coverage": camera,
        "projector_coverage": projector,
        "poses": pose_figures(calibration),
        "findings": [
            {"cause": found.cause, "message": found.message} for found in diagnose(calibration)
        ],
        "print_error_mm": calibration.adjusted.prior.print_mm,
        "sigma_inflation": calibration.inflation,
        "converged": calibration.adjusted.converged,
        "verdict": {
            "sigma_mm": judged.sigma_mm,
            "distance_mm": judged.distance_mm,
            "text": judged.text,
        },
        **_origin(rig.provenance),
    }


@summarise.register
def _(result: Measurement) -> dict[str, Any]:
    return summarise(result.points)


@summarise.register
def _(cloud: PointCloud) -> dict[str, Any]:
    return _of_cloud(cloud) | {"notes": list(cloud.notes), **_origin(cloud.provenance)}


@summarise.register
def _(points: Points) -> dict[str, Any]:
    sigma = points.sigma_mm
    return {
        "points": len(points.xyz_mm),
        "median_sigma_mm": None if sigma is None else float(np.median(sigma)),
        "notes": list(points.notes),
        **_origin(points.provenance),
    }


@summarise.register
def _(response: Response) -> dict[str, Any]:
    return {
        "camera": response.camera,
        "projector": response.projector,
        "gamma": response.gamma,
        "steps": response.steps,
        "residual_rad": response.residual_rad,
        **_origin(response.provenance),
    }


@summarise.register
def _(calibration: PlaneCalibration) -> dict[str, Any]:
    geometry = calibration.geometry
    return {
        "distance_mm": geometry.distance_mm,
        "distance_sigma_mm": calibration.distance_sigma_mm,
        "baseline_mm": geometry.baseline_mm,
        "baseline_sigma_mm": calibration.baseline_sigma_mm,
        "pitch_mm_per_px": geometry.pitch_mm_per_px,
        "sign": geometry.sign,
        "residual_mm": list(calibration.residual_mm),
        **_origin(calibration.provenance),
    }


@summarise.register
def _(calibration: PixelCalibration) -> dict[str, Any]:
    return {
        "median_mm_per_px": float(np.nanmedian(calibration.slope)),
        "calibrated_fraction": float(np.mean(np.isfinite(calibration.slope))),
        "pitch_mm_per_px": calibration.pitch_mm_per_px,
        **_origin(calibration.provenance),
    }


@summarise.register
def _(evaluation: FormEvaluation) -> dict[str, Any]:
    return evaluation.figures | _origin(evaluation.provenance)


@summarise.register
def _(inspection: Inspection) -> dict[str, Any]:
    checks = [
        {
            "name": check.tolerance.name,
            "quantity": check.tolerance.quantity,
            "areas": list(check.tolerance.areas),
            "value": check.value if np.isfinite(check.value) else None,
            "sigma": check.sigma if np.isfinite(check.sigma) else None,
            "unit": check.unit,
            "smallest": check.tolerance.low,
            "largest": check.tolerance.high,
            "verdict": check.verdict,
            "why": check.why,
        }
        for check in inspection.checks
    ]
    figures = summarise(inspection.surface)
    return figures | {
        "verdict": inspection.verdict,
        "checks": checks,
        "notes": list(inspection.notes),
    }


@summarise.register
def _(tests: SetupTests) -> dict[str, Any]:
    return setup_figures(tests)


def _of_heights(surface: HeightMap) -> dict[str, Any]:
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
        "minimum_mm": [float(v[ok].min()) for v in axes] if some else None,
        "maximum_mm": [float(v[ok].max()) for v in axes] if some else None,
        "median_sigma_mm": float(np.median(cloud.sigma_mm[ok])) if some else None,
        "median_noise_mm": float(np.median(cloud.noise_mm[ok])) if some else None,
        "residual_rms_px": None
        if cloud.residual_px is None or not some
        else float(np.sqrt(np.mean(cloud.residual_px[ok].astype(np.float64) ** 2))),
    }
