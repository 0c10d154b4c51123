"""The studio's side of a phone that is a camera: its page, its web socket, and those who use it."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import secrets
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import resources
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from typing import Any

from fastapi import FastAPI, WebSocket
from fastapi.responses import Response
from starlette.websockets import WebSocketDisconnect

from fringeworks.devices.phone_camera import OPEN_PAGE, RENDEZVOUS, TAKE_S

SILENT_S = 0.8
"""Time without a message after which a phone counts as gone, s, so that this is said within a
second. Its page sends one every 0.2 s."""
HEAD_BYTES = 12
"""Number of the order, of the part and of the parts before each part of a picture: 4 bytes each."""
MOST_BYTES = 2**26
"""Largest picture, bytes: JPEG of 100 megapixels has 50 million."""
MOST_LETTERS = 120
"""Letters of a phone's name, and of a problem, that are kept."""
ENDED = 4000
"""Code of a web socket that is closed for good, with the reason in words (RFC 6455: free for own
use). The page does not call again."""
GONE = (
    "expected a phone that answers, got none: its screen is locked, its page was closed, or the "
    f"network is down; unlock it, {OPEN_PAGE} and resume"
)
"""What is said of a phone that sends nothing."""


class PhoneGone(Exception):
    """Nobody answers; the message says what to do."""


@dataclass
class _Order:
    """What a phone was asked for, and what it has answered so far."""

    done: threading.Event = field(default_factory=threading.Event)
    told: dict[str, Any] = field(default_factory=dict)
    parts: dict[int, bytes] = field(default_factory=dict)
    size: int = 0


