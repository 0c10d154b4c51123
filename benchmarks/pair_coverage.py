"""``python -m benchmarks.pair_coverage``: share of errors within 1 and 2 σ, all pair methods.

``--seeds 1 2 3 --periods 9 14 25 --shapes plane curved wavy`` chooses what the shares are averaged
over; ``--each`` prints every period by itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from fringeworks import analyse
from fringeworks.pair import displacement_from_height
from fringeworks.pair.prepared import PreparedPair, prepare
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.scene import STANDARD_GEOMETRY
from fringeworks.types import FloatMap, Pair

FAULTS: dict[str, dict[str, float]] = {
    "clean": {},
    "JPEG 50": {"jpeg": 50},
    "JPEG 75": {"jpeg": 75},
    "JPEG 95": {"jpeg": 95},
    "pixel grid": {"grid_px": 3.7, "grid_depth": 0.5},
    "flicker": {"flicker": 0.03},
}
"""What is wrong with the frames, as fields of ``PairSettings``."""
SHAPES = ("plane", "curved", "wavy")
METHODS = ("fourier", "wavelet", "windowed_fourier", "windowed", "ifa", "sifa", "gsifa", "exact")
PERIODS_PX = (9.0, 14.0, 25.0)
"""Periods of the fringes, px.

Not 8: errors of JPEG's blocks of 8 px are then constant over the frame and cannot be seen.
"""
SEEDS = (1, 2, 3)
"""Seeds of the noise, of the surface and of the frames' settings."""
SETTINGS = ((1.6, 2.0), (1.0, 1.0), (2.2, 3.0))
"""γ of the projector and noise in counts, by seed."""
SIZE = 400
"""Side of the frames, px."""
BORDER_PERIODS = 2.0
"""Rim of the frame that is left out, periods; filters reach about so far."""
MIN_BORDER_PX = 30
"""Smallest rim, px: the wide windows of ``windowed_fourier`` and ``windowed`` reach so far."""


@dataclass(frozen=True)
class Coverage:
    """Share of the measured pixels whose error is within 1 and 2 σ, and their robust error."""

    measured: float
    within_1: float
    within_2: float
    error_px: float


def surface(shape: str, size: int, seed: int) -> FloatMap:
    """Height of a smooth surface, mm: a plane, one bump of Gaussian form, or waves everywhere."""
    rng = np.random.default_rng([seed, SHAPES.index(shape)])
    y, x = np.mgrid[:size, :size] / size - 0.5
    if shape == "plane":
        # Its mean is on the reference plane, so that the rim tells the fringe order.
        a, b = rng.uniform(-12.0, 12.0, 2)
        return np.asarray(a * x + b * y)
    if shape == "curved":
        cy, cx = rng.uniform(-0.1, 0.1, 2)
        width = rng.uniform(0.15, 0.25)
        return np.asarray(30.0 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2.0 * width**2)))
    (fx, fy), (px, py) = rng.uniform(1.5, 2.5, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
    return np.asarray(4.0 * np.sin(2.0 * np.pi * fx * x + px) * np.cos(2.0 * np.pi * fy * y + py))


def scene(
    shape: str, fault: str, *, size: int = SIZE, seed: int = 3, period_px: float = 25.0
) -> tuple[Pair, FloatMap]:
    """Simulate 8-bit frames of a surface, and its displacement in px."""
    height = surface(shape, size, seed)
    gamma, noise = SETTINGS[(seed - 1) % len(SETTINGS)]
    usual = {"bits": 8, "contrast": 0.8, "ambient": 0.1, "gamma": gamma, "noise": noise}
    settings = PairSettings(**{**usual, **FAULTS[fault], "fringes": size / period_px, "seed": seed})
    pair = capture_pair(height, STANDARD_GEOMETRY, settings)
    return pair, displacement_from_height(height, STANDARD_GEOMETRY)


def coverage(pair: Pair | PreparedPair, truth_px: FloatMap, method: str) -> Coverage:
    """Coverage of a method's σ away from the frame's rim."""
    found = analyse(pair, method)
    rim = max(MIN_BORDER_PX, int(BORDER_PERIODS * found.period_px))
    inner = (slice(rim, -rim),) * 2
    error = np.abs(found.displacement_px - truth_px)[inner]
    sigma = found.sigma_px[inner]
    ok = np.isfinite(error)
    ratio = error[ok] / sigma[ok]
    return Coverage(
        float(ok.mean()),
        float(np.mean(ratio < 1)),
        float(np.mean(ratio < 2)),
        float(np.quantile(error[ok], 0.68)),
    )


def mean_coverage(
    shape: str, fault: str, periods: Iterable[float], seeds: Iterable[int], methods: Iterable[str]
) -> dict[str, Coverage]:
    """Mean over periods and seeds, by method."""
    found: dict[str, list[Coverage]] = {name: [] for name in methods}
    for period, seed in product(periods, seeds):
        pair, truth = scene(shape, fault, seed=seed, period_px=period)
        prepared = prepare(pair)
        for name, values in found.items():
            values.append(coverage(prepared, truth, name))
    return {
        name: Coverage(
            *(
                float(np.mean([getattr(c, field) for c in values]))
                for field in ("measured", "within_1", "within_2", "error_px")
            )
        )
        for name, values in found.items()
    }


def main() -> None:
    """Print the table, in per cent within 1 σ / 2 σ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--periods", type=float, nargs="+", default=PERIODS_PX)
    parser.add_argument("--shapes", nargs="+", choices=SHAPES, default=SHAPES)
    parser.add_argument("--faults", nargs="+", choices=tuple(FAULTS), default=tuple(FAULTS))
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--each", action="store_true", help="a line for every period")
    chosen = parser.parse_args()
    print(f"| surface | frames | period, px | {' | '.join(chosen.methods)} |")
    print("|---|---|---|" + "---|" * len(chosen.methods))
    groups = [(p,) for p in chosen.periods] if chosen.each else [tuple(chosen.periods)]
    for shape, fault, periods in product(chosen.shapes, chosen.faults, groups):
        means = mean_coverage(shape, fault, periods, chosen.seeds, chosen.methods)
        cells = (f"{100 * c.within_1:.0f} / {100 * c.within_2:.0f}" for c in means.values())
        told = ", ".join(f"{p:g}" for p in periods)
        print(f"| {shape} | {fault} | {told} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
