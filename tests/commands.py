"""Commands of the command line, run by tests, and what they print."""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys

import typer

from fringeworks.cli import commands

COLUMNS = {
    "object",
    "method",
    "gamma",
    "noise",
    "bits",
    "fringes",
    "mean_abs_error_mm",
    "mean_error_mm",
    "std_error_mm",
    "max_abs_error_mm",
    "failed_fraction",
    "seconds",
}
"""Columns of a table of methods, at least."""


def run(*arguments, cwd=None, code=0):
    """Run a command in this process: a process of its own would import everything again."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        contextlib.chdir(cwd or "."),
    ):
        returned = commands.run([str(a) for a in arguments])
        said = []
        for stream in (out, err):
            stream.flush()
            said.append(stream.buffer.getvalue().decode())
    done = subprocess.CompletedProcess(arguments, returned, *said)
    return checked(done, code)


def run_alone(*arguments, code=0):
    """Run a command in a process of its own."""
    command = [sys.executable, "-W", "error", "-m", "fringeworks", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return checked(done, code)


def checked(done, code):
    assert done.returncode == code, done.stderr
    if code == 2:
        # Findings stand before the line of the error, on a slow machine also lines of progress.
        said = [
            line
            for line in done.stderr.splitlines()
            if not re.search(
                r"^(note|warning|error) \(|^and \d+ smaller finding|\(\d+ s(, \d+ s left)?\)$", line
            )
        ]
        assert said == done.stderr.splitlines()[-1:]
        assert len(said) == 1, done.stderr
        assert said[0].startswith("fringeworks: ")
        assert "Traceback" not in done.stderr
    return done


def walked(group, before=""):
    """All commands with their names."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from walked(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


COMMANDS = dict(walked(typer.main.get_command(commands.face.app)))
"""All commands by their names."""
