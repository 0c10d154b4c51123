"""The certificate of a scanner: quality parameters against their limits, in planned positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal, get_args

import numpy as np

from fringeworks.evaluate.acceptance.measured import PositionResult, measure_position
from fringeworks.evaluate.acceptance.positions import (
    PositionCheck,
    artefact_faults,
    check_positions,
    plan_positions,
)
from fringeworks.files.rig import read_rig
from fringeworks.types import Frozen, InputError, Provenance, Rig, Source, made_by
from fringeworks.types.certificate import AcceptanceTest, Parameter
from fringeworks.types.numbers import number

Verdict = Literal["pass", "fail", "undecided"]
NAMES: dict[str, str] = {
    "PF": "probing error, form",
    "PS": "probing error, size",
    "SD": "sphere-spacing error",
    "F": "flatness-measurement error",
}
"""Quality parameters of VDI/VDE 2634."""


@dataclass(frozen=True, eq=False, repr=False)
class QualityParameter(Frozen):
    """A quality parameter over all positions."""

    parameter: Parameter
    values_mm: tuple[float, ...]
    """In the order of the scans; two of a ball bar for PF and PS."""
    test_sigma_mm: float
    """Standard uncertainty of the test value: by the artefact's certificate, its form and its
    temperature, mm. What the scanner errs by is what is tested, and no part of it."""
    limit_mm: float | None
    """Maximum permissible error, mm; None where none is stated."""
    verdict: Verdict | None
    """None without a limit."""

    @property
    def largest_mm(self) -> float:
        """The value that is farthest from 0, with its sign."""
        return max(self.values_mm, key=abs)


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Frozen):
    """Result of an acceptance test."""

    test: AcceptanceTest
    parameters: tuple[QualityParameter, ...]
    results: tuple[PositionResult, ...]
    """What each scan says."""
    positions: PositionCheck
    faults: tuple[str, ...]
    """What the test lacks of what the guideline asks for; empty where it is complete."""
    provenance: Provenance

    @property
    def verdict(self) -> Verdict:
        """Fail where a limit is surely exceeded; pass where all are kept and nothing is missing."""
        found = [one.verdict for one in self.parameters if one.verdict is not None]
        if "fail" in found:
            return "fail"
        return "undecided" if "undecided" in found or self.faults or not found else "pass"


def certify(
    test: AcceptanceTest, *, progress: Callable[[str], None] = lambda _: None
) -> Certificate:
    """Test a scanner by scans of a ball bar and a plane, after VDI/VDE 2634 part 2 or 3.

    Parameters
    ----------
    test : AcceptanceTest
    progress : callable
        Called with what is done.

    Returns
    -------
    Certificate

    Raises
    ------
    InputError for a test without scans, and a scan that does not show its artefact.

    Notes
    -----
    PF is the range of the radial distances from the sphere of least squares with a free radius, PS
    its diameter less the calibrated one, SD the distance of two centres less the calibrated one, F
    the range of the distances from the plane of least squares; ranges without the farthest 0.3 % of
    the points. With the standard uncertainty u of the test value and z of the risk, a parameter
    passes where all |values| are at most MPE − z u, fails where one is above MPE + z u (ISO
    14253-1), and is undecided between.
    """
    if not test.scans:
        raise InputError("test: expected scans of artefacts, got none")
    rig = test.rig if isinstance(test.rig, Rig) or test.rig is None else read_rig(test.rig)
    results = []
    for number_of, one in enumerate(test.scans, 1):
        progress(f"scan {number_of} of {len(test.scans)}")
        results.append(measure_position(one, test, rig))
    planned = plan_positions(test, rig)
    positions = check_positions(test, planned, [one.placement for one in results])
    inputs = tuple(
        Source(f"{one.name}: {source.name}", source.sha256)
        for one in results
        for source in one.inputs
    )
    told = {"part": test.part, "risk": test.risk, "limits_mm": dict(test.limits_mm)}
    origin = made_by("certify", options=told, inputs=inputs, rig=rig)
    parameters = tuple(
        _judged(name, test, results)
        for name in get_args(Parameter)
        if any(name in one.values_mm for one in results)
    )
    faults = (*artefact_faults(test), *_faults(positions, results))
    return Certificate(test, parameters, tuple(results), positions, faults, origin)


def artefact_sigma(name: str, test: AcceptanceTest) -> float:
    """Return the standard uncertainty of a test value, mm.

    Notes
    -----
    Of lengths that of the certificate, and of a temperature that is uniform within its range. Of
    forms half of the calibrated form error and its uncertainty (ISO/TS 23165).
    """
    bar, plane = test.ball_bar, test.plane
    if name == "F":
        return 0.0 if plane is None else _form(plane.flatness_mm, plane.flatness_sigma_mm)
    if bar is None:
        return 0.0
    if name == "PF":
        return _form(bar.form_mm, bar.form_sigma_mm)
    warm = test.expansion_per_k * test.temperature_k / float(np.sqrt(3.0))
    if name == "PS":
        return float(np.hypot(bar.diameter_sigma_mm, warm * max(bar.diameters_mm)))
    return float(np.hypot(bar.length_sigma_mm, warm * bar.length_mm))


def _form(error: float, sigma: float) -> float:
    return float(np.hypot(0.5 * error, sigma))


def _judged(
    name: Parameter, test: AcceptanceTest, results: list[PositionResult]
) -> QualityParameter:
    values = tuple(v for one in results for v in one.values_mm.get(name, ()))
    sigma, most = artefact_sigma(name, test), test.limits_mm.get(name)
    verdict: Verdict | None = None
    if most is not None:
        guard = NormalDist().inv_cdf(1.0 - test.risk) * sigma
        largest = max(abs(v) for v in values)
        verdict = "undecided"
        if largest <= most - guard:
            verdict = "pass"
        elif largest > most + guard:
            verdict = "fail"
    return QualityParameter(name, values, sigma, most, verdict)


def _faults(positions: PositionCheck, results: list[PositionResult]) -> list[str]:
    """What the positions lack."""
    faults = [
        f"no scan of the {one.artefact} in the position {one.name!r}, about "
        f"({', '.join(number(float(v), 1.0) for v in one.centre_mm)}) mm"
        for one in positions.missing
    ]
    faults += [f"{results[k].name}: reaches out of the volume" for k in positions.outside]
    faults += [
        f"{results[i].name} and {results[j].name}: the same position" for i, j in positions.same
    ]
    return faults
