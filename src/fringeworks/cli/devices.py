"""``fringeworks devices | setup | capture | scan | studio | serve``: projectors and cameras."""

from __future__ import annotations

import shlex
import subprocess
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import (
    CameraWords,
    Folder,
    Force,
    JsonFile,
    Ply,
    PlyOption,
    ProjectorWords,
    axes_of,
)
from fringeworks.cli.robots import FrameName, RobotOptions
from fringeworks.cli.showing import ShowOptions
from fringeworks.cli.until import UntilOptions, scan_part

SECTION = "Devices"

PlanOfSetup = Annotated[
    Path | None, typer.Argument(help="Plan file; by default the plan of the set-up.")
]


@dataclass(frozen=True)
class CameraOptions:
    """Settings of a camera, as options."""

    exposure_ms: Annotated[float | None, typer.Option(help="Exposure, ms.")] = None
    gain_db: Annotated[float | None, typer.Option(help="Gain, dB.")] = None
    pixel_format: Annotated[
        str | None, typer.Option(help="Such as Mono8, Mono12p or BayerRG8.")
    ] = None

    @property
    def settings(self) -> fw.devices.CameraSettings:
        """As the library takes them."""
        return fw.devices.CameraSettings(
            exposure_ms=self.exposure_ms, gain_db=self.gain_db, pixel_format=self.pixel_format
        )


@dataclass(frozen=True)
class DeviceOptions(CameraOptions):
    """Which devices take the frames, and how the camera is set."""

    setup: Annotated[
        Path | None, typer.Option(help="Set-up file: devices, settings, delay and plan.")
    ] = None
    projector: ProjectorWords = None
    camera: CameraWords = None


@dataclass(frozen=True)
class TakingOptions:
    """How the frames of a plan are taken."""

    auto_exposure: Annotated[
        bool, typer.Option("--auto-exposure", help="Choose exposure and gain for fringes first.")
    ] = False
    hdr: Annotated[
        int, typer.Option(help="Number of exposures, decoded one by one and then fused.")
    ] = 1
    average: Annotated[int, typer.Option(help="Frames averaged for each picture.")] = 1
    fast: Annotated[
        bool, typer.Option("--fast", help="Rely on the delay that the set-up has measured.")
    ] = False
    most_saturated: Annotated[
        float, typer.Option(help="Share of the lit pixels that may be saturated, 0 to 1.")
    ] = 0.5
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on where an interrupted run ended: keep its frames."),
    ] = False
    force: Force = False


