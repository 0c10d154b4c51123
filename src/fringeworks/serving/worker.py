"""Work in a process of its own, so that the page answers meanwhile, and survives its end."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, Literal

from fringeworks.types import InputError

NICENESS = 10
"""Niceness of a worker's process, so that the page stays responsive."""
ENDED_S = 5.0
"""Longest wait for a process to end, s."""
STOP = "stop"
"""Sent to work that goes on until it is told to stop."""

State = Literal["waiting", "running", "done", "failed", "cancelled"]


@dataclass
class Job:
    """A piece of work: how far it is, and what came of it."""

    name: str
    """What is done, in words."""
    total: int = 0
    """Number of steps; 0 where it is not known."""
    steps: int = 0
    """Number of steps that have begun."""
    label: str = ""
    """The present step."""
    state: State = "running"
    result: Any = None
    """What the function returned."""
    problem: str = ""
    """Why it failed: what was found, a line each, then one sentence."""
    started_s: float = field(default_factory=time.monotonic)
    died: bool = False
    """Whether it failed because its process ended."""
    stopping: bool = False
    """Whether it was asked to stop."""
    latest: dict[str, Any] = field(default_factory=dict)
    """The last value that the work has sent, by kind."""
    _then: list[Callable[[], None]] = field(default_factory=list, repr=False)
    """Called once when the work has ended well."""
    _lock: Any = field(default_factory=threading.RLock, repr=False)
    _ended: threading.Event = field(default_factory=threading.Event, repr=False)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the work has ended in any way; whether it has."""
        return self._ended.wait(timeout_s)

    def end(self, state: State, problem: str = "") -> None:
        """End the work without a result."""
        self.problem, self.state = problem, state
        self._ended.set()

    def when_done(self, action: Callable[[], None]) -> None:
        """Call something when the work has ended well, at once where it has already."""
        with self._lock:
            if self.state != "done":
                self._then.append(action)
                return
        action()

    def finish(self, result: Any) -> None:
        """End the work well, after everything that waits for that."""
        self.result = result
        while True:
            with self._lock:
                if not self._then:
                    self.state = "done"
                    self._ended.set()
                    return
                action = self._then.pop(0)
            action()

    @property
    def open(self) -> bool:
        """Whether it waits or is being done."""
        return self.state in ("waiting", "running")

    @property
    def share(self) -> float:
        """Share of the steps that have begun, 0…1."""
        return min(self.steps / self.total, 1.0) if self.total else 0.0

    @property
    def left_s(self) -> float | None:
        """Time left, s; None where it is not known."""
        if not self.total or self.steps < 2:
            return None
        passed_s = time.monotonic() - self.started_s
        return passed_s * (self.total - self.steps + 1) / (self.steps - 1)


class Link:
    """Connection of work to the page: for its progress, and the request to stop."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def progress(self, label: str) -> None:
        """Tell that a step begins."""
        self._pipe.send(("progress", label))

    def show(self, kind: str, value: Any) -> None:
        """Send a value that takes the place of the one before."""
        self._pipe.send(("latest", (kind, value)))

    def stopped(self) -> bool:
        """Whether the page has asked the work to stop."""
        return self._pipe.poll() and self._pipe.recv() == STOP


Task = Callable[..., Any]
"""A function of a module, called with a ``Link`` and arguments. They and the result are pickled."""


