"""``python -m benchmarks.pair_coverage``: share of errors within 1 and 2 σ, all pair methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks import analyse, displacement_from_height
from fringeworks.simulate import STANDARD_GEOMETRY, PairSettings, capture_pair
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
SHAPES = ("plane", "curved")
METHODS = ("fourier", "wavelet", "windowed_fourier", "windowed", "ifa", "sifa", "gsifa", "exact")
BORDER_PX = 30
"""Rim of the frame that is left out, about a period."""


@dataclass(frozen=True)
class Coverage:
    """Share of the measured pixels whose error is within 1 and 2 σ, and their robust error."""

    measured: float
    within_1: float
    within_2: float
    error_px: float


def scene(shape: str, fault: str, *, size: int = 400, seed: int = 3) -> tuple[Pair, FloatMap]:
    """A smooth surface under 16 fringes of γ 1.6 with a noise of 2 counts, and its displacement."""
    y, x = np.mgrid[:size, :size] / size - 0.5
    if shape == "plane":
        height = 30.0 * (0.3 + 0.4 * x + 0.3 * y)
    else:
        height = 30.0 * np.exp(-(x * x + y * y) / (2.0 * 0.2**2))
    usual = {"fringes": 16, "gamma": 1.6, "noise": 2, "bits": 8, "contrast": 0.8, "ambient": 0.1}
    settings = PairSettings(**{**usual, "seed": seed, **FAULTS[fault]})
    pair = capture_pair(height, STANDARD_GEOMETRY, settings)
    return pair, displacement_from_height(height, STANDARD_GEOMETRY)


def coverage(pair: Pair, truth_px: FloatMap, method: str) -> Coverage:
    """Coverage of a method's σ away from the frame's rim."""
    found = analyse(pair, method)
    inner = (slice(BORDER_PX, -BORDER_PX),) * 2
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


def main() -> None:
    """Print the table."""
    print("| shape | frames | method | measured | within 1 σ | within 2 σ | error, px |")
    print("|---|---|---|---|---|---|---|")
    for shape in SHAPES:
        for fault in FAULTS:
            pair, truth = scene(shape, fault)
            for method in METHODS:
                c = coverage(pair, truth, method)
                print(
                    f"| {shape} | {fault} | {method} | {c.measured:.3f} | {c.within_1:.2f} "
                    f"| {c.within_2:.2f} | {c.error_px:.4f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
