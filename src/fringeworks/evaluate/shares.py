"""The parts of a standard deviation: what each comes from, its size and its degrees of freedom."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

Source = Literal[
    "noise",
    "neighbours",
    "blur",
    "calibration",
    "alignment",
    "board certificate",
    "temperature",
    "form filter",
]
"""What a part of an uncertainty comes from."""


class Share(NamedTuple):
    """A part of the standard deviation of a quantity."""

    source: Source
    sigma: float
    """Standard deviation of the quantity by this source alone, in its unit."""
    freedom: float = np.inf
    """Degrees of freedom of ``sigma``; ∞ where it follows from a model."""


Shares = tuple[Share, ...]


def total(shares: Iterable[Share]) -> float:
    """Return the standard deviation of all parts together."""
    # Summed exactly, so that the order of the parts does not matter.
    return math.sqrt(math.fsum(one.sigma**2 for one in shares))


def scaled(shares: Iterable[Share], factor: float) -> Shares:
    """Return the parts of a quantity that is so many times as uncertain."""
    return tuple(one._replace(sigma=one.sigma * factor) for one in shares)


def joined(shares: Iterable[Share]) -> Shares:
    """Return one part for each source.

    Notes
    -----
    Degrees of freedom by the formula of Welch and Satterthwaite (JCGM 100:2008, G.4.1).
    """
    found: dict[Source, list[Share]] = {}
    for one in shares:
        found.setdefault(one.source, []).append(one)
    return tuple(Share(name, total(some), freedom_of(some)) for name, some in found.items())


def freedom_of(shares: Iterable[Share]) -> float:
    """Return the effective degrees of freedom of all parts together (JCGM 100:2008, G.4.1)."""
    shares = tuple(shares)
    whole = total(shares)
    if not whole > 0:
        return np.inf
    below = sum((one.sigma / whole) ** 4 / one.freedom for one in shares)
    return 1.0 / below if below > 0 else np.inf
