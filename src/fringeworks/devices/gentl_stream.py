"""The frames of a GenTL camera: a thread that takes them as they arrive, and keeps the last."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from fringeworks.devices.gentl_system import gentl, said
from fringeworks.devices.protocols import Grab
from fringeworks.types import DeviceProblem

BUFFERS = 8
"""Frames that the producer can fill before they are taken: half a second at usual rates."""
KEPT_FRAMES = 8
"""Frames that wait to be grabbed; when another arrives, the oldest is lost. As many as the buffers,
like the camera of Aravis."""
POLL_S = 0.001
"""Pause between two questions for a new frame, s. The library holds Python's lock while it waits,
so it may not wait itself; 1 ms is the error of the arrival time, far below an exposure."""
END_S = 5.0
"""Longest wait for the thread to end, s: beyond the longest call of a producer."""


class GentlStream:
    """Frames of a device, from ``start`` of the acquisition engine to ``close``.

    Parameters
    ----------
    device : an open device of ``genicam.gentl``
    payload : int
        Bytes of a frame.
    grabbed : callable
        Makes a ``Grab`` of a buffer and the time of its arrival.
    """

    def __init__(self, device: Any, payload: int, grabbed: Callable[[Any, float], Grab]) -> None:
        self._module, _ = gentl()
        self._grabbed = grabbed
        self._changed = threading.Condition()
        self._frames: deque[Grab] = deque(maxlen=KEPT_FRAMES)
        self._problem: str | None = None
        self._stopping = threading.Event()
        self._buffers: list[Any] = []
        self._thread = threading.Thread(target=self._run, name="frames of GenTL", daemon=True)
        self._stream = device.create_data_stream()
        self._stream.open(device.data_stream_ids[0])
        try:
            self._begin(payload)
        except BaseException:
            self.close()
            raise

    def _begin(self, payload: int) -> None:
        new_buffer = self._module.EVENT_TYPE_LIST.EVENT_NEW_BUFFER
        self._events = self._module.EventManagerNewBuffer(self._stream.register_event(new_buffer))
        if self._stream.defines_payload_size():
            payload = self._stream.payload_size
        for n in range(self._count()):
            token = self._module.BufferToken(bytes(payload), n)
            self._buffers.append(self._stream.announce_buffer(token))
            self._stream.queue_buffer(self._buffers[-1])
        self._stream.start_acquisition(self._module.ACQ_START_FLAGS_LIST.ACQ_START_FLAGS_DEFAULT)
        self._thread.start()

    def _count(self) -> int:
        try:
            return max(BUFFERS, int(self._stream.buffer_announce_min))
        except self._module.GenericException:
            return BUFFERS

    def _run(self) -> None:
        """Body of the thread."""
        while not self._stopping.is_set():
            try:
                self._events.update_event_data(0)
                arrived_s = time.monotonic()
                buffer = self._events.buffer
                grab = self._grabbed(buffer, arrived_s)
                self._stream.queue_buffer(buffer)
            except self._module.TimeoutException:
                self._stopping.wait(POLL_S)
                continue
            except Exception as error:  # producers raise anything
                with self._changed:
                    self._problem = said(error)
                    self._changed.notify_all()
                return
            with self._changed:
                self._frames.append(grab)
                self._changed.notify_all()

    def take(self, timeout_s: float) -> Grab | None:
        """Return the oldest frame, or wait for one; None where none arrives in time.

        Raises
        ------
        DeviceProblem where the producer has given up.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._problem is not None, timeout_s)
            if self._frames:
                return self._frames.popleft()
            if self._problem is not None:
                raise DeviceProblem(self._problem)
        return None

    def waiting(self) -> int:
        """Number of frames that were not taken yet."""
        with self._changed:
            return len(self._frames)

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        time.sleep(2 * POLL_S)  # a frame of the last millisecond is still in the producer
        with self._changed:
            self._frames.clear()

    def close(self) -> None:
        """Stop, and give everything back, also where the camera is gone."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(END_S)
        stop = self._module.ACQ_STOP_FLAGS_LIST.ACQ_STOP_FLAGS_KILL
        everything = self._module.ACQ_QUEUE_TYPE_LIST.ACQ_QUEUE_ALL_DISCARD
        self._given_back(self._stream.stop_acquisition, stop)
        self._given_back(self._stream.flush_buffer_queue, everything)
        for buffer in self._buffers:
            self._given_back(self._stream.revoke_buffer, buffer)
        self._given_back(self._stream.close)
        self._buffers = []

    def _given_back(self, step: Callable[..., Any], *words: Any) -> None:
        """One step of the end: a camera that is gone refuses it, and the next must follow."""
        with suppress(self._module.GenericException):
            step(*words)
