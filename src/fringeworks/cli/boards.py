"""``fringeworks board``: calibration boards to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app

SECTION = "Stacks and rigs"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks board charuco:11x8:15:11 --paper A4 --out board.pdf",
)
def board(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="BOARD",
            help="chessboard:9x7:75 (inner corners, mm), charuco:8x6:30:22[:dictionary][:legacy] "
            "(squares, mm), circles:9x7:30 or asymmetric-circles:4x11:20.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="File to print: .pdf, .svg or .png.")],
    paper: Annotated[
        str, typer.Option(help="A5 … A0, letter, legal, tabloid, or width x height in mm.")
    ] = "A4",
    landscape: Annotated[
        bool | None,
        typer.Option(
            "--landscape/--portrait", help="Turn the paper; by default as the board fits."
        ),
    ] = None,
    white_on_black: Annotated[
        bool, typer.Option("--white-on-black", help="White circles on black.")
    ] = False,
    dpi: Annotated[int, typer.Option(help="Resolution of a .png, dots per inch.")] = 600,
) -> None:
    """Draw a calibration board to print, with rulers that check the printer's scale."""
    words = output.Output(out)
    output.check(out, "board")
    known = fw.parse_board(kind)
    with output.target(out, ".pdf") as place:
        fw.write_board(
            place, known, paper, landscape=landscape, white_on_black=white_on_black, dpi=dpi
        )
    words.wrote(out)
    words.say(
        f"Print at 100 % (actual size), check both rulers, and calibrate with --board {known.name}"
    )
