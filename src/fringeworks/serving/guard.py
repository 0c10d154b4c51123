"""Who may talk to a server: checks of every request before anything else sees it."""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
from collections import deque
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

TOKEN = "token"
"""Name of the query parameter that holds the token."""
COOKIE = "fringeworks_visitor"
"""Beginning of the name of the cookie that lets a visitor in afterwards. The port follows, because
browsers send cookies to all ports of a host."""
MOST_VISITORS = 1000
"""Cookies that are known; with more, the oldest visitor needs the token again."""
MOST_DIGITS = 20
"""Digits of a length that are read."""
MOST_BYTES = 2_000_000
"""Largest body of a request, bytes: the page sends clicks and numbers, and no files."""
BODY_S = 30.0
"""Longest time for the body of a request that programs send, s: some kilobytes arrive in less even
over a slow line."""
ENTERED = b"<!doctype html><title>fringeworks</title><script>location.replace('/')</script>"
"""Page that follows the token. After a redirection, browsers withhold a cookie with SameSite=Strict
if the link was on another site."""
MOST_REASON = 120
"""Letters of the reason of a socket's end: a control frame has 125 bytes (RFC 6455)."""
TWICE = "The request has two headers of Host, Origin or Content-Length."
TOO_LARGE = (413, f"A request has at most {MOST_BYTES:,} bytes.")
"""Status and sentence of a body that is too large."""
TOO_SLOW = (408, f"The body of a request must arrive within {BODY_S:g} s.")
"""Status and sentence of a body that takes too long."""
REFUSED_SOCKET = 1008
"""Code of a web socket that is closed for breaking a rule (RFC 6455)."""
HEADERS = [
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (
        b"content-security-policy",
        b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
        b"style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        b"object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
]
"""Headers of every answer: no page may hold or read what is served."""


class Guard:
    """Middleware that lets only a server's own pages, on its own addresses, through.

    Any page of the web can send requests to loopback, and open web sockets, which have no other
    protection. Browsers say where a request comes from; requests from elsewhere are refused.

    Parameters
    ----------
    app : ASGI application
    hosts : set of str, optional
        Names and addresses, with their port, that requests may be for. None allows all: the token
        is then what keeps strangers out.
    token : str, optional
        What a visitor must know; given once as ``?token=…`` and then kept as a cookie.
    who : str
        What is served, for messages.
    programs : bool
        Whether programs are served as well as pages. A program sends the token in the header
        ``Authorization: Bearer …`` of every request, which no page of another site can do, and
        needs no Origin then. Refusals are JSON, and bodies must arrive in 30 s.
    open_paths : set of str
        Paths that may be read without the token.
    """

    def __init__(
        self,
        app: App,
        *,
        hosts: frozenset[str] | None = None,
        token: str | None = None,
        who: str = "studio",
        programs: bool = False,
        open_paths: frozenset[str] = frozenset(),
    ) -> None:
        self._app = app
        self._hosts = hosts
        self._token = token
        self._who = who
        self._programs = programs
        self._open_paths = open_paths
        self._visitors: deque[str] = deque(maxlen=MOST_VISITORS)
        """What the cookies of visitors hold who knew the token."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse, one request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        if headers is None:
            await self._refuse(scope, send, 400, TWICE)
            return
        refused = self._refused(scope, headers)
        if refused is not None:
            await self._refuse(scope, send, *refused)
            return
        reading = scope["type"] == "http" and scope.get("method") in ("GET", "HEAD")
        is_open = reading and scope.get("path") in self._open_paths
        if self._token is not None and not is_open and not self._knows(scope, headers):
            await self._sign_in(scope, send, self._token)
            return
        body = _Body(receive, BODY_S if self._programs else None)
        answer = _Answer(send, body)
        await self._app(scope, body.receive, answer.send)
        if body.refused is not None and not answer.begun:
            await self._refuse(scope, send, *body.refused)

    def _refused(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Why a request is refused: status and sentence; None where it is not."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if not host or (self._hosts is not None and host not in self._hosts):
            return (
                421,
                f"The {self._who} does not serve this host name: open the address that it has "
                "printed.",
            )
        socket = scope["type"] == "websocket"
        # Behind a tunnel, pages may be encrypted.
        own = (f"http://{host}", f"https://{host}")
        if origin is not None and origin.lower() not in own:
            return 403, f"Another page asked; only the {self._who}'s own pages may."
        changes = socket or scope.get("method") not in ("GET", "HEAD")
        if origin is None and changes and not self._is_program(headers):
            return 403, "The request has no Origin header."
        site = headers.get("sec-fetch-site", "none")
        opened = headers.get("sec-fetch-dest") == "document" and not socket
        if site not in ("same-origin", "none") and not opened:
            return 403, f"Another page asked; only the {self._who}'s own pages may."
        size = headers.get("content-length", "0")
        if not size.isdecimal() or len(size) > MOST_DIGITS or int(size) > MOST_BYTES:
            return TOO_LARGE
        return None

    def _is_program(self, headers: dict[str, str]) -> bool:
        """Whether a program asks that knows the token."""
        kind, _, given = headers.get("authorization", "").partition(" ")
        if not self._programs or self._token is None or kind.lower() != "bearer":
            return False
        return hmac.compare_digest(given.strip().encode(), self._token.encode())

    async def _sign_in(self, scope: Scope, send: Send, token: str) -> None:
        """Turn a token in the address into a cookie, or refuse."""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(TOKEN, [""])[0]
        page = scope["type"] == "http" and scope.get("method") == "GET"
        if not page or not hmac.compare_digest(given.encode(), token.encode()):
            told = f"Open the whole address that the {self._who} has printed, with ?token=…"
            if self._programs:
                told += "; programs send the header Authorization: Bearer …"
            await self._refuse(scope, send, 401, told)
            return
        visitor = secrets.token_urlsafe(24)
        self._visitors.append(visitor)
        cookie = f"{_cookie_name(scope)}={visitor}; HttpOnly; SameSite=Strict; Path=/"
        # The address without the token: it must not stay in the browser's history.
        place = [(b"content-type", b"text/html"), (b"set-cookie", cookie.encode())]
        await send({"type": "http.response.start", "status": 200, "headers": place + HEADERS})
        await send({"type": "http.response.body", "body": ENTERED})

    def _knows(self, scope: Scope, headers: dict[str, str]) -> bool:
        """Whether a visitor was let in before (any cookie of the name counts), or a program knows
        the token."""
        if self._is_program(headers):
            return True
        name = _cookie_name(scope)
        given = [part.strip().partition("=") for part in headers.get("cookie", "").split(";")]
        return any(
            key == name and hmac.compare_digest(value.encode(), visitor.encode())
            for key, _, value in given
            for visitor in self._visitors
        )

    async def _refuse(self, scope: Scope, send: Send, status: int, sentence: str) -> None:
        if scope["type"] == "websocket":
            reason = sentence[:MOST_REASON]
            await send({"type": "websocket.close", "code": REFUSED_SOCKET, "reason": reason})
            return
        kind, text = "text/plain; charset=utf-8", sentence
        if self._programs:
            kind, text = "application/json", json.dumps({"problem": sentence})
        head = [(b"content-type", kind.encode()), *HEADERS]
        await send({"type": "http.response.start", "status": status, "headers": head})
        await send({"type": "http.response.body", "body": text.encode()})


def _headers(scope: Scope) -> dict[str, str] | None:
    """Headers by name; None where one that decides is there twice."""
    found: dict[str, str] = {}
    for name, value in scope["headers"]:
        key = name.decode("latin-1").lower()
        if key in found and key in ("host", "origin", "content-length", "authorization"):
            return None
        joint = "; " if key == "cookie" else ", "
        text = value.decode("latin-1")
        found[key] = f"{found[key]}{joint}{text}" if key in found else text
    return found


def _cookie_name(scope: Scope) -> str:
    server = scope.get("server") or ("", 0)
    return f"{COOKIE}_{server[1]}"


class _Body:
    """The body of a request: its bytes are counted, and it must not take for ever.

    Parameters
    ----------
    receive : callable
        Of the server.
    longest_s : float, optional
        Longest time until all of it is there, s.
    """

    def __init__(self, receive: Receive, longest_s: float | None) -> None:
        self._receive = receive
        self._longest_s = longest_s
        self._until: float | None = None
        self._received = 0
        self._whole = False
        self.refused: tuple[int, str] | None = None
        """Status and sentence, where it was refused."""

    async def receive(self) -> Message:
        """The next part; the end of the connection where it is refused."""
        if self.refused is not None:
            return {"type": "http.disconnect"}
        try:
            async with asyncio.timeout_at(self._deadline()):
                message = await self._receive()
        except TimeoutError:
            self.refused = TOO_SLOW
            return {"type": "http.disconnect"}
        if message["type"] == "http.request":
            self._received += len(message.get("body", b""))
            self._whole = not message.get("more_body", False)
            if self._received > MOST_BYTES:
                self.refused = TOO_LARGE
                return {"type": "http.disconnect"}
        else:
            self._whole = True  # a web socket, or the end
        return message

    def _deadline(self) -> float | None:
        """Until when the next part must be there, s of the loop's clock; None for no limit."""
        if self._whole or self._longest_s is None:
            return None
        if self._until is None:
            self._until = asyncio.get_running_loop().time() + self._longest_s
        return self._until


@dataclass
class _Answer:
    """An answer with the headers of every answer; nothing where the body was refused."""

    _send: Send
    _body: _Body
    begun: bool = False

    async def send(self, message: Message) -> None:
        """Hand on a part of the answer."""
        if self._body.refused is not None and not self.begun:
            return  # what the application says of half a body
        self.begun = True
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *HEADERS]}
        await self._send(message)
