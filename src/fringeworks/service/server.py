"""The server of the service: its address, its token, and the guard before both."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import sys
from pathlib import Path

import uvicorn

from fringeworks.files.atomic import StrPath
from fringeworks.service.api import service_app
from fringeworks.service.desk import Desk
from fringeworks.service.protocol import TimedProtocol
from fringeworks.service.scanner import Scanner
from fringeworks.service.store import Store
from fringeworks.serving.guard import Guard
from fringeworks.serving.listening import listening, named, own_names
from fringeworks.types import FileProblem, InputError

PORT = 8138
"""Port that is tried first, the one after the studio's; a free one is taken where it is in use."""
TOKEN_FILE = "token"
"""File in the folder that holds the token: clients keep theirs over restarts."""
TOKEN_VARIABLE = "FRINGEWORKS_TOKEN"
"""Environment variable with the token, for containers."""
SHORTEST_TOKEN = 16
"""Fewest letters of a token that is given: shorter ones can be guessed."""
MOST_CONNECTIONS = 200
"""Connections at a time; others get 503. A line has a handful of clients."""
SHUTDOWN_S = 3
"""Longest wait for answers that are being sent at the end, s."""
OPEN_PATHS = frozenset({"/health"})
"""What may be read without the token."""


def serve(
    folder: StrPath,
    scanner: Scanner,
    *,
    host: str | None,
    port: int | None,
    queue: int,
    keep: int,
) -> None:
    """Serve scans until it is interrupted; see ``run_service``."""
    if queue < 1 or keep < 1:
        raise InputError(f"queue, keep: expected 1 or more, got {queue} and {keep}")
    with Store(folder, keep) as store:
        token, desk = token_of(store.root), Desk(store, scanner, queue)
        with listening(host or "127.0.0.1", port, usual=PORT, who="service") as place:
            _run(place, desk, host, token)


def _run(place: socket.socket, desk: Desk, host: str | None, token: str) -> None:
    """Serve until a signal ends it."""
    used, root = place.getsockname()[1], desk.store.root
    guarded = Guard(
        service_app(desk),
        hosts=None if host else own_names(used),
        token=token,
        who="service",
        programs=True,
        open_paths=OPEN_PATHS,
    )
    print(f"The service of {root} is at http://{named(host)}:{used}/", flush=True)
    print(f"Its token is in {root / TOKEN_FILE}. Press Ctrl-C to end it.", flush=True)
    config = uvicorn.Config(
        guarded,
        http=TimedProtocol,
        log_level="error",
        lifespan="on",
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=SHUTDOWN_S,
        server_header=False,
    )
    # The server hands the signal on when it has ended.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    uvicorn.Server(config).run(sockets=[place])


def token_of(root: Path) -> str:
    """The token of a service: from the environment, or made once and kept in its folder.

    Raises
    ------
    InputError for a short token; FileProblem for a file that cannot be read or written.
    """
    given = os.environ.get(TOKEN_VARIABLE, "")
    path = root / TOKEN_FILE
    try:
        if not given and path.is_file():
            given = path.read_text("utf-8").strip()
        if given:
            if len(given) < SHORTEST_TOKEN:
                raise InputError(f"token: expected {SHORTEST_TOKEN} letters or more")
            return given
        made = secrets.token_urlsafe(24)
        with open(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w") as file:
            file.write(f"{made}\n")
    except (OSError, UnicodeDecodeError) as error:
        raise FileProblem(f"{path}: expected the token of the service, got: {error}") from error
    return made
