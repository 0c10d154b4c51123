"""``fringeworks measure`` of one camera, and how its plain call starts without the other commands.

Loading every command and its options takes longer than the points of twelve frames. A call that
says no more than what is read and what is written is therefore answered without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fringeworks.cli import output
from fringeworks.cli.decoding import DecodingOptions
from fringeworks.cli.showing import ShowOptions

if TYPE_CHECKING:
    from fringeworks.cli.robots import RobotOptions

QUIET = ("--quiet", "-q")
"""The option of all commands that a plain call may have."""


def measure_points(
    stack: Path,
    rig_file: Path,
    out: Path | None,
    how: DecodingOptions,
    show: ShowOptions,
    ply: str = "points",
    robot: RobotOptions | None = None,
    **known: Any,
) -> None:
    """Measure the points of a capture, write them, and say what they are.

    ``robot`` says in which coordinates; ``known`` are further options of ``fringeworks.measure``.
    """
    words = output.Output(out, *show.targets)
    output.check(out, "points", content=ply)
    show.check()
    options = how.options
    with output.progress() as progress:
        progress("reading …")
        with ThreadPoolExecutor(1) as ahead:
            # Frames are decompressed without the interpreter's lock, while modules load.
            reading = ahead.submit(how.read_captured, stack)
            from fringeworks.files.rig import read_rig
            from fringeworks.pipeline.stacks import measure

            loaded = reading.result()
        calibrated = read_rig(rig_file)
        progress("measuring …")
        found = measure(loaded, calibrated, **known, **options)
    del loaded
    if robot is not None:
        found = robot.placed(found, calibrated, stack.name)
    # Without the maps of coordinates and their memory, where nothing draws them.
    shown = found if show.draws else found.points
    del found
    show.write_points(words, shown, calibrated, out, ply, name=stack.name)
    words.wrote(out, show.figure, show.report)


def plain_call(arguments: Sequence[str]) -> dict[str, Any] | None:
    """What ``measure STACK --rig RIG --out POINTS`` reads and writes; None for any other call.

    ``--out`` may be left out, and ``--quiet`` may come first. Mistakes are left to the command.
    """
    words = list(arguments)
    quiet = bool(words) and words[0] in QUIET
    words = words[quiet:]
    if words[:1] != ["measure"] or len(words) not in (4, 6):
        return None
    given: dict[str, Path] = {}
    rest = words[1:]
    while rest:
        name = rest.pop(0) if rest[0] in ("--rig", "--out") else "stack"
        if name in given or not rest or rest[0].startswith("-") or not rest[0]:
            return None
        given[name] = Path(rest.pop(0))
    if not {"stack", "--rig"} <= set(given):
        return None
    return {
        "stack": given["stack"],
        "rig_file": given["--rig"],
        "out": given.get("--out"),
        "quiet": quiet,
    }


def run_plain(stack: Path, rig_file: Path, out: Path | None, quiet: bool) -> int:
    """Answer a plain call; its exit code."""
    from fringeworks.types import InputError

    try:
        output.configure(quiet=quiet, verbose=False, log=None)
        output.refuse_inputs({"stacks": [stack], "rig_file": rig_file, "out": out})
        measure_points(stack, rig_file, out, DecodingOptions(), ShowOptions())
    except InputError as error:
        return output.fail(str(error), error.findings)
    return 0


def answered(arguments: Sequence[str]) -> int | None:
    """The exit code of a plain call, which is answered here; None for any other."""
    plain = plain_call(arguments)
    return None if plain is None else run_plain(**plain)
