"""``fringeworks response | decode | light | calibrate | measure``: stacks of frames to points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.cameras import calibrate_cameras, measure_cameras
from fringeworks.cli.decoding import DecodingOptions, StackOptions
from fringeworks.cli.devices import DeviceOptions, take_poses
from fringeworks.cli.measuring import measure_points
from fringeworks.cli.options import (
    AxisName,
    CameraWords,
    DepthOption,
    JsonFile,
    Ply,
    PlyOption,
    ProjectorWords,
    ResponseFile,
    depth_of,
    gains_of,
    items,
)
from fringeworks.cli.robots import FrameName, RobotOptions
from fringeworks.cli.showing import ShowOptions

SECTION = "Stacks and rigs"

StackArgument = Annotated[
    Path,
    typer.Argument(help="Folder of images with its plan, or a TIFF, .npy or .npz stack."),
]


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks response plane/ --camera-name left "
    "--projector-name bench --out response.toml",
)
def response(
    stack: StackArgument,
    out: Annotated[Path, typer.Option("--out", help="Response file to write (TOML).")],
    how: StackOptions,
    number: Annotated[
        int, typer.Option("--set", help="Which set of steps of the plan, from 1.")
    ] = 1,
    json_file: JsonFile = None,
) -> None:
    """Measure the response of camera and projector on a white plane."""
    words = output.Output(out, json_file)
    output.check(out, "response")
    found = fw.signal.measure_response(how.read(stack), number=number, **how.options)
    with output.target(out, ".toml") as place:
        fw.files.write_response(place, found)
    figures = fw.report.summarise(found)
    output.write_json(json_file, figures)
    words.tell(found, figures)
    words.wrote(out)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks decode shots/ --out coordinates.npz --figure x.png",
)
def decode(
    stack: StackArgument,
    how: DecodingOptions,
    relative: Annotated[
        bool,
        typer.Option("--relative", help="Coordinates modulo the plan's unambiguous range."),
    ] = False,
    phases: Annotated[bool, typer.Option("--phases", help="Write wrapped phases as well.")] = False,
    steps: Annotated[
        str,
        typer.Option(
            help="Phase steps of frames without a plan: their number, or all shifts in degrees as "
            "0,90,180,270. The result is the wrapped phase."
        ),
    ] = "",
    unwrap: Annotated[
        bool, typer.Option("--unwrap", help="Write the unwrapped phase as well; with --steps.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Coordinates or phase to write (.npz).")
    ] = None,
    *,
    show: ShowOptions,
) -> None:
    """Decode fringes and Gray code to projector coordinates, or phase steps to their phase."""
    words = output.Output(out, *show.targets)
    output.check(out, "coordinate")
    show.check()
    options = how.options
    if steps:
        if how.plan is not None or relative or phases:
            raise fw.InputError(
                "--steps: it takes the place of a plan and gives a phase; expected none of "
                "--plan, --relative, --phases beside it"
            )
        for name, value in (("--channels", how.channels), ("--mosaic", how.mosaic)):
            if value is not None:
                raise fw.InputError(f"{name}: with --steps, write it into capture.toml instead")
        given: dict[str, Any] = {
            "camera": how.camera_name,
            "projector": how.projector_name,
            **options,
        }
        phase = fw.stack.wrapped_phase(stack, _shifts(steps), **given)
        _show_phase(words, stack.name, phase, unwrap, out, show)
        return
    if unwrap:
        raise fw.InputError("--unwrap: expected together with --steps")
    with output.progress() as progress:
        progress("reading …")
        loaded = how.read_captured(stack)
        progress("decoding …")
        if relative:
            options["absolute"] = False
        if phases:
            options["keep_phases"] = True
        found = fw.decode(loaded, **options)
    if out is not None:
        with output.target(out, ".npz") as place:
            fw.files.write_coordinates(place, found)
    figures = fw.report.summarise(found)
    show.write(found, figures, name=stack.name, provenance=found.provenance)
    words.tell(found, figures)
    words.wrote(out, show.figure, show.report)


def _shifts(steps: str) -> tuple[float, ...]:
    """Shifts in rad, from a number of equal steps or from degrees."""
    if steps.strip().isdigit():
        return fw.patterns.equal_steps(int(steps))
    return tuple(math.radians(d) for d in items(float, steps, "steps"))


def _show_phase(
    words: output.Output,
    name: str,
    phase: fw.stack.WrappedPhase,
    unwrap: bool,
    out: Path | None,
    show: ShowOptions,
) -> None:
    """Write and print a wrapped phase."""
    unwrapped = None
    if unwrap:
        unwrapped = fw.unwrap(phase.phase_rad, quality=phase.modulation)
    if out is not None:
        with output.target(out, ".npz") as place:
            fw.files.write_phase(place, phase, unwrapped)
    figures = fw.report.summarise(phase)
    show.write(phase, figures, name=name, provenance=phase.provenance)
    words.tell(phase, figures)
    if unwrapped is not None:
        words.say(
            f"unwrapped by {unwrapped.algorithm}: {unwrapped.residues} residues, "
            f"{int(unwrapped.region.max())} connected regions"
        )
    words.wrote(out, show.figure, show.report)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks light shots/ --out light.npz --figure light.png",
)
def light(
    stack: StackArgument,
    how: StackOptions,
    response: ResponseFile = None,
    contrast: Annotated[
        float,
        typer.Option(
            help="Contrast of the finest fringes on a matte sheet without indirect light, 0…1. "
            "What blur takes from it counts as indirect light otherwise."
        ),
    ] = 1.0,
    out: Annotated[Path | None, typer.Option("--out", help="Light to write (.npz).")] = None,
    *,
    show: ShowOptions,
) -> None:
    """Separate the projector's direct light from indirect light of other surfaces."""
    words = output.Output(out, *show.targets)
    output.check(out, "light")
    show.check()
    options = how.options
    if "min_modulation" in options:
        raise fw.InputError("--min-modulation: it has no meaning for `light`; leave it out")
    found = fw.stack.separate_light(
        how.read(stack),
        contrast=contrast,
        noise=options.get("noise"),
        saturation=options.get("saturation"),
        response=None if response is None else fw.files.read_response(response),
    )
    if out is not None:
        with output.target(out, ".npz") as place:
            fw.files.write_light(place, found)
    figures = fw.report.summarise(found)
    show.write(found, figures, name=stack.name, provenance=found.provenance)
    words.tell(found, figures)
    words.wrote(out, show.figure, show.report)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks calibrate board/ --board chessboard:11x8:12 --out rig.toml",
)
def calibrate(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="Folder with one stack per pose of the board; several cameras: one folder for "
            "each, with the same names of poses. Two folders of photographs: two cameras alone."
        ),
    ],
    board: Annotated[
        str,
        typer.Option(
            help="Board: chessboard:9x7:75 (inner corners, mm), "
            "charuco:8x6:30:22[:dictionary][:legacy] (squares, mm), "
            "circles:9x7:30 or asymmetric-circles:4x11:20."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Rig file: .toml, or .xml, .yml (OpenCV).")],
    how: DecodingOptions,
    distortion: Annotated[
        int | None,
        typer.Option(
            help="Distortion coefficients per lens: 0, 2, 4 or 5; by default those that are useful."
        ),
    ] = None,
    live: Annotated[
        bool,
        typer.Option("--live", help="Take the poses first, each judged at once; with --setup."),
    ] = False,
    projector: ProjectorWords = None,
    camera: CameraWords = None,
    *,
    show: ShowOptions,
) -> None:
    """Calibrate one or several cameras and a projector with a board in several poses."""
    for name, device in (("projector", projector), ("camera", camera)):
        if device is not None and not live:
            raise fw.InputError(
                f"--{name}: expected together with --live, for which it opens the device; the name "
                f"of the {name} is --{name}-name"
            )
    if len(folders) > 1:
        if live:
            raise fw.InputError("--live: expected one folder, got several cameras")
        calibrate_cameras(folders, board, out, how, distortion, show)
        return
    folder = folders[0]
    words = output.Output(out, *show.targets)
    from fringeworks.files.stack import pose_paths
    from fringeworks.types.packages import need_opencv

    need_opencv("a calibration")
    output.check(out, "rig")
    show.check()
    known = fw.rig.parse_board(board)
    if live:
        if how.setup is None:
            raise fw.InputError("--live: expected together with --setup")
        devices = DeviceOptions(setup=how.setup, projector=projector, camera=camera)
        take_poses(devices, how.plan, known, folder, how.options)
    options = how.options
    with output.progress(len(pose_paths(folder)) + 1) as progress:
        found = fw.calibrate(
            how.poses(folder), known, distortion=distortion, progress=progress, **options
        )
    with output.target(out, ".toml") as place:
        fw.files.write_rig(place, found.rig)
    figures = fw.report.summarise(found)
    show.write(found, figures, name=folder.name, provenance=found.rig.provenance)
    words.tell(found, figures)
    words.wrote(out, show.figure, show.report)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks measure part/ --rig rig.toml --out part.ply",
)
def measure(
    stacks: Annotated[
        list[Path],
        typer.Argument(
            help="Folder of images with its plan, or a TIFF, .npy or .npz stack; several cameras: "
            "one for each, in the order of the rig file."
        ),
    ],
    rig_file: Annotated[
        Path,
        typer.Option(
            "--rig",
            help="Rig file of `calibrate`; for two cameras and a projector that only codes also "
            "of OpenCV (.xml, .yml), .json, or text of MATLAB (.m, .txt).",
        ),
    ],
    how: DecodingOptions,
    axis: Annotated[
        AxisName | None,
        typer.Option(
            help="Axis along which the fringes vary, x or y; those of the other are left."
        ),
    ] = None,
    epipolar_px: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the epipolar error that the rig causes, px; by default "
            "from the rig."
        ),
    ] = None,
    depth: DepthOption = None,
    blur_px: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the camera's blur, px; its error on curved surfaces is "
            "removed. By default that of the rig; 0 keeps the error."
        ),
    ] = None,
    white_balance: Annotated[
        str | None,
        typer.Option(
            help="Gains of red, green and blue for the colour of points, as 1.9,1,1.4; or a "
            "capture of a grey card that fills the frame."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Points: .ply, .xyz, .npz, .pcd, .csv, .e57, .las, .laz, .mat or .mcap; '-' is "
            "PLY. Several cameras: none of .npz and .mat.",
        ),
    ] = None,
    ply: PlyOption = Ply.points,
    *,
    robot: RobotOptions,
    show: ShowOptions,
) -> None:
    """Measure the points of one or several cameras' frames with a calibrated rig."""
    chosen: Literal["x", "y"] | None = None if axis is None else axis.value
    robot.check()
    if len(stacks) > 1:
        if robot.frame != FrameName.camera:
            raise fw.InputError("--in: robot cannot be combined with several cameras")
        if (epipolar_px, depth, blur_px, white_balance) != (None,) * 4 or ply != Ply.points:
            raise fw.InputError(
                "measure: --epipolar-px, --depth, --blur-px, --white-balance and --ply cannot be "
                "combined with several cameras"
            )
        measure_cameras(stacks, rig_file, out, how, chosen, show)
        return
    known: dict[str, Any] = {"axis": chosen, "epipolar_px": epipolar_px, "blur_px": blur_px}
    known |= {"depth_mm": depth_of(depth), "white_balance": gains_of(white_balance)}
    measure_points(stacks[0], rig_file, out, how, show, ply.value, robot, **known)
