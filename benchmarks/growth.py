"""How the time of calls grows with pixels, frames, threads and windows."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.decoding import noisy
from benchmarks.harness import Growth, grown, work
from benchmarks.phases import hill
from benchmarks.triangulation import NEVER
from benchmarks.triangulation import rig as rig_of_benchmarks
from fringeworks import PatternPlan, Rig, analyse, encode, unwrap
from fringeworks.pair import wavelet_frequencies, wavelet_ridge, windowed_fourier_filter
from fringeworks.pair.prepared import prepare
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig import Pinhole, Triangulator
from fringeworks.signal import CameraNoise, decompose_rows
from fringeworks.simulate.scene import standard_scene
from fringeworks.stack import Decoder

MEGAPIXELS = (0.25, 1.0, 4.0, 16.0)
FEW_MEGAPIXELS = (0.25, 1.0, 4.0)
PAIR_MEGAPIXELS = (1.0, 2.25, 4.0, 9.0)
"""Smaller scenes are displaced so little that counting fringes takes fewer steps."""
FRAMES = (3, 8, 16, 32, 64)
WINDOWS = (9, 17, 33, 65)
WIDTH, HEIGHT = 1920, 1200


def side(megapixels: float) -> int:
    """Side of a square frame."""
    return round(1000.0 * megapixels**0.5)


def stack(n: int) -> tuple[PatternPlan, list[np.ndarray]]:
    """Twelve frames of n × n pixels."""
    sets = tuple(PhaseSteps("x", n / v, equal_steps(4)) for v in (1, 8, 64))
    plan = PatternPlan(n, n, sets)
    return plan, list(noisy(np.array(list(encode(plan))), 2.0))


def rig(n: int) -> Rig:
    """The rig of the other benchmarks for a camera and a projector of n × n pixels."""
    known = rig_of_benchmarks()

    def scaled(device: Pinhole) -> Pinhole:
        scale = n / device.width_px
        focal = (device.focal_px[0] * scale, device.focal_px[1] * scale)
        return Pinhole(n, n, focal, (0.5 * n, 0.5 * n), device.distortion)

    camera, projector = scaled(known.camera), scaled(known.projector)
    return Rig(camera, projector, known.T_projector_camera, known.covariance, known.residual_px)


@work
def growth_stacks() -> list[Growth]:
    """Decoding, triangulation, and both in one pass, over pixels and frames."""

    def decoded(megapixels: float) -> Callable[[], Any]:
        plan, frames = stack(side(megapixels))
        live = Decoder(plan, frames[0].shape, noise=CameraNoise(2.0), judge_every=NEVER)
        return lambda: live.decode(frames)

    def triangulated(megapixels: float) -> Callable[[], Any]:
        n = side(megapixels)
        plan, frames = stack(n)
        coordinates = Decoder(plan, (n, n), judge_every=NEVER).decode(frames)
        prepared = Triangulator(rig(n))
        cloud = prepared.triangulate(coordinates)
        return lambda: prepared.triangulate(coordinates, out=cloud)

    def measured(megapixels: float) -> Callable[[], Any]:
        n = side(megapixels)
        plan, frames = stack(n)
        live = Decoder(plan, (n, n), rig=rig(n), judge_every=NEVER)
        return lambda: live.points(frames)

    def of_frames(count: float) -> Callable[[], Any]:
        steps = PhaseSteps("x", float(WIDTH), equal_steps(int(count)))
        plan = PatternPlan(WIDTH, HEIGHT, (steps,))
        frames = list(noisy(np.array(list(encode(plan))), 2.0))
        live = Decoder(plan, (HEIGHT, WIDTH), noise=CameraNoise(2.0), judge_every=NEVER)
        return lambda: live.decode(frames)

    return [
        grown("decode 12 frames (Decoder)", "megapixels", MEGAPIXELS, decoded),
        grown("triangulate x", "megapixels", MEGAPIXELS, triangulated),
        grown("12 frames to points (Decoder)", "megapixels", MEGAPIXELS, measured),
        grown("decode 1920 x 1200 (Decoder)", "frames", FRAMES, of_frames),
    ]


@work
def growth_waves() -> list[Growth]:
    """Unwrapping and transforms over pixels."""

    def unwrapping(noise: float) -> Callable[[float], Callable[[], Any]]:
        def made(megapixels: float) -> Callable[[], Any]:
            _, wrapped = hill(side(megapixels), noise)
            return lambda: unwrap(wrapped)

        return made

    def filtered(megapixels: float) -> Callable[[], Any]:
        field = np.exp(1j * hill(side(megapixels), 0.3)[1]).astype(np.complex64)
        return lambda: windowed_fourier_filter(field)

    def ridge(megapixels: float) -> Callable[[], Any]:
        frame = np.cos(hill(side(megapixels), 0.3)[1])
        frequencies = wavelet_frequencies(1 / 16, 32, 1.8)
        return lambda: wavelet_ridge(frame, frequencies=frequencies)

    def modes(megapixels: float) -> Callable[[], Any]:
        rows = 100.0 * np.cos(hill(1000, 0.3)[1].astype(float))
        rows = np.tile(rows, (4, 1))[: round(1000 * megapixels)]
        return lambda: decompose_rows(rows)

    return [
        grown("unwrap, noise 0.3 rad", "megapixels", MEGAPIXELS, unwrapping(0.3)),
        grown("unwrap, noise 0.8 rad", "megapixels", FEW_MEGAPIXELS, unwrapping(0.8)),
        grown("windowed Fourier filter", "megapixels", FEW_MEGAPIXELS, filtered),
        grown("wavelet ridge", "megapixels", FEW_MEGAPIXELS, ridge),
        grown("EMD of rows", "megapixels", FEW_MEGAPIXELS, modes),
    ]


@work
def growth_pairs() -> list[Growth]:
    """Methods for two frames over pixels, at the same number of pixels per fringe."""

    def by(method: str) -> Callable[[float], Callable[[], Any]]:
        def made(megapixels: float) -> Callable[[], Any]:
            n = side(megapixels)
            scene = standard_scene(
                "parabola", height_mm=30.0, size=n, fringes=n // 25, noise=2.0, bits=8, seed=1
            )
            pair = prepare(scene)
            return lambda: analyse(pair, method)

        return made

    def window(width: float) -> Callable[[], Any]:
        scene = standard_scene("parabola", height_mm=30.0, fringes=40, noise=2.0, bits=8, seed=1)
        pair = prepare(scene)
        return lambda: analyse(pair, "windowed", scales=[width / 4.0])

    names = ("fourier", "gsifa", "windowed")
    return [
        *(grown(f"analyse, {name}", "megapixels", PAIR_MEGAPIXELS, by(name)) for name in names),
        grown("analyse 1000 x 1000, windowed, one scale", "window, px", WINDOWS, window),
    ]


ONE = """
import sys, time, statistics
from benchmarks.growth import stack
from benchmarks.triangulation import NEVER
from fringeworks.signal import CameraNoise
from fringeworks.stack import Decoder
plan, frames = stack(2000)
live = Decoder(plan, frames[0].shape, noise=CameraNoise(2.0), judge_every=NEVER)
times = []
for _ in range(15):
    started = time.perf_counter()
    live.decode(frames)
    times.append(time.perf_counter() - started)
print(statistics.median(times))
"""


@work
def growth_threads() -> list[Growth]:
    """Decoding on one thread, two and so on, each in a process of its own."""
    counts = [n for n in (1, 2, 4, 8, 16) if n <= (os.cpu_count() or 1)]
    seconds = []
    for count in counts:
        done = subprocess.run(
            [sys.executable, "-c", ONE],
            env={**os.environ, "RAYON_NUM_THREADS": str(count)},
            capture_output=True,
            text=True,
            check=True,
        )
        seconds.append(float(done.stdout))
    if len(counts) < 2:
        return []
    name = "decode 12 frames of 4 megapixels (Decoder)"
    return [Growth(name, "threads", tuple(map(float, counts)), tuple(seconds), None)]
