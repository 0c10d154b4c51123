"""Stacks of shifted fringes to absolute coordinates."""

from __future__ import annotations

import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.harness import (
    PeerMissing,
    Result,
    against,
    compared,
    peak_mb,
    peer_module,
    rows,
    streamer,
    work,
)
from fringeworks import PatternPlan, decode, encode
from fringeworks.patterns import PhaseSteps
from fringeworks.signal import CameraNoise
from fringeworks.stack import Decoder

WIDTH, HEIGHT, STEPS = 1920, 1200, 4
OUTPUTS = (np.float32, np.float32, np.float32, np.float32, np.uint8)
GROSS_PX = 5.0


def peer_of(counts: tuple[int, ...]) -> Any:
    """The peer set to the same plan: x only, as many fringes and steps."""
    peer = peer_module("fringes").Fringes()
    peer.X, peer.Y, peer.D, peer.K = WIDTH, HEIGHT, 1, len(counts)
    peer.v, peer.N = list(counts), [STEPS] * len(counts)
    return peer


def plan_of(counts: tuple[int, ...]) -> PatternPlan:
    """What the peer projects: its steps start at half a turn."""
    shifts = tuple(np.pi + 2.0 * np.pi * n / STEPS for n in range(STEPS))
    return PatternPlan(WIDTH, HEIGHT, tuple(PhaseSteps("x", WIDTH / v, shifts) for v in counts))


def noisy(patterns: np.ndarray, noise: float) -> np.ndarray:
    """Patterns as a camera sees them that looks at the projector's pixels."""
    counts = patterns + noise * np.random.default_rng(0).standard_normal(patterns.shape)
    return np.clip(np.rint(counts), 0, 255).astype(np.uint8)


def plain_rms(x: np.ndarray) -> float:
    """Root mean square error where it is no gross one, px."""
    off = x - np.arange(WIDTH)
    return float(np.sqrt(np.mean(off[np.abs(off) < GROSS_PX] ** 2)))


def gross(x: np.ndarray) -> int:
    """Pixels that are off by more than five."""
    return int(np.sum(np.abs(x - np.arange(WIDTH)) >= GROSS_PX))


def against_fringes(counts: tuple[int, ...], limit: float, accuracy: float) -> Result:
    """Decode the same frames with both; none of ours may be grossly wrong."""
    peer = peer_of(counts)
    frames = noisy(peer.encode(), 2.0)
    planes = np.ascontiguousarray(frames[..., 0])
    plan = plan_of(counts)
    ours = decode(planes, plan).x.coordinate_px
    theirs = np.asarray(peer.decode(frames).x).reshape(HEIGHT, WIDTH)
    label = "/".join(map(str, counts))
    print(
        f"    {label}: gross errors {gross(ours)} of ours, {gross(theirs)} of the peer's; "
        f"{np.mean(np.isnan(ours)):.4%} of ours without a value"
    )
    assert gross(ours) == 0
    return against(
        f"decode {label} fringes x {STEPS} steps, {WIDTH} x {HEIGHT}",
        "fringes",
        version("fringes"),
        lambda: decode(planes, plan).x.coordinate_px,
        lambda: np.asarray(peer.decode(frames).x).reshape(HEIGHT, WIDTH),
        plain_rms,
        limit_ratio=limit,
        limit_accuracy=accuracy,
    )


@work
def decode_hierarchical() -> list[Result]:
    """1, 8 and 64 fringes against the package ``fringes``, and against streaming the bytes."""
    counts = (1, 8, 64)
    return rows(
        lambda: against_fringes(counts, 45.0, 0.075),
        lambda: against_decoder(counts),
        lambda: against_stream(counts),
    )


@work
def decode_heterodyne() -> list[Result]:
    """59, 64 and 70 fringes against the package ``fringes``."""
    counts = (59, 64, 70)
    return rows(lambda: against_fringes(counts, 400.0, 0.040), lambda: against_decoder(counts))


def against_decoder(counts: tuple[int, ...]) -> Result:
    """Decode with the judgement of the stack, and by a Decoder that has judged before."""
    plan = plan_of(counts)
    planes = list(noisy(np.array(list(encode(plan))), 2.0))
    live = Decoder(plan, (HEIGHT, WIDTH), judge_every=10**9)
    live.decode(planes)
    earlier = decode(planes, plan)
    label = "/".join(map(str, counts))
    return compared(
        f"decode {label} fringes x {STEPS} steps, judged in the call",
        "own Decoder, judged before",
        version("fringeworks"),
        lambda: decode(planes, plan, out=earlier),
        lambda: live.decode(planes),
        limit_ratio=1.0 / 1.4,
        repeats=21,
    )


def against_stream(counts: tuple[int, ...]) -> Result:
    """Decode, and only read the frames and write as much as the results, on two threads."""
    plan = plan_of(counts)
    planes = list(noisy(np.array(list(encode(plan))), 2.0))
    with ThreadPoolExecutor(2) as pool:
        # Memory that is there already, for both.
        live = Decoder(plan, (HEIGHT, WIDTH), noise=CameraNoise(2.0), judge_every=10**9)
        live.decode(planes)
        maps = [np.zeros((HEIGHT, WIDTH), kind) for kind in OUTPUTS]
        found = compared(
            "decode 12 frames by a Decoder against streaming their bytes",
            "copy in, fill out, 2 threads",
            version("numpy"),
            lambda: live.decode(planes),
            streamer(planes, maps, pool),
            limit_ratio=1.0 / 1.8,
            repeats=41,
        )
    results = sum(np.dtype(kind).itemsize for kind in OUTPUTS) * WIDTH * HEIGHT / 2**20
    extra = peak_mb(lambda: decode(planes, plan)) - results
    print(f"    memory beside frames and results: {extra:.1f} MB")
    assert extra <= 16.0
    return replace(found, peak_mb=extra)


FIRST = """
import time, numpy as np, fringeworks as fw
steps = fw.patterns.equal_steps(4)
sets = tuple(fw.patterns.PhaseSteps("x", {width} / v, steps) for v in (59, 64, 70))
plan = fw.PatternPlan({width}, {height}, sets)
frames = list(fw.encode(plan))
started = time.perf_counter()
fw.decode(frames, plan)
print(time.perf_counter() - started)
"""


@work
def decode_first_call() -> list[Result]:
    """The first call after import, in a fresh interpreter."""
    script = FIRST.format(width=WIDTH, height=HEIGHT)
    seconds = []
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        )
        seconds.append(float(done.stdout))
    ours, warm = sorted(seconds)[1], None
    try:
        peer = peer_of((59, 64, 70))
        frames = noisy(peer.encode(), 0.0)
        started = time.perf_counter()
        peer.decode(frames)
        warm = time.perf_counter() - started
    except PeerMissing as error:
        print(f"    without a peer: {error}")
    return [
        Result(
            work="decode, first call after import",
            peer="fringes, compiled before",
            peer_version="" if warm is None else version("fringes"),
            ours_seconds=ours,
            peer_seconds=warm,
            ratio=None if warm is None else warm / ours,
            limit_seconds=0.3,
        )
    ]
