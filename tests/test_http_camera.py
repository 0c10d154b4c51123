"""Cameras with an address, against a server on loopback."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import re
import socket
import threading
import time
from functools import partial

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.http_camera import HttpCamera
from fringeworks.devices.protocols import Camera, Closing
from fringeworks.files import read_stack
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.types import CameraSettings, DeviceProblem, InputError, Region
from tests.http_peer import http_peer, jpeg

pytestmark = pytest.mark.system
PLAN = PatternPlan(
    128, 96, (PhaseSteps("x", 32.0, equal_steps(4)), PhaseSteps("x", 24.0, equal_steps(4)))
)


class Wall(Closing):
    """A projector, and the frames of a camera that looks at it."""

    name, size_px, bits, refresh_s = "wall", (128, 96), 8, 1 / 60

    def __init__(self):
        self.picture = np.zeros((96, 128), np.uint8)
        self.rng = np.random.default_rng(3)
        self.shown = 0

    def show(self, picture):
        self.picture, self.shown = picture.copy(), self.shown + 1
        return time.monotonic()

    def frame(self):
        noise = self.rng.normal(0, 1.0, self.picture.shape)
        return np.clip(20 + 0.7 * self.picture + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("style", ["stream", "bare", "snapshot", "closing"])
def test_a_plan_is_captured(tmp_path, style):
    wall = Wall()
    with http_peer(wall.frame, style, period_s=0.01) as peer, HttpCamera(peer.address) as camera:
        assert isinstance(camera, Camera)
        assert camera.name == peer.address
        limits = camera.limits()
        assert (limits.width_px, limits.height_px, limits.pixel_formats) == (128, 96, ("Mono8",))
        folder = capture(wall, camera, PLAN, tmp_path / "c")
    for frame, picture in zip(read_stack(folder).frames, fw.encode(PLAN), strict=True):
        assert np.abs(frame - (20 + 0.7 * picture)).mean() < 3


@pytest.mark.parametrize("style", ["stream", "snapshot"])
@pytest.mark.parametrize("how", ["silent", "cut"])
def test_unplugged_in_the_middle(tmp_path, style, how):
    """It is said within a second, what was taken is kept, and the capture goes on from there."""
    wall = Wall()
    with http_peer(wall.frame, style, period_s=0.01) as peer:
        gone = []
        show = wall.show

        def interrupted(picture):
            if wall.shown == 7 and not gone:
                gone.append(time.monotonic())
                (peer.silent if how == "silent" else peer.cut).set()
            return show(picture)

        wall.show = interrupted
        with (
            HttpCamera(peer.address) as camera,
            pytest.raises(DeviceProblem, match="unplugged or switched off, or the network is down"),
        ):
            capture(wall, camera, PLAN, tmp_path / "c")
        assert time.monotonic() - gone[0] < 1.0
        there = {path: path.read_bytes() for path in (tmp_path / "c").glob("*.png")}
        assert len(there) >= 2
        peer.silent.clear()
        peer.cut.clear()
        wall.show = show
        with HttpCamera(peer.address) as camera:
            capture(wall, camera, PLAN, tmp_path / "c", resume=True)
        assert all(path.read_bytes() == kept for path, kept in there.items())
    assert len(read_stack(tmp_path / "c").frames) == PLAN.frames


def test_frames_in_colour_and_damaged_ones():
    with (
        http_peer(lambda: np.full((20, 30), 77), grey=False) as peer,
        HttpCamera(peer.address) as camera,
    ):
        grab = camera.grab()
        assert grab.complete
        assert np.abs(grab.pixels.astype(int) - 77).max() <= 1
        peer.damaged = True
        while (grab := camera.grab()).complete:
            pass
        peer.damaged = False
        while not (grab := camera.grab()).complete:
            pass


@pytest.mark.parametrize(
    ("style", "said"),
    [
        ("text", "expected an image or a stream of images .*, got text/html"),
        ("missing", "expected an image, got the answer 404 Not Found"),
        (
            "password",
            "expected an image, got the answer 401 Unauthorized; give user:password@ before the host",
        ),
    ],
)
def test_addresses_without_a_camera(style, said):
    with http_peer(lambda: np.zeros((9, 9)), style) as peer:
        with pytest.raises(DeviceProblem, match=f"{peer.address}: {said}"):
            HttpCamera(peer.address)
        address = peer.address
    with pytest.raises(DeviceProblem, match="expected a camera that answers, got none"):
        HttpCamera(address)
    with pytest.raises(InputError, match="address: expected http://HOST/PATH, got 'ftp://x'"):
        HttpCamera("ftp://x")


def test_words_passwords_and_settings():
    with http_peer(lambda: np.zeros((9, 12)), "snapshot") as peer:
        address = f"http://me:a%3Ab@127.0.0.1:{peer.port}/shot?size=full"
        with fw.devices.open_camera(address) as camera:
            assert camera.name == f"http://127.0.0.1:{peer.port}/shot"
            assert base64.b64decode(peer.authorization.split()[1]) == b"me:a:b"
            used = camera.configure(CameraSettings(triggered=False, pixel_format="Mono8"))
            assert used == CameraSettings(None, None, Region(0, 0, 12, 9), "Mono8", False)
            with pytest.raises(InputError, match="exposure_ms: expected no setting; set it on the"):
                camera.configure(CameraSettings(exposure_ms=5.0))
        with pytest.raises(DeviceProblem, match="expected an open camera, got a closed one"):
            camera.grab()


class RawCamera:
    """A camera of another maker: ``answer`` gets the request's text and gives the bytes."""

    def __init__(self, answer):
        self._answer, self._heard = answer, socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self._heard.getsockname()[1]}/v"
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        while True:
            try:
                connection, _ = self._heard.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                while request := connection.recv(4096).decode("latin-1"):
                    said, closes = self._answer(request)
                    connection.sendall(said)
                    if closes:
                        break

    def close(self):
        self._heard.close()