class Worker:
    """A process that does one piece of work after the other.

    It is started for the first work, and again after it has ended in any way.

    Parameters
    ----------
    niceness : int
        Of its process.
    """

    def __init__(self, niceness: int = NICENESS) -> None:
        self._niceness = niceness
        self._context = multiprocessing.get_context("spawn")
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lock = threading.RLock()
        self._waiting: deque[tuple[Job, Task, tuple[Any, ...]]] = deque()
        self.job: Job | None = None
        """The present or last piece of work."""

    @property
    def busy(self) -> bool:
        """Whether work is being done."""
        return self.job is not None and self.job.state == "running"

    def start(self, name: str, task: Task, *given: Any, total: int = 0, wait: bool = False) -> Job:
        """Begin a piece of work, or let it wait until the work before it has ended.

        Raises
        ------
        InputError while other work is being done that it does not wait for.
        """
        with self._lock:
            if self.busy and not wait:
                assert self.job is not None
                raise InputError(f"busy with {self.job.name!r}: wait, or cancel it")
            job = Job(name, total, state="waiting")
            self._waiting.append((job, task, given))
            if not self.busy:
                self._begin()
            return job

    def _begin(self) -> None:
        """Begin the work that has waited longest."""
        self.job, task, given = self._waiting.popleft()
        self.job.state, self.job.started_s = "running", time.monotonic()
        try:
            self.warm().send((task, given))
        except OSError:
            # The process has ended since; a new one takes its place.
            self._end()
            self.warm().send((task, given))
        threading.Thread(target=self._follow, args=(self.job, self._pipe), daemon=True).start()

    def warm(self) -> Connection:
        """Start the process, where there is none; it loads the library meanwhile."""
        if self._process is None or not self._process.is_alive():
            self._pipe, far = self._context.Pipe()
            self._process = self._context.Process(
                target=_serve, args=(far, self._niceness), daemon=True
            )
            self._process.start()
            far.close()
        assert self._pipe is not None
        return self._pipe

    def stop(self) -> None:
        """Ask endless work to stop; only the first call sends the request."""
        with self._lock:
            if self.busy and self._pipe is not None and self.job is not None:
                if not self.job.stopping:
                    self._pipe.send(STOP)
                self.job.stopping = True

    def cancel(self, job: Job | None = None) -> None:
        """End work at once, the present one by default. What it has written so far stays."""
        with self._lock:
            job = job or self.job
            if job is None or not job.open:
                return
            running = job.state == "running"
            job.end("cancelled")
            self._waiting = deque(w for w in self._waiting if w[0] is not job)
            if running:
                self._end()
                self._go_on()

    def close(self) -> None:
        """End the process, and forget the work that waits."""
        with self._lock:
            self._waiting.clear()
            self._end()

    def _go_on(self) -> None:
        with self._lock:
            if self._waiting and not self.busy:
                self._begin()

    @property
    def process_id(self) -> int | None:
        """Of the process; None where there is none."""
        return None if self._process is None else self._process.pid

    def _end(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.join(ENDED_S)
            if self._process.is_alive():
                self._process.kill()
        self._process = None

    def _follow(self, job: Job, pipe: Connection) -> None:
        """Keep a job's state true until it ends."""
        try:
            while job.state == "running":
                kind, value = pipe.recv()
                if kind == "progress":
                    job.label, job.steps = value, job.steps + 1
                elif kind == "latest":
                    job.latest[value[0]] = value[1]
                elif kind == "done":
                    job.finish(value)
                else:
                    job.end("failed", value)
        except (EOFError, OSError):
            if job.state == "running":
                job.died = True
                job.end(
                    "failed", f"{job.name}: expected a result, but the process ended; start again"
                )
        self._go_on()


def _serve(pipe: Connection, niceness: int) -> None:
    """Do the work that comes, in the worker's process."""
    if hasattr(os, "nice"):
        os.nice(niceness)
    link = Link(pipe)
    while True:
        try:
            task, given = _next(pipe)
            pipe.send(_answer(link, task, given))
        except (EOFError, OSError, KeyboardInterrupt):
            return


def _answer(link: Link, task: Task, given: tuple[Any, ...]) -> tuple[str, Any]:
    """What a task returns, or why it failed."""
    try:
        result = task(link, *given)
        # Pickled here, so that a failure becomes a message.
        ForkingPickler.dumps(result)
    except InputError as problem:
        return "failed", "\n".join(problem.lines)
    except MemoryError:
        return "failed", "expected enough memory, got too little: use smaller frames"
    except Exception as problem:
        return "failed", f"internal error, please report it: {problem!r}"
    return "done", result


def _next(pipe: Connection) -> tuple[Task, tuple[Any, ...]]:
    """The next work; a late word to stop is passed over."""
    while (message := pipe.recv()) == STOP:
        pass
    return message  # type: ignore[no-any-return]
