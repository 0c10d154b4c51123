"""Peers of serial devices on pseudo terminals, for tests."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import subprocess
import threading
import time
import tty
from pathlib import Path

ROOT = Path(__file__).parent.parent
SKETCH = ROOT / "examples" / "trigger_box" / "trigger_box.ino"


@contextlib.contextmanager
def terminal():
    """The peer's end of a pseudo terminal, and the name of the port."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    try:
        yield ours, os.ttyname(theirs)
    finally:
        for end in (ours, theirs):
            with contextlib.suppress(OSError):
                os.close(end)


@contextlib.contextmanager
def sketch(folder: Path):
    """The Arduino sketch, compiled for this machine, on a port."""
    program = folder / "box"
    source = ROOT / "tests" / "arduino_shim.cpp"
    define = f'-DSKETCH="{SKETCH}"'
    subprocess.run(["g++", "-O1", "-Wall", "-Werror", define, source, "-o", program], check=True)
    with terminal() as (ours, port):
        process = subprocess.Popen([program], stdin=ours, stdout=ours)
        try:
            yield port
        finally:
            process.kill()
            process.wait()


class Lines:
    """A peer that answers each line by a function, in a thread; ``at_once`` are bytes that are
    answered without the end of a line."""

    def __init__(self, ours, answer, at_once=b""):
        self._ours, self._answer, self._stop = ours, answer, threading.Event()
        self._at_once = at_once
        self.heard = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        begun = ""
        while not self._stop.is_set():
            if not select.select([self._ours], [], [], 0.02)[0]:
                continue
            try:
                arrived = os.read(self._ours, 100)
            except OSError:
                return
            for byte in arrived:
                if byte in self._at_once:
                    self._hear(chr(byte))
                elif byte == 10:
                    self._hear(begun)
                    begun = ""
                else:
                    begun += chr(byte)

    def _hear(self, line):
        self.heard.append(line)
        os.write(self._ours, self._answer(line).encode())

    def stop(self):
        self._stop.set()
        self._thread.join()


@contextlib.contextmanager
def peer(answer, at_once=b""):
    """A peer on a port."""
    with terminal() as (ours, port):
        made = Lines(ours, answer, at_once)
        try:
            yield made, port
        finally:
            made.stop()


def table_peer(grbl):
    """GRBL on a port."""
    return peer(grbl.answer, b"\x18?!~")


class Grbl:
    """GRBL 1.1: G-code of one axis, with moves that take time."""

    def __init__(self, fault=None, begins_s=0.0):
        self.target, self.arrives = 0.0, 0.0
        self.begins_s, self.moves_from, self.pauses = begins_s, 0.0, False
        self.locked, self.fault, self.moves = True, fault, []

    def answer(self, line):
        if line == "\x18":
            return "\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"
        if line == "?":
            now = time.monotonic()
            state = "Run" if self.moves_from <= now < self.arrives else "Idle"
            held = self.fault if self.fault and self.fault.isalpha() else None
            ended = self.pauses and now >= self.arrives and not held
            self.pauses &= not ended
            said = f"<{held or state}|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
            return f"ok\r\n{said}" if ended else said
        if line == "$X":
            self.locked = False
            return "[MSG:Caution: Unlocked]\r\nok\r\n"
        if line == "G4 P0.01":
            self.pauses = True
            return ""
        if line in ("", "G21 G92 X0"):
            return "error:9\r\n" if self.locked and line else "ok\r\n"
        return self._move(line)

    def _move(self, line):
        move = re.fullmatch(r"G90 G1 X(-?\d+\.\d{4}) F(\d+\.\d\d)", line)
        if self.locked or not move:
            return "error:9\r\n" if self.locked else "error:20\r\n"
        if self.fault and ":" in self.fault:
            return f"{self.fault}\r\n"
        way, feed = abs(float(move[1]) - self.target), float(move[2])
        self.target = float(move[1])
        self.moves_from = time.monotonic() + self.begins_s
        self.arrives = self.moves_from + way / feed * 60
        self.moves.append((self.target, feed))
        return "ok\r\n"
