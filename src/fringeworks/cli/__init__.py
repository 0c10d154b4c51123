"""The command line, a file for each kind of work; ``fringeworks --help`` lists the commands.

A command parses its arguments, calls the library, and prints. It imports nothing heavy itself:
``import fringeworks as fw`` loads a name when it is first used.
"""

from __future__ import annotations

import sys

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 + the number of the signal SIGINT, as shells expect it."""


def main() -> None:
    """Entry point: exit code 0 done, 2 bad input (one line on stderr), 130 interrupted, 1 else."""
    if sys.argv[1:] == ["--version"]:
        # Asked by programs, which wait for it: the commands take ten times as long to load.
        import fringeworks as fw

        sys.stdout.write(f"fringeworks {fw.__version__}\n")
        return
    try:
        code = _run(sys.argv[1:])
    except KeyboardInterrupt:
        code = INTERRUPTED
    if code == INTERRUPTED:
        sys.stderr.write("fringeworks: interrupted\n")
    sys.exit(code)


def _run(arguments: list[str]) -> int:
    """Run a command; its exit code. Imports are here, so that Ctrl-C during them is answered."""
    if "measure" in arguments[:2]:
        from fringeworks.cli.measuring import answered

        code = answered(arguments)
        if code is not None:
            return code
    from fringeworks.cli.commands import run

    return run(arguments)
