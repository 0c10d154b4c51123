"""Recipes: what is measured of a part, and its tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from types import MappingProxyType
from typing import Any, Literal

from fringeworks.types.alignment import AlignBy, BestFit
from fringeworks.types.area import Area
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.points import TriangleMesh
from fringeworks.types.rig import Rig

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
UNITS: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(QUANTITIES, "mm") | {"volume": "mm³", "angle": "°", "valid_share": ""}
)
"""Units of the quantities."""
FROM_MODEL = frozenset({"deviation_mean", "deviation_rms", "deviation_max"})
"""Quantities that need a model."""
USUAL_RISK = 0.05
"""Probability of a wrong decision that ISO 14253-1:2017 takes unless another is agreed on."""


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

    @property
    def target(self) -> float | None:
        """The nominal value: as stated, or the middle of both limits; None where neither is."""
        if self.nominal is not None or self.low is None or self.high is None:
            return self.nominal
        return 0.5 * (self.low + self.high)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in QUANTITIES:
            names = ", ".join(QUANTITIES)
            raise InputError(
                f"tolerance {self.name}: expected a quantity of {names}, got {self.quantity!r}"
            )
        needed = QUANTITIES[self.quantity]
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
    InputError for unknown areas, repeated names, and a risk out of its range.
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.risk <= 0.5:
            raise InputError(
                f"risk: expected a probability above 0 and at most 0.5, got {self.risk}"
            )
        named = [name for one in self.tolerances for name in one.areas]
        for name in [*named, *([] if self.within is None else [self.within])]:
            if name not in self.areas:
                known = ", ".join(self.areas) or "none"
                raise InputError(f"area {name!r}: expected one of the recipe's, got {known}")
        needy = [one.name for one in self.tolerances if one.quantity in FROM_MODEL]
        if needy and self.model is None:
            raise InputError(f"tolerance {needy[0]!r}: expected a recipe with a model, got none")
        names = [one.name for one in self.tolerances]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"tolerance {twice!r}: expected each name once, got it twice")
