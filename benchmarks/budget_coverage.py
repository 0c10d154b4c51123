"""How often true values lie within U of their budgets: rigs that err by their own covariance.

``python -m benchmarks.budget_coverage [--first 9001] [--rigs 89] [--unknown-blur]``, from the root
of the source tree: 3 s for each rig. The last table of docs/budget.md.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.blur_doubt import with_blur_doubt
from fringeworks.evaluate.budget import budget_of
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.calibration.parameters import moved_rig
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.stack.frames import Stack
from fringeworks.types import CameraBlur
from tests.inspected import AREAS, TRUE, scene
from tests.test_budget import COVARIANCE

BLUR_SIGMA = 0.05
"""Relative error of the variance of a rig's blur, as calibrations from boards have it."""


def measured_blur(rng: np.random.Generator) -> CameraBlur:
    """Return the blur of the simulated camera with an error."""
    variance = Optics().blur_px ** 2 * (1.0 + BLUR_SIGMA * rng.normal())
    factors = (float(variance), 0.0, 0.0, 0.0, 0.0, 0.0)
    return CameraBlur(factors, 510.0, (300.0, 800.0), BLUR_SIGMA)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--first", type=int, default=9001, help="first seed")
    options.add_argument("--rigs", type=int, default=89, help="number of rigs")
    options.add_argument("--unknown-blur", action="store_true", help="rigs without their blur")
    given = options.parse_args()
    root = np.linalg.cholesky(COVARIANCE)
    true, plan, view = scene()
    found = defaultdict(list)
    for seed in range(given.first, given.first + given.rigs):
        rng = np.random.default_rng([31, seed])
        rig = replace(moved_rig(true, root @ rng.normal(size=24)), covariance=COVARIANCE)
        if not given.unknown_blur:
            rig = replace(rig, blur=measured_blur(rng))
        light = Optics(noise=float(rng.uniform(0.5, 3.0)), seed=seed)
        found_points = measure(Stack(list(photograph(view, plan, light)), plan), rig).points
        cloud = with_blur_doubt(found_points, rig)
        for (quantity, *names), truth in TRUE.items():
            areas = [area_points(cloud, AREAS[name], rig) for name in names]
            value = MEASURED[quantity](*areas)
            error = value.value - truth
            found[quantity].append((error / value.sigma, error / budget_of(value, areas).expanded))
    for quantity, values in found.items():
        z, of_expanded = np.array(values).T
        print(
            f"{quantity}: {len(z)}, within U {np.mean(np.abs(of_expanded) <= 1):.1%}, mean "
            f"{z.mean():+.2f} σ, scatter {z.std():.2f} σ"
        )


if __name__ == "__main__":
    main()
