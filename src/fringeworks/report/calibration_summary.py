"""The numerical results of the calibration of a rig, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.report.summary import origin, summary
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.rig.calibration.verdict import verdict
from fringeworks.types import RIG_PARAMETERS


@summary.register
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
        **origin(rig.provenance),
    }
