"""A service in a process of its own, and programs that talk to it."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np

import fringeworks as fw
from fringeworks.types import RobotFrame

PLUGIN = Path(__file__).with_name("quick_scanner.py")
READY_S = 60.0
TOKEN = "a-token-for-the-tests"
HEADERS = {"authorization": f"Bearer {TOKEN}"}
RECIPE = """kind = "recipe"
within = "nose"
[areas.nose]
box = [50, 40, 78, 65]
[[tolerances]]
name = "sharp"
quantity = "median_sigma"
areas = ["nose"]
max = 0.001
"""


def quick_rig():
    """The true rig of the quick scanner."""
    return fw.simulate.standard_rig(scale=0.15)


def quick_plan():
    """The plan that it shows."""
    return fw.simulate.fringe_plan(quick_rig(), both=False)


def mounted(rig):
    """A rig whose camera stands beside a robot."""
    T = np.eye(4)
    T[:3, 3] = 100.0, 200.0, 300.0
    return replace(rig, robot=RobotFrame("base", T, np.diag([1e-8] * 3 + [1e-4] * 3)))


class Running:
    """A service that was started by the command, on the quick scanner."""

    def __init__(self, folder, *options, scene="", rig=None):
        self.folder = Path(folder)
        self.folder.mkdir(exist_ok=True)
        fw.files.write_rig(self.folder / "rig.toml", rig or quick_rig())
        fw.files.write_plan(self.folder / "plan.toml", quick_plan())
        words = "quick" + (f":{scene}" if scene else "")
        self.command = [
            *(sys.executable, "-m", "fringeworks", "--plugin", str(PLUGIN), "serve"),
            *(str(self.folder / "srv"), str(self.folder / "plan.toml")),
            *("--rig", str(self.folder / "rig.toml"), "--projector", "quick"),
            *("--camera", words, "--port", "0", *options),
        ]
        self.begin()

    def begin(self):
        self.said = tempfile.TemporaryFile("w+")  # noqa: SIM115, closed with the service
        environment = os.environ | {
            "FRINGEWORKS_TOKEN": TOKEN,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        self.process = subprocess.Popen(
            self.command, stdout=subprocess.PIPE, stderr=self.said, env=environment, text=True
        )
        line = self.process.stdout.readline()
        found = re.search(r"http://\S+?(?=/$)", line.strip())
        assert found, line + self.errors()
        self.address = found[0]
        self.port = int(self.address.rpartition(":")[2])
        self.web = httpx.Client(base_url=self.address, headers=HEADERS, timeout=60)
        until = time.monotonic() + READY_S
        while time.monotonic() < until:
            with contextlib.suppress(httpx.TransportError):
                if self.web.get("/health").status_code == 200:
                    return
            time.sleep(0.05)
        raise AssertionError("the service did not answer")

    def scan(self, **wanted):
        """Ask for a scan; its job."""
        answer = self.web.post("/v1/scans", json=wanted)
        assert answer.status_code == 202, answer.text
        return answer.json()

    def ended(self, job, wait_s=60):
        """A job when it has ended."""
        number = job if isinstance(job, int) else job["number"]
        found = self.web.get(f"/v1/jobs/{number}", params={"wait_s": wait_s}).json()
        assert found["state"] not in ("waiting", "running"), found
        return found

    def worker(self):
        """Process of the worker; None where there is none."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        for found in tasks:
            for pid in found.read_text().split():
                words = Path(f"/proc/{pid}/cmdline").read_bytes()
                if b"spawn_main" in words:
                    return int(pid)
        return None

    def kill_worker(self):
        """Kill the worker; whether there was one."""
        pid = self.worker()
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return pid is not None

    def raw(self, content, *, read=True):
        """Send bytes as they are; what is answered."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=30) as connection:
            with contextlib.suppress(ConnectionError):
                connection.sendall(content)
            return connection.recv(4096).decode("latin-1") if read else ""

    def errors(self):
        """What the server has written to its standard error."""
        self.said.seek(0)
        return self.said.read()

    def kill(self):
        """End it as a power cut does, its worker as well."""
        pid = self.worker()
        self.process.kill()
        self.process.wait()
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._forget()

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._forget()

    def _forget(self):
        self.web.close()
        self.process.stdout.close()
        self.said.close()
