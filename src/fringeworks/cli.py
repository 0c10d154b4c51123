"""The command line: ``fringeworks simulate | reconstruct | compare | paper | demo | methods``.

Commands that draw import matplotlib themselves: it takes longer than most other commands run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from typer.exceptions import TyperException

from fringeworks.analysis import get_method, methods
from fringeworks.capture import read_capture, read_pair, write_capture
from fringeworks.evaluate import compare, errors, format_table, to_json
from fringeworks.files import make_folder, read_frame, write_text
from fringeworks.formats import WRITERS, check_target, write_surface
from fringeworks.pipeline import reconstruct as run_reconstruct
from fringeworks.pipeline import summary
from fringeworks.simulate import standard_scene
from fringeworks.types import Axis, Capture, InputError, ReferencePlaneGeometry

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


class Ply(StrEnum):
    """What a .ply file holds."""

    points = "points"
    mesh = "mesh"


Item = TypeVar("Item")


def _list_of(kind: Callable[[str], Item], text: str, name: str) -> list[Item]:
    """A comma-separated option as a list."""
    try:
        items = [kind(part.strip()) for part in text.split(",") if part.strip()]
    except ValueError as error:
        raise InputError(f"--{name}: expected values separated by commas, got {text!r}") from error
    if not items:
        raise InputError(f"--{name}: expected at least one value, got {text!r}")
    return items


def _write_json(path: Path | None, content: str) -> None:
    if path is None:
        return
    if str(path) == "-":
        sys.stdout.write(content)
    else:
        write_text(path, content)


def _axis(axis: AxisName | None) -> Axis | None:
    return None if axis is None else ("x" if axis is AxisName.x else "y")


@contextmanager
def _progress(total: int | None = None) -> Iterator[Callable[[str], None]]:
    """A progress line on stderr, gone when done; silent where stderr is no terminal."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    hidden = not stderr.is_terminal
    with Progress(*columns, console=stderr, transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=total)
        yield lambda text: bar.update(task, description=text, advance=1)


@app.command()
def simulate(
    out: Output,
    object: Annotated[str, typer.Option(help="parabola, cube, cylinder, sphere, …")] = "parabola",
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
    height_mm: Annotated[float, typer.Option(help="Largest height, mm.")] = 100.0,
    fringes: Annotated[float, typer.Option(help="Periods across the frame.")] = 10.0,
    gamma: Annotated[float, typer.Option(help="Exponent of the projector's response.")] = 1.0,
    noise: Annotated[float, typer.Option(help="Gaussian noise, counts of 8 bit.")] = 0.0,
    shot: Annotated[float, typer.Option(help="Shot noise, variance per count.")] = 0.0,
    bits: Annotated[int, typer.Option(help="8, 10, 12, 16, or 0 for none.")] = 0,
    ambient: Annotated[float, typer.Option(help="Ambient light, share of the range.")] = 0.0,
    paint: Annotated[bool, typer.Option(help="Paint the object.")] = False,
    axis: Annotated[AxisName, typer.Option(help="Direction of the fringes.")] = AxisName.x,
    sign: Annotated[int, typer.Option(help="Side of the projector, 1 or -1.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of noise and paint.")] = 0,
) -> None:
    """Write a capture of an artificial object, with its truth."""
    if sign not in (1, -1):
        raise InputError(f"--sign: expected 1 or -1, got {sign}")
    scene = standard_scene(
        object,
        size=size,
        height_mm=height_mm,
        painted=paint,
        sign=1 if sign == 1 else -1,
        fringes=fringes,
        gamma=gamma,
        noise=noise,
        shot=shot,
        bits=bits,
        ambient=ambient,
        axis=axis.value,
        seed=seed,
    )
    typer.echo(f"wrote {write_capture(out, scene)}")


def _load(
    capture: Path | None,
    reference: Path | None,
    object: Path | None,
    axis: AxisName | None,
    mask: Path | None,
    geometry: dict[str, float | None],
) -> Capture:
    """The capture that the options of ``reconstruct`` describe."""
    if (capture is None) == (reference is None and object is None):
        raise InputError("expected either a capture, or --reference and --object")
    if capture is not None:
        loaded = read_capture(capture)
    elif reference is None or object is None:
        missing = "--reference" if reference is None else "--object"
        raise InputError(f"expected two images, got one: {missing} is missing")
    else:
        loaded = read_pair(reference, object)
    if axis is not None:
        loaded = replace(loaded, axis=_axis(axis))
    if mask is not None:
        loaded = replace(loaded, mask=read_frame(mask)[0] != 0)
    given = {name: value for name, value in geometry.items() if value is not None}
    if given:
        loaded = replace(loaded, geometry=_geometry(given))
    return loaded


