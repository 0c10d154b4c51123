"""Responses of projectors that are no power of the value sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.types import FloatMap, InputError

ResponseCurve = Callable[[FloatMap], FloatMap]
"""Light, 0…1, as a function of the value sent, 0…1; any function that keeps 0 and 1 will do."""


@dataclass(frozen=True)
class TabulatedResponse:
    """A response that was measured at some values, between which it rises smoothly.

    Raises
    ------
    InputError for values that do not rise from 0 to 1, or fewer than three.

    Notes
    -----
    Monotone cubic interpolation (Fritsch and Carlson 1980, doi:10.1137/0717021).

    Examples
    --------
    >>> bent = TabulatedResponse((0.0, 0.5, 1.0), (0.0, 0.3, 1.0))
    >>> float(bent(np.array(0.5)))
    0.3
    """

    sent: tuple[float, ...]
    """Values sent, rising from 0 to 1."""
    light: tuple[float, ...]
    """Light at these values, rising from 0 to 1."""

    def __post_init__(self) -> None:
        for name in ("sent", "light"):
            values = np.asarray(getattr(self, name), np.float64)
            rises = values.size >= 3 and bool(np.all(np.diff(values) > 0))
            if not (rises and values[0] == 0.0 and values[-1] == 1.0):
                raise InputError(f"{name}: expected 3 values or more, rising from 0 to 1")
        if len(self.sent) != len(self.light):
            raise InputError(
                f"light: expected {len(self.sent)} values, as many as sent, got {len(self.light)}"
            )

    def __call__(self, sent: FloatMap) -> FloatMap:
        """Return the light, 0…1, for values sent, 0…1."""
        return np.asarray(scipy.interpolate.PchipInterpolator(self.sent, self.light)(sent))


@dataclass(frozen=True)
class SCurve:
    """The S-shaped response of liquid crystals: toe, steep middle and shoulder.

    Raises
    ------
    InputError for exponents or an offset that are not above 0, and α < β.

    Notes
    -----
    (1 + C) v^α / (v^β + C): the S-curve model of LCD projectors (Kwak and MacDonald 2000,
    doi:10.1016/S0141-9382(00)00048-3).
    """

    alpha: float = 2.9
    """α, exponent of the toe."""
    beta: float = 2.6
    """β, exponent of the shoulder; the slope at white is α − β / (1 + C)."""
    offset: float = 0.2
    """C, place of the bend."""

    def __post_init__(self) -> None:
        if not (self.alpha >= self.beta > 0 and self.offset > 0):
            raise InputError(
                f"S-curve: expected alpha >= beta > 0 and offset > 0, got {self.alpha}, "
                f"{self.beta} and {self.offset}"
            )

    def __call__(self, sent: FloatMap) -> FloatMap:
        """Return the light, 0…1, for values sent, 0…1."""
        bend = sent**self.beta + self.offset
        return np.asarray((1.0 + self.offset) * sent**self.alpha / bend)


LCD = SCurve()
"""A panel of liquid crystals without correction. Its three numbers are our choice: half of the
light at 0.54 of the value sent, and a slope of 0.7 at white."""
DLP_BRIGHT = TabulatedResponse(
    (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
    (0.0, 0.01, 0.04, 0.10, 0.19, 0.33, 0.52, 0.72, 0.87, 0.96, 1.0),
)
"""A mirror projector in its bright mode, in which a white segment of the colour wheel joins in: a
toe below 0.2, the steepest part from 0.5 to 0.7, and a shoulder above 0.8. The table is our choice;
such curves differ from device to device."""
