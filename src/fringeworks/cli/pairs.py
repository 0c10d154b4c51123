"""``fringeworks reconstruct | methods | calibrate-plane``: two frames to heights."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import (
    AxisName,
    CameraName,
    DenoiseOption,
    JsonFile,
    Ply,
    PlyOption,
    ProjectorName,
    ResponseFile,
    ZeroName,
    ZeroOption,
    depth_of,
    items,
)
from fringeworks.cli.showing import ShowOptions

SECTION = "Two frames"


@dataclass(frozen=True)
class RigOptions:
    """A calibrated rig, and the plane that the reference frame shows."""

    rig: Annotated[
        Path | None, typer.Option(help="Rig file of `calibrate`; measures points in mm.")
    ] = None
    plane_coordinates: Annotated[
        Path | None,
        typer.Option(help="With --rig: coordinates of the reference plane, from `decode`."),
    ] = None
    plane_equation: Annotated[
        str | None,
        typer.Option(
            help="With --rig: a,b,c,d of the reference plane a x + b y + c z = d, camera "
            "coordinates, mm."
        ),
    ] = None
    plane_sigma_mm: Annotated[
        float | None,
        typer.Option(help="With --plane-equation: its standard deviation, mm; 1 by default."),
    ] = None
    period_px: Annotated[
        float | None,
        typer.Option(help="With --rig: period of the fringes in the projector, px."),
    ] = None
    bright_px: Annotated[
        float | None,
        typer.Option(help="With --period-px: projector coordinate of a bright fringe, px."),
    ] = None
    depth: Annotated[
        str | None,
        typer.Option(
            help="Smallest and largest depth of what is lit, mm, as 450:560. With --rig: fringe "
            "orders that lead out of it are corrected."
        ),
    ] = None

    def check(self, geometry: object) -> None:
        """Refuse what does not belong together."""
        planes = {
            "--plane-coordinates": self.plane_coordinates,
            "--plane-equation": self.plane_equation,
            "--plane-sigma-mm": self.plane_sigma_mm,
            "--period-px": self.period_px,
            "--bright-px": self.bright_px,
            "--depth": self.depth,
        }
        for option, value in planes.items():
            if self.rig is None and value is not None:
                raise fw.InputError(f"{option}: expected together with --rig")
        if self.rig is not None and geometry is not None:
            raise fw.InputError("--rig cannot be combined with a geometry")

    def measure(self, pair: fw.Pair, method: str, **options: Any) -> tuple[fw.Measurement, fw.Rig]:
        """Measure the points of a pair; return them with the rig."""
        assert self.rig is not None
        rig = fw.files.read_rig(self.rig)
        equation = self.plane_equation
        plane = None if equation is None else items(float, equation, "plane-equation")
        found = fw.measure(
            pair,
            rig,
            reference=self.plane_coordinates,
            plane=plane,
            plane_sigma_mm=self.plane_sigma_mm,
            period_px=self.period_px,
            bright_px=self.bright_px,
            depth_mm=depth_of(self.depth),
            method=method,
            **options,
        )
        return found, rig


PRINTED = {"True": "true", "False": "false", "None": "null"}
"""JSON of the values that ``methods`` prints in the words of Python."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks reconstruct --reference plane.jpg --object part.jpg "
    "--out part.tif --figure part.png",
)
def reconstruct(
    capture: Annotated[
        Path | None, typer.Argument(help="Capture folder, .npz or .mat file.")
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(help="Image of the reference plane; none for a single frame.")
    ] = None,
    object: Annotated[Path | None, typer.Option(help="Image with the object.")] = None,
    black: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|COUNTS",
            help="Image of the object under the projector's black; or the camera's black level, as "
            "counts or from a set-up file.",
        ),
    ] = None,
    white: Annotated[
        Path | None, typer.Option(help="Image of the object under the projector's white.")
    ] = None,
    method: Annotated[str, typer.Option(help="Method, see `fringeworks methods`.")] = "windowed",
    option: Annotated[
        list[str] | None, typer.Option(help="Option of the method, name=value; repeatable.")
    ] = None,
    geometry: Annotated[
        Path | None, typer.Option(help="Calibration that `calibrate-plane` wrote.")
    ] = None,
    distance_mm: Annotated[float | None, typer.Option(help="l, plane to pupils, mm.")] = None,
    baseline_mm: Annotated[float | None, typer.Option(help="d₀, between the pupils, mm.")] = None,
    pitch_mm_per_px: Annotated[
        float | None, typer.Option(help="Camera pixel on the reference plane, mm.")
    ] = None,
    sign: Annotated[int | None, typer.Option(help="Side of the projector, 1 or -1.")] = None,
    principal_px: Annotated[
        str | None,
        typer.Option(help="x,y of the pixel below the camera's pupil, for cropped frames."),
    ] = None,
    axis: Annotated[
        AxisName | None,
        typer.Option(help="Axis along which the fringes vary, x or y; found by default."),
    ] = None,
    mask: Annotated[Path | None, typer.Option(help="Image, non-zero where to measure.")] = None,
    background: Annotated[
        Path | None, typer.Option(help="Image, non-zero where the object frame shows the plane.")
    ] = None,
    denoise: DenoiseOption = None,
    zero: ZeroOption = ZeroName.rim,
    response: ResponseFile = None,
    camera_name: CameraName = None,
    projector_name: ProjectorName = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Height map: .tif, .npz, .ply, .x3p, .gsf or .csv; '-' is TIFF. With --rig, "
            "points as those of `measure`; '-' is PLY.",
        ),
    ] = None,
    ply: PlyOption = Ply.points,
    *,
    on_rig: RigOptions,
    show: ShowOptions,
) -> None:
    """Measure the surface of a pair of frames."""
    words = output.Output(out, *show.targets)
    _check_out(out, ply, points=on_rig.rig is not None)
    show.check()
    pair = _changed(
        _read(capture, reference, object),
        axis=None if axis is None else axis.value,
        black=None if black is None else _black(black),
        white=None if white is None else fw.files.read_frame(white)[0],
        mask=None if mask is None else fw.files.read_frame(mask)[0] != 0,
        background=None if background is None else fw.files.read_frame(background)[0] != 0,
        camera=camera_name,
        projector=projector_name,
    )
    known = _geometry(geometry, distance_mm, baseline_mm, pitch_mm_per_px, sign)
    if principal_px is not None:
        known = _with_principal(known or pair.geometry, principal_px)
    on_rig.check(known)
    options: dict[str, Any] = {
        "response": None if response is None else fw.files.read_response(response),
        "denoise": None if denoise is None else denoise.value,
        "zero": zero.value,
        **_method_options(method, option or []),
    }
    name = _name(capture, object)
    with output.progress() as progress:
        progress(f"{method} …")
        if on_rig.rig is not None:
            show.write_points(words, *on_rig.measure(pair, method, **options), out, ply, name=name)
            words.wrote(out, show.figure, show.report)
            return
        result = fw.reconstruct(pair, method, geometry=known, **options)
    if out is not None:
        with output.target(out, ".tif") as place:
            fw.files.write_surface(place, result.surface, ply=ply.value)
    figures = _figures(result, pair)
    show.write(result, figures, name=name, provenance=result.surface.provenance)
    words.tell(result, figures)
    words.wrote(out, show.figure, show.report)


