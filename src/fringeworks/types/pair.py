"""Two frames, and what is measured between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.arrays import Axis, BoolMap, ByteMap, FloatMap
from fringeworks.types.checks import finite, positive
from fringeworks.types.displayed import Plotted, Sectioned
from fringeworks.types.errors import InputError
from fringeworks.types.exchanged import Arrayed
from fringeworks.types.frozen import Frozen
from fringeworks.types.provenance import Source


@dataclass(frozen=True, eq=False, repr=False)
class ReferencePlaneGeometry(Frozen):
    """Camera and projector pupils at equal distance above a reference plane (theory §2)."""

    distance_mm: float
    """l, from the reference plane to the line through both pupils; > 0, mm."""
    baseline_mm: float
    """d₀, between the two pupils; > 0, mm."""
    pitch_mm_per_px: float = 1.0
    """Size of a camera pixel on the reference plane; > 0, mm/px."""
    sign: Literal[1, -1] = 1
    """Side of the projector: +1 where a raised surface moves the fringes towards larger x (or y),
    −1 where towards smaller."""
    principal_px: tuple[float, float] | None = None
    """Pixel (x, y) above which the camera's pupil stands, px: the principal point. It may lie
    outside a cropped frame. None for the middle of the frame, which is right for most frames that
    were not cropped."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("distance_mm", "baseline_mm", "pitch_mm_per_px"):
            value = getattr(self, name)
            if not (positive(value)):
                raise InputError(f"geometry: expected {name} > 0, got {value}")
        if self.principal_px is not None and not (
            len(self.principal_px) == 2 and finite(*self.principal_px)
        ):
            raise InputError(
                f"geometry: expected principal_px as x and y, finite, got {self.principal_px}"
            )
        if self.sign not in (1, -1):
            raise InputError(f"geometry: expected sign +1 or -1, got {self.sign}")


@dataclass(frozen=True, eq=False, repr=False)
class Pair(Plotted, Frozen):
    """A reference frame and an object frame, as the camera delivered them."""

    reference: NDArray[Any] | None
    """Fringes on the reference plane, (h, w), uint8, uint16 or float, counts. None for a single
    frame: its fringes are compared with the plain fringe of the background."""
    object: NDArray[Any]
    """The same fringes with the object in front, (h, w), counts."""
    black: NDArray[Any] | float | None = None
    """The object while the projector shows black, (h, w), counts; or the camera's black level."""
    white: NDArray[Any] | None = None
    """The object while the projector shows white, (h, w), counts: it shows the paint."""
    mask: BoolMap | None = None
    """True where the object is to be measured, (h, w); None for everywhere."""
    background: BoolMap | None = None
    """True where the reference plane shows in the object frame, (h, w); None to find it. For two
    frames, it tells where the displacement is 0 (``zero`` of ``reconstruct``)."""
    axis: Axis | None = None
    """Direction in which the fringes vary; None to find it."""
    geometry: ReferencePlaneGeometry | None = None
    """None where unknown: results are then displacements in px."""
    camera: str | None = None
    """Name of the camera."""
    projector: str | None = None
    """Name of the projector."""
    truth_mm: FloatMap | None = None
    """True height where it is known (simulations), (h, w), mm."""
    notes: tuple[str, ...] = ()
    """What was done to the frames on reading, such as colour turned to grey."""
    sources: tuple[Source, ...] = ()
    """The files that the frames were read from."""


@dataclass(frozen=True, eq=False, repr=False)
class DisplacementMap(Sectioned, Arrayed, Frozen):
    """Displacement of the fringes per pixel: d(x) = a + b·s(x − u), theory §2 and §4."""

    layout = {  # noqa: RUF012
        "displacement_px": "fiu hw",
        "sigma_px": "fiu hw",
        "modulation_ratio": "fiu hw",
        "reason": "ui hw",
        "iterations": "?ui hw",
        "albedo": "?fiu hw",
        "walls": "?ui hw",
    }
    main = "displacement_px"

    displacement_px: FloatMap
    """u along the carrier's axis, (h, w), px; NaN where it cannot be measured."""
    sigma_px: FloatMap
    """Standard deviation of u, (h, w), px; NaN where u is."""
    modulation_ratio: FloatMap
    """b, modulation over that of the reference frame, (h, w); NaN where it was not measured."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    period_px: float
    """Mean fringe period on the reference, px."""
    axis: Axis
    """Direction of the displacement."""
    method: str
    """Name of the method in the registry."""
    tilt_deg: float = 0.0
    """Angle between the direction in which the fringes change and that axis, degrees."""
    iterations: ByteMap | None = None
    """Refinement steps of each pixel, (h, w), where the method iterates."""
    albedo: FloatMap | None = None
    """Albedo of the object over that of the reference, (h, w) > 0, where the method has found paint
    with hard edges."""
    walls: ByteMap | None = None
    """1 for the pixels on either side of a cliff, else 0, (h, w), where the method has found
    cliffs."""
    converged: bool = True
    """False where an iteration of the analysis reached its largest number of steps: the search for
    the background of a single frame, or the unwrapping by least squares."""
    details: dict[str, Any] = field(default_factory=dict)
    """Figures that the method found on its way (carrier, noise, regions), for reports."""

    @property
    def phase_rad(self) -> FloatMap:
        """φ = 2π u / p, p the mean period, (h, w), rad: a phase difference where p is constant."""
        return self.displacement_px * (2.0 * np.pi / self.period_px)
