"""What is shown of the check of a rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.summary import origin
from fringeworks.rig.calibration.drift import RigCheck


def figures(checked: RigCheck) -> dict[str, Any]:
    """How far the rig has moved, with its standard deviations, and likely causes."""
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


def words(checked: RigCheck, _: dict[str, Any]) -> Iterator[Word]:
    """The verdict with its causes."""
    yield checked.text
    yield from checked.findings


describe(RigCheck, Kind(figures, words))
