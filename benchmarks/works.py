"""The kinds of work that are measured; each checks both results before a time counts."""

from __future__ import annotations

import ctypes
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from skimage.restoration import unwrap_phase

from benchmarks.peers import gsifa_scipy_rows
from fringeworks import analyse, displacement_from_height, standard_scene, unwrap
from fringeworks.analysis import prepare


@dataclass(frozen=True)
class Result:
    """One row of ``results.json``."""

    work: str
    peer: str
    peer_version: str
    ours_seconds: float
    peer_seconds: float | None
    ratio: float | None
    limit_seconds: float | None
    limit_ratio: float | None
    peak_mb: float
    accuracy: float
    peer_accuracy: float | None


Work = Callable[[], list[Result]]
WORKS: dict[str, Work] = {}


def work(function: Work) -> Work:
    """Register a kind of work under its function's name."""
    WORKS[function.__name__] = function
    return function


def in_turn(*calls: Callable[[], Any], repeats: int = 5) -> tuple[list[float], list[Any]]:
    """Median seconds of each call, run alternately so that both see the same machine."""
    seconds: list[list[float]] = [[] for _ in calls]
    results: list[Any] = [None] * len(calls)
    for _ in range(repeats):
        for k, call in enumerate(calls):
            started = time.perf_counter()
            results[k] = call()
            seconds[k].append(time.perf_counter() - started)
    return [statistics.median(s) for s in seconds], results


def resident_mb(field: str) -> float:
    """A figure of this process's memory by Linux: VmRSS now, VmHWM at its highest; MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field):
            return int(line.split()[1]) / 1024.0
    return float("nan")


def peak_mb(call: Callable[[], Any]) -> float:
    """By how much a call raises the memory of the whole process at its peak, kernels included."""
    try:
        # Memory that earlier calls left in the allocator would hide what this one needs.
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5")  # forget the highest mark
    except (OSError, AttributeError):
        return float("nan")
    before = resident_mb("VmRSS")
    call()
    return resident_mb("VmHWM") - before


@work
def gsifa_1000() -> list[Result]:
    """Global spline IFA on the ideal standard scene against a SciPy row loop."""
    scene = standard_scene("parabola")
    truth = displacement_from_height(scene.truth_mm, scene.geometry)
    pair = prepare(scene)

    def ours() -> np.ndarray:
        return analyse(pair, "gsifa").displacement_px

    def theirs() -> np.ndarray:
        return gsifa_scipy_rows(pair.reference, pair.object, pair.period)

    (a, b), (found, expected) = in_turn(ours, theirs)
    accuracy = float(np.nanmean(np.abs(found - truth)))
    peer_accuracy = float(np.nanmean(np.abs(expected - truth)))
    assert accuracy < 0.001, accuracy
    assert peer_accuracy < 0.01, peer_accuracy
    return [
        Result(
            work="gsifa 1000 x 1000",
            peer="row loop with scipy CubicSpline",
            peer_version=version("scipy"),
            ours_seconds=a,
            peer_seconds=b,
            ratio=b / a,
            limit_seconds=None,
            limit_ratio=50.0,
            peak_mb=peak_mb(ours),
            accuracy=accuracy,
            peer_accuracy=peer_accuracy,
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

        def ours(scene=scene) -> np.ndarray:
            return analyse(scene, "windowed").displacement_px

        def fourier(scene=scene) -> np.ndarray:
            return analyse(scene, "fourier").displacement_px

        (a, b), (found, coarse) = in_turn(ours, fourier)
        accuracy = float(np.nanmean(np.abs(found - truth)))
        peer_accuracy = float(np.nanmean(np.abs(coarse - truth)))
        assert accuracy < 0.5 * peer_accuracy
        results.append(
            Result(
                work=f"windowed adaptive 1000 x 1000, {fringes} fringes",
                peer="our fourier (accuracy is the point)",
                peer_version=version("fringeworks"),
                ours_seconds=a,
                peer_seconds=b,
                ratio=b / a,
                limit_seconds=2.5,
                limit_ratio=None,
                peak_mb=peak_mb(ours),
                accuracy=accuracy,
                peer_accuracy=peer_accuracy,
            )
        )
    return results


@work
def windowed_window_size() -> list[Result]:
    """A single scale: a 41 x 41 window against a 9 x 9 one; both are ±2 σ wide."""
    scene = standard_scene("parabola", height_mm=30.0, fringes=40, noise=2.0, bits=8, seed=1)
    truth = displacement_from_height(scene.truth_mm, scene.geometry)
    pair = prepare(scene)

    def side(pixels: int) -> Callable[[], np.ndarray]:
        sigma = pixels / 4.0
        return lambda: analyse(pair, "windowed", scales=[sigma]).displacement_px

    large, small = side(41), side(9)
    (a, b), (wide, narrow) = in_turn(large, small, repeats=7)
    return [
        Result(
            work="windowed, one scale, 41 x 41",
            peer="the same at 9 x 9 (ratio must not fall below 1/1.5)",
            peer_version=version("fringeworks"),
            ours_seconds=a,
            peer_seconds=b,
            ratio=b / a,
            limit_seconds=None,
            limit_ratio=1 / 1.5,
            peak_mb=peak_mb(large),
            accuracy=float(np.nanmean(np.abs(wide - truth))),
            peer_accuracy=float(np.nanmean(np.abs(narrow - truth))),
        )
    ]


@work
def unwrap_1024() -> list[Result]:
    """Sorting by reliability against scikit-image, noise 0.3 rad."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:1024, :1024].astype(float)
    truth = 0.4 * x + 60 * np.exp(-((x - 500) ** 2 + (y - 520) ** 2) / 60000)
    truth += 0.3 * rng.standard_normal(x.shape)
    wrapped = np.angle(np.exp(1j * truth)).astype(np.float32)

    def wrong(phase: np.ndarray) -> float:
        order = np.round((phase - truth) / (2 * np.pi))
        return float(np.mean(order != np.median(order)))

    (a, b), (found, expected) = in_turn(
        lambda: unwrap(wrapped)[0], lambda: unwrap_phase(wrapped), repeats=5
    )
    assert wrong(found) == 0
    return [
        Result(
            work="unwrap 1024 x 1024, noise 0.3 rad",
            peer="scikit-image unwrap_phase",
            peer_version=version("scikit-image"),
            ours_seconds=a,
            peer_seconds=b,
            ratio=b / a,
            limit_seconds=None,
            limit_ratio=None,
            peak_mb=peak_mb(lambda: unwrap(wrapped)),
            accuracy=wrong(found),
            peer_accuracy=wrong(np.asarray(expected)),
        )
    ]
