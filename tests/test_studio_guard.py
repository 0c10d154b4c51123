"""Who may talk to the studio: other pages, other names, no token, large bodies, other folders."""

from __future__ import annotations

import asyncio
import base64
import os
import signal
import socket
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import fringeworks as fw
from fringeworks.serving.guard import COOKIE, MOST_BYTES, Guard
from fringeworks.studio.state import Studio
from fringeworks.studio.workspace import open_workspace
from fringeworks.types import FileProblem, InputError

pytestmark = pytest.mark.system

HOST = "127.0.0.1:8137"
OWN = {"host": HOST, "origin": f"http://{HOST}"}


async def _app(scope, receive, send):
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"in"})


def asked(
    headers,
    *,
    kind="http",
    method="GET",
    query="",
    token=None,
    hosts=(HOST,),
    body=(b"",),
    guard=None,
):
    """What the guard answers: status of a page, or the type of a socket's answer."""
    pairs = headers.items() if isinstance(headers, dict) else headers
    scope = {
        "type": kind,
        "method": method,
        "query_string": query.encode(),
        "server": ("127.0.0.1", 8137),
        "headers": [(k.encode(), v.encode()) for k, v in pairs],
    }
    sent, parts = [], list(body)

    async def receive():
        part = parts.pop(0)
        return {"type": "http.request", "body": part, "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    if guard is None:
        guard = Guard(_app, hosts=None if hosts is None else frozenset(hosts), token=token)
    asyncio.run(guard(scope, receive, send))
    return sent


def status(*args, **kwargs):
    sent = asked(*args, **kwargs)
    return sent[0].get("status", sent[0]["type"]) if sent else None


def test_own_pages_are_let_in():
    assert status({"host": HOST}) == 200
    assert status(OWN, method="POST") == 200
    assert status(OWN, kind="websocket") == "websocket.accept"
    assert status({"host": HOST, "sec-fetch-site": "same-origin"}) == 200
    link = {"host": HOST, "sec-fetch-site": "cross-site", "sec-fetch-dest": "document"}
    assert status(link) == 200
    assert dict(asked({"host": HOST})[0]["headers"])[b"x-frame-options"] == b"DENY"


@pytest.mark.parametrize(
    ("headers", "options", "expected"),
    [
        ({}, {}, 421),
        ({"host": "evil.example"}, {}, 421),
        ({"host": "evil.example:8137"}, {}, 421),
        ({"host": "127.0.0.1:9"}, {}, 421),
        ({"host": HOST, "origin": "https://evil.example"}, {}, 403),
        ({"host": HOST, "origin": "null"}, {}, 403),
        ({"host": HOST, "origin": f"http://{HOST}.evil.example"}, {}, 403),
        ({"host": HOST, "origin": "http://localhost:8137"}, {}, 403),
        ({"host": HOST}, {"method": "POST"}, 403),
        ({"host": HOST, "sec-fetch-site": "cross-site", "sec-fetch-dest": "image"}, {}, 403),
        ({"host": HOST, "sec-fetch-site": "same-site"}, {}, 403),
        (OWN | {"content-length": str(2 * 1024**3)}, {"method": "POST"}, 413),
        (OWN | {"content-length": "-1"}, {"method": "POST"}, 413),
        (OWN | {"content-length": "0" * 5000 + "1"}, {"method": "POST"}, 413),
        ({"host": HOST, "origin": "http://[::1"}, {}, 403),
        ({"host": HOST, "origin": f"foo://{HOST}"}, {}, 403),
        ([("host", "evil.example"), ("host", HOST)], {}, 400),
        ([*OWN.items(), ("origin", "http://evil.example")], {}, 400),
    ],
)
def test_others_are_refused(headers, options, expected):
    assert status(headers, **options) == expected


@pytest.mark.parametrize(
    "headers",
    [
        {"host": HOST},
        {"host": HOST, "origin": "https://evil.example"},
        {"host": "evil.example", "origin": "http://evil.example"},
        OWN | {"sec-fetch-site": "cross-site"},
        # A page cannot be opened as a socket.
        OWN | {"sec-fetch-site": "cross-site", "sec-fetch-dest": "document"},
    ],
)
def test_sockets_of_others_are_refused(headers):
    assert status(headers, kind="websocket") == "websocket.close"


def test_a_body_of_untold_length_ends_at_the_limit():
    parts = [b"x" * (MOST_BYTES // 2)] * 5
    assert status(OWN, method="POST", body=parts) == 413
    assert status(OWN, method="POST", body=parts[:2]) == 200


def test_the_token_is_needed_once():
    away = {"host": "192.168.1.7:8137"}
    options = {"guard": Guard(_app, token="secret")}
    assert status(away, **options) == 401
    assert status(away, query="token=wrong", **options) == 401
    assert status(away | {"cookie": f"{COOKIE}_8137=wrong"}, **options) == 401
    assert status(away | {"cookie": "\x01;;=,"}, **options) == 401
    own = away | {"origin": "http://192.168.1.7:8137"}
    assert status(own, kind="websocket", **options) == "websocket.close"
    assert status(own, kind="websocket", query="token=secret", **options) == "websocket.close"
    entered = asked(away, query="token=secret", **options)[0]
    headers = dict(entered["headers"])
    assert entered["status"] == 200
    assert b"HttpOnly; SameSite=Strict" in headers[b"set-cookie"]
    cookie = {"cookie": headers[b"set-cookie"].decode().split(";")[0]}
    assert status(away | cookie, **options) == 200
    assert status(own | cookie, kind="websocket", **options) == "websocket.accept"
    assert status(own | cookie | {"origin": "http://evil.example"}, **options) == 403
    # Cookies of other programs on the host lie beside it, in any order, well-formed or not.
    for other in ('prefs={"a":"b c"}', "abc", "a b=c", "path=/x", f"{COOKIE}_8137=x"):
        for both in (f"{other}; {cookie['cookie']}", f"{cookie['cookie']}; {other}"):
            assert status(away | {"cookie": both}, **options) == 200
    # It is not the token itself, and holds for this port only.
    assert "secret" not in cookie["cookie"]
    elsewhere = cookie["cookie"].replace("_8137", "_9000")
    assert status(away | {"cookie": elsewhere}, **options) == 401


@pytest.mark.parametrize(
    "name", ["../x", "a/../../x", "/etc/passwd", "link/x", "link", "a\0b", "..", "../work-other/x"]
)
def test_nothing_outside_the_folder(tmp_path, name):
    space = open_workspace(tmp_path / "work")
    (tmp_path / "work-other").mkdir()
    (space.root / "link").symlink_to(tmp_path)
    with pytest.raises(FileProblem, match="folder"):
        space.inside(name)


@pytest.mark.parametrize("name", ["../x", "a/b", ".hidden", "", "x" * 61, "a\\b", "a.", "con\n"])
def test_names_are_words(tmp_path, name):
    with pytest.raises(FileProblem, match="letters, digits"):
        open_workspace(tmp_path).new(name)


def test_links_are_not_listed(tmp_path):
    space = open_workspace(tmp_path / "work")
    (tmp_path / "capture.toml").write_text('kind = "stack"')
    (tmp_path / "x.ply").write_text("ply")
    (space.root / "link").symlink_to(tmp_path)
    (space.root / "x.ply").symlink_to(tmp_path / "x.ply")
    assert space.captures() == []
    assert space.results() == []


@pytest.mark.parametrize("name", ["board", "rig.toml", "Setup.TOML", "recipe.toml", "dissertation"])
def test_the_studios_own_names_are_taken(tmp_path, name):
    with pytest.raises(FileProblem, match="does not use"):
        open_workspace(tmp_path).new(name)


@pytest.mark.parametrize("name", ["board", "rig.toml", "setup.toml"])
def test_links_in_place_of_own_files_are_refused(tmp_path, name):
    space = open_workspace(tmp_path / "work")
    (tmp_path / "elsewhere").mkdir()
    (space.root / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FileProblem, match="link"):
        space.check()
    studio = Studio(space.root)
    with pytest.raises(FileProblem, match="link"):
        studio.run_setup(studio.session("a"))
    studio.close()


def test_odd_entries_do_not_stop_the_lists(tmp_path):
    space = open_workspace(tmp_path)
    for name in ("good", "pipe", "zero", "closed", "--help", "a\nb"):
        (tmp_path / name).mkdir()
    os.mkdir(os.fsencode(tmp_path) + b"/bad\xff")
    (tmp_path / "good" / "capture.toml").write_text('kind = "stack"')
    (tmp_path / "--help" / "capture.toml").write_text('kind = "stack"')
    os.mkfifo(tmp_path / "pipe" / "capture.toml")
    (tmp_path / "zero" / "capture.toml").symlink_to("/dev/zero")
    (tmp_path / "closed").chmod(0)
    begun = time.monotonic()
    assert space.captures() == ["good"]
    with pytest.raises(FileProblem, match="file"):
        fw.files.read_stack(tmp_path / "pipe")
    assert time.monotonic() - begun < 5
    (tmp_path / "closed").chmod(0o700)


def test_only_poses_can_be_deleted(tmp_path):
    studio = Studio(tmp_path)
    for name in ("pose-01", 'x" :y="z', "pose-1x"):
        (tmp_path / "board" / name).mkdir(parents=True)
        (tmp_path / "board" / name / "capture.toml").write_text('kind = "stack"')
    (tmp_path / "scan").mkdir()
    (tmp_path / "board" / "pose-02").symlink_to(tmp_path / "scan")
    assert studio.workspace.taken_poses() == ["pose-01"]
    for name in ("pose-02", "../scan", 'x" :y="z'):
        with pytest.raises(InputError, match="pose"):
            studio.undo_pose(name)
    studio.close()


@pytest.mark.parametrize(
    "words",
    ["webcam:/etc/%02d.png", "webcam:http://127.0.0.1:1/x", "folder:/etc", "folder:..", "x" * 999],
)
def test_devices_do_not_read_elsewhere(tmp_path, words):
    studio = Studio(tmp_path / "work")
    studio.camera = words
    if studio.camera == words:
        with pytest.raises(InputError):
            _ = studio.words
    studio.camera = {"a": 1}
    assert isinstance(studio.camera, str)
    studio.close()


def test_scans_do_not_replace_others(tmp_path):
    studio = Studio(tmp_path)
    (tmp_path / "setup.toml").write_text("")
    (tmp_path / "part").mkdir()
    for call in (
        lambda: studio.scan(studio.session("a"), "part"),
        lambda: studio.start_series(studio.session("a"), ["new", "part"], 0.0),
    ):
        with pytest.raises(InputError, match="already"):
            call()
    studio.close()


def raw(address, text):
    """The first line of the answer to a request that is sent as it stands."""
    parts = urlsplit(address)
    with socket.create_connection((parts.hostname, parts.port), timeout=20) as connection:
        connection.sendall(text.replace("\n", "\r\n").encode() + b"\r\n\r\n")
        return connection.recv(200).decode("latin-1").split("\r\n")[0]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    from tests.studio_page import Running

    folder = tmp_path_factory.mktemp("guarded") / "work"
    running = Running(folder)
    (folder / "inside.txt").write_text("inside")
    (folder / "out").symlink_to(folder.parent)
    (folder.parent / "outside.txt").write_text("outside")
    yield running
    running.close()


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("/file/inside.txt", "200"),
        ("/file/../outside.txt", "40"),
        ("/file/..%2foutside.txt", "40"),
        ("/file/%2e%2e/outside.txt", "40"),
        ("/file/out/outside.txt", "40"),
        ("/file//etc/passwd", "40"),
        ("/file/inside.txt%00.png", "40"),
        ("/file/" + "a" * 300, "40"),
        ("/file/" + "a/" * 3000, "4"),
        ("/surface/1", "404"),
        ("/surface/../1", "40"),
        ("/docs", "404"),
        ("/openapi.json", "404"),
    ],
)
def test_paths_of_the_server(served, path, expected):
    host = urlsplit(served.address).netloc
    answer = raw(served.address, f"GET {path} HTTP/1.1\nHost: {host}\nConnection: close")
    assert answer.split()[1].startswith(expected), answer


@pytest.mark.parametrize("origin", ["https://evil.example", None, "own"])
def test_the_socket_of_the_server(served, origin):
    host = urlsplit(served.address).netloc
    key = base64.b64encode(os.urandom(16)).decode()
    told = f"http://{host}" if origin == "own" else origin
    answer = raw(
        served.address,
        "GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1\n"
        f"Host: {host}\nConnection: Upgrade\nUpgrade: websocket\nSec-WebSocket-Version: 13\n"
        f"Sec-WebSocket-Key: {key}" + (f"\nOrigin: {told}" if told else ""),
    )
    assert answer.split()[1] == ("101" if origin == "own" else "403")


def test_the_server_listens_on_loopback_only(served):
    port = urlsplit(served.address).port
    for name in {i[4][0] for i in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}:
        if not name.startswith("127."):
            with pytest.raises((ConnectionError, TimeoutError)):
                socket.create_connection((name, port), timeout=2)


def test_a_host_needs_the_token(tmp_path):
    from tests.studio_page import Running

    running = Running(tmp_path / "work", "--host", "127.0.0.1")
    try:
        parts = urlsplit(running.address)
        assert parts.query.startswith("token=")
        assert raw(running.address, f"GET / HTTP/1.1\nHost: {parts.netloc}").split()[1] == "401"
    finally:
        running.close()


def test_nothing_is_left_behind_when_it_is_ended(tmp_path, monkeypatch):
    from tests.studio_page import Running

    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", None)
    running = Running(tmp_path / "work")
    assert list(Path(tmp_path / "tmp").glob("fringeworks-studio-*"))
    running.process.send_signal(signal.SIGTERM)
    running.process.wait(20)
    assert not list(Path(tmp_path / "tmp").glob("fringeworks-studio-*"))
    running.close()
