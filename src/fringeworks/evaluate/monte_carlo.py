"""Uncertainty by Monte Carlo: measured points moved by their errors, through the same functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints
from fringeworks.evaluate.budget import PROBABILITY, UNIFORM, Budget
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.quantities import MEASURED, AreaDeviation
from fringeworks.evaluate.shares import Share
from fringeworks.evaluate.tolerances.skins import Skin
from fringeworks.evaluate.tolerances.uncertain import Value
from fringeworks.rig.point_errors import root_of
from fringeworks.types import FloatMap, Frozen, InputError

LEAST_DRAWS = 100
"""Smallest number of draws: 95 % then leaves five outside."""
DIGITS = 1
"""Significant digits of σ that the two methods must agree in (JCGM 101:2008, 7.9.2). With two, some
10⁵ draws would be needed."""
ENOUGH = 0.2
"""Largest error of Monte Carlo itself, over the numerical tolerance, with which the two methods are
compared (JCGM 101:2008, 8.2)."""
PARTS = 10
"""Parts of the draws from whose scatter the error of Monte Carlo is taken."""


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(Frozen):
    """What Monte Carlo makes of a quantity (JCGM 101:2008)."""

    draws: int
    mean: float
    """Mean of the draws, in the unit of the quantity."""
    sigma: float
    """Their standard deviation."""
    interval: tuple[float, float]
    """Shortest interval that holds 95 % of them."""
    tolerance: float
    """Numerical tolerance δ of the standard uncertainty: half a unit of its first digit."""
    error: float
    """Standard error of the interval's ends by the number of draws."""
    differs: float
    """Largest distance of an end of the interval from value ± U."""

    @property
    def agrees(self) -> bool | None:
        """Whether linear budget and Monte Carlo agree within δ (JCGM 101:2008, 8.1); None where
        there are too few draws to tell."""
        if self.differs - 2.0 * self.error > self.tolerance:
            return False
        if self.error > ENOUGH * self.tolerance and self.differs + 2.0 * self.error > (
            self.tolerance
        ):
            return None
        return self.differs <= self.tolerance


@dataclass
class Errors:
    """One draw of all errors that points have in common."""

    random: np.random.Generator
    known: dict[str, FloatMap] = field(default_factory=dict)

    def normal(self, name: str, count: int) -> FloatMap:
        """Return the draw of some normal numbers: the same each time that a name is asked for."""
        if name not in self.known:
            self.known[name] = self.random.normal(size=count)
        return self.known[name]

    def of(self, name: str, one: Share) -> float:
        """Return the draw of a source of variance 1, uniform where it is one between limits."""
        if name not in self.known:
            limit = 3.0**0.5
            uniform = one.source in UNIFORM
            drawn = self.random.uniform(-limit, limit) if uniform else self.random.normal()
            self.known[name] = np.array([drawn])
        return float(self.known[name][0])


def moved(area: AreaPoints, errors: Errors, name: str, *, freed: bool = False) -> AreaPoints:
    """Return the points of an area, moved by a draw of their errors.

    Parameters
    ----------
    area : AreaPoints
    errors : Errors
        Those that all areas have in common.
    name : str
        Of the area, whose patches have errors of their own where no covariance is known.
    freed : bool
        Whether the quantity is freed of the noise of points, which they then hold twice.
    """
    along = area.noise * errors.random.normal(size=len(area.noise))
    along = along + area.blur * errors.normal("blur", 1)
    if area.by_rig is None:
        patches = errors.normal(f"patches of {name}", int(area.patch.max()) + 1)
        along = along + area.common * patches[area.patch]
    change = area.by_value * along[:, None]
    if area.by_rig is not None:
        parts = area.by_rig @ errors.normal("rig", area.by_rig.shape[2])
        change = change + parts[area.cell]
    for number, one in enumerate(area.scales):
        change = change + (area.points - area.still) * one.sigma * errors.of(f"scale {number}", one)
    noise = area.noise * 2.0**0.5 if freed else area.noise
    if not isinstance(area, AreaDeviation):
        return replace(area, points=area.points + change, noise=noise)
    root = root_of(area.pose_covariance)
    pose = area.by_pose @ (root @ errors.normal("pose", root.shape[1]))
    distance = area.distance + np.einsum("nc,nc->n", change, area.outwards) + pose
    return replace(area, points=area.points + change, noise=noise, distance=distance)


