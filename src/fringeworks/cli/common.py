"""What the commands share: the application, option types, progress and output."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from fringeworks.files.atomic import write_text
from fringeworks.signal.denoise import Denoiser
from fringeworks.types import Axis, InputError

app = typer.Typer(
    help="From photographs of projected fringes to heights with an error bar on every pixel.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
stderr = Console(stderr=True)

Output = Annotated[Path, typer.Option("--out", help="Folder to write to.")]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", help="Write the figures as JSON to this file, or to - for stdout."),
]


class AxisName(StrEnum):
    """Direction in which the fringes vary."""

    x = "x"
    y = "y"


class DenoiserName(StrEnum):
    """How frames are denoised before they are analysed."""

    emd = "emd"
    emd2d = "emd2d"
    bemd = "bemd"


def denoiser_of(name: DenoiserName | None) -> Denoiser | None:
    """The option as the library names it."""
    known: dict[DenoiserName, Denoiser] = {
        DenoiserName.emd: "emd",
        DenoiserName.emd2d: "emd2d",
        DenoiserName.bemd: "bemd",
    }
    return None if name is None else known[name]


Item = TypeVar("Item")


def list_of(kind: Callable[[str], Item], text: str, name: str) -> list[Item]:
    """A comma-separated option as a list."""
    try:
        items = [kind(part.strip()) for part in text.split(",") if part.strip()]
    except ValueError as error:
        raise InputError(f"--{name}: expected values separated by commas, got {text!r}") from error
    if not items:
        raise InputError(f"--{name}: expected at least one value, got {text!r}")
    return items


def write_json(path: Path | None, content: str) -> None:
    if path is None:
        return
    if str(path) == "-":
        sys.stdout.write(content)
    else:
        write_text(path, content)


def failures(reasons: dict[str, int]) -> str:
    """How many pixels failed for which reason, for people."""
    failed = (f"{name.replace('_', ' ')} {n}" for name, n in reasons.items() if name != "ok")
    return ", ".join(failed) or "none"


def axis_of(axis: AxisName | None) -> Axis | None:
    return None if axis is None else ("x" if axis is AxisName.x else "y")


@contextmanager
def show_progress(total: int | None = None) -> Iterator[Callable[[str], None]]:
    """A progress line on stderr, gone when done; silent where stderr is no terminal."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    hidden = not stderr.is_terminal
    with Progress(*columns, console=stderr, transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=total)
        yield lambda text: bar.update(task, description=text, advance=1)
