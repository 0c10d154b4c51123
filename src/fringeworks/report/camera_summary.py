"""The numerical results of rigs with several cameras, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.pipeline.cameras import MultiMeasurement
from fringeworks.report.summary import origin, summary, told
from fringeworks.rig.calibration.cameras import MultiCalibration
from fringeworks.rig.camera_findings import difference_histogram
from fringeworks.rig.camera_points import CameraPoints
from fringeworks.types import FloatMap, Reason, count_reasons, multi_rig_parameters


@summary.register
def _(calibration: MultiCalibration) -> dict[str, Any]:
    rig, adjusted = calibration.rig, calibration.adjusted
    assert rig.covariance is not None
    assert rig.residual_px is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    named = zip(multi_rig_parameters(len(rig.cameras)), sigma, strict=True)
    predicted = dict(zip(calibration.poses, calibration.predicted_px, strict=False))
    return {
        "cameras": [
            {
                "number": number,
                "poses": [o.name for o in seen],
                "rms_px": rig.residual_px[number - 1],
                "place_mm": (-T[:3, :3].T @ T[:3, 3]).tolist(),
            }
            for number, (seen, T) in enumerate(
                zip(calibration.observations, rig.T_camera_first, strict=True), 1
            )
        ],
        "projector_rms_px": rig.residual_px[-1],
        "sigma": {name: float(value) for name, value in named},
        "predicted_rms_px": predicted,
        "skipped": calibration.skipped,
        "print_error_mm": adjusted.prior.print_mm,
        "sigma_inflation": calibration.inflation,
        "converged": adjusted.converged,
        **origin(rig.provenance),
    }


@summary.register
def _(found: MultiMeasurement) -> dict[str, Any]:
    points = found.points
    return {
        "points": len(points.xyz_mm),
        "median_sigma_mm": _median(points.sigma_mm),
        "median_noise_mm": _median(points.noise_mm),
        "cameras": [_of_camera(number, seen) for number, seen in enumerate(found.cameras, 1)],
        **told(found),
        **origin(points.provenance),
    }


def _of_camera(number: int, seen: CameraPoints) -> dict[str, Any]:
    """Points, pairs and disagreement of one camera."""
    ok = seen.points.reason == Reason.OK
    names = [
        "projector" if isinstance(device, str) else f"camera {device + 1}"
        for device in seen.devices
    ]
    return {
        "number": number,
        "points": int(ok.sum()),
        "confirmed_by_cameras": int(seen.matched.sum()),
        "reasons": count_reasons(seen.points.reason),
        "median_sigma_mm": _median(seen.points.sigma_mm[ok]),
        "pairs": {
            name: {
                "points": int((pair.reason == Reason.OK).sum()),
                "median_sigma_mm": _median(pair.sigma_mm[pair.reason == Reason.OK]),
                "mean_weight": _mean(seen.weights[..., i][ok]),
            }
            for i, (name, pair) in enumerate(zip(names, seen.pairs, strict=True))
        },
        "median_difference_mm": _median(seen.difference_mm[np.isfinite(seen.difference_mm)]),
        "difference_histogram": difference_histogram(seen),
    }


def _median(values: FloatMap | None) -> float | None:
    return None if values is None or not values.size else float(np.median(values))


def _mean(values: FloatMap) -> float | None:
    return float(values.mean()) if values.size else None
