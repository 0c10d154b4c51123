"""The numerical results of two frames and of their calibration, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.report.summary import of_heights, origin, summary, told
from fringeworks.rig.calibration.planes import PixelCalibration, PlaneCalibration


@summary.register
def _(result: Reconstruction) -> dict[str, Any]:
    figures = of_heights(result.surface)
    return figures | {
        "axis": result.displacement.axis,
        "period_px": result.displacement.period_px,
        "tilt_deg": result.displacement.tilt_deg,
        "converged": result.converged,
        **told(result),
        **origin(result.surface.provenance),
    }


@summary.register
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
        **origin(calibration.provenance),
    }


@summary.register
def _(calibration: PixelCalibration) -> dict[str, Any]:
    return {
        "median_mm_per_px": float(np.nanmedian(calibration.slope)),
        "calibrated_fraction": float(np.mean(np.isfinite(calibration.slope))),
        "pitch_mm_per_px": calibration.pitch_mm_per_px,
        **origin(calibration.provenance),
    }
