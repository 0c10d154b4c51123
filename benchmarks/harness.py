"""What a benchmark is: two calls in turn on the same arrays, their results checked, as a ratio."""

from __future__ import annotations

import ctypes
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

BAND = 40
"""Rows that a stream works on at a time."""


@dataclass(frozen=True)
class Result:
    """One row of the table."""

    work: str
    peer: str
    peer_version: str
    ours_seconds: float
    peer_seconds: float | None = None
    ratio: float | None = None
    """Time of the peer over ours, medians."""
    spread: tuple[float, float] | None = None
    """Quartiles of the ratios of the runs that followed one another."""
    limit_seconds: float | None = None
    limit_ratio: float | None = None
    peak_mb: float | None = None
    accuracy: float | None = None
    peer_accuracy: float | None = None

    @property
    def reached(self) -> bool:
        """Whether the limits are kept."""
        if self.limit_seconds is not None and self.ours_seconds > self.limit_seconds:
            return False
        return self.limit_ratio is None or self.ratio is None or self.ratio >= self.limit_ratio


@dataclass(frozen=True)
class Growth:
    """How the time of a call grows with the size of its work."""

    work: str
    variable: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]
    limit: float | None
    """Largest slope that is accepted."""

    @property
    def slope(self) -> float:
        """Slope of the logarithms: 1 where twice the work takes twice the time."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])

    @property
    def reached(self) -> bool:
        return self.limit is None or self.slope <= self.limit


Row = Result | Growth
Work = Callable[[], Sequence[Row]]
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


def in_turn(*calls: Callable[[], Any], repeats: int = 5) -> tuple[list[list[float]], list[Any]]:
    """Seconds of each call, run alternately so that all see the same machine, and last results."""
    seconds: list[list[float]] = [[] for _ in calls]
    results: list[Any] = [None] * len(calls)
    for _ in range(repeats):
        for k, call in enumerate(calls):
            started = time.perf_counter()
            results[k] = call()
            seconds[k].append(time.perf_counter() - started)
    return seconds, results


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


def compared(
    work: str,
    peer: str,
    peer_version: str,
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    *,
    accuracy: Callable[[bool], float] | None = None,
    limit_ratio: float | None = None,
    limit_seconds: float | None = None,
    limit_accuracy: float | None = None,
    repeats: int = 5,
) -> Result:
    """Time two calls in turn.

    ``accuracy`` measures the results that the calls have left: ours (True) or the peer's. What
    exceeds ``limit_accuracy`` is refused: a time of something that is not accurate does not count.
    """
    (a, b), _ = in_turn(ours, theirs, repeats=repeats)
    reached = None if accuracy is None else accuracy(True)
    assert limit_accuracy is None or (reached is not None and reached <= limit_accuracy), work
    low, _, high = statistics.quantiles(np.array(b) / np.array(a), n=4)
    return Result(
        work=work,
        peer=peer,
        peer_version=peer_version,
        ours_seconds=statistics.median(a),
        peer_seconds=statistics.median(b),
        ratio=statistics.median(b) / statistics.median(a),
        spread=(float(low), float(high)),
        limit_seconds=limit_seconds,
        limit_ratio=limit_ratio,
        accuracy=reached,
        peer_accuracy=None if accuracy is None else accuracy(False),
    )


def against(
    work: str,
    peer: str,
    peer_version: str,
    ours: Callable[[], Any],
    theirs: Callable[[], Any],
    accuracy: Callable[[Any], float],
    **limits: Any,
) -> Result:
    """Time two calls in turn and judge what both return by the same measure; see ``compared``."""
    last: dict[bool, Any] = {}

    def kept(own: bool, call: Callable[[], Any]) -> Callable[[], None]:
        def run() -> None:
            last[own] = call()

        return run

    found = compared(
        work,
        peer,
        peer_version,
        kept(True, ours),
        kept(False, theirs),
        accuracy=lambda own: accuracy(last[own]),
        **limits,
    )
    return replace(found, peak_mb=peak_mb(ours))


def grown(
    work: str,
    variable: str,
    sizes: Sequence[float],
    made: Callable[[float], Callable[[], Any]],
    *,
    limit: float | None = 1.1,
    seconds: float = 0.6,
) -> Growth:
    """Time a call at several sizes, each for ``seconds`` or three times, and keep the medians."""
    found = []
    for size in sizes:
        call = made(size)
        call()
        times: list[float] = []
        while len(times) < 3 or sum(times) < seconds:
            started = time.perf_counter()
            call()
            times.append(time.perf_counter() - started)
        found.append(statistics.median(times))
    return Growth(work, variable, tuple(sizes), tuple(found), limit)


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
