"""Reads files by programs of their own, which may crash or run out of memory and time."""

from __future__ import annotations

import sys
from pathlib import Path

from fringeworks.files.limits import told
from fringeworks.types import FileProblem

MARGIN_BYTES = 2 << 30
"""Memory of a reading process beyond what it reads: Python, NumPy and a library."""
COPIES = 3
"""Copies of what it reads that reading and writing take."""
PROGRAM = "apart_program.py"
"""What sets the limits and starts the reader."""


def read_apart(
    reader: str, arguments: list[str], most_bytes: int, cpu_seconds: int, expected: str
) -> bytes:
    """Run a reader in a process of its own, and return what it writes.

    Parameters
    ----------
    reader : str
        Name of a file beside this one. Its function ``main`` takes the arguments as strings, writes
        to standard output, and raises what it cannot read.
    arguments : list of str
    most_bytes : int
        Largest size of what it reads.
    cpu_seconds : int
        Processor time that it may take; it may run twice as long.
    expected : str
        What the file should be, for messages.

    Raises
    ------
    FileProblem for a reader that fails, crashes or takes too long.
    """
    import subprocess  # 5 ms, for those only who read such files

    folder = Path(__file__).parent
    call = [sys.executable, "-P", str(folder / PROGRAM), str(folder / reader)]
    try:
        done = subprocess.run(
            [*call, str(MARGIN_BYTES + COPIES * most_bytes), str(cpu_seconds), *arguments],
            capture_output=True,
            timeout=2 * cpu_seconds,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        raise FileProblem(f"expected {expected}, got none in time") from error
    if done.returncode == 0:
        return done.stdout
    lines = done.stderr.decode("utf-8", "replace").splitlines()
    why = told(lines[-1]) if lines and done.returncode == 2 else "a damaged one"
    raise FileProblem(f"expected {expected}, got: {why}")
