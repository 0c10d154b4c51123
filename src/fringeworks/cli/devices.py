"""``fringeworks devices | setup | capture | scan``: projectors and cameras."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import AxisName, Folder, Force, JsonFile, Ply, PlyOption, items
from fringeworks.cli.words import say_points

SECTION = "Devices"

ProjectorWords = Annotated[
    str | None,
    typer.Option("--projector", help="screen, screen:NAME, memory:FOLDER or virtual[:SCENE]."),
]
CameraWords = Annotated[
    str | None,
    typer.Option("--camera", help="webcam:NUMBER, genicam[:NAME], folder:PATH or virtual[:SCENE]."),
]
SetupFile = Annotated[
    Path | None, typer.Option("--setup", help="Set-up file: devices, settings, delay and plan.")
]
Exposure = Annotated[float | None, typer.Option("--exposure-ms", help="Exposure, ms.")]
GainDb = Annotated[float | None, typer.Option("--gain-db", help="Gain, dB.")]
Format = Annotated[
    str | None, typer.Option("--pixel-format", help="Such as Mono8, Mono12p or BayerRG8.")
]
Average = Annotated[int, typer.Option("--average", help="Frames averaged for each picture.")]
AutoExposure = Annotated[
    bool, typer.Option("--auto-exposure", help="Choose exposure and gain for fringes first.")
]
Hdr = Annotated[
    int, typer.Option("--hdr", help="Number of exposures, decoded one by one and then fused.")
]
Fast = Annotated[
    bool, typer.Option("--fast", help="Rely on the delay that the set-up has measured.")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Keep the frames of an interrupted capture.")
]


@dataclass(frozen=True)
class _Bench:
    """Open devices, and what the set-up knows of them."""

    projector: Any
    camera: Any
    settings: fw.CameraSettings
    setup: Any
    """StoredSetup, or None."""


@contextmanager
def opened(
    projector: str | None,
    camera: str | None,
    setup: Path | None,
    settings: fw.CameraSettings,
) -> Iterator[_Bench]:
    """The devices that options or a set-up name; options hold before the set-up."""
    stored = None if setup is None else fw.read_setup(setup)
    projector = projector or (stored.projector if stored else None)
    camera = camera or (stored.camera if stored else None)
    if projector is None or camera is None:
        raise fw.InputError("devices: expected --projector and --camera, or --setup")
    if stored is not None:
        given = {name: value for name, value in vars(settings).items() if value is not None}
        settings = fw.CameraSettings(**(vars(stored.settings) | given))
    shows, films = fw.open_devices(projector, camera)
    with shows, films:
        yield _Bench(shows, films, settings, stored)


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks devices")
def devices() -> None:
    """List the projectors and cameras that are there, with their limits."""
    words = output.Output()
    for role, found in zip(("projectors", "cameras"), fw.list_devices(), strict=True):
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
    exposure_ms: Exposure = None,
    gain_db: GainDb = None,
    pixel_format: Format = None,
    frames: Annotated[int, typer.Option(help="Frames of the plan that is proposed.")] = 12,
    axes: Annotated[
        str, typer.Option(help="Axes of that plan: x, y or x,y; a calibration needs both.")
    ] = "x",
) -> None:
    """Find out what a projector and a camera can do together, and propose a plan."""
    words = output.Output(out)
    settings = fw.CameraSettings(exposure_ms, gain_db, None, pixel_format)
    with opened(projector, camera, None, settings) as bench, output.progress() as step:
        found = fw.set_up(
            bench.projector,
            bench.camera,
            settings=bench.settings,
            frames=frames,
            axes=tuple(axis.value for axis in items(AxisName, axes, "axes")),
            progress=step,
        )
    assert projector is not None
    assert camera is not None
    written = fw.write_setup(out, found, projector=projector, camera=camera)
    words.say(f"projector {found.projector}: {found.size_px[0]} × {found.size_px[1]} px")
    exposure = found.settings.exposure_ms
    words.say(
        f"camera {found.camera}: exposure "
        + ("unknown" if exposure is None else f"{exposure:.3g} ms")
        + f", noise {found.noise.read_counts:.2g} counts, gain {found.noise.gain:.2g}"
    )
    words.say(
        f"response: light ≈ level^{found.levels.gamma:.2f}, white {found.levels.contrast:.0f} "
        "times as bright as black"
    )
    words.say(f"delay: {found.delay or 'unknown'}")
    words.say(
        f"proposed plan: {found.proposal.summary}; predicted σ {found.proposal.sigma_px:.2g} px"
    )
    for finding in found.findings:
        words.say(f"finding: {finding.text}")
    if not found.findings:
        words.say("nothing was found that makes measurements worse")
    words.wrote(*written)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks capture plan.toml --setup setup.toml --out part/",
)
def capture(
    out: Folder,
    plan: Annotated[
        Path | None, typer.Argument(help="Plan file; by default the plan of the set-up.")
    ] = None,
    setup: SetupFile = None,
    projector: ProjectorWords = None,
    camera: CameraWords = None,
    exposure_ms: Exposure = None,
    gain_db: GainDb = None,
    pixel_format: Format = None,
    auto_exposure: AutoExposure = False,
    hdr: Hdr = 1,
    average: Average = 1,
    fast: Fast = False,
    resume: Resume = False,
    force: Force = False,
) -> None:
    """Show the pictures of a plan and take a frame of each."""
    output.check_folder(out)
    words = output.Output()
    settings = fw.CameraSettings(exposure_ms, gain_db, None, pixel_format)
    with opened(projector, camera, setup, settings) as bench:
        how = _How(average, fast, auto_exposure, hdr, resume, force)
        _capture(bench, plan, out, how)
    words.wrote(out)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks scan --setup setup.toml --rig rig.toml --out part.ply",
)
def scan(
    rig: Annotated[Path, typer.Option("--rig", help="Rig file.")],
    out: Annotated[Path, typer.Option("--out", help="Points: .ply, .xyz or .npz.")],
    folder: Annotated[
        Path, typer.Option("--capture", help="Folder to write the frames to.", show_default=False)
    ],
    plan: Annotated[
        Path | None, typer.Argument(help="Plan file; by default the plan of the set-up.")
    ] = None,
    setup: SetupFile = None,
    projector: ProjectorWords = None,
    camera: CameraWords = None,
    exposure_ms: Exposure = None,
    gain_db: GainDb = None,
    pixel_format: Format = None,
    auto_exposure: AutoExposure = False,
    hdr: Hdr = 1,
    average: Average = 1,
    fast: Fast = False,
    resume: Resume = False,
    force: Force = False,
    ply: PlyOption = Ply.points,
    json_file: JsonFile = None,
) -> None:
    """Take the frames of a plan and measure the points of the object."""
    output.check_folder(folder)
    words = output.Output(out, json_file)
    from fringeworks.files.points import check_points_target

    output.check(out, check_points_target)
    known = fw.read_rig(rig)
    settings = fw.CameraSettings(exposure_ms, gain_db, None, pixel_format)
    with opened(projector, camera, setup, settings) as bench:
        how = _How(average, fast, auto_exposure, hdr, resume, force)
        _capture(bench, plan, folder, how)
    found = fw.measure(folder, known)
    with output.target(out, ".ply") as place:
        fw.write_points(place, found.points, kind=ply.value)
    figures = fw.summarise(found)
    output.write_json(json_file, figures)
    say_points(words, figures)
    words.wrote(folder, out, json_file)


def take_poses(setup: Path, plan: Path | None, board: fw.Board, folder: Path) -> None:
    """Take poses of a board until they are enough; the user presses Enter for each."""

    def ready(judgement: fw.PoseJudgement) -> bool:
        typer.echo(f"{judgement}")
        answer = typer.prompt(
            "Enter takes the pose, q ends", default="", show_default=False, err=True
        )
        return not str(answer).strip().lower().startswith("q")

    with opened(None, None, setup, fw.CameraSettings()) as bench:
        chosen = bench.setup.plan if plan is None else fw.read_plan(plan)
        fw.take_poses(
            bench.projector,
            bench.camera,
            chosen,
            board,
            folder,
            ready=ready,
            taken=lambda pose: typer.echo(f"{pose}"),
            settings=bench.settings,
        )


@dataclass(frozen=True)
class _How:
    """How the frames of a plan are taken."""

    average: int
    fast: bool
    auto_exposure: bool
    hdr: int
    resume: bool
    force: bool


def _delay(bench: _Bench, how: _How) -> Any:
    """The delay of the set-up, where the fast way is asked for."""
    if not how.fast:
        return None
    if bench.setup is None or bench.setup.delay is None:
        raise fw.InputError("--fast: expected a set-up with a measured delay, got none")
    if how.hdr > 1 or how.auto_exposure:
        raise fw.InputError(
            "--fast cannot be combined with --hdr or --auto-exposure: the delay depends on the "
            "exposure"
        )
    return bench.setup.delay


def _capture(bench: _Bench, plan: Path | None, folder: Path, how: _How) -> None:
    """Take the frames of a plan into a folder."""
    if plan is None and bench.setup is None:
        raise fw.InputError("plan: expected a plan file, or --setup with its plan; got neither")
    chosen = bench.setup.plan if plan is None else fw.read_plan(plan)
    delay = _delay(bench, how)
    settings = bench.settings
    if how.auto_exposure and how.hdr == 1:
        bench.camera.configure(settings)
        settings = fw.auto_exposure(bench.projector, bench.camera)
    if how.hdr > 1:
        bench.camera.configure(settings)
        series = fw.exposure_series(bench.projector, bench.camera, how.hdr)
        with output.progress(chosen.frames * len(series)) as step:
            fw.capture_hdr(
                bench.projector,
                bench.camera,
                chosen,
                folder,
                series,
                average=how.average,
                resume=how.resume,
                force=how.force,
                progress=step,
            )
        return
    with output.progress(chosen.frames) as step:
        fw.capture(
            bench.projector,
            bench.camera,
            chosen,
            folder,
            settings=settings,
            delay=delay,
            average=how.average,
            resume=how.resume,
            force=how.force,
            progress=step,
        )
