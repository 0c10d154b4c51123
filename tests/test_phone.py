"""A phone as a camera: Chromium with a made-up camera before a running studio."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import ssl
import stat
import subprocess
import threading
import time
import urllib.parse

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from fringeworks.devices.opening import open_camera
from fringeworks.devices.protocols import Camera
from fringeworks.studio.workspace import Workspace, checked_words
from fringeworks.types import CameraSettings, DeviceProblem, InputError

from tests.studio_page import Running, Visitor, playwright  # isort: skip

pytestmark = pytest.mark.system

FAKE = [
    "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
    "--no-sandbox",
]
"""Chromium shows a made-up camera, and gives it without asking."""

STOPPED_MS = 3000
"""Time for which a page runs no script, ms."""
HIDDEN = "(state) => Object.defineProperty(document, 'visibilityState', { value: state, configurable: true })"


@pytest.fixture(scope="module")
def phone():
    """A browser that has a camera."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("no chromium: the page of the phone is not tried")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=FAKE)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    running = Running(tmp_path_factory.mktemp("studio"))
    yield running
    running.close()


@pytest.fixture
def page(phone, studio):
    """The page of the phone, whose camera runs."""
    page = phone.new_page()
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(f"{studio.address}phone")
    page.get_by_role("button", name="Start").click()
    page.get_by_text("The phone is the camera.").wait_for()
    yield page
    page.close()
    assert not complaints


@pytest.mark.usefixtures("page")
def test_pictures_and_settings(studio):
    with open_camera(f"phone:{studio.folder}") as camera:
        assert isinstance(camera, Camera)
        assert camera.name.startswith("phone fake_device")
        limits = camera.limits()
        first, second = camera.grab(), camera.grab()
        assert first.complete
        assert first.pixels.shape == (limits.height_px, limits.width_px)
        # The made-up camera counts its frames in the picture.
        assert first.pixels.std() > 10
        assert np.any(first.pixels != second.pixels)
        assert [first.number, second.number] == [0, 1]
        assert camera.configure(CameraSettings(triggered=False)).pixel_format == "Mono8"
        with pytest.raises(InputError, match="gain_db: expected no such setting; this phone's"):
            camera.configure(CameraSettings(gain_db=3.0))
        if limits.exposure_ms is None:
            with pytest.raises(InputError, match="exposure_ms: expected no such setting"):
                camera.configure(CameraSettings(exposure_ms=10.0))
    file = studio.folder / "phone.json"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_a_silent_phone_is_said_within_a_second_and_goes_on(page, studio):
    with open_camera(f"phone:{studio.folder}") as camera:
        camera.grab()
        # A phone with a locked screen runs no script.
        page.evaluate(
            f"() => setTimeout(() => {{ const end = Date.now() + {STOPPED_MS};"
            "while (Date.now() < end); })"
        )
        time.sleep(0.1)
        begin_s = time.monotonic()
        with pytest.raises(DeviceProblem, match="its screen is locked.*unlock it.*and resume"):
            camera.grab()
        assert time.monotonic() - begin_s < 1.0
        page.wait_for_timeout(STOPPED_MS)
        assert camera.grab().complete


def test_a_page_in_the_background_takes_no_pictures(page, studio):
    with open_camera(f"phone:{studio.folder}") as camera:
        page.evaluate(HIDDEN, "hidden")
        with pytest.raises(DeviceProblem, match="its page is in the background"):
            camera.grab()
        page.evaluate(HIDDEN, "visible")
        page.wait_for_timeout(300)
        assert camera.grab().complete


def test_the_studio_offers_the_phone_and_its_guard_keeps_others_out(page, studio, phone):
    visitor = Visitor(phone, studio.address)
    visitor.step("Set up")
    visitor.page.get_by_label("Camera", exact=True).first.click()
    visitor.page.get_by_role("option", name="phone", exact=True).wait_for()
    visitor.page.close()
    assert checked_words("phone", Workspace(studio.folder)) == f"phone:{studio.folder}"
    assert checked_words("phone:/etc", Workspace(studio.folder)) == f"phone:{studio.folder}"
    assert page.get_by_text("The phone is the camera.").is_visible()
    address = studio.address.replace("http", "ws") + "phone/socket"
    for origin in (None, "http://elsewhere.example"):
        with pytest.raises(InvalidStatus), connect(address, origin=origin):
            pass


