"""The parts of σ, of points and of quantities, for one rig of the whole chain.

``python -m benchmarks.budget [--seed 900] [--blur 0.7] [--noise 1.0]``, from the root of the source
tree: one minute. The tables of docs/budget.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import fringeworks as fw
from benchmarks.whole_chain import (
    Patch,
    calibrated,
    disc,
    outline,
    pose_of,
    random_rig,
    square,
    strip,
)
from fringeworks.evaluate.area_points import AreaPoints, area_points
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.evaluate.shares import Source, joined
from fringeworks.simulate.standard import fringe_plan
from tests.ray_caster import Ball, Photographs, Sheet, Tube

PARTS: tuple[Source, ...] = ("noise", "calibration", "blur")


def share(areas: list[AreaPoints], kind: str) -> tuple[float, list[float]]:
    """σ of a quantity and its parts, in µm or milli-degrees."""
    found = MEASURED[kind](*areas)
    parts = {one.source: 1e3 * one.sigma for one in joined(found.shares)}
    # What the removal of noise leaves unknown belongs to the noise.
    parts["noise"] = float(np.hypot(parts.get("noise", 0.0), parts.get("form filter", 0.0)))
    return 1e3 * found.sigma, [parts[part] for part in PARTS]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=900)
    options.add_argument("--blur", type=float, default=0.7, help="of the camera's lens, px")
    options.add_argument("--noise", type=float, default=1.0, help="counts of 255")
    given = options.parse_args()
    rng = np.random.default_rng([8, given.seed])
    true = random_rig(rng)
    light = {"blur_px": given.blur, "noise": given.noise}
    rig = calibrated(true, rng, light)
    plan = fringe_plan(true, both=False)
    wall = Sheet(pose_of(rng, 8.0, (0.0, 0.0, 575.0)))
    balls = [Ball((side, 0.0, 505.0), 20.0) for side in (-36.0, 36.0)]
    tube = Tube((0.0, 0.0, 510.0), (1.0, 0.2, 0.1), 20.0)
    tilts = [pose_of(rng, 15.0, (side, 0.0, 505.0)) for side in (-35.0, 35.0)]

    def see(bodies: list[Any], areas: list[Any], seed: int) -> list[AreaPoints]:
        stack = Photographs(true, [*bodies, wall], over=3).stack(plan, seed=seed, **light)
        cloud = fw.measure(stack, rig).points
        return [area_points(cloud, area, rig) for area in areas]

    spheres = see(balls, [disc(true, ball) for ball in balls], 1)
    middle = np.array(balls[0].centre_mm)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    (inside,) = see(balls, [outline(true, middle + 8.0 * corners)], 1)
    cylinders = see([tube], [strip(true, tube)], 2)
    planes = see([*map(Patch, tilts)], [square(true, T) for T in tilts], 3)
    print("points, median σ / µm: noise, calibration, blur")
    for name, area in (("plane", planes[0]), ("ball", inside), ("ball to 0.9 R", spheres[0])):
        parts = (area.noise, area.common, np.abs(area.blur))
        print(f"| {name} |", " | ".join(f"{1e3 * np.median(p):.2f}" for p in parts), "|")
    print("quantities, σ / µm or 0.001°: whole, noise, calibration, blur")
    for kind, areas in (
        ("flatness", planes[:1]),
        ("angle", planes),
        ("distance", planes),
        ("sphere_diameter", spheres[:1]),
        ("sphere_spacing", spheres),
        ("cylinder_diameter", cylinders),
    ):
        whole, found = share(areas, kind)
        print(f"| {kind} | {whole:.2f} |", " | ".join(f"{p:.2f}" for p in found), "|")


if __name__ == "__main__":
    main()
