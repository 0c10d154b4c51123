"""Recipes: what is measured of a part, and its tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from types import MappingProxyType
from typing import Any, Literal, get_args

from fringeworks.types.alignment import AlignBy, BestFit, DatumPlanes
from fringeworks.types.area import Area
from fringeworks.types.checks import finite
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.numbers import SHARE
from fringeworks.types.points import TriangleMesh
from fringeworks.types.report_head import checked_head
from fringeworks.types.rig import Rig
from fringeworks.types.uncertainty import StatedUncertainty

Quantity = Literal[
    "flatness",
    "step_height",
    "distance",
    "sphere_diameter",
    "sphere_spacing",
    "cylinder_diameter",
    "volume",
    "parallelism",
    "angle",
    "roundness",
    "valid_share",
    "median_sigma",
    "deviation_mean",
    "deviation_rms",
    "deviation_max",
    "iso_straightness",
    "iso_flatness",
    "iso_roundness",
    "iso_cylindricity",
    "iso_line_profile",
    "iso_surface_profile",
    "iso_parallelism",
    "iso_perpendicularity",
    "iso_angularity",
    "iso_position",
    "iso_concentricity",
    "iso_coaxiality",
    "iso_symmetry",
    "iso_circular_run_out",
    "iso_total_run_out",
]
QUANTITIES: Mapping[str, int] = MappingProxyType(
    {
        "flatness": 1,
        "step_height": 2,
        "distance": 2,
        "sphere_diameter": 1,
        "sphere_spacing": 2,
        "cylinder_diameter": 1,
        "volume": 2,
        "parallelism": 2,
        "angle": 2,
        "roundness": 1,
        "valid_share": 1,
        "median_sigma": 1,
        "deviation_mean": 1,
        "deviation_rms": 1,
        "deviation_max": 1,
    }
)
"""Quantities that can have a tolerance, and how many areas each is measured on."""
CHARACTERISTICS: Mapping[str, int] = MappingProxyType(
    {
        "iso_straightness": 0,
        "iso_flatness": 0,
        "iso_roundness": 0,
        "iso_cylindricity": 0,
        "iso_line_profile": 0,
        "iso_surface_profile": 0,
        "iso_parallelism": 1,
        "iso_perpendicularity": 1,
        "iso_angularity": 1,
        "iso_position": 1,
        "iso_concentricity": 1,
        "iso_coaxiality": 1,
        "iso_symmetry": 1,
        "iso_circular_run_out": 1,
        "iso_total_run_out": 1,
    }
)
"""Characteristics of ISO 1101, and the smallest number of datums that each one needs."""
BODIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "iso_straightness": ("plane", "cylinder"),
        "iso_flatness": ("plane",),
        "iso_roundness": ("cylinder",),
        "iso_cylindricity": ("cylinder",),
        "iso_parallelism": ("plane", "cylinder"),
        "iso_perpendicularity": ("plane", "cylinder"),
        "iso_angularity": ("plane", "cylinder"),
        "iso_concentricity": ("cylinder", "sphere"),
        "iso_coaxiality": ("cylinder",),
        "iso_symmetry": ("plane",),
        "iso_circular_run_out": ("plane", "cylinder"),
        "iso_total_run_out": ("plane", "cylinder"),
    }
)
"""Bodies that a characteristic is defined for."""
UNITS: Mapping[str, str] = MappingProxyType(
    dict.fromkeys([*QUANTITIES, *CHARACTERISTICS], "mm")
    | {"volume": "mm³", "angle": "°", "valid_share": ""}
)
"""Units of the quantities."""
SHARES = frozenset({"valid_share"})
"""Quantities that are shares: 0…1 in files, percent where they are shown."""
SIGNED = frozenset({"step_height", "deviation_mean"})
"""Quantities that can be below zero; all others are sizes, ranges and shares."""
FROM_MODEL = frozenset(
    {
        "deviation_mean",
        "deviation_rms",
        "deviation_max",
        "iso_line_profile",
        "iso_surface_profile",
    }
)
"""Quantities that need a model."""
Association = Literal["minimum-zone", "least-squares", "outside", "circumscribed", "inscribed"]
FeatureBody = Literal["plane", "cylinder", "sphere"]
MOST_DATUMS = 3
"""Datums of a system: the primary, the secondary and the tertiary one (ISO 5459)."""
USUAL_RISK = 0.05
"""Probability of a wrong decision that ISO 14253-1:2017 takes unless another is agreed on."""


@dataclass(frozen=True, eq=False, repr=False)
class Datum(Frozen):
    """A datum of a drawing: areas of a part, and the body that is associated with them.

    Raises
    ------
    InputError for no area, and for a median plane of other than two areas.
    """

    areas: tuple[str, ...]
    """Names of its areas; several make a common datum."""
    body: FeatureBody | Literal["median"] = "plane"
    """``median`` for the median plane of two areas that face each other."""
    association: Association = "outside"
    """``outside`` touches the material from outside, as ISO 5459 asks; ``least-squares`` is less
    sensitive to noise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _one_of("datum", self.body, (*get_args(FeatureBody), "median"))
        _one_of("association", self.association, get_args(Association))
        if not self.areas or (self.body == "median" and len(self.areas) != 2):
            needed = "two areas" if self.body == "median" else "an area"
            raise InputError(f"datum: expected {needed}, got {len(self.areas)}")