def opened(
    devices: DeviceOptions, plan: Path | None = None
) -> AbstractContextManager[fw.scan.Bench]:
    """The devices that options or a set-up name; options hold before the set-up."""
    return fw.scan.open_bench(
        devices.setup,
        projector=devices.projector,
        camera=devices.camera,
        settings=devices.settings,
        plan=plan,
    )


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks devices")
def devices() -> None:
    """List the projectors and cameras that are there, with their limits."""
    words = output.Output()
    for role, found in zip(("projectors", "cameras"), fw.devices.list_devices(), strict=True):
        words.say(f"{role}:")
        for device in found:
            words.say(f"  {device}")
    words.say("without hardware: --projector virtual --camera virtual")


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks setup --projector screen:1 --camera webcam:0 --out setup.toml",
)
def setup(
    out: Annotated[Path, typer.Option("--out", help="Set-up file to write (TOML).")],
    projector: ProjectorWords = None,
    camera: CameraWords = None,
    settings: CameraOptions = CameraOptions(),
    frames: Annotated[int, typer.Option(help="Frames of the plan.")] = 12,
    axes: Annotated[
        str, typer.Option(help="Axes of the plan, as x,y; a calibration needs both.")
    ] = "x",
    json_file: JsonFile = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure",
            help="Draw a picture: of every test, .png, .pdf or .svg; by default beside --out.",
        ),
    ] = None,
) -> None:
    """Find out what a projector and a camera can do together, and propose a plan."""
    from fringeworks.files.setup import check_setup_target

    words = output.Output(json_file, figure)
    beside = out.with_suffix(".png")
    if figure is None and output.draws(words, beside):
        figure = beside
    check_setup_target(out)
    output.check(figure, "figure")
    devices = DeviceOptions(**vars(settings), projector=projector, camera=camera)

    def show(tests: fw.scan.SetupTests) -> None:
        figures = fw.report.summarise(tests)
        if figure is not None:
            output.draw(fw.report.setup_sheet(tests), figure, None)
        output.write_json(json_file, figures)
        words.tell(tests, figures)

    try:
        with opened(devices) as bench, output.progress() as step:
            found = fw.set_up(
                bench.projector,
                bench.camera,
                settings=bench.settings,
                frames=frames,
                axes=axes_of(axes),
                progress=step,
            )
    except fw.scan.SetupStopped as error:
        show(error.tests)
        words.wrote(figure, json_file)
        raise
    show(found)
    assert projector is not None
    assert camera is not None
    written = fw.files.write_setup(out, found, projector=projector, camera=camera)
    words.wrote(*written, figure, json_file)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks capture plan.toml --setup setup.toml --out part/",
)
def capture(
    out: Folder, devices: DeviceOptions, taking: TakingOptions, plan: PlanOfSetup = None
) -> None:
    """Show the pictures of a plan and take a frame of each."""
    output.check_folder(out)
    words = output.Output()
    how = fw.scan.Take(**vars(taking))
    with opened(devices, plan) as bench:
        _take(bench, out, how)
    words.wrote(out)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks scan --setup setup.toml --rig rig.toml --capture part/ "
    "--out part.ply",
)
def scan(
    rig: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            help="Points: .ply, .xyz, .npz, .pcd, .csv, .e57, .las, .laz, .mat or .mcap; with "
            "--turntable none of .npz and .mat.",
        ),
    ],
    folder: Annotated[
        Path, typer.Option("--capture", help="Folder to write the frames to.", show_default=False)
    ],
    devices: DeviceOptions,
    taking: TakingOptions,
    plan: PlanOfSetup = None,
    ply: PlyOption = Ply.points,
    turntable: Annotated[
        float | None,
        typer.Option(help="Angle between two views of a turntable, degrees; merges the views."),
    ] = None,
    board: Annotated[
        str | None, typer.Option(help="Board: as for `calibrate`; it turns with the part.")
    ] = None,
    turn: Annotated[
        str | None,
        typer.Option(
            help="Command that turns the table, with {angle} in degrees; by default you turn it."
        ),
    ] = None,
    *,
    until: UntilOptions,
    robot: RobotOptions,
    show: ShowOptions,
) -> None:
    """Take the frames of a plan and measure the points of the object."""
    output.check_folder(folder)
    words = output.Output(out, *show.targets)
    if until.until is not None:
        if turntable is not None or robot.frame != FrameName.camera:
            raise fw.InputError("--until cannot be combined with --turntable or --in robot")
        scan_part(words, rig, out, folder, opened(devices, plan), vars(taking), until, ply, show)
        return
    if turntable is not None:
        if any(target is not None for target in show.targets):
            raise fw.InputError(
                "--turntable cannot be combined with a figure, JSON or report of one view"
            )
        if robot.frame != FrameName.camera:
            raise fw.InputError("--turntable cannot be combined with --in robot")
        take_views(words, rig, out, folder, devices, taking, plan, (turntable, board, turn))
        return
    if board is not None or turn is not None:
        raise fw.InputError("--board and --turn: expected together with --turntable")
    output.check(out, "points", content=ply.value)
    show.check()
    known = fw.files.read_rig(rig)
    robot.check_before(known, folder.name)
    how = fw.scan.Take(**vars(taking))
    with opened(devices, plan) as bench:
        _take(bench, folder, how)
    found = robot.placed(fw.measure(folder, known), known, folder.name)
    show.write_points(words, found, known, out, ply, name=folder.name)
    words.wrote(folder, out, *show.targets)


