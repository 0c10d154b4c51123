"""Results as figures, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.pipeline import Reconstruction
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.types import RIG_PARAMETERS, Decoded, PointCloud, Reason, count_reasons


def summary(result: Reconstruction) -> dict[str, Any]:
    """Figures of a reconstruction that need no truth, ready for JSON."""
    surface = result.surface
    finite = np.isfinite(surface.values)
    values, sigma = surface.values[finite], surface.sigma[finite]
    return {
        "method": surface.method,
        "quantity": surface.quantity,
        "unit": surface.unit,
        "shape": list(surface.shape),
        "axis": result.displacement.axis,
        "period_px": result.displacement.period_px,
        "tilt_deg": result.displacement.tilt_deg,
        "failed_fraction": surface.failed_fraction,
        "reasons": count_reasons(surface.reason),
        "minimum": float(values.min()) if values.size else None,
        "maximum": float(values.max()) if values.size else None,
        "median": float(np.median(values)) if values.size else None,
        "median_sigma": float(np.median(sigma)) if sigma.size else None,
        "seconds": result.seconds,
        "notes": list(result.notes),
    }


def decoded_summary(decoded: Decoded, notes: tuple[str, ...] = ()) -> dict[str, Any]:
    """Figures of decoded coordinates, ready for JSON."""
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
        "notes": [*notes, *decoded.notes],
    }


def calibration_summary(calibration: Calibration) -> dict[str, Any]:
    """Figures of a calibration, ready for JSON."""
    rig = calibration.rig
    assert rig.covariance is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    offset = rig.T_projector_camera[:3, 3]
    values = [*rig.camera.parameters, *rig.projector.parameters]
    gradient = np.concatenate((np.zeros(21), offset / rig.baseline_mm))
    camera, projector = coverage(calibration)
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
    }


def points_summary(cloud: PointCloud) -> dict[str, Any]:
    """Figures of a point cloud, ready for JSON."""
    ok = cloud.reason == Reason.OK
    xyz, sigma, noise = cloud.xyz_mm[ok], cloud.sigma_mm[ok], cloud.noise_mm[ok]
    return {
        "shape": list(cloud.shape),
        "points": int(ok.sum()),
        "failed_fraction": cloud.failed_fraction,
        "reasons": count_reasons(cloud.reason),
        "minimum_mm": xyz.min(axis=0).tolist() if len(xyz) else None,
        "maximum_mm": xyz.max(axis=0).tolist() if len(xyz) else None,
        "median_sigma_mm": float(np.median(sigma)) if len(xyz) else None,
        "median_noise_mm": float(np.median(noise)) if len(xyz) else None,
        "residual_rms_px": None
        if cloud.residual_px is None or not len(xyz)
        else float(np.sqrt(np.mean(cloud.residual_px[ok].astype(np.float64) ** 2))),
    }
