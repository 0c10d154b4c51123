"""Inverse function analysis and windowed inversion."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from benchmarks.harness import Result, against, work
from benchmarks.peers import gsifa_scipy_rows
from fringeworks import analyse
from fringeworks.pair import displacement_from_height
from fringeworks.pair.prepared import prepare
from fringeworks.simulate.scene import standard_scene


@work
def gsifa_1000() -> list[Result]:
    """Global spline IFA on the ideal standard scene against a SciPy row loop."""
    scene = standard_scene("parabola")
    truth = displacement_from_height(scene.truth_mm, scene.geometry)
    pair = prepare(scene)
    return [
        against(
            "gsifa 1000 x 1000",
            "row loop with scipy CubicSpline",
            version("scipy"),
            lambda: analyse(pair, "gsifa").displacement_px,
            lambda: gsifa_scipy_rows(pair.reference, pair.object, pair.period),
            lambda u: float(np.nanmean(np.abs(u - truth))),
            limit_ratio=60.0,
            limit_accuracy=0.001,
        )
    ]


@work
def windowed_1000() -> list[Result]:
    """Adaptive windowed inversion on noisy standard scenes, with the Fourier method beside it."""
    results = []
    for fringes in (10, 40):
        scene = standard_scene(
            "parabola", height_mm=30.0, fringes=fringes, gamma=2.2, noise=2.0, bits=8, seed=1
        )
        truth = displacement_from_height(scene.truth_mm, scene.geometry)
        result = against(
            f"windowed adaptive 1000 x 1000, {fringes} fringes",
            "our fourier (accuracy is the point)",
            version("fringeworks"),
            lambda scene=scene: analyse(scene, "windowed").displacement_px,
            lambda scene=scene: analyse(scene, "fourier").displacement_px,
            lambda u, truth=truth: float(np.nanmean(np.abs(u - truth))),
            limit_seconds=2.5,
        )
        assert result.accuracy < 0.5 * result.peer_accuracy
        results.append(result)
    return results


@work
def windowed_window_size() -> list[Result]:
    """A single scale: a 41 x 41 window against a 9 x 9 one; both are ±2 σ wide."""
    scene = standard_scene("parabola", height_mm=30.0, fringes=40, noise=2.0, bits=8, seed=1)
    truth = displacement_from_height(scene.truth_mm, scene.geometry)
    pair = prepare(scene)
    return [
        against(
            "windowed, one scale, 41 x 41",
            "the same at 9 x 9 (ratio must not fall below 1/1.5)",
            version("fringeworks"),
            lambda: analyse(pair, "windowed", scales=[41 / 4]).displacement_px,
            lambda: analyse(pair, "windowed", scales=[9 / 4]).displacement_px,
            lambda u: float(np.nanmean(np.abs(u - truth))),
            limit_ratio=1 / 1.5,
            repeats=7,
        )
    ]
