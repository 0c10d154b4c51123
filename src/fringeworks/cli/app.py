"""The application: commands in the order of the light, options of all commands, errors."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperGroup

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.panels import PanelCommand

Command = TypeVar("Command", bound=Callable[..., Any])

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


class Commands(typer.Typer):
    """Commands whose options may be fields of dataclasses, with help in panels."""

    def command(self, name: str | None = None, **given: Any) -> Callable[[Command], Command]:
        """Register a function as a command; see ``typer.Typer.command``."""
        register = super().command(name, cls=PanelCommand, **given)

        def registered(function: Command) -> Command:
            register(_grouped(function))
            return function

        return registered


def _grouped(command: Command) -> Command:
    """Let a command take dataclasses: each field becomes an option, with the field's default.

    A field is declared as an option of a command is: ``Annotated[type, typer.Option(...)]``.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        kind = hints[name]
        if isinstance(kind, type) and is_dataclass(kind):
            groups[name] = kind
            parameters += _options(kind)
        else:
            parameters.append(
                parameter.replace(annotation=kind, kind=inspect.Parameter.KEYWORD_ONLY)
            )

    @functools.wraps(command)
    def call(**given: Any) -> None:
        output.refuse_inputs(given)
        made = {
            name: kind(**{field.name: given.pop(field.name) for field in fields(kind)})
            for name, kind in groups.items()
        }
        command(**given, **made)

    signature = inspect.Signature(parameters)
    call.__signature__ = signature  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters} | {"return": None}
    return call  # type: ignore[return-value]


def _options(kind: type[Any]) -> list[inspect.Parameter]:
    """The fields of a dataclass as parameters of a command."""
    from fringeworks.cli import options

    # Files of options name these in annotations alone, so that they load without typer.
    names = vars(options) | {"typer": typer}
    hints = get_type_hints(kind, localns=names, include_extras=True)
    return [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(kind)
    ]


app = Commands(
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
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print all findings, not only the first five.")
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
    output.configure(quiet=quiet, verbose=verbose, log=log)
    if max_gb is not None or outside:
        limit = {} if max_gb is None else {"max_gb": max_gb}
        context.with_resource(fw.files.file_limits(**limit, outside=outside))
    for path in plugin or []:
        fw.load_plugin(path)
