"""The desk: takes requests, lets one job after the other be done, and keeps what came of them."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, NamedTuple

from fringeworks.files.plan import read_plan
from fringeworks.files.rig import read_rig
from fringeworks.files.setup import read_setup
from fringeworks.service import scanner as tasks
from fringeworks.service.clouds import check_frame
from fringeworks.service.metrics import Metrics
from fringeworks.service.models import (
    OPEN_STATES,
    JobInfo,
    MeasureRequest,
    ResultInfo,
    ScanRequest,
    State,
    Timing,
)
from fringeworks.service.scanner import Places, Scanner
from fringeworks.service.store import UNREADABLE, Store
from fringeworks.serving.worker import Job, Worker
from fringeworks.types import FileProblem, InputError

MOST_ATTEMPTS = 3
"""How often a job is begun whose process ends: one that kills it every time, as for want of memory,
is not begun for ever."""
LONGEST_S = 600.0
"""Longest time of an attempt, s: a scan takes seconds. A driver that hangs is ended then."""
ENDING_S = 8.0
"""Time that a running job has to end when the service ends, s: container engines wait for 10 s."""
POLL_S = 0.05
"""Time between two looks at the frames that were taken, s."""
LOST = "the service ended while the scan was running; the part may have moved, so scan it again"


class QueueFull(InputError):
    """So many jobs wait that no more are taken."""


class Ending(InputError):
    """The service ends, and takes no more jobs."""


class NoSuchJob(InputError):
    """There is no job of this number."""


class Entry(NamedTuple):
    """Something that happened to a job."""

    event: str
    job: JobInfo


class Desk:
    """Jobs, one after the other.

    Parameters
    ----------
    store : Store
    scanner : Scanner
    limit : int
        Largest number of jobs that wait.
    """

    def __init__(self, store: Store, scanner: Scanner, limit: int) -> None:
        self.store, self.scanner, self.limit = store, scanner, limit
        self.rig = read_rig(scanner.rig)
        self.metrics = Metrics()
        self.started_s = time.monotonic()
        self.worker = Worker(niceness=0)
        self.listeners: set[Callable[[Entry], None]] = set()
        self._wake = threading.Condition()
        self._jobs: dict[int, JobInfo] = {job.number: job for job in store.ended()}
        self._queue: deque[int] = deque()
        self._asked: dict[int, float] = {}
        """When jobs were accepted, s of the monotonic clock."""
        self.measured: dict[int, float] = {}
        """When the points of the last jobs were computed, in the same."""
        self._running: int | None = None
        self._cancelled: int | None = None
        """Number of the running job that is to end."""
        self._frames = plan_frames(scanner)
        self._ending = False
        self._take_over()
        self._next = 1 + max(self._jobs, default=0)
        self._thread = threading.Thread(target=self._work, name="desk", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        with suppress(InputError):
            self.worker.start("opening the devices", tasks.warm, self.scanner)
        self._thread.start()

    def _take_over(self) -> None:
        """Go on with the queue that was left: scans that were running are lost, in words."""
        for number, job in self.store.open_jobs():
            if job is None:
                request = ScanRequest.model_validate({})
                job = _new(number, request, state="lost", problem=UNREADABLE)
            elif job.state == "running" and (job.kind == "scan" or job.attempts >= MOST_ATTEMPTS):
                job = job.model_copy(update={"state": "lost", "problem": LOST})
            if job.state == "lost":
                self._keep(job.model_copy(update={"ended": _now()}))
                self.metrics.ended(job.kind, "lost")
                continue
            self._jobs[number] = job.model_copy(update={"state": "waiting"})
            self._asked[number] = time.monotonic()
            self._queue.append(number)

    @property
    def running(self) -> int | None:
        """Number of the job that is being done."""
        return self._running

    @property
    def ending(self) -> bool:
        """Whether no more jobs are taken."""
        return self._ending

    @property
    def waiting(self) -> list[int]:
        """Numbers of the jobs that wait, the next first."""
        with self._wake:
            return list(self._queue)

    @property
    def last(self) -> int | None:
        """Number of the last result."""
        with self._wake:
            return max((n for n, job in self._jobs.items() if job.state == "done"), default=None)

    def jobs(self, state: State | None, most: int) -> list[JobInfo]:
        """Jobs, the newest first."""
        with self._wake:
            known = sorted(self._jobs.items(), reverse=True)
        found = [self.seen(n) for n, job in known if state is None or job.state == state]
        return found[:most]

    def seen(self, number: int) -> JobInfo:
        """A job as it is now.

        Raises
        ------
        NoSuchJob
        """
        with self._wake:
            job = self._jobs.get(number)
            if job is None:
                raise NoSuchJob(f"job {number}: there is none; old ones are deleted")
            now: dict[str, Any] = {"place": None}
            if job.state == "waiting":
                now["place"] = self._queue.index(number) if number in self._queue else 0
            if number == self._running and self.worker.job is not None:
                now["step"] = self.worker.job.steps
            return job.model_copy(update=now)

    def accept(self, request: ScanRequest | MeasureRequest) -> JobInfo:
        """Take a job; it is on the disk when this returns.

        Raises
        ------
        QueueFull, Ending; InputError for what the rig or the folder cannot give; FileProblem where
        the disk is full.
        """
        self._check(request)
        with self._wake:
            if self._ending:
                raise Ending("the service ends; ask again when it is back")
            known = self._known(request)
            if known is not None:
                return self.seen(known)
            if len(self._queue) >= self.limit:
                raise QueueFull(
                    f"queue: expected fewer than {self.limit} jobs that wait, got "
                    f"{len(self._queue)}; ask again later"
                )
            job = _new(self._next, request)
            self.store.put(job)
            self._next += 1
            self._jobs[job.number] = job
            self._asked[job.number] = time.monotonic()
            self._queue.append(job.number)
            self._wake.notify_all()
        self._tell("accepted", job.number)
        return self.seen(job.number)

    def _known(self, request: ScanRequest | MeasureRequest) -> int | None:
        """The job of an earlier request with the same key."""
        if request.key is None:
            return None
        for number, job in reversed(self._jobs.items()):
            if job.key == request.key:
                if job.request != request:
                    raise InputError(f"key: {request.key} is that of another request, {number}")
                return number
        return None

    def _check(self, request: ScanRequest | MeasureRequest) -> None:
        """Refuse what cannot be done, before it waits."""
        check_frame(self.rig, request, request.frame)
        if isinstance(request, ScanRequest):
            tasks.check_taking(self.scanner, request)
        if request.recipe is not None and not self.store.recipe(request.recipe).is_file():
            known = ", ".join(self.store.recipes())
            expected = f"one of {known}" if known else "one in recipes/, which holds none"
            raise InputError(f"recipe: expected {expected}, got {request.recipe}")
        if request.recipe is not None:
            tasks.check_recipe(self.store.recipe(request.recipe))
        if isinstance(request, MeasureRequest) and not self.store.capture(request.scan).is_dir():
            raise InputError(
                f"scan: the frames of {request.scan} are not there; scan with keep_frames"
            )

    def cancel(self, number: int) -> JobInfo:
        """End a job that waits or is being done; one that has ended stays as it is.

        Raises
        ------
        NoSuchJob
        """
        with self._wake:
            job = self.seen(number)
            if job.state == "waiting" and number in self._queue:
                self._queue.remove(number)
            elif number == self._running:
                self._cancelled = number  # the thread that waits for it does the rest
                return job
            else:
                return job
        self._end(job, "cancelled")
        return self.seen(number)

    def close(self) -> None:
        """Take no more jobs, wait a little for the one that is being done, and end."""
        with self._wake:
            self._ending = True
            self._wake.notify_all()
        if self._thread.is_alive():
            self._thread.join(ENDING_S)
        self.worker.close()
        self.store.close()

    def _work(self) -> None:
        """Do one job after the other until the service ends."""
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._ending or self._queue)
                if self._ending:
                    return
                number = self._queue.popleft()
                self._running = number
            try:
                self._do(self._jobs[number])
            except FileProblem as problem:
                # The disk is full: what is known stays in memory, and the queue still has the job.
                self._note(self._jobs[number], "failed", problem=str(problem))
                self._tell("ended", number)
            finally:
                self._running = None

    def _do(self, job: JobInfo) -> None:
        """Do a job, again where its process ends."""
        if self.worker.job is not None:
            self.worker.job.wait(LONGEST_S)  # the devices are being opened
        begun = time.monotonic()
        while True:
            job = self._note(
                job, "running", attempts=job.attempts + 1, steps=self._steps(job.request)
            )
            work = self._begin(job)
            self.store.put(job)  # while the first picture is shown
            self._tell("running", job.number)
            self._follow(job.number, work)
            again = work.died and work.state == "failed" and job.attempts < MOST_ATTEMPTS
            if self._ending or not again:
                break
            self.metrics.restarts += 1
        if self._ending and work.died:
            return  # the queue has it as running, and the next start names it
        if work.state == "done":
            self._done(job, work.result, begun)
        elif work.state == "cancelled":
            self._end(job, "cancelled")
        else:
            self._end(job, "failed", work.problem)

    def _begin(self, job: JobInfo) -> Job:
        wanted = job.request
        keeps = isinstance(wanted, MeasureRequest) or wanted.keep_frames
        source = wanted.scan if isinstance(wanted, MeasureRequest) else job.number
        places = Places(
            self.store.half(job.number),
            self.store.capture(source),
            keeps,
            None if wanted.recipe is None else self.store.recipe(wanted.recipe),
        )
        task = tasks.measure_again if isinstance(wanted, MeasureRequest) else tasks.scan
        return self.worker.start(f"job {job.number}", task, self.scanner, wanted, places)

    def _follow(self, number: int, work: Job) -> None:
        """Wait for work, and tell of its frames."""
        until, told = time.monotonic() + LONGEST_S, 0
        while not work.wait(POLL_S):
            if work.steps != told:
                told = work.steps
                self._tell("step", number)
            if self._cancelled == number:
                self.worker.cancel(work)
            elif time.monotonic() > until:
                self.worker.cancel(work)
                work.end("failed", f"it took longer than {LONGEST_S:g} s and was ended")

    def _steps(self, request: ScanRequest | MeasureRequest) -> int:
        return 0 if isinstance(request, MeasureRequest) else self._frames * request.hdr

    def _done(self, job: JobInfo, said: dict[str, Any], begun: float) -> None:
        times, now = said.pop("timing"), time.monotonic()
        asked = self._asked.get(job.number, begun)
        timing = Timing(
            waiting_s=begun - asked,
            taking_s=times["taking_s"],
            computing_s=times["computing_s"],
            writing_s=now - times["measured"],
            total_s=now - asked,
        )
        result = ResultInfo(
            **said,
            frame=job.request.frame,
            recipe=job.request.recipe,
            timing=timing,
            frames_kept=isinstance(job.request, ScanRequest) and job.request.keep_frames,
        )
        self.measured[job.number] = times["measured"]
        self.measured.pop(job.number - MOST_MEASURED, None)
        self.metrics.result(result)
        self._end(job, "done", result=result)

    def _end(self, job: JobInfo, state: State, problem: str = "", **more: Any) -> None:
        ended = job.model_copy(
            update={"state": state, "problem": problem or None, "ended": _now(), **more}
        )
        self.metrics.ended(job.kind, state)
        self._keep(ended)

    def _keep(self, job: JobInfo) -> None:
        """Tell an ended job, keep it on the disk, and delete old ones.

        Who waits gets the files while they are being synced: a power cut in between leaves the job
        in the queue, and the next start names it.
        """
        with self._wake:
            self._jobs[job.number] = job
            self._asked.pop(job.number, None)
            if self._running == job.number:
                self._running = None
        self._tell("ended", job.number)
        self.store.end(job)
        old = self.store.purge()
        with self._wake:
            for number in old:
                self._jobs.pop(number, None)

    def _note(self, job: JobInfo, state: State, **more: Any) -> JobInfo:
        with self._wake:
            changed = job.model_copy(update={"state": state, **more})
            self._jobs[job.number] = changed
            return changed

    def _tell(self, event: str, number: int) -> None:
        with suppress(NoSuchJob):
            entry = Entry(event, self.seen(number))
            for listener in list(self.listeners):
                listener(entry)


MOST_MEASURED = 100
"""Results whose time of computing is kept, for the latency of their first delivery."""


def plan_frames(scanner: Scanner) -> int:
    """Frames of the plan that is shown; 0 where the projector's memory holds it."""
    if scanner.plan is not None:
        return read_plan(scanner.plan).frames
    return 0 if scanner.setup is None else read_setup(scanner.setup).plan.frames


def _new(
    number: int,
    request: ScanRequest | MeasureRequest,
    state: State = "waiting",
    problem: str | None = None,
) -> JobInfo:
    return JobInfo(
        number=number,
        kind="measure" if isinstance(request, MeasureRequest) else "scan",
        name=request.name,
        key=request.key,
        state=state,
        place=None,
        accepted=_now(),
        ended=None,
        attempts=0,
        step=0,
        steps=0,
        problem=problem,
        request=request,
        result=None,
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def is_open(job: JobInfo) -> bool:
    """Whether a job waits or is being done."""
    return job.state in OPEN_STATES
