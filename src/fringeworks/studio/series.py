"""A series of scans, with a pause before each: it goes on whatever page is open."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fringeworks.serving.worker import Job
from fringeworks.types import InputError

ROUND_S = 0.05
"""Interval at which the scan that runs is polled, s."""


@dataclass
class Series:
    """Scans that are taken one after the other."""

    names: Sequence[str]
    """Of the captures."""
    pause_s: float
    """Before each scan: to turn the object, s."""
    begin: Callable[[str], Job]
    """Begins the scan of a name."""
    taken: list[str] = field(default_factory=list)
    """Names of the scans that were taken."""
    next_s: float = 0.0
    """When the next scan begins, on the monotonic clock."""
    problem: str = ""
    """Why it ended early; empty where it did not."""
    running: bool = True

    def __post_init__(self) -> None:
        self._stopped = threading.Event()

    @property
    def waiting_s(self) -> float:
        """Time until the next scan begins, s."""
        return max(0.0, self.next_s - time.monotonic())

    @property
    def left(self) -> int:
        """Number of scans that are not taken yet."""
        return len(self.names) - len(self.taken)

    def start(self) -> None:
        """Begin, in a thread of its own."""
        threading.Thread(target=self._run, daemon=True).start()

    def stop(self) -> None:
        """Take no further scan."""
        self._stopped.set()

    def _run(self) -> None:
        try:
            for name in self.names:
                self.next_s = time.monotonic() + self.pause_s
                if self._stopped.wait(self.pause_s):
                    return
                job = self.begin(name)
                while job.open:
                    time.sleep(ROUND_S)
                if job.state != "done":
                    self.problem = job.problem or "The scan was cancelled."
                    return
                self.taken.append(name)
        except InputError as problem:
            self.problem = "\n".join(problem.lines)
        finally:
            self.running = False
