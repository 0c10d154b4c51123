"""The studio's server: the page, its files, and the guard before both."""

from __future__ import annotations

import secrets
import socket
import threading
import webbrowser
from pathlib import Path

import uvicorn
from fastapi import FastAPI, HTTPException
from fastapi.responses import FileResponse, PlainTextResponse, Response
from nicegui import ui

from fringeworks.files.atomic import StrPath
from fringeworks.report.viewer.page import viewer_script, viewer_style
from fringeworks.studio.guard import TOKEN, Guard
from fringeworks.studio.page import STYLE, add_page
from fringeworks.studio.state import Studio
from fringeworks.types import DeviceProblem, FileProblem

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names of this machine for itself."""
PORT = 8137
"""Port that is tried first; a free one is taken where it is in use."""
SHUTDOWN_S = 2
"""Longest wait for pages that are still open at the end, s."""


def serve(folder: StrPath, *, host: str | None, port: int | None, show: bool) -> None:
    """Serve a studio until it is interrupted; see ``run_studio``."""
    listening = _listening(host or "127.0.0.1", port)
    used = listening.getsockname()[1]
    token = None if host is None else secrets.token_urlsafe(24)
    studio = Studio(folder)
    address = f"http://{host or '127.0.0.1'}:{used}/" + (f"?{TOKEN}={token}" if token else "")
    hosts = None if host else frozenset(f"{name}:{used}" for name in LOOPBACK)
    guarded = Guard(studio_app(studio), hosts=hosts, token=token)
    config = uvicorn.Config(
        guarded, log_level="error", lifespan="on", timeout_graceful_shutdown=SHUTDOWN_S
    )
    studio.devices.warm()
    studio.compute.warm()
    print(f"The studio of {studio.workspace.root} is at {address}", flush=True)
    print("Press Ctrl-C to end it.", flush=True)
    if show:
        threading.Timer(1.0, webbrowser.open, (address,)).start()
    try:
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        studio.close()


def studio_app(studio: Studio) -> FastAPI:
    """Return the application of a studio, without its guard."""
    api = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @api.get("/viewer.js")
    def _script() -> Response:
        return Response(viewer_script(), media_type="text/javascript")

    @api.get("/studio.css")
    def _style() -> Response:
        return Response(viewer_style() + STYLE, media_type="text/css")

    @api.get("/surface/{number}")
    def _surface(number: int) -> Response:
        return _file(studio.surface(number))

    @api.get("/live/{number}")
    def _live(number: int) -> Response:  # noqa: ARG001, makes every picture's address new
        job = studio.devices.job
        picture = job.latest.get("picture", {}) if job else {}
        return Response(picture.get("jpeg", b""), media_type="image/jpeg")

    @api.get("/file/{name:path}")
    def _download(name: str) -> Response:
        try:
            path = studio.workspace.inside(name)
        except FileProblem as problem:
            return PlainTextResponse(str(problem), status_code=403)
        return _file(path, download=True)

    add_page(studio)
    ui.run_with(
        api,
        title="fringeworks studio",
        dark=None,
        storage_secret=secrets.token_hex(),
        show_welcome_message=False,
        reconnect_timeout=30.0,
    )
    return api


def _file(path: Path, *, download: bool = False) -> FileResponse:
    if not path.is_file():
        raise HTTPException(404, "There is no such file.")
    name = path.name if download else None
    return FileResponse(path, filename=name, headers={"cache-control": "no-store"})


def _listening(host: str, port: int | None) -> socket.socket:
    """A socket at an address."""
    for tried in (PORT, 0) if port is None else (port,):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        found = socket.socket(family, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((host, tried))
        except OSError as error:
            found.close()
            if tried and port is None:
                continue
            raise DeviceProblem(
                f"studio: expected an address to serve on, got {host}:{tried}: {error.strerror}"
            ) from error
        return found
    raise AssertionError
