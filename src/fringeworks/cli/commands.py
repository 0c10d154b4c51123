"""All commands, and what becomes of their errors."""

from __future__ import annotations

from collections.abc import Sequence

import typer
from typer.exceptions import TyperException

import fringeworks as fw
from fringeworks.cli import app as face
from fringeworks.cli import output

# Importing a file registers its commands. The order of the help is that of the sections.
from fringeworks.cli import devices, rigs, pairs, patterns, results  # noqa: F401 isort: skip
from fringeworks.cli import inspecting, batches, comparing, merging, meshing  # noqa: F401 isort: skip
from fringeworks.cli import deviating, reports, robots, scoring, simulation, stacks  # noqa: F401 isort: skip
from fringeworks.cli import certifying, foreseeing, studying  # noqa: F401 isort: skip


def run(arguments: Sequence[str]) -> int:
    """Run one command; its exit code."""
    try:
        # A bare call is a question, not a mistake.
        code = face.app(list(arguments) or ["--help"], standalone_mode=False)
    except fw.files.FolderInUse as error:
        return output.fail(f"{error}; choose another folder, or add --force to write into it")
    except fw.InputError as error:
        return output.fail(str(error), error.findings)
    except TyperException as error:
        message = error.format_message().replace("Value error, ", "")
        unknown = getattr(error, "option_name", None)
        if any(unknown in one.opts for one in typer.main.get_command(face.app).params):
            message = f"No such option: {unknown}; options of all commands stand before the command"
        return output.fail(message)
    except typer.Abort:
        return 130
    return code if isinstance(code, int) else 0
