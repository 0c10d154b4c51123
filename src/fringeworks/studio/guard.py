"""Who may talk to the studio: checks of every request before anything else sees it."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

TOKEN = "token"
"""Name of the query parameter that holds the token."""
COOKIE = "fringeworks_token"
"""Name of the cookie that holds it afterwards."""
MOST_BYTES = 2_000_000
"""Largest body of a request, bytes: the page sends clicks and numbers, and no files."""
REFUSED_SOCKET = 1008
"""Code of a web socket that is closed for breaking a rule (RFC 6455)."""
HEADERS = [
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
]
"""Headers of every answer: no page may hold or read the studio."""


class Guard:
    """Middleware that lets only the studio's own pages, on its own addresses, through.

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
    """

    def __init__(
        self, app: App, *, hosts: frozenset[str] | None = None, token: str | None = None
    ) -> None:
        self._app = app
        self._hosts = hosts
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse, one request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        refused = self._refused(scope, headers)
        if refused is not None:
            await _refuse(scope, send, *refused)
            return
        if self._token is not None and not _knows(headers.get("cookie", ""), self._token):
            await self._sign_in(scope, send, self._token)
            return
        await self._app(scope, _limited(receive), _with_headers(send))

    def _refused(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Why a request is refused: status and sentence; None where it is not."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if not host or (self._hosts is not None and host not in self._hosts):
            return 421, "The studio does not answer to this name."
        socket = scope["type"] == "websocket"
        if origin is not None and urlsplit(origin).netloc.lower() != host:
            return 403, "Another page asked; only the studio's own pages may."
        if origin is None and (socket or scope.get("method") not in ("GET", "HEAD")):
            return 403, "It is not known which page asked."
        site = headers.get("sec-fetch-site", "none")
        opened = headers.get("sec-fetch-dest") == "document" and not socket
        if site not in ("same-origin", "none") and not opened:
            return 403, "Another page asked; only the studio's own pages may."
        size = headers.get("content-length", "0")
        if not size.isdecimal() or int(size) > MOST_BYTES:
            return 413, f"A request has at most {MOST_BYTES:,} bytes."
        return None

    async def _sign_in(self, scope: Scope, send: Send, token: str) -> None:
        """Turn a token in the address into a cookie, or refuse."""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(TOKEN, [""])[0]
        page = scope["type"] == "http" and scope.get("method") == "GET"
        if not page or not hmac.compare_digest(given.encode(), token.encode()):
            await _refuse(scope, send, 401, "The address with its token is needed once.")
            return
        cookie = f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
        # The address without the token: it must not stay in the browser's history.
        place = [(b"location", b"/"), (b"set-cookie", cookie.encode())]
        await send({"type": "http.response.start", "status": 303, "headers": place + HEADERS})
        await send({"type": "http.response.body", "body": b""})


def _headers(scope: Scope) -> dict[str, str]:
    """Headers by name; of repeated ones the last."""
    return {name.decode("latin-1").lower(): v.decode("latin-1") for name, v in scope["headers"]}


def _knows(cookies: str, token: str) -> bool:
    try:
        found = SimpleCookie(cookies).get(COOKIE)
    except CookieError:
        return False
    return found is not None and hmac.compare_digest(found.value.encode(), token.encode())


async def _refuse(scope: Scope, send: Send, status: int, sentence: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": REFUSED_SOCKET, "reason": sentence})
        return
    kind = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": status, "headers": kind + HEADERS})
    await send({"type": "http.response.body", "body": sentence.encode()})


def _limited(receive: Receive) -> Receive:
    """Count the bytes of a body whose length was not told."""
    received = 0

    async def counted() -> Message:
        nonlocal received
        message = await receive()
        if message["type"] == "http.request":
            received += len(message.get("body", b""))
            if received > MOST_BYTES:
                return {"type": "http.disconnect"}
        return message

    return counted


def _with_headers(send: Send) -> Send:
    async def added(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *HEADERS]}
        await send(message)

    return added