def _geometry(given: dict[str, float]) -> ReferencePlaneGeometry:
    needed = ("distance_mm", "baseline_mm", "pitch_mm_per_px")
    missing = [f"--{name.replace('_', '-')}" for name in needed if name not in given]
    if missing:
        raise InputError(
            f"geometry: expected --distance-mm, --baseline-mm and --pitch-mm-per-px "
            f"together, {', '.join(missing)} missing"
        )
    sign = given.get("sign", 1)
    if sign not in (1, -1):
        raise InputError(f"--sign: expected 1 or -1, got {sign:g}")
    return ReferencePlaneGeometry(
        distance_mm=given["distance_mm"],
        baseline_mm=given["baseline_mm"],
        pitch_mm_per_px=given["pitch_mm_per_px"],
        sign=1 if sign == 1 else -1,
    )


def _method_options(method: str, settings: list[str]) -> dict[str, Any]:
    """``name=value`` pairs, values read as JSON."""
    known = get_method(method).options
    options: dict[str, Any] = {}
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise InputError(f"--option: expected name=value, got {setting!r}")
        if name not in known:
            raise InputError(
                f"--option: {method} has {', '.join(known) or 'no options'}, got {name!r}"
            )
        try:
            options[name] = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"--option {name}: expected a number or list, got {text!r}") from error
    return options


