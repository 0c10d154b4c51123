"""What the acceptance test of a scanner needs: artefacts, volume, scans and limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Literal, get_args

from fringeworks.types.checks import finite, positive
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.recipe import USUAL_RISK
from fringeworks.types.rig import Rig

Parameter = Literal["PF", "PS", "SD", "F"]
"""Probing error of form and of size, sphere-spacing error, flatness-measurement error."""
Artefact = Literal["ball bar", "plane"]
"""What a scan shows."""


def _need(what: str, *, above: tuple[float, ...], least: tuple[float, ...] = ()) -> None:
    """Refuse lengths that are not above 0, and uncertainties below it."""
    if not positive(*above) or not finite(*least) or any(v < 0 for v in least):
        raise InputError(
            f"{what}: expected lengths > 0 and uncertainties from 0 on, got {above} and {least}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class BallBar(Frozen):
    """Two balls at a calibrated distance.

    Raises
    ------
    InputError for lengths that are not above 0, and uncertainties below 0.
    """

    length_mm: float
    """Calibrated distance of the centres, mm."""
    diameters_mm: tuple[float, float]
    """Calibrated diameters, mm."""
    length_sigma_mm: float = 0.0
    """Standard uncertainty of the distance: U / k of the certificate, mm."""
    diameter_sigma_mm: float = 0.0
    """The same of the diameters, mm."""
    form_mm: float = 0.0
    """Calibrated form error of the balls, mm."""
    form_sigma_mm: float = 0.0
    """Its standard uncertainty, mm."""
    calibration: str = ""
    """Number of its calibration certificate, and its date; "" where it is not stated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        least = (self.length_sigma_mm, self.diameter_sigma_mm, self.form_mm, self.form_sigma_mm)
        _need("ball bar", above=(self.length_mm, *self.diameters_mm), least=least)


@dataclass(frozen=True, eq=False, repr=False)
class PlaneArtefact(Frozen):
    """A plane of calibrated flatness.

    Raises
    ------
    InputError for sides that are not above 0, and uncertainties below 0.
    """

    size_mm: tuple[float, float]
    """Length and width, mm."""
    flatness_mm: float = 0.0
    """Calibrated flatness, mm."""
    flatness_sigma_mm: float = 0.0
    """Its standard uncertainty, mm."""
    calibration: str = ""
    """Number of its calibration certificate, and its date; "" where it is not stated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        least = (self.flatness_mm, self.flatness_sigma_mm)
        _need("plane", above=self.size_mm, least=least)


@dataclass(frozen=True, eq=False, repr=False)
class TestVolume(Frozen):
    """The measuring volume that is stated, a box in camera coordinates.

    Raises
    ------
    InputError for sides that are not above 0.
    """

    __test__ = False  # no test of pytest

    centre_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    """Along x, y and z of the camera, mm."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _need("volume", above=self.size_mm)
        if not finite(*self.centre_mm):
            raise InputError(f"volume: expected a finite centre, got {self.centre_mm}")

    @property
    def diagonal_mm(self) -> float:
        """L₀ of the guideline: the diagonal of the volume, mm."""
        return float(sum(side**2 for side in self.size_mm) ** 0.5)


@dataclass(frozen=True, eq=False, repr=False)
class TestScan(Frozen):
    """A scan of an artefact in one position."""

    __test__ = False

    artefact: Artefact
    scan: PathLike[str] | Any
    """Path of a capture or of points; or a PointCloud, or Points."""
    name: str = ""
    """Name in tables; by default that of the path."""


@dataclass(frozen=True, eq=False, repr=False)
class AcceptanceTest(Frozen):
    """An acceptance test after VDI/VDE 2634 part 2 or 3.

    Raises
    ------
    InputError for a limit that is not above 0 or has no artefact, an unknown part of the
    guideline, and a risk out of its range.
    """

    volume: TestVolume
    ball_bar: BallBar | None = None
    plane: PlaneArtefact | None = None
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    """Maximum permissible errors by PF, PS, SD and F, mm."""
    scans: tuple[TestScan, ...] = ()
    rig: Rig | PathLike[str] | None = None
    """The rig that captures are measured with, or the path of its file."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of decoding."""
    risk: float = USUAL_RISK
    """Probability of a wrong decision, 0…0.5."""
    part: Literal[2, 3] = 2
    """Part of the guideline: 2 for single views, 3 for points of several views."""
    expansion_per_k: float = 0.0
    """Thermal expansion of the ball bar, 1/K."""
    temperature_k: float = 0.0
    """The bar's temperature is anywhere within so many K of that of its calibration."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ball_bar is None and self.plane is None:
            raise InputError("test: expected a ball bar, a plane or both, got neither")
        for name, value in self.limits_mm.items():
            if name not in get_args(Parameter) or not positive(value):
                raise InputError(
                    f"limits: expected PF, PS, SD or F above 0 mm, got {name} = {value}"
                )
            if (self.plane if name == "F" else self.ball_bar) is None:
                raise InputError(f"limits: expected the artefact of {name}, got none")
        if self.part not in (2, 3):
            raise InputError(f"part: expected 2 or 3 of VDI/VDE 2634, got {self.part}")
        if not 0 < self.risk <= 0.5:
            raise InputError(f"risk: expected above 0 and at most 0.5, got {self.risk}")
        _need("temperature", above=(1.0,), least=(self.expansion_per_k, self.temperature_k))
