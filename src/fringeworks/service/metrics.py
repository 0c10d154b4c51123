"""Counts and times of the service, in the text format of Prometheus."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from fringeworks.service.models import Kind, ResultInfo, State

BUCKETS_S = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""Upper ends of the histograms, s: half decades from the time of a small file to that of a long
scan. 0.03 s is what the delivery of a cloud may take."""
STAGES = ("waiting", "taking", "computing", "writing", "delivering")
"""Stages whose time is measured; ``delivering`` is from the points to the last byte that was sent
to a client that waited."""
PAGE_BYTES = 4096
"""Bytes of a memory page on Linux for x86 and most ARM systems."""
CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


@dataclass
class Histogram:
    """How often a time was below each limit."""

    counts: list[int] = field(default_factory=lambda: [0] * (len(BUCKETS_S) + 1))
    total_s: float = 0.0

    def add(self, seconds: float) -> None:
        """Count a time."""
        place = next((k for k, top in enumerate(BUCKETS_S) if seconds <= top), len(BUCKETS_S))
        self.counts[place] += 1
        self.total_s += seconds


class Metrics:
    """What the service counts."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ended: Counter[tuple[str, str]] = Counter()
        self._refused: Counter[int] = Counter()
        self._stages = {stage: Histogram() for stage in STAGES}
        self._points = 0
        self.restarts = 0
        """How often a process was replaced that ended in the middle of a job."""

    def ended(self, kind: Kind, state: State) -> None:
        """Count an ended job."""
        with self._lock:
            self._ended[kind, state] += 1

    def refused(self, status: int) -> None:
        """Count a request that was refused."""
        with self._lock:
            self._refused[status] += 1

    def result(self, result: ResultInfo) -> None:
        """Count the times and points of a result."""
        times = result.timing.model_dump()
        with self._lock:
            self._points = result.points
            for stage in STAGES[:-1]:
                self._stages[stage].add(times[f"{stage}_s"])

    def delivered(self, seconds: float) -> None:
        """Count how long after its points a cloud was sent to a client that waited for it."""
        with self._lock:
            self._stages["delivering"].add(seconds)

    def text(self, *, waiting: int, limit: int, busy: bool, uptime_s: float, version: str) -> str:
        """All of it as Prometheus reads it."""
        with self._lock:
            lines = [
                *_gauge("build_info", "The version that runs.", 1, f'version="{version}"'),
                *_gauge("uptime_seconds", "Time since the start.", round(uptime_s, 3)),
                *_gauge("busy", "1 while a job is being done.", int(busy)),
                *_gauge("queue_length", "Jobs that wait.", waiting),
                *_gauge("queue_limit", "Most jobs that may wait.", limit),
                *_gauge("last_points", "Points of the last result.", self._points),
                *_gauge("resident_memory_bytes", "Memory of the server.", memory_bytes()),
                *_counter(
                    "jobs_total",
                    "Jobs that ended.",
                    [(f'kind="{k}",state="{s}"', n) for (k, s), n in sorted(self._ended.items())],
                ),
                *_counter(
                    "refused_total",
                    "Requests that were refused.",
                    [(f'status="{s}"', n) for s, n in sorted(self._refused.items())],
                ),
                *_counter("worker_restarts_total", "Replaced processes.", [("", self.restarts)]),
                *self._histograms(),
            ]
        return "\n".join(lines) + "\n"

    def _histograms(self) -> Iterable[str]:
        name = "fringeworks_stage_seconds"
        yield f"# HELP {name} Time of each stage of a scan."
        yield f"# TYPE {name} histogram"
        for stage, histogram in self._stages.items():
            below = 0
            for top, count in zip((*BUCKETS_S, "+Inf"), histogram.counts, strict=True):
                below += count
                yield f'{name}_bucket{{stage="{stage}",le="{top}"}} {below}'
            yield f'{name}_sum{{stage="{stage}"}} {histogram.total_s:.6f}'
            yield f'{name}_count{{stage="{stage}"}} {below}'


def _gauge(name: str, told: str, value: float, labels: str = "") -> list[str]:
    return _family(name, told, "gauge", [(labels, value)])


def _counter(name: str, told: str, values: list[tuple[str, int]]) -> list[str]:
    return _family(name, told, "counter", values)


def _family(name: str, told: str, kind: str, values: Iterable[tuple[str, float]]) -> list[str]:
    whole = f"fringeworks_{name}"
    shown = [
        f"{whole}{{{labels}}} {value}" if labels else f"{whole} {value}" for labels, value in values
    ]
    return [f"# HELP {whole} {told}", f"# TYPE {whole} {kind}", *shown]


def memory_bytes() -> int:
    """Memory that this process holds, bytes; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES
    except (OSError, ValueError, IndexError):
        return 0