def _check_out(out: Path | None, ply: Ply, *, points: bool) -> None:
    """Refuse a file that cannot be written."""
    if points:
        output.check(out, "points", content=ply.value)
    elif ply in (Ply.normals, Ply.frame):
        raise fw.InputError(f"--ply {ply.value}: expected together with --rig, for points")
    else:
        output.check(out, "surface")


def _figures(result: fw.Reconstruction, pair: fw.Pair) -> dict[str, Any]:
    """What is said of a surface, with its errors where the truth is known."""
    figures = fw.report.summarise(result)
    if pair.truth_mm is not None and result.surface.unit == "mm":
        figures["errors"] = asdict(fw.evaluate.errors(result.surface, pair.truth_mm))
    return figures


def _black(named: str) -> Any:
    """A black level, from a set-up or not, or the frame in a file."""
    try:
        return float(named)
    except ValueError:
        pass
    if Path(named).suffix.lower() != ".toml":
        return fw.files.read_frame(named)[0]
    level = fw.files.read_setup(named).black_counts
    if level is None:
        raise fw.InputError(f"{named}: expected black_counts in [camera]; make the set-up anew")
    return level


def _name(capture: Path | None, object: Path | None) -> str | None:
    """What to call the capture in a picture."""
    named = capture or object
    return None if named is None else named.stem


def _read(capture: Path | None, reference: Path | None, object: Path | None) -> fw.Pair:
    """The pair that the arguments name."""
    if (capture is None) == (reference is None and object is None):
        raise fw.InputError("expected either a capture, or --reference and --object")
    if capture is not None:
        found = fw.files.read_capture(capture)
        if not isinstance(found, fw.Pair):
            raise fw.InputError(
                f"{capture}: expected a pair of frames, got a stack; use `fringeworks measure`, or "
                "`fringeworks decode` without a rig"
            )
        return found
    if object is None:
        raise fw.InputError("expected two images, got one: --object is missing")
    return fw.files.read_pair(reference, object)


def _changed(pair: fw.Pair, **changes: Any) -> fw.Pair:
    """The pair with the changes that are given."""
    return replace(pair, **{name: value for name, value in changes.items() if value is not None})


