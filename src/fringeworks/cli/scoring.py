"""``fringeworks score``: the errors of anyone's results on scenes whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import Force, JsonFile

if TYPE_CHECKING:
    from fringeworks.evaluate.scored_scenes import BenchmarkScene
    from fringeworks.evaluate.scoring import Score

SECTION = "Results"
COLUMNS = {
    "scene": "scene",
    "quantity": "quantity",
    "unit": "unit",
    "measured": "measured",
    "mean": "mean",
    "mean_abs": "mean |e|",
    "rms": "rms",
    "p95": "95 %",
    "wrong_orders_ppm": "wrong orders, ppm",
    "within_1_sigma": "in 1 σ",
    "within_2_sigma": "in 2 σ",
}
"""Columns of the table that is printed, by the fields of a score; the JSON has all."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks score --scene bust --out bust/, then fringeworks score "
    "mine.npz --scene bust; fringeworks score results/ --truth test/",
)
def score(
    result: Annotated[
        Path | None,
        typer.Argument(help="Result to score: a file, or with --truth a folder; none for frames."),
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="Scene of the benchmark; without it, all are listed.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="Folder of true depth maps in FPP-ML-Bench's layout.")
    ] = None,
    holds: Annotated[
        str | None,
        typer.Option(help="Content of a map: depth, height, coordinate, phase, displacement."),
    ] = None,
    scale: Annotated[float, typer.Option(help="Millimetres per unit of the maps.")] = 1.0,
    out: Annotated[Path | None, typer.Option(help="Folder to write a scene's frames to.")] = None,
    force: Force = False,
    json_file: JsonFile = None,
) -> None:
    """Score results on scenes with a known truth: rms, mean, 95 %, wrong orders, coverage of σ."""
    words = output.Output(json_file)
    if result is None:
        _frames(words, scene, out, force)
        return
    if out is not None:
        raise fw.InputError("--out: it is for a scene's frames and cannot be combined with results")
    if (scene is None) == (truth is None):
        raise fw.InputError("expected either --scene, or --truth with a folder")
    if truth is not None:
        if holds not in (None, "depth"):
            raise fw.InputError(f"--holds: expected depth with --truth, got {holds!r}")
        rows = fw.evaluate.score_depths(result, truth, scale=scale)
    else:
        assert scene is not None
        rows = (_scored(result, scene, holds, scale),)
    _tell(words, rows)
    output.write_json(json_file, {"rows": [row.as_dict() for row in rows]})
    words.wrote(json_file)


def _scored(result: Path, scene: str, holds: str | None, scale: float) -> Score:
    """The score of a file: a result of this package, or a map of another program."""
    from fringeworks.files.foreign_maps import named_map, read_map, read_named_map

    known: Any = {"quantity": holds}
    name = named_map(result)
    if name is not None:
        if holds not in (None, name):
            raise fw.InputError(f"--holds: expected {name} for {result}, got {holds!r}")
        values, sigma, _ = read_named_map(result)
        spread = None if sigma is None else sigma * scale
        return fw.evaluate.score(values * scale, scene, quantity=name, sigma=spread)  # type: ignore[arg-type]
    if holds is not None:
        return fw.evaluate.score(read_map(result, scale=scale), scene, **known)
    return fw.evaluate.score(fw.read(result), scene)


def _frames(words: output.Output, scene: str | None, out: Path | None, force: bool) -> None:
    """List the scenes, or write the frames of one."""
    known = fw.evaluate.benchmark_scenes()
    if scene is None:
        if out is not None:
            raise fw.InputError(f"--scene: expected one of {', '.join(known)}")
        words.say(fw.report.format_table([{"scene": n, "tests": t} for n, t in known.items()]))
        return
    if out is None:
        raise fw.InputError("expected a result to score, or --out with a folder for the frames")
    output.check_folder(out)
    words.wrote(*_write(fw.evaluate.benchmark_scene(scene), out, force))


def _write(scene: BenchmarkScene, folder: Path, force: bool) -> list[Path]:
    """Write the frames of a scene, without its truth, and the rig."""
    place = folder / "frames"
    if isinstance(scene.capture, fw.Pair):
        return [fw.files.write_pair(place, scene.capture, force=force)]
    frames = fw.files.write_stack(place, scene.capture.frames, scene.capture.plan, force=force)
    assert scene.rig is not None
    return [frames, fw.files.write_rig(folder / "rig.toml", scene.rig)]


def _tell(words: output.Output, rows: tuple[Score, ...]) -> None:
    shown = []
    for row in rows:
        known = row.as_dict()
        shown.append({COLUMNS[n]: known[n] for n in COLUMNS if known[n] is not None})
    words.say(fw.report.format_table(shown).rstrip("\n"))