IMAGE = jpeg(np.full((12, 16), 90, np.uint8))


def snapshot(kind="Content-Type: image/jpeg", *, closes=False):
    head = f"HTTP/1.1 200 OK\r\n{kind}\r\nContent-Length: {len(IMAGE)}\r\n\r\n"
    return lambda _: (head.encode() + IMAGE, closes)


def mjpeg(kind, mark=b"--frame"):
    part = mark + b"\r\nContent-Length: %d\r\n\r\n" % len(IMAGE) + IMAGE + b"\r\n"
    head = f"HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\n\r\n".encode()
    return lambda _: (head + 20 * part, True)


def digest(request, *, qop=True, algorithm="MD5"):
    """A camera that asks for a password by Digest, as RFC 7616 computes it."""
    given = dict(re.findall(r'(\w+)="?([^",\r]+)', request.partition("Digest ")[2]))
    made = hashlib.md5 if algorithm == "MD5" else hashlib.sha256

    def hashed(*words):
        return made(":".join(words).encode()).hexdigest()

    if given:
        who, what = hashed("eva", "a camera", "p:w"), hashed("GET", given["uri"])
        middle = (given["nc"], given["cnonce"], "auth") if qop else ()
        if given["response"] == hashed(who, "n0", *middle, what) and given["username"] == "eva":
            return snapshot()(request)
    asks = f'realm="a camera", nonce="n0", algorithm={algorithm}' + ', qop="auth"' * qop
    head = f"HTTP/1.1 401 No\r\nWWW-Authenticate: Digest {asks}\r\nContent-Length: 0\r\n\r\n"
    return head.encode(), False


ODD = {
    "ends each connection and says so": snapshot(
        "Content-Type: image/jpeg\r\nConnection: close", closes=True
    ),
    "bytes": snapshot("Content-Type: application/octet-stream"),
    "no type": snapshot("X: y"),
    "other boundary": mjpeg("multipart/x-mixed-replace; boundary=other"),
    "no boundary": mjpeg("multipart/x-mixed-replace"),
    "mixed": mjpeg("multipart/mixed; boundary=frame"),
}


@pytest.mark.parametrize("kind", ODD)
def test_cameras_with_odd_headers(kind):
    peer = RawCamera(ODD[kind])
    with contextlib.closing(peer), HttpCamera(peer.address) as camera:
        for _ in range(3):
            assert (camera.grab().pixels == 90).all()


@pytest.mark.parametrize(
    "how", [{}, {"qop": False}, {"algorithm": "SHA-256"}], ids=["md5", "old", "sha"]
)
def test_a_password_by_digest(how):
    peer = RawCamera(partial(digest, **how))
    with contextlib.closing(peer):
        address = peer.address.replace("//", "//eva:p%3Aw@")
        with HttpCamera(address) as camera:
            assert (camera.grab().pixels == 90).all()
            assert camera.name == peer.address
        with pytest.raises(DeviceProblem, match="the user or the password is not right"):
            HttpCamera(peer.address.replace("//", "//eva:wrong@"))
        with pytest.raises(DeviceProblem, match="401 No; give user:password@ before the host"):
            HttpCamera(peer.address)


def test_a_camera_that_moved_or_asks_in_an_unknown_way():
    moved = b"HTTP/1.1 302 Found\r\nLocation: /real.jpg\r\nContent-Length: 0\r\n\r\n"
    peer = RawCamera(lambda _: (moved, True))
    with (
        contextlib.closing(peer),
        pytest.raises(DeviceProblem, match="its images are at /real.jpg now: give this address"),
    ):
        HttpCamera(peer.address)
    asks = b"HTTP/1.1 401 No\r\nWWW-Authenticate: Bearer\r\nContent-Length: 0\r\n\r\n"
    peer = RawCamera(lambda _: (asks, True))
    with (
        contextlib.closing(peer),
        pytest.raises(DeviceProblem, match="by Basic, or by Digest with .*, got Bearer"),
    ):
        HttpCamera(peer.address.replace("//", "//eva:x@"))


@pytest.mark.parametrize("address", ["http://h:99999/", "http://h:x/", "http://[::1/", "http:///x"])
def test_addresses_that_are_none(address):
    with pytest.raises(InputError, match="address: expected http://HOST"):
        HttpCamera(address)