def draw_quantity(
    quantity: str,
    areas: Mapping[str, AreaPoints],
    draws: int,
    random: np.random.Generator,
    *,
    freed: bool,
) -> FloatMap:
    """Draw a quantity of areas; areas that no body is found in any more are drawn again."""
    found: list[float] = []
    lost = 0
    while len(found) < draws:
        errors = Errors(random)
        try:
            some = (moved(a, errors, n, freed=freed) for n, a in areas.items())
            drawn = MEASURED[quantity](*some)
        except InputError:
            lost += 1
            if lost > draws:
                raise
            continue
        found.append(drawn.value)
    return np.array(found)


def draw_zone(
    value: Value, skins: Sequence[Skin], draws: int, random: np.random.Generator
) -> FloatMap:
    """Draw the zone of a characteristic of ISO 1101, with the noise that is left in surfaces."""
    found = np.zeros(draws)
    for k in range(draws):
        errors = Errors(random)
        changes = []
        for number, skin in enumerate(skins):
            common = np.array(
                [errors.of(f"part {n}", one) for n, one in enumerate(skin.sources)], float
            )
            own = errors.normal(f"own {number}", skin.own.shape[1])
            changes.append(skin.noise(random).likely[0] + skin.parts @ common + skin.own @ own)
        found[k] = value(changes)
    return found


def compared(drawn: FloatMap, found: Quantified, budget: Budget) -> MonteCarlo:
    """Compare the draws of a quantity with its value and its budget.

    Parameters
    ----------
    drawn : (m,) array, m ≥ 100
    found : Quantified
    budget : Budget

    Notes
    -----
    y ± U agrees with Monte Carlo where both ends lie within δ of the shortest interval that holds
    as many draws (JCGM 101:2008, 8.1).
    """
    ends = shortest(drawn)
    sigma = float(np.std(drawn, ddof=1))
    parts = np.array([shortest(part) for part in np.array_split(drawn, PARTS)])
    error = float(np.max(np.std(parts, axis=0, ddof=1))) / PARTS**0.5
    goal = (found.value - budget.expanded, found.value + budget.expanded)
    return MonteCarlo(
        len(drawn),
        float(drawn.mean()),
        sigma,
        ends,
        numerical_tolerance(budget.sigma),
        error,
        float(np.max(np.abs(np.subtract(ends, goal)))),
    )


def shortest(values: FloatMap) -> tuple[float, float]:
    """Return the shortest interval that holds 95.45 % of some values (JCGM 101:2008, 5.3.4)."""
    ordered = np.sort(values)
    count = min(int(np.ceil(PROBABILITY * len(ordered))), len(ordered) - 1)
    first = int(np.argmin(ordered[count:] - ordered[: len(ordered) - count]))
    return float(ordered[first]), float(ordered[first + count])


def numerical_tolerance(sigma: float) -> float:
    """Return δ: half a unit of the last significant digit of σ (JCGM 101:2008, 7.9.2)."""
    if not sigma > 0:
        return 0.0
    exponent = int(np.floor(np.log10(sigma))) - (DIGITS - 1)
    # σ of 9.6 rounds to 10, whose first digit is one place higher.
    if round(sigma / 10.0**exponent) >= 10**DIGITS:
        exponent += 1
    return 0.5 * 10.0**exponent


def monte_carlo_of(
    draw: Callable[[int, np.random.Generator], FloatMap],
    found: Quantified,
    budget: Budget,
    *,
    draws: int,
    seed: int,
    recentred: bool = False,
) -> MonteCarlo:
    """Return what Monte Carlo makes of a quantity; see ``compared``.

    Parameters
    ----------
    draw : function
        Of the number of draws and the source of random numbers.
    recentred : bool
        Whether the draws hold noise once more that the value was freed of: their mean is then
        moved to the value.
    """
    if draws < LEAST_DRAWS:
        raise InputError(f"draws: expected {LEAST_DRAWS} or more, got {draws}")
    random = np.random.default_rng(seed)
    drawn = draw(draws, random)
    if recentred:
        drawn = drawn - drawn.mean() + found.value
    filtered = [one.sigma for one in found.shares if one.source == "form filter"]
    if filtered:
        limit = 3.0**0.5 * float(np.hypot.reduce(filtered))
        drawn = drawn + random.uniform(-limit, limit, len(drawn))
    return compared(drawn, found, budget)
