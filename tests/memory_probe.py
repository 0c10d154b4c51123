"""Prints how much memory calls of the library need beside their inputs and results, as JSON, MB.

Each call runs in a process of its own, two at a time: what others leave in the heap, free but
resident or resident but in pieces, changed the figure of one call by 10 or 20 MB.
"""

from __future__ import annotations

import ctypes
import dataclasses
import gc
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import look_at, project, rays, transform

WIDTH, HEIGHT = 1920, 1200
Calls = dict[str, Callable[[], Any]]


def status_mb(field: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field):
            return int(line.split()[1]) / 1024.0
    raise LookupError(field)


def size_mb(value: Any, seen: set[int]) -> float:
    """Memory of all arrays in a result; shared memory counts once."""
    if isinstance(value, np.ndarray):
        while isinstance(value.base, np.ndarray):
            value = value.base
        fresh = id(value) not in seen
        seen.add(id(value))
        return value.nbytes / 2**20 if fresh else 0.0
    if dataclasses.is_dataclass(value):
        return sum(size_mb(getattr(value, f.name), seen) for f in dataclasses.fields(value))
    if isinstance(value, (tuple, list)):
        return sum(size_mb(item, seen) for item in value)
    if isinstance(value, dict):
        return sum(size_mb(item, seen) for item in value.values())
    return 0.0


def extra_mb(call: Callable[[], Any]) -> float:
    """Peak of a call beyond what is there before and what it returns: the middle one of three.

    Tasks of several threads that meet by chance change it.
    """
    call()
    return sorted(one_peak_mb(call) for _ in range(3))[1]


def one_peak_mb(call: Callable[[], Any]) -> float:
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # forget the highest mark
    before = status_mb("VmRSS")
    result = call()
    return status_mb("VmHWM") - before - size_mb(result, set())


def stacks() -> Calls:
    """Frames of 1920 × 1200 to points."""
    rng = np.random.default_rng(0)
    plan = fw.PatternPlan(
        WIDTH,
        HEIGHT,
        tuple(
            fw.patterns.PhaseSteps("x", WIDTH / v, fw.patterns.equal_steps(4)) for v in (1, 8, 64)
        ),
    )
    camera = fw.rig.Pinhole(
        WIDTH, HEIGHT, (4000.0, 4000.0), (960.0, 600.0), (-0.1, 0.1, 0.0, 0.0, 0.0)
    )
    pose = look_at(np.array([200.0, 0.0, 0.0]), np.array([0.0, 0.0, 500.0]))
    rig = fw.Rig(camera, camera, pose, np.eye(24) * 1e-8, (0.01, 0.01))
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    depth = 500.0 + 20.0 * np.sin(u / 100.0) + 10.0 * np.cos(v / 80.0)
    points = rays(camera, np.stack((u, v), axis=-1)) * depth[..., None]
    seen = project(camera, transform(rig.T_projector_camera, points))[..., 0]
    frames = []
    for block in plan.blocks:
        assert isinstance(block, fw.patterns.PhaseSteps)
        for k in range(block.frames):
            light = 20.0 + 200.0 * block.values(seen, k) + 2.0 * rng.standard_normal(seen.shape)
            frames.append(np.clip(np.rint(light), 0, 255).astype(np.uint8))
    floats = [frame.astype(np.float32) for frame in frames]
    decoded = fw.decode(frames, plan)
    decoder = fw.stack.Decoder(plan, (HEIGHT, WIDTH), rig=rig)

    def streamed() -> Any:
        stream = fw.stack.StreamingDecoder(plan)
        for frame in frames:
            stream.add(frame)
        return stream.result(), frames  # as much as the copies that it keeps

    def refilled() -> None:
        decoder.points(frames)  # the result lies in memory that the decoder keeps

    return {
        "decode": lambda: fw.decode(frames, plan),
        "decode, float": lambda: fw.decode(floats, plan),
        "StreamingDecoder": streamed,
        "Decoder.points": refilled,
        "triangulate": lambda: fw.triangulate(decoded, rig),
        "wrapped_phase": lambda: fw.stack.wrapped_phase(frames[:4], fw.patterns.equal_steps(4)),
    }


def waves() -> Calls:
    """Frames and phases of 1024 × 1024."""
    y, x = np.mgrid[:1024, :1024].astype(float)
    rng = np.random.default_rng(0)
    phase = 0.3 * x + 0.1 * y
    smooth = np.angle(np.exp(1j * phase)).astype(np.float32)
    rough = np.angle(np.exp(1j * (phase + 0.8 * rng.standard_normal(x.shape)))).astype(np.float32)
    frame = 127.0 + 100.0 * np.cos(phase) + 2.0 * rng.standard_normal(x.shape)
    field = np.exp(1j * smooth).astype(np.complex64)
    frequencies = fw.pair.wavelet_frequencies(1 / 16, 32, 1.8)
    return {
        "wavelet_ridge": lambda: fw.pair.wavelet_ridge(frame, frequencies=frequencies),
        "decompose_rows": lambda: fw.signal.decompose_rows(frame),
        "denoise": lambda: fw.denoise(frame),
        "decompose_frame": lambda: fw.signal.decompose_frame(frame),
        "windowed_fourier_filter": lambda: fw.pair.windowed_fourier_filter(field),
        "unwrap, smooth": lambda: fw.unwrap(smooth),
        "unwrap, noisy": lambda: fw.unwrap(rough),
    }


def pairs() -> Calls:
    """Both frames of 1000 × 1000, by every method."""
    scene = fw.simulate.standard_scene(
        "parabola", height_mm=30.0, fringes=40, gamma=2.2, noise=2.0, bits=8, seed=1
    )
    return {f"analyse, {name}": lambda name=name: fw.analyse(scene, name) for name in fw.methods()}


GROUPS = {"stacks": stacks, "waves": waves, "pairs": pairs}
NAMES = {
    "stacks": (
        "decode",
        "decode, float",
        "StreamingDecoder",
        "Decoder.points",
        "triangulate",
        "wrapped_phase",
    ),
    "waves": (
        "wavelet_ridge",
        "decompose_rows",
        "denoise",
        "decompose_frame",
        "windowed_fourier_filter",
        "unwrap, smooth",
        "unwrap, noisy",
    ),
    "pairs": tuple(f"analyse, {name}" for name in fw.methods()),
}
"""Calls of each group, whose inputs take seconds to make."""

SETTINGS = {
    "MALLOC_MMAP_THRESHOLD_": "131072",
    "MALLOC_ARENA_MAX": "1",
    "RAYON_NUM_THREADS": "2",
}
"""Each thread has buffers of its own, so that their number is fixed. And the GNU allocator gives
arrays back as soon as they are freed; otherwise it learns to keep tens of megabytes, which a call
finds there or not by chance."""


def alone_mb(group: str, name: str) -> float:
    """What a call needs, measured in another process."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.memory_probe", group, name],
        env=os.environ | SETTINGS,
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def main() -> None:
    if sys.argv[1:]:
        group, name = sys.argv[1:]
        print(extra_mb(GROUPS[group]()[name]))
        return
    wanted = [(group, name) for group, names in NAMES.items() for name in names]
    with ThreadPoolExecutor(2) as pool:
        found = pool.map(lambda call: alone_mb(*call), wanted)
        json.dump({name: mb for (_, name), mb in zip(wanted, found, strict=True)}, sys.stdout)


if __name__ == "__main__":
    main()
