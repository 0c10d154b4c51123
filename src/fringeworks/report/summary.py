"""The numerical results, ready for JSON, and words that several kinds of results share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fringeworks.files.findings import finding_from_dict, findings_as_dicts
from fringeworks.report.kind import kind_of
from fringeworks.types import Finding, InputError, Provenance


def summarise(result: object) -> dict[str, Any]:
    """The numerical results of a chain, ready for JSON.

    Parameters
    ----------
    result : Reconstruction, Measurement, Decoded, WrappedPhase, LightSeparation, Calibration,
        MultiCalibration, RigCheck, RigWatch, PlaneCalibration, PixelCalibration, Response,
        FormEvaluation, Inspection, Deviation, HeightMap, PointCloud, Points, TriangleMesh,
        MultiMeasurement, SetupTests, GaugeStudy, GaugeType1 or GaugeLinearity

    Returns
    -------
    Dictionary of JSON values. Timings are not in it: equal runs give equal numbers.

    Raises
    ------
    InputError for anything else.
    """
    figures = kind_of(result).figures
    if figures is None:
        raise InputError(f"result: expected a result of fringeworks, got {type(result).__name__}")
    return figures(result)


def told(result: Any) -> dict[str, Any]:
    """The findings of a result as part of a summary, and their text."""
    return {"findings": findings_as_dicts(result.findings), "notes": list(result.notes)}


def origin(provenance: Provenance | None) -> dict[str, Any]:
    """The provenance as part of a summary; nothing where there is none."""
    return {} if provenance is None else {"provenance": provenance.as_dict()}


def failures(reasons: dict[str, int]) -> str:
    """How many pixels failed for which reason, in words."""
    failed = (f"{name.replace('_', ' ')} {n}" for name, n in reasons.items() if name != "ok")
    return ", ".join(failed) or "none"


def finding_words(figures: dict[str, Any]) -> Iterator[Finding]:
    """The findings among a result's figures."""
    yield from map(finding_from_dict, figures["findings"])