@dataclass(frozen=True, eq=False, repr=False)
class ToleranceZone(Frozen):
    """What a characteristic of ISO 1101 needs besides its areas.

    Raises
    ------
    InputError for unknown words, more than three datums, and a direction of length 0.
    """

    body: FeatureBody = "plane"
    """Nominal body of the feature."""
    datums: tuple[str, ...] = ()
    """Names of datums of the recipe: primary, secondary, tertiary."""
    association: Association = "minimum-zone"
    """Of the reference body of a form tolerance."""
    at_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Exact place in the frame of the datums, for positions, mm."""
    direction: tuple[float, float, float] | None = None
    """Exact direction of an axis or normal in the frame of the datums; of lines on a plane or free
    form, in the coordinates of the points."""
    angle_deg: float | None = None
    """Exact angle of an angularity, 0…90°."""
    located: bool = False
    """Whether the model's alignment holds a profile; it may move to fit best otherwise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _one_of("body", self.body, get_args(FeatureBody))
        _one_of("association", self.association, get_args(Association))
        if len(self.datums) > MOST_DATUMS or len(set(self.datums)) < len(self.datums):
            raise InputError(
                f"datums: expected up to {MOST_DATUMS} different ones, got {len(self.datums)}"
            )
        if self.direction is not None and not any(self.direction):
            raise InputError("direction: expected a vector, got one of length 0")
        if not finite(*self.at_mm, *(self.direction or ())):
            raise InputError("zone: expected finite places and directions, got others")
        if self.angle_deg is not None and not 0 <= self.angle_deg <= 90:
            raise InputError(f"angle: expected 0…90°, got {self.angle_deg}")


def _one_of(what: str, word: str, known: tuple[str, ...]) -> None:
    if word not in known:
        raise InputError(f"{what}: expected one of {', '.join(known)}, got {word!r}")


@dataclass(frozen=True, eq=False, repr=False)
class PartTolerance(Frozen):
    """Limits of a quantity of a part.

    Raises
    ------
    InputError for an unknown quantity, another number of areas than it needs, and no limit.
    """

    name: str
    """Name in tables."""
    quantity: Quantity
    areas: tuple[str, ...]
    """Names of the areas that it is measured on; of a step, a volume or a
    parallelism, the second is the base."""
    low: float | None = None
    """Smallest allowed value; mm, mm³, degrees or a share."""
    high: float | None = None
    """Largest allowed value."""
    nominal: float | None = None
    """Value of the drawing, for reports; the middle of both limits where it is None."""
    zone: ToleranceZone = field(default_factory=ToleranceZone)
    """Body, datums and exact dimensions of a characteristic of ISO 1101."""

    @property
    def target(self) -> float | None:
        """The nominal value: as stated, or the middle of both limits; None where neither is."""
        if self.nominal is not None or self.low is None or self.high is None:
            return self.nominal
        return 0.5 * (self.low + self.high)

    def unit(self, measured: str = "") -> str:
        """The unit in which its numbers are shown: of its value where there is one."""
        return SHARE if self.quantity in SHARES else measured or UNITS[self.quantity]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in QUANTITIES and self.quantity not in CHARACTERISTICS:
            names = ", ".join([*QUANTITIES, *CHARACTERISTICS])
            raise InputError(
                f"tolerance {self.name}: expected a quantity of {names}, got {self.quantity!r}"
            )
        self._check_zone()
        needed = QUANTITIES.get(self.quantity, 2 if self.quantity == "iso_symmetry" else 1)
        if len(self.areas) != needed:
            raise InputError(
                f"tolerance {self.name}: expected {needed} area{'s' * (needed > 1)} for "
                f"{self.quantity}, got {len(self.areas)}"
            )
        if len(set(self.areas)) < needed:
            raise InputError(
                f"tolerance {self.name}: expected two different areas, got {self.areas[0]!r} twice"
            )
        if self.low is None and self.high is None:
            raise InputError(
                f"tolerance {self.name}: expected a smallest or largest value, got none"
            )
        if self.low is not None and self.high is not None and self.low > self.high:
            raise InputError(
                f"tolerance {self.name}: expected limits in order, got {self.low} and {self.high}"
            )

    def _check_zone(self) -> None:
        needed, datums = CHARACTERISTICS.get(self.quantity), self.zone.datums
        if needed is None:
            if self.zone != ToleranceZone():
                raise InputError(
                    f"tolerance {self.name}: expected no datums or zone for {self.quantity}, got "
                    "some: they belong to characteristics of ISO 1101"
                )
        elif bool(needed) != bool(datums):
            expected = "datums" if needed else "no datums"
            raise InputError(
                f"tolerance {self.name}: expected {expected} for {self.quantity}, got {len(datums)}"
            )
        if (self.quantity == "iso_angularity") != (self.zone.angle_deg is not None):
            raise InputError(
                f"tolerance {self.name}: expected an angle for an angularity, and only there"
            )
        needs = BODIES.get(self.quantity)
        if needs and self.zone.body not in needs:
            raise InputError(
                f"tolerance {self.name}: expected a {' or '.join(needs)} for {self.quantity}, got "
                f"a {self.zone.body}"
            )


