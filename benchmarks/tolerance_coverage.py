"""How often true values of ISO 1101 lie within σ, and parts at their limit pass: random bodies.

``python -m benchmarks.tolerance_coverage [QUANTITY …] [--first 7001] [--bodies 200] [--rigs]``,
from the root of the source tree: 1 to 6 s for each body. The tables of docs/tolerances.md. With
``--rigs``, each body is measured by a rig of its own, which errs by a draw of its covariance.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints, area_points
from fringeworks.evaluate.inspect import decide
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.tolerances.measure import prepared
from fringeworks.evaluate.tolerances.uncertain import quantified
from fringeworks.rig.point_errors import point_errors
from fringeworks.simulate.standard import standard_rig
from fringeworks.types import PointCloud, Recipe, Rig
from tests.test_budget import COVARIANCE
from tests.tolerance_bodies import BODIES, Case, case

RISK = 0.05
"""Stated risk of a wrong decision."""
STREAM = 48
"""Second seed of the bodies: these are drawn nowhere else."""


class Outcome(NamedTuple):
    """A body that was measured."""

    true: float
    found: Quantified
    verdict: str
    """Of the decision whether it keeps its true value: the limit."""

    @property
    def over(self) -> float:
        """Error over σ."""
        return (self.found.value - self.true) / self.found.sigma


def areas_of(
    recipe: Recipe, cloud: PointCloud, rig: Rig | None = None
) -> Callable[[str], AreaPoints]:
    """Return a function that gives the points of an area of the recipe, computed once."""
    known: dict[str, AreaPoints] = {}

    def of_area(name: str) -> AreaPoints:
        if name not in known:
            known[name] = area_points(cloud, recipe.areas[name], rig)
        return known[name]

    return of_area


def true_value(one: Case) -> float:
    """Return the value of the points without noise."""
    recipe = one.recipe()
    of_area = areas_of(recipe, one.cloud(np.random.default_rng(0), 0.0))
    value, skins = prepared(one.tolerance, recipe, of_area, of_area)
    return value([np.zeros(len(skin.foot)) for skin in skins])


def by_rig(cloud: PointCloud, rig: Rig, rng: np.random.Generator) -> PointCloud:
    """Return the points as a rig measures them that errs by a draw of its covariance."""
    xyz = cloud.xyz_mm.astype(float)
    errors = point_errors(rig, xyz.reshape(-1, 3), cloud)
    moved = xyz + (errors @ rng.normal(size=errors.shape[2])).reshape(xyz.shape)
    return replace(cloud, xyz_mm=moved.astype(np.float32))


def measured(quantity: str, seed: int, *, rigs: bool = False) -> Outcome:
    """Measure a random body, and decide about it as if its true value was its limit."""
    rng = np.random.default_rng([STREAM, seed, BODIES.index(quantity)])
    one = case(quantity, rng)
    recipe, true = one.recipe(), true_value(one)
    cloud, rig = one.cloud(rng), None
    if rigs:
        rig = replace(standard_rig(scale=0.3), covariance=COVARIANCE)
        cloud = by_rig(cloud, rig, rng)
    of_area = areas_of(recipe, cloud, rig)
    found = quantified(*prepared(one.tolerance, recipe, of_area, of_area))
    return Outcome(true, found, decide(found, replace(one.tolerance, high=true), RISK))


def line(quantity: str, outcomes: list[Outcome]) -> str:
    """Return a row of the table."""
    z = np.array([one.over for one in outcomes])
    passed = np.mean([one.verdict == "pass" for one in outcomes])
    failed = np.mean([one.verdict == "fail" for one in outcomes])
    sigma = 1e3 * np.median([one.found.sigma for one in outcomes])
    return (
        f"| {quantity} | {len(z)} | {np.mean(np.abs(z) < 1):.0%} | {np.mean(np.abs(z) < 2):.1%} | "
        f"{np.abs(z).max():.1f} | {z.mean():+.2f} | {passed:.1%} | {failed:.1%} | {sigma:.1f} µm |"
    )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("quantities", nargs="*", default=BODIES, help="characteristics")
    options.add_argument("--first", type=int, default=7001, help="first seed")
    options.add_argument("--bodies", type=int, default=200, help="bodies of each characteristic")
    options.add_argument("--rigs", action="store_true", help="a rig with errors for each body")
    given = options.parse_args()
    print(
        "| characteristic | bodies | within 1 σ | within 2 σ | largest | mean | pass | fail | σ |"
    )
    for quantity in given.quantities:
        seeds = range(given.first, given.first + given.bodies)
        print(
            line(quantity, [measured(quantity, seed, rigs=given.rigs) for seed in seeds]),
            flush=True,
        )


if __name__ == "__main__":
    main()