def _geometry(
    path: Path | None,
    distance_mm: float | None,
    baseline_mm: float | None,
    pitch_mm_per_px: float | None,
    sign: int | None,
) -> fw.pair.ReferencePlaneGeometry | fw.pair.PixelCalibration | None:
    """The geometry by its file or by its numbers."""
    numbers = {
        "--distance-mm": distance_mm,
        "--baseline-mm": baseline_mm,
        "--pitch-mm-per-px": pitch_mm_per_px,
    }
    given = [name for name, value in {**numbers, "--sign": sign}.items() if value is not None]
    if path is not None:
        if given:
            raise fw.InputError(f"--geometry cannot be combined with {given[0]}")
        return fw.files.read_reference_plane(path)
    if not given:
        return None
    if distance_mm is None or baseline_mm is None or pitch_mm_per_px is None:
        missing = [name for name, value in numbers.items() if value is None]
        raise fw.InputError(
            "geometry: expected --distance-mm, --baseline-mm and --pitch-mm-per-px together, "
            f"{', '.join(missing)} missing"
        )
    side: Any = 1 if sign is None else sign
    return fw.pair.ReferencePlaneGeometry(distance_mm, baseline_mm, pitch_mm_per_px, side)


def _with_principal(
    geometry: fw.pair.ReferencePlaneGeometry | fw.pair.PixelCalibration | None, text: str
) -> fw.pair.ReferencePlaneGeometry:
    """The geometry with another principal point."""
    if not isinstance(geometry, fw.pair.ReferencePlaneGeometry):
        raise fw.InputError(
            "--principal-px: expected a geometry (--distance-mm, --baseline-mm and "
            "--pitch-mm-per-px, a .toml or that of the capture), got none"
        )
    place = items(float, text, "principal-px")
    if len(place) != 2:
        raise fw.InputError(f"--principal-px: expected x,y in px, got {text!r}")
    return replace(geometry, principal_px=(place[0], place[1]))


def _method_options(method: str, settings: list[str]) -> dict[str, fw.pair.MethodOption]:
    """``name=value`` pairs: words where the method expects one, values as ``methods`` prints them
    else."""
    known = fw.pair.get_method(method).options
    options: dict[str, fw.pair.MethodOption] = {}
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise fw.InputError(f"--option: expected name=value, got {setting!r}")
        if isinstance(known.get(name), str):
            options[name] = text
            continue
        try:
            options[name] = json.loads(PRINTED.get(text, text))
        except json.JSONDecodeError as error:
            raise fw.InputError(
                f"--option {name}: expected a number, a list, True, False or None, got {text!r}"
            ) from error
    return options


@app.command("methods", rich_help_panel=SECTION, epilog="Example: fringeworks methods")
def list_methods() -> None:
    """List the methods for two frames and their options."""
    rows = []
    for entry in fw.methods().values():
        options = "\n".join(f"{name} = {value}" for name, value in entry.options.items())
        rows.append([entry.name, entry.summary, options])
    output.Output().table(["method", "what it does", "options"], rows)


@app.command(
    "calibrate-plane",
    rich_help_panel=SECTION,
    epilog="Example: fringeworks calibrate-plane --reference 0.png --plane 4=4.png --plane 8=8.png "
    "--pitch-mm-per-px 0.2 --out geometry.toml",
)
def calibrate_plane(
    reference: Annotated[Path, typer.Option(help="Image of the reference plane.")],
    plane: Annotated[
        list[str],
        typer.Option(help="The plane at a height, mm=image; two or more, three for .npz."),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", help="Geometry (.toml), or a law for every pixel (.npz)."),
    ],
    pitch_mm_per_px: Annotated[
        float | None,
        typer.Option(help="Camera pixel on the reference plane, mm; .toml needs it."),
    ] = None,
    method: Annotated[str, typer.Option(help="Method, see `fringeworks methods`.")] = "windowed",
    json_file: JsonFile = None,
) -> None:
    """Calibrate the two-frame path with a plane at known heights."""
    words = output.Output(out, json_file)
    from fringeworks.files.reference_plane import PIXELS_SUFFIX

    output.check(out, "reference_plane")
    by_pixel = out.suffix.lower() == PIXELS_SUFFIX
    if not by_pixel and pitch_mm_per_px is None:
        raise fw.InputError(f"--out {out}: expected --pitch-mm-per-px for .toml")
    heights, pairs = [], []
    for text in plane:
        height, separator, name = text.partition("=")
        try:
            heights.append(float(height))
        except ValueError as error:
            raise fw.InputError(f"--plane: expected mm=image, got {text!r}") from error
        if not separator:
            raise fw.InputError(f"--plane: expected mm=image, got {text!r}")
        pairs.append(fw.files.read_pair(reference, name))
    with output.progress() as progress:
        progress(f"{method} …")
        found = fw.pair.calibrate_plane(
            pairs, heights, pitch_mm_per_px=pitch_mm_per_px, by_pixel=by_pixel, method=method
        )
    with output.target(out, ".toml") as place:
        fw.files.write_reference_plane(place, found)
    figures = fw.report.summarise(found)
    output.write_json(json_file, figures)
    words.tell(found, figures)
    words.wrote(out)