@dataclass(frozen=True, eq=False, repr=False)
class PartModel(Frozen):
    """The model of a part, and how the part is brought to it.

    Raises
    ------
    InputError for a reach that is not above 0.
    """

    mesh: TriangleMesh | PathLike[str]
    """The drawing, or the path of its file."""
    align: AlignBy = field(default_factory=BestFit)
    """How the part is brought to it."""
    reach_mm: float | None = None
    """Points farther from the model do not belong to it, mm; None for 5 % of its size."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reach_mm is not None and not self.reach_mm > 0:
            raise InputError(f"model: expected a reach > 0 mm, got {self.reach_mm}")


@dataclass(frozen=True, eq=False, repr=False)
class Recipe(Frozen):
    """How parts of one kind are measured and judged.

    Raises
    ------
    InputError for unknown areas, repeated names, a risk out of its range, and unknown fields of the
    head.
    """

    method: str = "windowed"
    """Method for pairs."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the method, or of decoding."""
    rig: Rig | PathLike[str] | None = None
    """Rig, or the path of its file; needed for stacks."""
    plan: Any = None
    """``PatternPlan`` of frames that have none of their own, such as an array."""
    areas: Mapping[str, Area] = field(default_factory=dict)
    """Areas of the camera's image by name."""
    within: str | None = None
    """Area outside of which nothing is measured; None for everywhere."""
    tolerances: tuple[PartTolerance, ...] = ()
    risk: float = USUAL_RISK
    """Probability up to which a part that breaks a limit passes, or a good one fails; 0…0.5."""
    model: PartModel | None = None
    """The model that deviations are measured from."""
    datums: Mapping[str, Datum] = field(default_factory=dict)
    """Datums of the drawing by name."""
    uncertainty: StatedUncertainty = field(default_factory=StatedUncertainty)
    """Uncertainties that no frame shows: of the board's certificate, and by temperature."""
    head: Mapping[str, str] = field(default_factory=dict)
    """Fields of the head of reports, such as customer, part_number and revision."""

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_head(self.head)
        if not 0 < self.risk <= 0.5:
            raise InputError(
                f"risk: expected a probability above 0 and at most 0.5, got {self.risk}"
            )
        for one in self.tolerances:
            if not isinstance(one, PartTolerance):
                got = type(one).__name__
                raise InputError(f"tolerances: expected each as a PartTolerance, got {got}")
        named = [name for one in self.tolerances for name in one.areas]
        named += [name for one in self.datums.values() for name in one.areas]
        for name in (name for one in self.tolerances for name in one.zone.datums):
            if name not in self.datums:
                known = ", ".join(self.datums) or "none"
                raise InputError(f"datum {name!r}: expected one of the recipe's, got {known}")
        for name in [*named, *([] if self.within is None else [self.within])]:
            if name not in self.areas:
                known = ", ".join(self.areas) or "none"
                raise InputError(f"area {name!r}: expected one of the recipe's, got {known}")
        needy = [one.name for one in self.tolerances if one.quantity in FROM_MODEL]
        if needy and self.model is None:
            raise InputError(f"tolerance {needy[0]!r}: expected a recipe with a model, got none")
        self._check_faces()
        names = [one.name for one in self.tolerances]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"tolerance {twice!r}: expected each name once, got it twice")

    def _check_faces(self) -> None:
        """Faces need a model, and an alignment that does not need them."""
        faces = {name for name, area in self.areas.items() if area.face is not None}
        if faces and self.model is None:
            raise InputError(f"area {min(faces)!r}: expected a recipe with a model, got none")
        if self.within in faces:
            raise InputError(f"within: expected pixels, got the face of the area {self.within!r}")
        align = None if self.model is None else self.model.align
        fitted = [align.within] if isinstance(align, BestFit) else []
        fitted += list(align.where) if isinstance(align, DatumPlanes) else []
        if any(isinstance(one, Area) and one.face is not None for one in fitted):
            raise InputError("model: expected areas of pixels for the alignment, got a face")
