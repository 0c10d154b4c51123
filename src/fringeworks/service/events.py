"""What happens to jobs, for those who wait for it: requests that wait, and web sockets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from fringeworks.service.desk import Desk, Entry
from fringeworks.service.models import Event, as_json

MOST_EVENTS = 64
"""Events that are kept for a listener who reads too slowly; then the oldest are dropped, and the
next one says how many."""
MOST_SOCKETS = 32
"""Web sockets that are served at a time."""
SEND_S = 10.0
"""Longest time to hand an event to a client, s; then its socket is closed."""
TRY_LATER = 1013
"""Code of a web socket that is closed because there are too many (RFC 6455, its registry)."""


@dataclass(eq=False)
class Listener:
    """Events for one who waits."""

    events: asyncio.Queue[Entry] = field(default_factory=lambda: asyncio.Queue(MOST_EVENTS))
    missed: int = 0

    def put(self, entry: Entry) -> None:
        """Add an event; the oldest is dropped where there are too many."""
        if self.events.full():
            self.events.get_nowait()
            self.missed += 1
        self.events.put_nowait(entry)


class Hub:
    """Hands the events of a desk, which come from threads, to the server's loop."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self._listeners: set[Listener] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self.sockets = 0

    def start(self) -> None:
        """Begin to listen, in the server's loop."""
        self._loop = asyncio.get_running_loop()
        self.desk.listeners.add(self._heard)

    def _heard(self, entry: Entry) -> None:
        with suppress(RuntimeError):  # the loop has ended
            assert self._loop is not None
            self._loop.call_soon_threadsafe(self._hand_on, entry)

    def _hand_on(self, entry: Entry) -> None:
        for listener in self._listeners:
            listener.put(entry)

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[Listener]:
        """A listener for as long as the block runs."""
        listener = Listener()
        self._listeners.add(listener)
        try:
            yield listener
        finally:
            self._listeners.discard(listener)

    async def serve(self, socket: WebSocket) -> None:
        """Send events to a web socket until one of the two ends it."""
        await socket.accept()
        if self.sockets >= MOST_SOCKETS:
            await socket.close(TRY_LATER, f"at most {MOST_SOCKETS} web sockets are served")
            return
        self.sockets += 1
        try:
            async with self.listening() as listener:
                gone = asyncio.ensure_future(_gone(socket))
                try:
                    await self._send_all(socket, listener, gone)
                finally:
                    gone.cancel()
        finally:
            self.sockets -= 1

    async def _send_all(
        self, socket: WebSocket, listener: Listener, gone: asyncio.Future[None]
    ) -> None:
        """Send events until the client is gone, or takes too long."""
        await _send(socket, Event(event="hello", job=None, missed=0))
        while not gone.done():
            waiting: asyncio.Future[Entry] = asyncio.ensure_future(listener.events.get())
            both: set[asyncio.Future[Any]] = {waiting, gone}
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            if not waiting.done():
                waiting.cancel()
                return
            entry = waiting.result()
            missed, listener.missed = listener.missed, 0
            event = Event(event=entry.event, job=entry.job, missed=missed)  # type: ignore[arg-type]
            try:
                async with asyncio.timeout(SEND_S):
                    await _send(socket, event)
            except (TimeoutError, WebSocketDisconnect, RuntimeError):
                return


async def _send(socket: WebSocket, event: Event) -> None:
    await socket.send_json(as_json(event))


async def _gone(socket: WebSocket) -> None:
    """End when the client does; what it sends is passed over."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
