"""A studio in a process of its own, and a browser before it."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

READY_S = 60.0


class Running:
    """A studio that was started by the command."""

    def __init__(self, folder, *options):
        self.folder = Path(folder)
        command = [sys.executable, "-m", "fringeworks", "studio", str(folder), "--no-show"]
        self.started_s = time.monotonic()
        # A file, because a full pipe would hold the server up.
        self.said = tempfile.TemporaryFile("w+")  # noqa: SIM115, closed with the studio
        self.process = subprocess.Popen(
            [*command, "--port", "0", *options],
            stdout=subprocess.PIPE,
            stderr=self.said,
            # NiceGUI does not compress under pytest.
            env={k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"},
            text=True,
        )
        try:
            said = self.process.stdout.readline()
            found = re.search(r"http://\S+", said)
            assert found, said + self.errors()
            self.address = found[0]
            self._wait()
        except BaseException:
            self.close()
            raise

    def _wait(self):
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        while time.monotonic() - self.started_s < READY_S:
            with contextlib.suppress(urllib.error.URLError, ConnectionError):
                opener.open(self.address, timeout=5).read()
                return
            time.sleep(0.1)
        raise AssertionError("the studio did not answer")

    def errors(self):
        """What the server has written to its standard error."""
        self.said.seek(0)
        return self.said.read()

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self.said.close()


class Visitor:
    """A page of a studio."""

    def __init__(self, context, address):
        self.address = address
        self.requests, self.complaints = [], []
        self.page = context.new_page()
        self.page.set_default_timeout(20_000)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(address)
        self.page.wait_for_selector(".fw-steps a")

    def step(self, name):
        """Go to a step, and wait until the page shows it."""
        button = self.page.locator(".fw-steps a", has_text=name)
        button.click()
        self.page.locator(".fw-steps a[aria-current=step]", has_text=name).wait_for()

    def click(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def choose(self, label, option):
        wanted = self.page.get_by_role("option", name=option, exact=True)
        self.page.get_by_label(label, exact=True).first.click()
        try:
            wanted.click(timeout=10_000)
        except playwright.TimeoutError:
            # The list closes when the server changes the field meanwhile: open it again.
            self.page.keyboard.press("Escape")
            self.page.get_by_label(label, exact=True).first.click()
            wanted.click()
        self.page.locator(".q-menu").wait_for(state="hidden")
        field = self.page.locator(".q-field", has=self.page.get_by_label(label, exact=True))
        field.filter(has_text=option).first.wait_for()

    def sees(self, text, timeout_s=60):
        self.page.get_by_text(text).first.wait_for(timeout=1000 * timeout_s)

    def comes_to(self, pattern, timeout_s=220):
        """Wait for an address; where it does not come, say what the page shows instead."""
        try:
            self.page.wait_for_url(pattern, timeout=1000 * timeout_s)
        except playwright.TimeoutError:
            shown = self.page.locator("body").inner_text()
            raise AssertionError(f"still at {self.page.url}, which shows:\n{shown}") from None

    def surface(self, timeout_s=60):
        """Wait for a surface, and return how many points it has."""
        self.page.wait_for_function(
            "document.querySelector('.fringe-viewer-mount')?.viewer?.surfaces?.length",
            timeout=1000 * timeout_s,
        )
        return self.page.evaluate(
            "document.querySelector('.fringe-viewer-mount').viewer.surfaces.at(-1).header.count"
        )
