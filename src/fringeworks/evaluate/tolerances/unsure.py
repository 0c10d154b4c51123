"""What noise leaves unknown of the distances of a surface, and draws of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.evaluate.tolerances.likely import Likely
from fringeworks.types import FloatMap


class Changes(NamedTuple):
    """Changes of distances, each with its mirror image."""

    likely: FloatMap
    """From the mean surface to likely ones, (2, m), mm."""
    again: FloatMap
    """From the mean surface to those that would be likely if it was measured again, (2, m), mm."""


@dataclass(frozen=True)
class Unsure:
    """A part of the distances of a surface that is not known exactly."""

    design: FloatMap
    """Derivative of the distances by the coefficients of a spline, (m, p); of points that share
    nothing, their standard deviations, (m,), mm."""
    likely: Likely | None = None
    """Posterior of the coefficients; None for points that share nothing."""

    def at(self, some: NDArray[np.generic]) -> Unsure:
        """Return the same of some points alone."""
        return replace(self, design=self.design[some])

    def scaled(self, factor: FloatMap) -> Unsure:
        """Return the same of distances times a factor of each point, (m,)."""
        shape = (-1,) + (1,) * (self.design.ndim - 1)
        return replace(self, design=factor.reshape(shape) * self.design)

    def draw(self, random: np.random.Generator) -> Changes:
        """Draw changes of the distances."""
        signs = np.array([[1.0], [-1.0]])
        if self.likely is None:
            one, other = random.normal(size=(2, len(self.design)))
            return Changes(signs * self.design * one, signs * self.design * (one + other))
        found, mean = self.likely.draw(random), self.likely.mean
        return Changes((found.likely - mean) @ self.design.T, (found.again - mean) @ self.design.T)


def drawn(parts: Sequence[Unsure], random: np.random.Generator) -> Changes:
    """Draw changes of distances that are the sums of independent parts."""
    each = [one.draw(random) for one in parts]
    return Changes(
        np.sum([one.likely for one in each], axis=0), np.sum([one.again for one in each], axis=0)
    )