def test_a_page_that_is_closed_and_opened_again(phone, studio):
    page = phone.new_page()
    page.goto(f"{studio.address}phone")
    page.get_by_role("button", name="Start").click()
    page.get_by_text("The phone is the camera.").wait_for()
    with open_camera(f"phone:{studio.folder}") as camera:
        camera.grab()
        page.close()
        begin_s = time.monotonic()
        with pytest.raises(DeviceProblem, match="its page was closed"):
            camera.grab()
        assert time.monotonic() - begin_s < 1.0
        page = phone.new_page()
        page.goto(f"{studio.address}phone")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("The phone is the camera.").wait_for()
        assert camera.grab().complete
    page.close()


@pytest.mark.usefixtures("page")
def test_without_a_phone_or_without_the_key(studio, tmp_path):
    with pytest.raises(DeviceProblem, match="expected a studio that runs in .* and a phone that"):
        open_camera(f"phone:{tmp_path}")
    told = json.loads((studio.folder / "phone.json").read_text())
    (tmp_path / "phone.json").write_text(json.dumps(told | {"key": "00" * 32}))
    with pytest.raises(DeviceProblem, match="expected a studio that runs in"):
        open_camera(f"phone:{tmp_path}")
    with pytest.raises(DeviceProblem, match="phone: expected phone:FOLDER, got phone alone"):
        open_camera("phone")
    # Who guessed the key wrong disturbs nobody.
    with open_camera(f"phone:{studio.folder}") as camera:
        assert camera.grab().complete


class Proxy:
    """A server with a certificate of its own before a studio, as Caddy or a tunnel is."""

    def __init__(self, folder, port):
        key, certificate = folder / "key.pem", folder / "certificate.pem"
        words = [
            "req",
            "-x509",
            "-newkey",
            "rsa:2048",
            "-nodes",
            "-days",
            "1",
            "-subj",
            "/CN=127.0.0.1",
        ]
        made = ["openssl", *words, "-keyout", str(key), "-out", str(certificate)]
        subprocess.run(made, check=True, capture_output=True)
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(certificate, key)
        self._behind = port
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                plain, _ = self._socket.accept()
                threading.Thread(target=self._join, args=(plain,), daemon=True).start()

    def _join(self, plain):
        with contextlib.suppress(OSError):
            outer = self._context.wrap_socket(plain, server_side=True)
            inner = socket.create_connection(("127.0.0.1", self._behind))
            back = threading.Thread(target=self._pump, args=(inner, outer), daemon=True)
            back.start()
            self._pump(outer, inner)

    @staticmethod
    def _pump(one, other):
        with contextlib.suppress(OSError), one, other:
            while content := one.recv(65536):
                other.sendall(content)

    def close(self):
        self._socket.close()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl for a certificate")
def test_behind_a_certificate(phone, tmp_path):
    """The guard, its token and the web socket stay as they are."""
    running = Running(tmp_path / "studio", "--host", "127.0.0.1")
    address = urllib.parse.urlsplit(running.address)
    proxy = Proxy(tmp_path, address.port)
    context = phone.new_context(ignore_https_errors=True)
    try:
        page = context.new_page()
        refused = page.goto(f"https://127.0.0.1:{proxy.port}/phone")
        assert refused.status == 401
        page.goto(f"https://127.0.0.1:{proxy.port}/?{address.query}")
        page.wait_for_selector(".fw-steps a")
        page.goto(f"https://127.0.0.1:{proxy.port}/phone")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("The phone is the camera.").wait_for()
        with open_camera(f"phone:{running.folder}") as camera:
            assert camera.grab().complete
    finally:
        context.close()
        proxy.close()
        running.close()
