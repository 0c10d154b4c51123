"""The numerical results of a rig's calibration, and of a check of it, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.summary import origin, summary
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.rig.calibration.drift import RigCheck
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
        "findings": findings_as_dicts(diagnose(calibration)),
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


@summary.register
def _(checked: RigCheck) -> dict[str, Any]:
    numbers = (
        *("drift_mm", "sigma_mm", "drift_px", "sigma_px", "excess", "noticeable_mm"),
        *("camera_rms_px", "projector_rms_px", "flatness_mm", "scale", "scale_sigma"),
        "distance_mm",
    )
    vectors = ("rotation_deg", "rotation_sigma_deg", "translation_mm", "translation_sigma_mm")
    return {
        "verdict": checked.verdict,
        "text": checked.text,
        **{name: getattr(checked, name) for name in numbers},
        **{name: getattr(checked, name).tolist() for name in vectors},
        "causes": [{"name": cause.name, "text": cause.text} for cause in checked.causes],
        "findings": findings_as_dicts(checked.findings),
        **origin(checked.provenance),
    }
