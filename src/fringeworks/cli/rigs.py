"""``fringeworks rig | board``: check a rig, rig files of other programs, boards to print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import Commands, app
from fringeworks.cli.cameras import convert_stereo
from fringeworks.cli.decoding import DecodingOptions
from fringeworks.cli.options import JsonFile, region_of, size_of

SECTION = "Stacks and rigs"
EXIT_CODES = {"holds": 0, "has moved": 3, "cannot tell": 4}
"""As those of ``inspect``: pass, fail, undecided."""
WATCH_CODES = {"holds": 0, "has moved": 3, "suspect": 4, "learning": 4}
"""The same for a watched rig."""

rigs = Commands(
    help="Check a calibrated rig, or convert its file.",
    epilog="Example: fringeworks rig check pose/ --rig rig.toml --board chessboard:11x8:12",
    rich_markup_mode=None,
    no_args_is_help=True,
)
app.add_typer(rigs, name="rig", rich_help_panel=SECTION)


@rigs.command(
    epilog="Example: fringeworks rig check pose/ --rig rig.toml --board chessboard:11x8:12 "
    "--adjust --out rig2.toml",
)
def check(
    captures: Annotated[
        list[Path], typer.Argument(help="The board in one pose, or in several, a stack each.")
    ],
    rig_file: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    board: Annotated[str, typer.Option(help="Board: as for `calibrate`.")],
    how: DecodingOptions,
    adjust: Annotated[
        bool,
        typer.Option("--adjust", help="Correct relative pose and focal lengths, write --out."),
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Corrected rig, with --adjust.")] = None,
    history: Annotated[
        Path | None,
        typer.Option(help="Table (.csv) of all checks of the rig, to which this one is added."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Check whether a rig still holds; exit code 0 holds, 3 has moved, 4 cannot tell."""
    from fringeworks.files.atomic import check_target

    words = output.Output(out, json_file)
    if history is not None:
        check_target(history, (".csv",))
    if adjust != (out is not None):
        raise fw.InputError("--adjust: expected together with --out")
    output.check(out, "rig")
    options = how.options
    rig = fw.files.read_rig(rig_file)
    with output.progress() as progress:
        progress("reading …")
        stacks = [how.read(path) for path in captures]
        progress("checking …")
        found = fw.rig.check_rig(rig, stacks, board, **options)
    figures = fw.report.summarise(found)
    output.write_json(json_file, figures)
    words.tell(found, figures)
    if history is not None:
        _chart(words, fw.files.append_check(history, found))
    if out is None or found.verdict == "holds":
        if out is not None:
            words.say(f"{out}: not written, because the rig holds")
        raise typer.Exit(EXIT_CODES[found.verdict])
    adjusted = fw.rig.adjust_rig(rig, stacks, board, **options)
    with output.target(out, ".toml") as place:
        fw.files.write_rig(place, adjusted)
    words.wrote(out)


def _chart(words: output.Output, history: fw.files.CheckHistory) -> None:
    """Tell the patterns that the last check completes."""
    from fringeworks.report.kinds.check_history import charted

    last = len(history.dates) - 1
    for name, series in charted(history).items():
        for one in series.signals:
            if one.last == last:
                words.say(f"control chart of {name}: {one}")


