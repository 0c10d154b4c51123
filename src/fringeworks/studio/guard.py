"""Who may talk to the studio: checks of every request before anything else sees it."""

from __future__ import annotations

import hmac
import secrets
from collections import deque
from collections.abc import Awaitable, Callable, MutableMapping
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
ENTERED = b"<!doctype html><title>fringeworks studio</title><script>location.replace('/')</script>"
"""Page that follows the token. After a redirection, browsers withhold a cookie with SameSite=Strict
if the link was on another site."""
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
        self._visitors: deque[str] = deque(maxlen=MOST_VISITORS)
        """What the cookies of visitors hold who knew the token."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse, one request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        if headers is None:
            await _refuse(
                scope, send, 400, "The request has two headers of Host, Origin or Content-Length."
            )
            return
        refused = self._refused(scope, headers)
        if refused is not None:
            await _refuse(scope, send, *refused)
            return
        if self._token is not None and not self._knows(scope, headers):
            await self._sign_in(scope, send, self._token)
            return
        await self._app(scope, _limited(receive), _with_headers(send))

    def _refused(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Why a request is refused: status and sentence; None where it is not."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if not host or (self._hosts is not None and host not in self._hosts):
            return (
                421,
                "The studio does not serve this host name: open the address that it has printed.",
            )
        socket = scope["type"] == "websocket"
        # Behind a tunnel, pages may be encrypted.
        own = (f"http://{host}", f"https://{host}")
        if origin is not None and origin.lower() not in own:
            return 403, "Another page asked; only the studio's own pages may."
        if origin is None and (socket or scope.get("method") not in ("GET", "HEAD")):
            return 403, "The request has no Origin header."
        site = headers.get("sec-fetch-site", "none")
        opened = headers.get("sec-fetch-dest") == "document" and not socket
        if site not in ("same-origin", "none") and not opened:
            return 403, "Another page asked; only the studio's own pages may."
        size = headers.get("content-length", "0")
        if not size.isdecimal() or len(size) > MOST_DIGITS or int(size) > MOST_BYTES:
            return 413, f"A request has at most {MOST_BYTES:,} bytes."
        return None

    async def _sign_in(self, scope: Scope, send: Send, token: str) -> None:
        """Turn a token in the address into a cookie, or refuse."""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(TOKEN, [""])[0]
        page = scope["type"] == "http" and scope.get("method") == "GET"
        if not page or not hmac.compare_digest(given.encode(), token.encode()):
            await _refuse(
                scope,
                send,
                401,
                "Open the whole address that the studio has printed, with ?token=…",
            )
            return
        visitor = secrets.token_urlsafe(24)
        self._visitors.append(visitor)
        cookie = f"{_cookie_name(scope)}={visitor}; HttpOnly; SameSite=Strict; Path=/"
        # The address without the token: it must not stay in the browser's history.
        place = [(b"content-type", b"text/html"), (b"set-cookie", cookie.encode())]
        await send({"type": "http.response.start", "status": 200, "headers": place + HEADERS})
        await send({"type": "http.response.body", "body": ENTERED})

    def _knows(self, scope: Scope, headers: dict[str, str]) -> bool:
        """Whether a visitor was let in before: any cookie of the name counts."""
        name = _cookie_name(scope)
        given = [part.strip().partition("=") for part in headers.get("cookie", "").split(";")]
        return any(
            key == name and hmac.compare_digest(value.encode(), visitor.encode())
            for key, _, value in given
            for visitor in self._visitors
        )


def _headers(scope: Scope) -> dict[str, str] | None:
    """Headers by name; None where one that decides is there twice."""
    found: dict[str, str] = {}
    for name, value in scope["headers"]:
        key = name.decode("latin-1").lower()
        if key in found and key in ("host", "origin", "content-length"):
            return None
        joint = "; " if key == "cookie" else ", "
        text = value.decode("latin-1")
        found[key] = f"{found[key]}{joint}{text}" if key in found else text
    return found


def _cookie_name(scope: Scope) -> str:
    server = scope.get("server") or ("", 0)
    return f"{COOKIE}_{server[1]}"


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