@app.command()
def reconstruct(
    capture: Annotated[
        Path | None, typer.Argument(help="Capture folder, .npz or .mat file.")
    ] = None,
    reference: Annotated[Path | None, typer.Option(help="Image of the reference plane.")] = None,
    object: Annotated[Path | None, typer.Option(help="Image with the object.")] = None,
    method: Annotated[str, typer.Option(help="See `fringeworks methods`.")] = "windowed",
    option: Annotated[
        list[str] | None, typer.Option(help="Option of the method, name=value; repeatable.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help=f"Result file: {', '.join(WRITERS)}.")] = None,
    ply: Annotated[Ply, typer.Option(help="What a .ply file holds.")] = Ply.points,
    figure: Annotated[
        Path | None, typer.Option(help="Picture of values, σ and reasons (PNG).")
    ] = None,
    json_file: JsonFile = None,
    axis: Annotated[AxisName | None, typer.Option(help="Direction of the fringes.")] = None,
    mask: Annotated[Path | None, typer.Option(help="Image, non-zero where to measure.")] = None,
    distance_mm: Annotated[float | None, typer.Option(help="l, plane to pupils, mm.")] = None,
    baseline_mm: Annotated[float | None, typer.Option(help="d₀, between pupils, mm.")] = None,
    pitch_mm_per_px: Annotated[float | None, typer.Option(help="Pixel on the plane, mm.")] = None,
    sign: Annotated[int | None, typer.Option(help="Side of the projector, 1 or -1.")] = None,
) -> None:
    """Measure the surface of a capture: two frames in, a height map out."""
    geometry = {
        "distance_mm": distance_mm,
        "baseline_mm": baseline_mm,
        "pitch_mm_per_px": pitch_mm_per_px,
        "sign": sign,
    }
    loaded = _load(capture, reference, object, axis, mask, geometry)
    if out is not None:
        check_target(out)
    with _progress() as progress:
        progress(f"{method} …")
        result = run_reconstruct(loaded, method, **_method_options(method, option or []))
    content = summary(result)
    if loaded.truth_mm is not None and result.surface.unit == "mm":
        content["errors"] = asdict(errors(result.surface, loaded.truth_mm))
    if out is not None:
        write_surface(out, result.surface, ply="mesh" if ply is Ply.mesh else "points")
    if figure is not None:
        from fringeworks import figures

        figures.save(figures.surface_sheet(f"{method}", result.surface), figure)
    _write_json(json_file, to_json(content))
    if str(json_file) != "-":
        _report(content, out)


def _report(content: dict[str, Any], out: Path | None) -> None:
    for note in content["notes"]:
        typer.echo(f"note: {note}")
    unit = content["unit"]
    if content["median"] is None:
        typer.echo(f"{content['quantity']}: no pixel could be measured")
    else:
        typer.echo(
            f"{content['quantity']}: {content['minimum']:.4g} … {content['maximum']:.4g} {unit}, "
            f"median σ {content['median_sigma']:.2g} {unit}"
        )
    reasons = {k: n for k, n in content["reasons"].items() if k != "ok"}
    failed = ", ".join(f"{k.replace('_', ' ')} {n}" for k, n in reasons.items()) or "none"
    typer.echo(f"failed: {content['failed_fraction']:.2%} ({failed})")
    if "errors" in content:
        e = content["errors"]
        typer.echo(
            f"against the truth: mean |error| {e['mean_abs_error_mm']:.4g} mm, "
            f"s.d. {e['std_error_mm']:.4g} mm"
        )
    if out is not None:
        typer.echo(f"wrote {out}")


@app.command("compare")
def compare_methods(
    object: Annotated[str, typer.Option(help="Objects, separated by commas.")] = "parabola",
    names: Annotated[
        str, typer.Option("--methods", help="Methods, separated by commas; all by default.")
    ] = "",
    gamma: Annotated[str, typer.Option(help="Response exponents.")] = "1",
    noise: Annotated[str, typer.Option(help="Noise, counts of 8 bit.")] = "0",
    bits: Annotated[str, typer.Option(help="Quantisation: 0, 8, 10, 12, 16.")] = "0",
    fringes: Annotated[str, typer.Option(help="Periods across the frame.")] = "10",
    height_mm: Annotated[float, typer.Option(help="Largest height, mm.")] = 100.0,
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    json_file: JsonFile = None,
    csv: Annotated[Path | None, typer.Option(help="Write the table as CSV.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table as Markdown.")] = None,
) -> None:
    """Compare methods on the standard scene; lists are combined, each with each."""
    chosen = _list_of(str, names, "methods") if names else list(methods())
    for name in chosen:
        get_method(name)
    with _progress() as progress:
        rows = compare(
            _list_of(str, object, "object"),
            chosen,
            gammas=_list_of(float, gamma, "gamma"),
            noises=_list_of(float, noise, "noise"),
            bits=_list_of(int, bits, "bits"),
            fringes=_list_of(float, fringes, "fringes"),
            height_mm=height_mm,
            size=size,
            seed=seed,
            on_result=lambda row, _: progress(f"{row['object']} {row['method']}"),
        )
    if csv is not None:
        write_text(csv, format_table(rows, "csv"))
    if markdown is not None:
        write_text(markdown, format_table(rows, "markdown"))
    _write_json(json_file, format_table(rows, "json"))
    if str(json_file) != "-":
        typer.echo(format_table(rows), nl=False)


@app.command()
def paper(
    out: Output,
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
) -> None:
    """Make all figures of the dissertation's chapter 4, and its table of errors."""
    from fringeworks.paper import write_paper

    with _progress() as progress:
        written = write_paper(out, size=size, progress=progress)
    typer.echo(f"wrote {len(written)} files to {out}")


@app.command()
def demo(
    out: Output,
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
    json_file: JsonFile = None,
) -> None:
    """Measure three objects, ideal and as a camera sees them, and show the errors."""
    from fringeworks.demo import write_demo

    make_folder(out)
    with _progress() as progress:
        rows, pictures = write_demo(out, size=size, progress=progress)
    _write_json(json_file, format_table(rows, "json"))
    if str(json_file) == "-":
        return
    shown = [
        {
            k: row[k]
            for k in (
                "object",
                "case",
                "method",
                "mean_abs_error_mm",
                "std_error_mm",
                "failed_fraction",
                "seconds",
            )
        }
        for row in rows
    ]
    typer.echo(format_table(shown), nl=False)
    if not any(path.name.startswith("cone") for path in pictures):
        typer.echo("no real captures: set FRINGEWORKS_DATA to a folder that holds pair_cone/")
    for path in pictures:
        typer.echo(f"see {path}")


@app.command("methods")
def list_methods() -> None:
    """List the methods and their options."""
    table = Table("method", "what it does", "options", box=None, pad_edge=False)
    for entry in methods().values():
        options = "\n".join(f"{name} = {value}" for name, value in entry.options.items())
        table.add_row(entry.name, entry.summary, options)
    Console().print(table)


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
