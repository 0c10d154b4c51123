"""What is shown of the certificate of a scanner."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.evaluate.acceptance.certify import NAMES, Certificate, QualityParameter
from fringeworks.evaluate.acceptance.positions import ArtefactPlace
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.page.blocks import Block, Chapter, Picture, Table, Text
from fringeworks.report.page.chapter import Context
from fringeworks.report.page.parts import facts
from fringeworks.report.summary import origin
from fringeworks.report.verdicts import Verdict
from fringeworks.types.numbers import UNKNOWN, limit, number, percent, sigma_text
from fringeworks.types.report_head import DEVICE_HEAD

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

COLUMNS = ("parameter", "", "values", "largest", "u of the test", "MPE", "verdict")
"""Columns of the table of quality parameters."""
PLACE_DIGITS_MM = 1.0
"""Standard deviation that places of artefacts are shown with, mm."""
NOT_STATED = "certificate not stated"
"""What stands in place of the number of an artefact's calibration certificate."""
RULES = (
    "PF is the range of the radial distances of the points from the sphere of least squares with a "
    "free radius, PS its diameter less the calibrated one, SD the distance of both centres less "
    "the calibrated one, F the range of the distances from the plane of least squares. The "
    "farthest 0.3 % of the points of each body do not count in ranges; no other filter is applied. "
    "A parameter passes where all its values keep the maximum permissible error less a guard band "
    "of z u, and fails where one exceeds it by as much (ISO 14253-1); u is the standard "
    "uncertainty of the test value by the artefacts' certificates and temperature."
)
"""Rules of the evaluation."""


def figures(found: Certificate) -> dict[str, Any]:
    """Parameters, positions, faults and hashes."""
    test = found.test
    return {
        "guideline": f"VDI/VDE 2634 part {test.part}",
        "verdict": found.verdict,
        "faults": list(found.faults),
        "volume": {
            "centre_mm": list(test.volume.centre_mm),
            "size_mm": list(test.volume.size_mm),
            "diagonal_mm": test.volume.diagonal_mm,
        },
        "risk": test.risk,
        "parameters": [
            {
                "parameter": one.parameter,
                "values_mm": list(one.values_mm),
                "largest_mm": one.largest_mm,
                "test_sigma_mm": one.test_sigma_mm,
                "limit_mm": one.limit_mm,
                "verdict": one.verdict,
            }
            for one in found.parameters
        ],
        "positions": _position_figures(found),
        "missing": [one.name for one in found.positions.missing],
        **origin(found.provenance),
    }


def _position_figures(found: Certificate) -> list[dict[str, Any]]:
    """What each scan says."""
    return [
        {
            "name": one.name,
            "artefact": one.placement.artefact,
            "centre_mm": one.placement.centre_mm.tolist(),
            "direction": one.placement.direction.tolist(),
            "planned": _planned(found, k),
            "points": one.points,
            "rejected_share": one.rejected,
            "values_mm": {name: list(values) for name, values in one.values_mm.items()},
            "sigma_mm": {
                name: [v if np.isfinite(v) else None for v in values]
                for name, values in one.sigma_mm.items()
            },
        }
        for k, one in enumerate(found.results)
    ]


def _planned(found: Certificate, scan: int) -> str | None:
    """Name of the planned position that a scan is in."""
    for one, taken in zip(found.positions.planned, found.positions.taken, strict=True):
        if taken == scan:
            return one.name
    return None


def _row(one: QualityParameter) -> tuple[str, ...]:
    return (
        one.parameter,
        NAMES[one.parameter],
        str(len(one.values_mm)),
        number(1e3 * one.largest_mm, 1e3 * one.test_sigma_mm, "µm"),
        sigma_text(1e3 * one.test_sigma_mm, "µm"),
        UNKNOWN if one.limit_mm is None else f"{limit(1e3 * one.limit_mm)} µm",
        one.verdict or "no limit",
    )


def words(found: Certificate, _: dict[str, Any]) -> Iterator[Word]:
    """The parameters, what is missing, and the verdict."""
    yield Rows(COLUMNS, [_row(one) for one in found.parameters])
    for fault in found.faults:
        yield f"incomplete: {fault}"
    yield found.verdict


def place_rows(planned: Sequence[ArtefactPlace]) -> list[tuple[str, ...]]:
    """Return a row for each planned position."""
    return [
        (
            one.artefact,
            one.name,
            ", ".join(number(float(v), PLACE_DIGITS_MM) for v in one.centre_mm),
            ", ".join(number(float(v), 0.1) for v in one.direction),
            "yes" if one.seen else "no",
        )
        for one in planned
    ]


PLACE_COLUMNS = ("artefact", "position", "centre / mm", "direction", "seen")
"""Columns of the table of planned positions."""


