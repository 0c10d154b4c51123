"""The command line, a file for each kind of work; ``fringeworks --help`` lists the commands."""

from __future__ import annotations

import sys
from typing import NoReturn

import typer
from typer.exceptions import TyperException

# Importing a file registers its commands, in the order in which help shows them.
from fringeworks.cli import calibration, comparison, measure, rig, show, stacks  # noqa: F401
from fringeworks.cli.common import app, stderr
from fringeworks.types import InputError


def main() -> None:
    """Entry point: 0 done, 2 bad input (one line on stderr), 1 anything else."""
    try:
        # A bare call is a question, not a mistake.
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except TyperException as error:
        _fail(error.format_message())
    except (typer.Abort, KeyboardInterrupt):
        stderr.print("interrupted")
        sys.exit(1)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str) -> NoReturn:
    """One line on stderr, exit code 2."""
    sys.stderr.write(f"fringeworks: {' '.join(message.split())}\n")
    sys.exit(2)
