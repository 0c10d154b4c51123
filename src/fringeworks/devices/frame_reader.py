"""A thread that reads a video source all the time, so that no frame that it returns is stale."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import CameraLimits, Closing
from fringeworks.types import DeviceProblem

T = TypeVar("T")

KEPT_FRAMES = 4
"""Frames that wait to be grabbed; when another arrives, the oldest is lost. Frames of colour are
large, and two frames in a row are all that a comparison needs."""
FAILED_READS = 5
"""Reads in a row that fail before the camera counts as gone. Single reads fail where a packet of a
compressed frame was lost."""
RETRY_S = 0.02
"""Pause after a read that failed, s: below the period of usual cameras."""
ANSWER_S = 15.0
"""Longest wait for the driver, s. Video4Linux gives up waiting for a frame after 10 s."""
RATED_FRAMES = 16
"""Arrival times that the frame rate is computed from: half a second at 30 Hz."""
FULL_PAUSE_S = 0.002
"""Pause while a file waits for its frames to be grabbed, s."""
CLOSED = "expected an open camera, got a closed one"
"""What is said after ``close``."""


class Read(NamedTuple):
    """One frame as the source gave it."""

    image: NDArray[Any] | None
    """(h, w) or (h, w, channels); None where the frame could not be decoded."""
    host_s: float
    """Time at which it arrived, on the clock of ``time.monotonic``, s."""
    number: int
    """Number of the frame, counted from 0 when the source was opened."""


class FrameReader:
    """Reads a video source in a thread of its own, and keeps the last frames.

    Parameters
    ----------
    open_source : callable
        Returns an open ``cv2.VideoCapture``, or something with its methods ``grab``, ``retrieve``
        and ``release``. It is called in the thread, and the source is used in the thread only:
        ``VideoCapture`` is not safe in several threads.
    name : str
        Name of the camera in messages.
    live : bool
        True for a camera: frames that nobody grabs are lost. False for a file: reading waits until
        there is space.

    Raises
    ------
    Whatever ``open_source`` raises; DeviceProblem where it does not return in time.

    Notes
    -----
    Drivers queue up to three frames. A program that reads a frame only when it needs one gets old
    frames. Because this thread always reads, no kept frame is older than one frame period, and
    ``discard`` leaves no old frame.
    """

    def __init__(self, open_source: Callable[[], Any], name: str, *, live: bool = True) -> None:
        self._name = name
        self._live = live
        self._jobs: queue.SimpleQueue[tuple[Future[Any], Callable[[Any], Any]]] = (
            queue.SimpleQueue()
        )
        self._changed = threading.Condition()
        self._frames: deque[Read] = deque(maxlen=KEPT_FRAMES)
        self._arrivals_s: deque[float] = deque(maxlen=RATED_FRAMES)
        self._count = 0
        self._discarded_s = -np.inf
        self._stop = threading.Event()
        self._problem: str | None = None
        opened: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(open_source, opened), name=f"reader of {name}", daemon=True
        )
        self._thread.start()
        try:
            opened.result(ANSWER_S)
        except FutureTimeout:
            self._stop.set()
            raise DeviceProblem(
                f"{name}: expected the driver to open it within {ANSWER_S:g} s, got no answer"
            ) from None
        except BaseException:
            self._stop.set()
            self._thread.join(ANSWER_S)
            raise

    @property
    def period_s(self) -> float | None:
        """Median time between the last frames, s; None before three have arrived."""
        with self._changed:
            gaps = np.diff(self._arrivals_s)
        return float(np.median(gaps)) if gaps.size > 1 else None

    def run(self, job: Callable[[Any], T]) -> T:
        """Call a function with the source, between two frames, and return its result.

        Raises
        ------
        DeviceProblem where the camera is gone; whatever the function raises.
        """
        answer: Future[T] = Future()
        with self._changed:
            self._check_running()
            self._jobs.put((answer, job))
        try:
            return answer.result(ANSWER_S)
        except FutureTimeout:
            raise DeviceProblem(
                f"{self._name}: expected an answer of the driver within {ANSWER_S:g} s, got none"
            ) from None

    def take(self, timeout_s: float) -> Read:
        """Return the oldest kept frame, or wait for one.

        Raises
        ------
        DeviceProblem where none arrives in time, the camera is gone, or the reader was closed.
        """
        with self._changed:
            if self._stop.is_set():
                self._check_running()
            self._changed.wait_for(lambda: self._frames or self._problem is not None, timeout_s)
            if self._frames:
                return self._frames.popleft()
            self._check_running()
        raise DeviceProblem(f"{self._name}: expected a frame, got none within {timeout_s:g} s")

    def first(self, timeout_s: float) -> Read:
        """Return the oldest kept frame without taking it, or wait for one; see ``take``."""
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._problem is not None, timeout_s)
            if self._frames:
                return self._frames[0]
            self._check_running()
        raise DeviceProblem(f"{self._name}: expected a frame, got none within {timeout_s:g} s")

    def waiting(self) -> int:
        """Number of kept frames."""
        with self._changed:
            return len(self._frames)

    def discard(self) -> None:
        """Throw away all frames that have arrived, also one that is just being decoded."""
        with self._changed:
            self._frames.clear()
            self._discarded_s = time.monotonic()

    def close(self) -> None:
        """End the thread and release the source; again without effect.

        Raises
        ------
        DeviceProblem where the driver does not return from a read.
        """
        self._stop.set()
        self._thread.join(ANSWER_S)
        if self._thread.is_alive():
            raise DeviceProblem(
                f"{self._name}: expected the driver to return from a read within {ANSWER_S:g} s, "
                "got no answer: unplug the camera"
            )

    def _check_running(self) -> None:
        if self._stop.is_set():
            raise DeviceProblem(f"{self._name}: {CLOSED}")
        if self._problem is not None:
            raise DeviceProblem(f"{self._name}: {self._problem}")

    def _run(self, open_source: Callable[[], Any], opened: Future[None]) -> None:
        """Body of the thread."""
        try:
            source = open_source()
        except BaseException as error:
            opened.set_exception(error)
            return
        opened.set_result(None)
        problem = CLOSED
        try:
            problem = self._read_all(source) or CLOSED
        except DeviceProblem as error:
            problem = str(error)
        except Exception as error:  # OpenCV and drivers raise anything
            problem = f"expected a frame, got an error of the driver: {error}"
        finally:
            try:
                source.release()
            finally:
                self._end(problem)

    def _read_all(self, source: Any) -> str | None:
        """Read until told to stop; why the source ended by itself, if it did."""
        failed = 0
        while not self._stop.is_set():
            self._do_jobs(source)
            if not self._live and self.waiting() == KEPT_FRAMES:
                self._stop.wait(FULL_PAUSE_S)
                continue
            if not source.grab():
                failed += 1
                if not self._live:
                    return "expected a frame, got the end of the file"
                if failed == FAILED_READS:
                    return (
                        "expected a frame, got none from the driver: the camera was unplugged or "
                        "has stopped; plug it in and start again"
                    )
                self._stop.wait(RETRY_S)
                continue
            failed = 0
            arrived_s = time.monotonic()
            decoded, image = source.retrieve()
            self._keep(image if decoded and image is not None else None, arrived_s)
        return None

    def _do_jobs(self, source: Any) -> None:
        while not self._jobs.empty():
            answer, job = self._jobs.get()
            try:
                answer.set_result(job(source))
            except BaseException as error:
                answer.set_exception(error)

    def _keep(self, image: NDArray[Any] | None, arrived_s: float) -> None:
        with self._changed:
            if arrived_s >= self._discarded_s:
                self._frames.append(Read(image, arrived_s, self._count))
            self._arrivals_s.append(arrived_s)
            self._count += 1
            self._changed.notify_all()

    def _end(self, problem: str) -> None:
        """Tell everybody who waits that no frame and no answer will come."""
        with self._changed:
            self._problem = problem
            while not self._jobs.empty():
                answer, _ = self._jobs.get()
                answer.set_exception(DeviceProblem(f"{self._name}: {problem}"))
            self._changed.notify_all()


class FromReader(Closing):
    """Mix-in of cameras whose frames a reader takes, in ``_reader``."""

    _reader: FrameReader
    _name: str
    _size_px: tuple[int, int]
    _colours = False

    @property
    def name(self) -> str:
        """The kind and which one, or the address; without a password."""
        return self._name

    def limits(self) -> CameraLimits:
        """Frame size and rate, where no limits of exposure and gain are known."""
        return CameraLimits(
            *self._size_px, pixel_formats=(self._format,), frame_s=self._reader.period_s
        )

    @property
    def _format(self) -> str:
        """Pixel format of the frames that are delivered."""
        return "RGB8" if self._colours else "Mono8"

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        self._colours = wanted

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""
        return self._reader.waiting()

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        self._reader.discard()

    def close(self) -> None:
        """End the thread and release the camera; again without effect."""
        self._reader.close()
