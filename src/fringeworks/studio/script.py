"""What was clicked, as commands and as Python."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Any, Literal

Measured = Literal["pair", "stack", "recipe", "result"]
"""How a surface came about."""


@dataclass(frozen=True)
class Command:
    """Something that was done, as a command and as Python."""

    shell: str
    python: str
    replaces: str | None = None
    """Folder of a pose: one that is taken again takes the place of the one before."""


def set_up_command(words: tuple[str, str], frames: int) -> Command:
    """What does a set-up; ``words`` are those of projector and camera."""
    return _command(
        f"setup --projector {_quoted(words[0])} --camera {_quoted(words[1])} "
        f"--frames {frames} --axes x,y --out setup.toml",
        _with_devices(
            words,
            f"found = fw.set_up(projector, camera, frames={frames}, axes=('x', 'y'))",
            f"fw.write_setup('setup.toml', found, projector={words[0]!r}, camera={words[1]!r})",
        ),
    )


def board_command(board: str) -> Command:
    """What draws a board to print."""
    return _command(
        f"board --kind {_quoted(board)} --paper A4 --out board.pdf",
        f"fw.write_board('board.pdf', {board!r})",
    )


def capture_command(
    words: tuple[str, str], name: str, *, exposures: int = 1, average: int = 1
) -> Command:
    """What takes the frames of an object, or of a pose of a board."""
    more = f" --hdr {exposures}" if exposures > 1 else ""
    more += f" --average {average}" if average > 1 else ""
    given = f"projector, camera, stored.plan, {name!r}"
    averaged = "" if average == 1 else f", average={average}"
    taking = (
        f"fw.capture({given}, settings=stored.settings{averaged})"
        if exposures == 1
        else f"fw.capture_hdr({given}, {exposures}{averaged})"
    )
    return _command(
        f"capture --setup setup.toml --camera {_quoted(words[1])}{more} --out {_quoted(name)}",
        "stored = fw.read_setup('setup.toml')\n" + _with_devices(words, taking),
    )


def calibrate_command(board: str) -> Command:
    """What calibrates with the poses of a board."""
    return _command(
        f"calibrate board/ --board {_quoted(board)} --out rig.toml",
        f"fw.write_rig('rig.toml', fw.calibrate_stacks('board', {board!r}).rig)",
    )


def inspect_command(name: str) -> Command:
    """What judges a part by the recipe in the folder."""
    return _command(
        f"inspect {_quoted(name)} --recipe recipe.toml",
        f"print(fw.inspect({name!r}, 'recipe.toml').verdict)",
    )


def paper_command(size: int) -> Command:
    """What makes the dissertation's figures."""
    return _command(
        f"paper --size {size} --out dissertation", f"fw.write_paper('dissertation', size={size})"
    )


def export_command(
    source: str, method: str, options: dict[str, Any], name: str, kind: str, *, how: Measured
) -> Command:
    """What measures a capture, or reads a result, and writes it or its report."""
    report = name.endswith((".html", ".pdf"))
    mesh = f" --ply {kind}" if name.endswith(".ply") and kind == "mesh" else ""
    target = f"{'--report' if report else '--out'} {_quoted(name)}{mesh}"
    if how == "pair":
        told = "".join(f" --option {_quoted(f'{key}={value}')}" for key, value in options.items())
        made = f"fw.reconstruct({source!r}, {method!r}, **{options!r})"
        return _command(
            f"reconstruct {_quoted(source)} --method {method}{told} {target}",
            _written(name, kind, made, ".surface"),
        )
    if how == "stack":
        made = f"fw.measure({source!r}, 'rig.toml')"
        return _command(
            f"measure {_quoted(source)} --rig rig.toml {target}",
            _written(name, kind, made, ".points"),
        )
    if how == "recipe":
        made = f"fw.inspect({source!r}, 'recipe.toml').surface"
        return _command(
            f"inspect {_quoted(source)} --recipe recipe.toml {target}",
            _written(name, kind, made, ""),
        )
    return _command(
        f"report {_quoted(source)} --out {_quoted(name)}"
        if report
        else f"convert {_quoted(source)} {_quoted(name)}{mesh}",
        _written(name, kind, f"fw.read({source!r})", ""),
    )


def _command(shell: str, python: str) -> Command:
    return Command(f"fringeworks {shell}", python)


def _with_devices(words: tuple[str, str], *lines: str) -> str:
    """Python that runs lines with open devices."""
    opened = f"projector, camera = fw.open_devices({words[0]!r}, {words[1]!r})"
    return "\n".join([opened, "with projector, camera:", *(f"    {line}" for line in lines)])


def _written(name: str, kind: str, result: str, part: str) -> str:
    """Python that writes a result or its report."""
    if name.endswith((".html", ".pdf")):
        return f"fw.write_report({name!r}, {result})"
    mesh = ", kind='mesh'" if kind == "mesh" else ""
    return f"fw.write({name!r}, {result}{part}{mesh})"


def _quoted(text: str) -> str:
    return shlex.quote(text)