def _values(values: Sequence[float], sigmas: Sequence[float]) -> str:
    """Values in µm, with the digits of the scanner's own σ."""
    return ", ".join(
        number(1e3 * v, 1e3 * s if np.isfinite(s) else None)
        for v, s in zip(values, sigmas, strict=True)
    )


def _positions(found: Certificate) -> Table:
    rows = []
    for k, one in enumerate(found.results):
        values = [f"{name} {_values(v, one.sigma_mm[name])}" for name, v in one.values_mm.items()]
        rows.append(
            (
                one.name,
                _planned(found, k) or "–",
                ", ".join(number(float(v), PLACE_DIGITS_MM) for v in one.placement.centre_mm),
                "; ".join(values),
                f"{one.points:,}",
                percent(one.rejected),
            )
        )
    columns = ("scan", "position", "centre / mm", "values / µm", "points", "far points")
    return Table(columns, tuple(rows), "Positions")


def picture(found: Certificate, name: str | None) -> Figure:
    """Values of all parameters against their limits."""
    from fringeworks.report.certificate_chart import certificate_chart  # needs Matplotlib

    return certificate_chart(found, name)


def chapter(found: Certificate, context: Context) -> Chapter:
    """The certificate."""
    if found.verdict in ("pass", "fail", "undecided"):
        context.verdicts.append(found.verdict)
    table = Table.judged(
        COLUMNS,
        tuple(_row(one) for one in found.parameters),
        "Quality parameters",
        [one.verdict for one in found.parameters],
    )
    missing: list[Block] = [
        Table(("incomplete",), tuple((fault,) for fault in found.faults), "What is missing")
    ]
    hashes = Table(
        ("raw frames", "sha256"),
        tuple((_frame(source.name), source.sha256) for source in found.provenance.inputs),
        "Raw frames",
    )
    return Chapter(
        context.name,
        (
            table,
            *(missing if found.faults else ()),
            facts(_facts(found)),
            Text(RULES),
            _positions(found),
            Picture(picture(found, None), "Values of all positions; dashed, the limits."),
            hashes,
        ),
    )


def _facts(found: Certificate) -> list[tuple[str, str]]:
    """Guideline, volume, artefacts and risk."""
    test, volume = found.test, found.test.volume
    guard = NormalDist().inv_cdf(1.0 - test.risk)
    return [
        ("guideline", f"VDI/VDE 2634 part {test.part}"),
        ("volume", f"{' × '.join(limit(v) for v in volume.size_mm)} mm about "
         f"({', '.join(limit(v) for v in volume.centre_mm)}) mm of the camera"),
        ("diagonal L₀", number(volume.diagonal_mm, digits=4, unit="mm")),
        *_artefacts(found),
        ("risk of a wrong decision", f"{percent(test.risk)}: guard band {number(guard)} u"),
        ("rig", f"sha256 {found.provenance.rig_sha256 or '–'}"),
    ]  # fmt: skip


def _artefacts(found: Certificate) -> list[tuple[str, str]]:
    bar, plane = found.test.ball_bar, found.test.plane
    rows = []
    if bar is not None:
        balls = " and ".join(limit(d) for d in bar.diameters_mm)
        rows.append(
            (
                "ball bar",
                f"{limit(bar.length_mm)} mm, u {sigma_text(bar.length_sigma_mm, 'mm')}; balls of "
                f"{balls} mm, u {sigma_text(bar.diameter_sigma_mm, 'mm')}, form "
                f"{limit(bar.form_mm)} mm",
            )
        )
        rows.append(("its calibration", bar.calibration or NOT_STATED))
    if plane is not None:
        rows.append(
            (
                "plane",
                f"{' × '.join(limit(v) for v in plane.size_mm)} mm, flatness "
                f"{limit(plane.flatness_mm)} mm, u {sigma_text(plane.flatness_sigma_mm, 'mm')}",
            )
        )
        rows.append(("its calibration", plane.calibration or NOT_STATED))
    return rows


def _frame(name: str) -> str:
    """A frame without the name of its scan, where its own folder has that name: a line holds it."""
    scan, sign, file = name.partition(": ")
    return file if sign and file.startswith(f"{scan}/") else name


def verdict(found: Certificate) -> Verdict:
    """The verdict of the test."""
    said = {
        "pass": "all limits are kept, in all positions",
        "fail": "a limit is exceeded",
        "undecided": "the test is incomplete"
        if found.faults
        else "a value is too close to a limit",
    }[found.verdict]
    return Verdict(found.verdict, f"{found.verdict.upper()}: {said}.")


describe(Certificate, Kind(figures, words, picture, chapter, verdict=verdict, head=DEVICE_HEAD))
