"""The studio's server: the page, its files, and the guard before both."""

from __future__ import annotations

import gzip
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path

import uvicorn
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from nicegui import app, ui

from fringeworks.files.atomic import StrPath
from fringeworks.report.viewer.page import viewer_script, viewer_style
from fringeworks.serving.guard import TOKEN, Guard
from fringeworks.serving.listening import listening, named, own_names
from fringeworks.studio.page import MODULES, SCRIPT, STYLE, add_page
from fringeworks.studio.phone import add_phone
from fringeworks.studio.slim import slim_files
from fringeworks.studio.state import Studio
from fringeworks.studio.thumbnails import thumbnail
from fringeworks.types import FileProblem, InputError

PORT = 8137
"""Port that is tried first; a free one is taken where it is in use."""
ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16">'
    '<rect width="16" height="16" rx="3" fill="#1f5fbf"/>'
    '<path d="M3 2v12M6.3 2v12M9.7 2v12M13 2v12" stroke="#fff"/></svg>'
)
"""Icon of the page in the browser: fringes."""
ALONE = "sandbox allow-scripts allow-popups"
"""Policy of reports: their scripts reach neither the studio nor its cookies."""
MISSING = (
    '<!doctype html><html lang="en"><title>fringeworks studio</title><h1>There is no such page.'
    '</h1><p><a href="/">To the start of the studio</a></p></html>'
)
"""Page for addresses that nothing is at."""
SHUTDOWN_S = 2
"""Longest wait for pages that are still open at the end, s."""


def serve(folder: StrPath, *, host: str | None, port: int | None, show: bool) -> None:
    """Serve a studio until it is interrupted; see ``run_studio``."""
    place = listening(host or "127.0.0.1", port, usual=PORT, who="studio")
    used = place.getsockname()[1]
    token = None if host is None else secrets.token_urlsafe(24)
    studio = Studio(folder)
    address = f"http://{named(host)}:{used}/" + (f"?{TOKEN}={token}" if token else "")
    hosts = None if host else own_names(used)
    guarded = Guard(studio_app(studio, used), hosts=hosts, token=token)
    studio.devices.warm()
    studio.compute.warm()
    print(f"The studio of {studio.workspace.root} is at {address}", flush=True)
    print("Press Ctrl-C to end it.", flush=True)
    if show:
        threading.Timer(1.0, webbrowser.open, (address,)).start()
    _run(guarded, place, studio)


def _run(guarded: Guard, place: socket.socket, studio: Studio) -> None:
    """Serve until a signal ends it."""
    config = uvicorn.Config(
        guarded, log_level="error", lifespan="on", timeout_graceful_shutdown=SHUTDOWN_S
    )
    # The server hands the signal on when it has ended: then there is still something to delete.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        uvicorn.Server(config).run(sockets=[place])
    finally:
        studio.close()


def studio_app(studio: Studio, port: int = PORT) -> FastAPI:
    """Return the application of a studio, without its guard.

    The port is part of the cookie's name: browsers send cookies to all ports of a host.
    """
    # No bar at the top while something loads: it has no name, and the page says what it does.
    app.config.quasar_config["loadingBar"] = {"skipHijack": True}
    app.exception_handler(404)(_missing)
    api = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    _add_files(api, studio)
    add_phone(api, studio.phone)
    add_page(studio)
    ui.run_with(
        api,
        title="fringeworks studio",
        dark=None,
        language="en-US",
        favicon=ICON,
        tailwind=False,
        storage_secret=secrets.token_hex(),
        show_welcome_message=False,
        reconnect_timeout=30.0,
        session_middleware_kwargs={"session_cookie": f"fringeworks_{port}", "same_site": "strict"},
    )
    return api


def _add_files(api: FastAPI, studio: Studio) -> None:
    """Register what pages load: scripts and styles, surfaces, pictures, and files of the folder."""
    _add_texts(api)
    _add_reports(api, studio)

    @api.get("/thumb/{name:path}")
    def _thumb(name: str) -> Response:
        try:
            content = thumbnail(studio.workspace.inside(name))
        except InputError:
            raise HTTPException(404, "There is no picture of that.") from None
        headers = {"cache-control": "private, max-age=86400"}
        return Response(content, media_type="image/jpeg", headers=headers)

    @api.get("/surface/{number}")
    def _surface(number: int) -> Response:
        return _file(studio.surface(number))

    @api.get("/live/{number}")
    def _live(number: int) -> Response:  # noqa: ARG001, makes every picture's address new
        job = studio.devices.job
        picture = job.latest.get("picture", {}) if job else {}
        return Response(picture.get("jpeg", b""), media_type="image/jpeg")

    @api.get("/cloud/{number}")
    def _cloud(number: int) -> Response:  # noqa: ARG001, as above
        job = studio.devices.job
        cloud = job.latest.get("cloud", {}) if job else {}
        return Response(cloud.get("data", b""), media_type="application/octet-stream")

    @api.get("/file/{name:path}")
    def _download(name: str) -> Response:
        try:
            return _file(studio.workspace.inside(name), download=True)
        except FileProblem as problem:
            return PlainTextResponse(str(problem), status_code=403)
        except (OSError, ValueError):
            return PlainTextResponse("There is no such file.", status_code=404)


def _add_reports(api: FastAPI, studio: Studio) -> None:
    """Register the reports of the folder, which anybody may have written."""

    @api.get("/report/{name:path}")
    def _report(name: str) -> Response:
        # A page of the folder may hold anything: it runs as if it came from nowhere.
        try:
            path = studio.workspace.inside(name)
        except (FileProblem, ValueError):
            raise HTTPException(404, "There is no such report.") from None
        if path.suffix.lower() != ".html":
            raise HTTPException(404, "There is no such report.")
        answer = _file(path)
        answer.headers["content-security-policy"] = ALONE
        return answer


def _add_texts(api: FastAPI) -> None:
    """Register scripts and styles, compressed once."""
    texts = {
        "viewer.js": (viewer_script(), "text/javascript"),
        "viewer.css": (viewer_style(), "text/css"),
        "studio.js": (SCRIPT, "text/javascript"),
        "studio.css": (STYLE, "text/css"),
    } | {f"{name}.js": (text, "text/javascript") for name, text in MODULES.items()}
    for name, (text, kind) in texts.items():
        api.get(f"/{name}")(_text(text, kind))
    for name, (text, kind) in slim_files().items():
        api.get(f"/_nicegui/{{version}}/static/{name}")(_text(text, kind))


def _text(text: str, kind: str) -> Callable[[Request], Response]:
    """What answers with a text, compressed where the browser can read that."""
    plain = text.encode()
    packed = gzip.compress(plain, mtime=0)

    def answer(request: Request) -> Response:
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(plain, media_type=kind)
        headers = {"content-encoding": "gzip", "vary": "Accept-Encoding"}
        return Response(packed, media_type=kind, headers=headers)

    return answer


async def _missing(_: Request, __: Exception) -> HTMLResponse:
    """Answer for addresses that nothing is at."""
    return HTMLResponse(MISSING, status_code=404)


def _file(path: Path, *, download: bool = False) -> FileResponse:
    if not path.is_file():
        raise HTTPException(404, "There is no such file.")
    name = path.name if download else None
    return FileResponse(path, filename=name, headers={"cache-control": "no-store"})