class PhoneHub:
    """Brings one phone and the programs that use it together.

    Parameters
    ----------
    folder : Path
        The studio's folder, in which programs find the way.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / RENDEZVOUS
        self._numbers = itertools.count(1)
        self._orders: dict[int, _Order] = {}
        self._socket: WebSocket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listener: Listener | None = None
        self._heard_s = 0.0
        self._hello: dict[str, Any] = {}

    async def join(self, socket: WebSocket) -> None:
        """Talk to a phone until it leaves; the newest phone is the camera."""
        await socket.accept()
        before, self._socket, self._loop = self._socket, socket, asyncio.get_running_loop()
        self._hello = {}
        if before is not None:
            with suppress(RuntimeError):
                await before.close(ENDED, "Another phone is the camera now.")
        try:
            self._listen()
        except OSError:
            self._socket = None
            await socket.close(ENDED, "The studio cannot write to its folder.")
            return
        try:
            while self._socket is socket:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    break
                self._heard_s = time.monotonic()
                if message.get("bytes") is not None:
                    self._part(message["bytes"])
                else:
                    self._word(message.get("text") or "")
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            if self._socket is socket:
                self._socket = None

    def _word(self, text: str) -> None:
        """A message of the phone: about itself, or the answer to an order."""
        try:
            told = json.loads(text)
        except ValueError:
            return
        if not isinstance(told, dict):
            return
        if "hello" in told and isinstance(told["hello"], dict):
            self._hello = told["hello"]
        order = self._orders.get(told.get("id", 0)) if isinstance(told.get("id"), int) else None
        if order is not None:
            order.told = told
            order.done.set()

    def _part(self, content: bytes) -> None:
        """A part of a picture."""
        number, part, parts = (int.from_bytes(content[k : k + 4], "big") for k in (0, 4, 8))
        order = self._orders.get(number)
        if order is None or order.size + len(content) > MOST_BYTES:
            return
        order.parts[part] = content[HEAD_BYTES:]
        order.size += len(content)
        if len(order.parts) == parts:
            order.done.set()

    def ask(self, order: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return a phone's answer to an order, and the picture that it took.

        Raises
        ------
        PhoneGone where there is none, or it falls silent.
        """
        number, kept = next(self._numbers), _Order()
        self._orders[number] = kept
        end_s = time.monotonic() + min(float(order.get("timeout_s", TAKE_S)), TAKE_S)
        try:
            self._send({**order, "id": number})
            while not kept.done.wait(SILENT_S / 8):
                self._check()
                if time.monotonic() > end_s:
                    raise PhoneGone("expected a picture, got none in time; look at the phone")
        finally:
            del self._orders[number]
        if "problem" in kept.told:
            raise PhoneGone(str(kept.told["problem"])[:MOST_LETTERS])
        return kept.told, b"".join(kept.parts[k] for k in sorted(kept.parts))

    def state(self) -> dict[str, Any]:
        """What a phone has said about itself.

        Raises
        ------
        PhoneGone where there is none.
        """
        end_s = time.monotonic() + SILENT_S
        while not self._hello and time.monotonic() < end_s:
            time.sleep(SILENT_S / 8)
        self._check()
        if not self._hello:
            raise PhoneGone("expected a phone whose camera runs; press Start on its page")
        return {
            "name": str(self._hello.get("name", ""))[:MOST_LETTERS],
            "exposures_ms": _range(self._hello.get("exposures_ms")),
        }

    @property
    def there(self) -> bool:
        """Whether a phone has joined and answers."""
        return self._socket is not None and time.monotonic() - self._heard_s <= SILENT_S

    def _check(self) -> None:
        if not self.there:
            raise PhoneGone(GONE)

    def _send(self, order: dict[str, Any]) -> None:
        self._check()
        socket, loop = self._socket, self._loop
        assert loop is not None
        if socket is not None:
            sent = asyncio.run_coroutine_threadsafe(socket.send_text(json.dumps(order)), loop)
            with suppress(Exception):  # the phone is gone, which the wait will tell
                sent.result(SILENT_S)

    def _listen(self) -> None:
        """Let programs of this user find the phone, from the first one that joins."""
        if self._listener is not None:
            return
        key = secrets.token_bytes(32)
        self._listener = Listener(authkey=key)
        told = {"address": self._listener.address, "key": key.hex()}
        told["family"] = "AF_PIPE" if os.name == "nt" else "AF_UNIX"
        self._file.unlink(missing_ok=True)
        handle = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(told, file)
        threading.Thread(target=self._accept, name="users of the phone", daemon=True).start()

    def _accept(self) -> None:
        assert self._listener is not None
        while True:
            try:
                user = self._listener.accept()
            except OSError:
                return
            except Exception:  # somebody without the key
                continue
            threading.Thread(target=self._serve, args=(user,), daemon=True).start()

    def _serve(self, user: Connection) -> None:
        """Answer one program until it leaves."""
        with user, suppress(OSError, EOFError):
            while True:
                order = json.loads(user.recv_bytes(2**16))
                content = b""
                try:
                    if order.get("what") == "state":
                        answer = self.state()
                    else:
                        answer, content = self.ask(order)
                except PhoneGone as problem:
                    answer = {"problem": str(problem)}
                user.send_bytes(json.dumps({**answer, "bytes": len(content)}).encode())
                if content:
                    user.send_bytes(content)

    def close(self) -> None:
        """Delete the way to the phone; again without effect."""
        if self._listener is not None:
            self._file.unlink(missing_ok=True)
            self._listener.close()
            self._listener = None


def _range(told: Any) -> list[float] | None:
    """Two numbers that a phone has said; None for anything else."""
    if not isinstance(told, list) or len(told) != 2:
        return None
    return [float(n) for n in told] if all(isinstance(n, int | float) for n in told) else None


def add_phone(api: FastAPI, hub: PhoneHub) -> None:
    """Register the page that makes a phone a camera, and its web socket."""
    room = resources.files("fringeworks.studio")
    page, script = (room.joinpath(f"phone.{kind}").read_text("utf-8") for kind in ("html", "js"))

    @api.get("/phone")
    def _page() -> Response:
        return Response(page, media_type="text/html")

    @api.get("/phone.js")
    def _script() -> Response:
        return Response(script, media_type="text/javascript")

    @api.websocket("/phone/socket")
    async def _socket(socket: WebSocket) -> None:
        await hub.join(socket)
