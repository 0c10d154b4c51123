"""The application: commands in the order of the light, options of all commands, errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import fringeworks as fw
from fringeworks.cli import output

SECTIONS = ("Patterns", "Devices", "Two frames", "Stacks and rigs", "Results", "Simulation")
"""Groups of commands, in the order of the light."""


class LightGroup(TyperGroup):
    """Lists the commands by section."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write a section of the help for each group."""
        for section in SECTIONS:
            commands = [
                (name, (command.help or "").partition("\n")[0])
                for name, command in self.commands.items()
                if getattr(command, "rich_help_panel", None) == section
            ]
            with formatter.section(section):
                formatter.write_dl(commands)


app = typer.Typer(
    cls=LightGroup,
    help="From photographs of projected fringes to heights and points with an error bar on every "
    "pixel.",
    epilog="A name '-' stands for standard output. Exit codes: 0 done, 2 bad input, "
    "130 interrupted.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"fringeworks {fw.__version__}")
        raise typer.Exit


@app.callback()
def all_commands(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001, answered by its callback
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print errors only, and what goes to '-'.")
    ] = False,
    log: Annotated[
        Path | None, typer.Option("--log", help="Append messages with date and time to this file.")
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", help="Python file that registers methods or devices; repeatable."),
    ] = None,
    max_gb: Annotated[
        float | None,
        typer.Option("--max-gb", help="Memory that the content of one file may take, GB."),
    ] = None,
    outside: Annotated[
        bool,
        typer.Option("--outside", help="Let a capture.toml name files outside its folder."),
    ] = False,
) -> None:
    """Options of all commands stand before the command."""
    output.configure(quiet=quiet, log=log)
    if max_gb is not None or outside:
        limit = {} if max_gb is None else {"max_gb": max_gb}
        context.with_resource(fw.files.file_limits(**limit, outside=outside))
    for path in plugin or []:
        fw.load_plugin(path)
