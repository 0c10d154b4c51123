"""Acceptance tests on disk: artefacts, volume, limits and scans, as TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from fringeworks.files.atomic import StrPath
from fringeworks.files.description import Field, Section
from fringeworks.files.limits import MESSAGE_LETTERS, told
from fringeworks.files.toml import read_toml
from fringeworks.types import FileProblem, InputError
from fringeworks.types.certificate import (
    AcceptanceTest,
    BallBar,
    PlaneArtefact,
    TestScan,
    TestVolume,
)
from fringeworks.types.recipe import USUAL_RISK

MOST_SCANS = 1000
"""Largest number of scans; the guideline asks for thirteen."""


class _Volume(Section):
    """``[volume]``: a box in camera coordinates."""

    centre_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]


class _BallBar(Section):
    """``[ball_bar]``: what its certificate says; expanded uncertainties U, and their k."""

    length_mm: float
    diameters_mm: tuple[float, float]
    length_expanded_mm: float = 0.0
    diameter_expanded_mm: float = 0.0
    form_mm: float = 0.0
    form_expanded_mm: float = 0.0
    k: float = Field(default=2.0, ge=1.0)
    calibration: str = Field(default="", max_length=120)

    def artefact(self) -> BallBar:
        return BallBar(
            self.length_mm,
            self.diameters_mm,
            self.length_expanded_mm / self.k,
            self.diameter_expanded_mm / self.k,
            self.form_mm,
            self.form_expanded_mm / self.k,
            self.calibration,
        )


class _Plane(Section):
    """``[plane]``: the same of a plane."""

    size_mm: tuple[float, float]
    flatness_mm: float = 0.0
    flatness_expanded_mm: float = 0.0
    k: float = Field(default=2.0, ge=1.0)
    calibration: str = Field(default="", max_length=120)

    def artefact(self) -> PlaneArtefact:
        sigma = self.flatness_expanded_mm / self.k
        return PlaneArtefact(self.size_mm, self.flatness_mm, sigma, self.calibration)


class _Scan(Section):
    """``[[scans]]``: a capture, or points, relative to the file."""

    artefact: Literal["ball bar", "plane"]
    scan: str
    name: str = Field(default="", max_length=80)


class CertificateFile(Section):
    """The whole of an acceptance test; unknown keys are refused."""

    kind: Literal["acceptance-test"]
    volume: _Volume
    ball_bar: _BallBar | None = None
    plane: _Plane | None = None
    rig: str | None = None
    risk: float = USUAL_RISK
    part: Literal[2, 3] = 2
    expansion_per_k: float = 0.0
    temperature_k: float = 0.0
    limits_mm: dict[str, float] = Field(default_factory=dict)
    options: dict[str, Any] = Field(default_factory=dict)
    scans: list[_Scan] = Field(default_factory=list, max_length=MOST_SCANS)


def read_acceptance_test(path: StrPath) -> AcceptanceTest:
    """Read an acceptance test.

    Parameters
    ----------
    path : path
        TOML file. Its rig and its scans are named relative to it.

    Returns
    -------
    AcceptanceTest; its rig and scans are paths.

    Raises
    ------
    FileProblem that names the file and its first fault.
    """
    path = Path(path)
    content = read_toml(path, CertificateFile)
    bar, plane = content.ball_bar, content.plane
    try:
        return AcceptanceTest(
            TestVolume(content.volume.centre_mm, content.volume.size_mm),
            None if bar is None else bar.artefact(),
            None if plane is None else plane.artefact(),
            content.limits_mm,
            tuple(
                TestScan(one.artefact, path.parent / one.scan, one.name) for one in content.scans
            ),
            rig=None if content.rig is None else path.parent / content.rig,
            options=content.options,
            risk=content.risk,
            part=content.part,
            expansion_per_k=content.expansion_per_k,
            temperature_k=content.temperature_k,
        )
    except FileProblem:
        raise
    except InputError as problem:
        raise FileProblem(f"{told(path)}: {told(problem, MESSAGE_LETTERS)}") from problem