@rigs.command(
    epilog="Example: fringeworks rig watch monday/ --rig rig.toml --watched watch.jsonl",
)
def watch(
    captures: Annotated[
        list[Path] | None,
        typer.Argument(help="Scans of parts, a stack each, or folders that hold several."),
    ] = None,
    *,
    rig_file: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    how: DecodingOptions,
    watched: Annotated[
        Path, typer.Option(help="Log (.jsonl) of all scans of the rig, to which these are added.")
    ],
    learn: Annotated[
        int, typer.Option(min=12, help="Number of first scans that the rig is learnt from.")
    ] = 20,
    false_alarms: Annotated[
        float, typer.Option(help="Largest expected number of alarms in 1,000 scans.")
    ] = 1.0,
    report: Annotated[
        Path | None, typer.Option(help="Write a report: the chart of all scans, .html or .pdf.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Watch by scans of parts, without a board, whether a rig has moved.

    Exit code 0 holds, 3 has moved, 4 cannot tell yet.
    """
    words = output.Output(report, json_file)
    output.check(report, "report")
    with output.progress() as progress:

        def scans() -> Iterator[tuple[str, fw.Stack]]:
            for path in captures or []:
                for place in _stacks_in(path):
                    progress(f"{place.name} …")
                    yield place.name, how.read(place)

        found = fw.rig.watch_rig(
            rig_file,
            scans(),
            log=watched,
            baseline=learn,
            false_alarms=false_alarms,
            **how.options,
        )
    figures = fw.report.summarise(found)
    words.tell(found, figures)
    if report is not None:
        with output.target(report, ".html") as place:
            fw.write_report(place, {f"Watched rig: {watched.stem}": found})
    output.write_json(json_file, figures)
    words.wrote(watched, report, json_file)
    raise typer.Exit(WATCH_CODES[found.verdict])


def _stacks_in(path: Path) -> list[Path]:
    """The stacks in a folder of scans, by name; a stack itself where it is one."""
    from fringeworks.files.limits import is_folder
    from fringeworks.files.stack import pose_paths

    if not is_folder(path):
        return [path]
    inner = [place for place in path.iterdir() if is_folder(place)]
    return pose_paths(path) if inner else [path]


@rigs.command(
    name="history",
    epilog="Example: fringeworks rig history checks.csv --report checks.html",
)
def history(
    table: Annotated[Path, typer.Argument(help="Table of `rig check --history`.")],
    report: Annotated[
        Path | None, typer.Option(help="Write a report: a page to hand on, .html or .pdf.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Chart all checks of a rig, and look for the patterns of Nelson's rules."""
    words = output.Output(report, json_file)
    output.check(report, "report")
    found = fw.files.read_check_history(table)
    figures = fw.report.summarise(found)
    words.tell(found, figures)
    if report is not None:
        with output.target(report, ".html") as place:
            fw.write_report(place, {f"Checks of a rig: {table.stem}": found})
    output.write_json(json_file, figures)
    words.wrote(report, json_file)


@rigs.command(
    epilog="Example: fringeworks rig projector left/ right/ --rig cameras.toml --out rig.toml",
)
def projector(
    captures: Annotated[
        list[Path], typer.Argument(help="Per camera: a stack, or a folder with one for each scene.")
    ],
    rig_file: Annotated[
        Path, typer.Option("--rig", help="Rig file of `calibrate`; of cameras alone.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Rig file with the projector.")],
    how: DecodingOptions,
    distortion: Annotated[
        int,
        typer.Option(help="Distortion coefficients per lens: 0, 2, 4 or 5; of the projector's."),
    ] = 5,
) -> None:
    """Calibrate a projector by scenes that calibrated cameras measured, without a board."""
    words = output.Output(out)
    output.check(out, "multi_rig")
    scenes = _scenes_of(captures)
    with output.progress(len(scenes) + 1) as progress:
        stacks = [[how.read_captured(path) for path in scene] for scene in scenes]
        found = fw.rig.calibrate_projector(
            stacks, rig_file, distortion=distortion, progress=progress, **how.options
        )
    with output.target(out, ".toml") as place:
        fw.files.write_multi_rig(place, found)
    from fringeworks.types.numbers import number

    assert found.projector is not None
    focal, rms = found.projector.focal_px, (found.residual_px or (float("nan"),))[-1]
    along, across = (number(float(one), digits=6) for one in focal)
    words.say(f"projector: focal lengths {along} and {across} px")
    if found.residual_px is not None:
        words.say(f"residual of its coordinates: {number(rms, unit='px')} rms")
    words.wrote(out)


def _scenes_of(cameras: list[Path]) -> list[list[Path]]:
    """The stacks of every scene, one for each camera, by the names of the folders."""
    stacks = [{place.name: place for place in _stacks_in(path)} for path in cameras]
    if all(len(one) == 1 for one in stacks):
        return [[next(iter(one.values())) for one in stacks]]
    for path, one in zip(cameras, stacks, strict=True):
        if one.keys() != stacks[0].keys():
            raise fw.InputError(
                f"{path}: expected the scenes {', '.join(stacks[0])}, as in {cameras[0]}, got "
                f"{', '.join(one)}"
            )
    return [[one[name] for one in stacks] for name in stacks[0]]


@rigs.command(
    epilog="Example: fringeworks rig convert rig.xml --projector-size 1024x768 --out rig.toml",
)
def convert(
    source: Annotated[
        Path,
        typer.Argument(
            help="Rig file: .toml, or .xml, .yml (OpenCV); with --cameras .json, .m and .txt too."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Rig file of another kind.")],
    projector_size: Annotated[
        str | None,
        typer.Option(
            help="Projector's columns x rows, as 1920x1080; where a file of OpenCV has none."
        ),
    ] = None,
    camera_size: Annotated[
        str | None, typer.Option(help="Camera's columns x rows, as 1280x1024; as above.")
    ] = None,
    unit_mm: Annotated[
        float | None, typer.Option(help="Unit of OpenCV's file in mm, such as 1000 for metres.")
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(help="x,y,w,h: first column and row, columns and rows of cropped frames."),
    ] = None,
    binning: Annotated[
        int, typer.Option("--bin", min=1, help="Pixels along columns and rows that became one.")
    ] = 1,
    scale: Annotated[
        float, typer.Option(help="Size of resampled frames, over that of the rig's.")
    ] = 1.0,
    cameras: Annotated[
        bool,
        typer.Option("--cameras", help="The file is of two cameras; the projector only codes."),
    ] = False,
    also: Annotated[
        Path | None,
        typer.Option("--with", help="Second file of two cameras, such as extrinsics.yml."),
    ] = None,
    rectified: Annotated[
        bool,
        typer.Option("--rectified", help="Two cameras whose frames are rectified, by P1 and P2."),
    ] = False,
) -> None:
    """Convert a rig file, to and from OpenCV's XML and YAML, or for cropped or binned frames."""
    if cameras:
        if projector_size is not None or crop is not None or binning != 1 or scale != 1.0:
            raise fw.InputError(
                "--cameras: it cannot be combined with --projector-size, --crop, --bin and --scale"
            )
        size = None if camera_size is None else size_of(camera_size, "camera-size")
        sources = [source] if also is None else [source, also]
        convert_stereo(sources, out, size, unit_mm, rectified=rectified)
        return
    if also is not None or rectified:
        raise fw.InputError("--with, --rectified: expected together with --cameras")
    from fringeworks.rig.point_findings import unit_findings

    words = output.Output(out)
    output.check(out, "rig")
    sizes = [
        None if given is None else size_of(given, name)
        for name, given in (("camera-size", camera_size), ("projector-size", projector_size))
    ]
    with output.target(out, ".toml") as place:
        found = fw.files.read_rig(
            source, camera_size=sizes[0], projector_size=sizes[1], unit_mm=unit_mm
        )
        region = None if crop is None else region_of(crop, "crop")
        found = fw.rig.for_frames(found, region=region, binning=binning, scale=scale)
        fw.files.write_rig(place, found)
    words.found(unit_findings(found))
    words.wrote(out)


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
        str, typer.Option(help="Paper: A5 … A0, letter, legal, tabloid, or width x height in mm.")
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
    known = fw.rig.parse_board(kind)
    with output.target(out, ".pdf") as place:
        fw.report.write_board(
            place, known, paper, landscape=landscape, white_on_black=white_on_black, dpi=dpi
        )
    words.wrote(out)
    words.say(
        f"Print at 100 % (actual size), check both rulers, and calibrate with --board {known.name}"
    )