def take_views(
    words: output.Output,
    rig: Path,
    out: Path,
    folder: Path,
    devices: DeviceOptions,
    taking: TakingOptions,
    plan: Path | None,
    table: tuple[float, str | None, str | None],
) -> None:
    """Take views of a part on a turntable, and write the merged part."""
    step_deg, board, command = table
    output.check(out, "merged")
    how = fw.scan.Take(**vars(taking))
    with opened(devices, plan) as bench:
        found = fw.scan.scan_turntable(
            lambda place: _take(bench, place, how),
            lambda angle: _turn(angle, command),
            folder,
            rig,
            step_deg=step_deg,
            board=board,
            progress=words.say,
        )
    with output.target(out, ".ply") as place:
        fw.files.write_merged_points(place, found.points, provenance=found.provenance)
    words.found(found.findings)
    words.say(f"{len(found.points.xyz_mm)} points of {len(found.poses)} views")
    words.wrote(folder, out)


def _turn(angle_deg: float, command: str | None) -> None:
    """Turn the table by a command, or wait until somebody has turned it."""
    if command is None:
        typer.prompt(
            f"turn the table to {angle_deg:g}°, then Enter",
            default="",
            show_default=False,
            err=True,
        )
        return
    words = [word.replace("{angle}", f"{angle_deg:g}") for word in shlex.split(command)]
    done = subprocess.run(words, check=False)
    if done.returncode:
        raise fw.InputError(
            f"--turn: expected a command that ends with 0, got {done.returncode} from {words[0]}"
        )


def take_poses(
    devices: DeviceOptions,
    plan: Path | None,
    board: fw.rig.Board,
    folder: Path,
    options: fw.stack.DecodeOptions,
) -> None:
    """Take poses of a board until they are enough; the user presses Enter for each."""

    def ready(judgement: fw.scan.PoseJudgement) -> bool:
        typer.echo(f"{judgement}")
        try:
            answer = typer.prompt(
                "Enter takes the pose, q ends", default="", show_default=False, err=True
            )
        except typer.Abort:
            typer.echo(f"\nended; the same command goes on with the poses in {folder}", err=True)
            raise
        return not str(answer).strip().lower().startswith("q")

    with opened(devices, plan) as bench:
        fw.scan.take_poses(
            bench,
            board,
            folder,
            ready=ready,
            taken=lambda pose: typer.echo(f"{pose}"),
            **options,
        )


def _take(bench: fw.scan.Bench, folder: Path, how: fw.scan.Take) -> None:
    """Take the frames of the bench's plan into a folder, and show how far they are."""
    with output.progress(bench.plan.pictures * how.hdr) as step:
        fw.scan.take(bench, folder, how, progress=step)


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


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks serve scanner/ --setup setup.toml --rig rig.toml",
)
def serve(
    folder: Annotated[
        Path, typer.Argument(help="Folder of the queue, the results, the recipes and the token.")
    ],
    rig: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    plan: PlanOfSetup = None,
    setup: Annotated[
        Path | None, typer.Option(help="Set-up file: devices, settings, delay and plan.")
    ] = None,
    projector: ProjectorWords = None,
    camera: CameraWords = None,
    host: Annotated[
        str | None, typer.Option(help="Address to serve other machines on; all need the token.")
    ] = None,
    port: Annotated[int | None, typer.Option(help="Port; by default 8138, or a free one.")] = None,
    queue: Annotated[int, typer.Option(help="Scans that may wait; others are refused.")] = 8,
    keep: Annotated[
        int, typer.Option(help="Results that are kept; older ones are deleted.")
    ] = 1000,
) -> None:
    """Serve scans over HTTP: one at a time, with results that survive restarts."""
    fw.run_service(
        folder,
        rig,
        setup=setup,
        projector=projector,
        camera=camera,
        plan=plan,
        host=host,
        port=port,
        queue=queue,
        keep=keep,
    )
