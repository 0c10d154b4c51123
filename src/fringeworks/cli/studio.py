"""``fringeworks studio``: the whole measurement in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli.app import app

SECTION = "Devices"


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks studio measurements/")
def studio(
    folder: Annotated[Path, typer.Argument(help="Folder that is read and written.")] = Path("."),
    host: Annotated[
        str | None,
        typer.Option(help="Address to serve other machines on; the page then needs a token."),
    ] = None,
    port: Annotated[int | None, typer.Option(help="Port; by default 8137, or a free one.")] = None,
    show: Annotated[
        bool, typer.Option("--show/--no-show", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Set up, calibrate, scan, look and export on a page in the browser."""
    fw.run_studio(folder, host=host, port=port, show=show)
