"""What a recipe states about uncertainties that no frame shows: the board's certificate, heat."""

from __future__ import annotations

from dataclasses import dataclass

from fringeworks.types.checks import finite
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen


@dataclass(frozen=True, eq=False, repr=False)
class StatedUncertainty(Frozen):
    """Uncertainties of the scale that a recipe states; none by default.

    Raises
    ------
    InputError for numbers below 0, and degrees of freedom that are not above 0.
    """

    board_scale: float = 0.0
    """Standard uncertainty of the board's scale, relative: U / k of its certificate over the
    length that it is for."""
    board_freedom: float | None = None
    """Degrees of freedom of that; None for many."""
    expansion_per_k: float = 0.0
    """Coefficient of thermal expansion of the part, 1/K."""
    temperature_k: float = 0.0
    """The part's temperature is anywhere within so many K of the reference temperature."""

    def __post_init__(self) -> None:
        super().__post_init__()
        values = (self.board_scale, self.expansion_per_k, self.temperature_k)
        if not finite(*values) or min(values) < 0:
            raise InputError(f"uncertainty: expected finite numbers from 0 on, got {values}")
        if self.board_freedom is not None and not self.board_freedom > 0:
            raise InputError(
                f"uncertainty: expected degrees of freedom above 0, got {self.board_freedom}"
            )
