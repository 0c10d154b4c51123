"""What is shown of calibrations of the two-frame path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.summary import origin
from fringeworks.rig.calibration.planes import PixelCalibration, PlaneCalibration


def plane_figures(calibration: PlaneCalibration) -> dict[str, Any]:
    """The geometry with its standard deviations and residuals."""
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


def pixel_figures(calibration: PixelCalibration) -> dict[str, Any]:
    """The median of the pixels' laws, and how many have one."""
    return {
        "median_mm_per_px": float(np.nanmedian(calibration.slope)),
        "calibrated_fraction": float(np.mean(np.isfinite(calibration.slope))),
        "pitch_mm_per_px": calibration.pitch_mm_per_px,
        **origin(calibration.provenance),
    }


def words(_: object, figures: dict[str, Any]) -> Iterator[str]:
    """All figures."""
    for name, value in figures.items():
        if name != "provenance":
            yield f"{name}: {value}"


describe(PlaneCalibration, Kind(plane_figures, words))
describe(PixelCalibration, Kind(pixel_figures, words))
