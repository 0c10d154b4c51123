"""What a benchmark is: two calls in turn on the same arrays, their results checked, as a ratio."""

from __future__ import annotations

import ctypes
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

BAND = 40
"""Rows that a stream works on at a time."""


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


class PeerMissing(Exception):
    """A peer, or a library of the system that it needs, is not installed."""


def peer_module(name: str) -> Any:
    """The module of a peer.

    Raises
    ------
    PeerMissing with the reason, where it cannot be imported.
    """
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        raise PeerMissing(f"{name}: {error}") from error


def rows(*calls: Callable[[], Result]) -> list[Result]:
    """The results of those calls whose peers are there; the reason is printed for others."""
    found = []
    for call in calls:
        try:
            found.append(call())
        except PeerMissing as error:
            print(f"    skipped: {error}")
    return found


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


def against(
    work: str,
    peer: str,
    peer_version: str,
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    accuracy: Callable[[Any], float],
    *,
    limit_ratio: float | None = None,
    limit_seconds: float | None = None,
    limit_accuracy: float | None = None,
    repeats: int = 5,
) -> Result:
    """Time two calls in turn and judge both results by the same measure.

    ``limit_accuracy`` is asserted: a time of something that is not accurate does not count.
    """
    (a, b), (found, expected) = in_turn(ours, theirs, repeats=repeats)
    reached = accuracy(found)
    assert limit_accuracy is None or reached <= limit_accuracy, (work, reached)
    return Result(
        work=work,
        peer=peer,
        peer_version=peer_version,
        ours_seconds=a,
        peer_seconds=b,
        ratio=b / a,
        limit_seconds=limit_seconds,
        limit_ratio=limit_ratio,
        peak_mb=peak_mb(ours),
        accuracy=reached,
        peer_accuracy=accuracy(expected),
    )


def streamer(
    inputs: Sequence[Any], outputs: Sequence[Any], pool: ThreadPoolExecutor
) -> Callable[[], Any]:
    """Read the inputs and write over the outputs, in bands of rows, as two threads of ``pool``."""
    rows = len(inputs[0])

    def half(start: int) -> None:
        # One line per kind of input stays in the first caches.
        lines = {(a.dtype, a.shape[1:]): np.empty((BAND, *a.shape[1:]), a.dtype) for a in inputs}
        for top in range(start, start + rows // 2, BAND):
            for plane in inputs:
                np.copyto(lines[plane.dtype, plane.shape[1:]], plane[top : top + BAND])
            for result in outputs:
                result[top : top + BAND] = 1

    return lambda: list(pool.map(half, (0, rows // 2)))
