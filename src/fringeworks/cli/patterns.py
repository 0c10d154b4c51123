"""``fringeworks plan | patterns``: choose what is projected, and draw it."""

from __future__ import annotations

from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import Folder, Force, JsonFile, axes_of, depth_of, size_of

SECTION = "Patterns"
DEPTH_ALONE = (
    "--depth: expected with --rig and without --projector-size, --camera-pixel, --blur-px and "
    "--colours"
)
"""What goes with a range of depths."""


class PictureFormat(StrEnum):
    """How pictures are written."""

    png = "png"
    tiff = "tiff"
    flash = "flash"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks plan --projector-size 1920x1080 --frames 12 --out plan.toml",
)
def plan(
    frames: Annotated[int, typer.Option(help="Frames of the plan.")],
    rig_file: Annotated[
        Path | None,
        typer.Option("--rig", help="Rig file of `calibrate`; for the projector's size or --depth."),
    ] = None,
    depth: Annotated[
        str | None,
        typer.Option(
            "--depth",
            help="Smallest and largest depth of what is lit, mm, as 450:560; with --rig. Three or "
            "four frames then suffice.",
        ),
    ] = None,
    projector_size: Annotated[
        str | None, typer.Option(help="Projector's columns x rows, as 1920x1080.")
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(help="Set-up file: projector's size, noise, modulation and shortest period."),
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(help="Axes of the plan, as x,y; x, or with --depth the rig's main axis."),
    ] = None,
    noise: Annotated[
        float | None, typer.Option(help="Standard deviation of the camera's noise, counts; 2.")
    ] = None,
    modulation: Annotated[
        float | None,
        typer.Option(help="Modulation of the darkest surface that matters, counts; 100."),
    ] = None,
    min_period: Annotated[
        float | None,
        typer.Option(help="Shortest period that the devices resolve, projector px; 16."),
    ] = None,
    max_period: Annotated[
        float | None,
        typer.Option(help="Longest period of the fringes, projector px; any by default."),
    ] = None,
    camera_pixel: Annotated[
        float | None,
        typer.Option(
            help="Projector px that a camera pixel spans: a Gray code of the finest cells that it "
            "resolves is proposed as well."
        ),
    ] = None,
    blur_px: Annotated[
        float | None,
        typer.Option(help="Standard deviation of the camera's blur, px; with --camera-pixel."),
    ] = None,
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            help="Short periods only, 1.5 times the shortest: against light between surfaces.",
        ),
    ] = False,
    colours: Annotated[
        bool,
        typer.Option(
            "--colours",
            help="Three steps in red, green and blue of each picture, for a colour camera; "
            "--frames counts pictures, four of them solid.",
        ),
    ] = False,
    channel: Annotated[
        Literal["red", "green", "blue"] | None,
        typer.Option(
            help="Colour of the light, red, green or blue: pictures are shown in it, and that "
            "channel of colour images is decoded."
        ),
    ] = None,
    kind: Annotated[str, typer.Option(help="Kind of plan to write; the best by default.")] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Plan file to write (TOML).")] = None,
    json_file: JsonFile = None,
) -> None:
    """Propose plans for a projector and a number of frames, the smallest error first."""
    from fringeworks.types import made_by

    words = output.Output(out, json_file)
    known = None if setup is None else fw.files.read_setup(setup)
    rig = None if rig_file is None else fw.files.read_rig(rig_file)
    given = {
        "noise": noise,
        "modulation": modulation,
        "min_period_px": min_period,
        "max_period_px": max_period,
        "robust": robust or None,
        "colours": colours or None,
        "camera_pixel_px": camera_pixel,
        "blur_px": blur_px,
        "axes": None if axes is None else axes_of(axes),
    }
    options: dict[str, Any] = _of_setup(known, depth is None) if known else {}
    options |= {n: value for n, value in given.items() if value is not None} | {"frames": frames}
    if depth is None:
        options["width_px"], options["height_px"] = _size(projector_size, known, rig)
        found = fw.propose(**options)
        origin = made_by("propose", options=options)
    elif rig is None or colours or (projector_size, camera_pixel, blur_px) != (None,) * 3:
        raise fw.InputError(DEPTH_ALONE)
    else:
        options["depth_mm"] = depth_of(depth)
        found = fw.patterns.propose_for_depth(rig, **options)
        origin = made_by("propose_for_depth", options=options, rig=rig)
    found = [replace(p, plan=replace(p.plan, channel=channel)) for p in found]
    chosen = [p for p in found if p.kind == kind] if kind else found[:1]
    if not chosen:
        raise fw.InputError(f"--kind: expected {', '.join(p.kind for p in found)}, got {kind!r}")
    if out is not None:
        with output.target(out, ".toml") as place:
            fw.files.write_plan(place, chosen[0].plan)
    told = {"proposals": [_figures(p) for p in found], "provenance": origin.as_dict()}
    output.write_json(json_file, told)
    _say(words, found)
    if out is not None and not output.is_stdout(out):
        words.say(f"wrote {out} ({chosen[0].kind})")


def _say(words: output.Output, found: list[fw.patterns.Proposal]) -> None:
    """Print proposals as a table, and why they have such periods."""
    from fringeworks.types.numbers import number, sigma_text  # when used: it starts quickly

    words.table(
        ["kind", "σ / px", "margin / σ", "frames", "periods × steps"],
        [
            [
                p.kind,
                sigma_text(p.sigma_px),
                number(p.margin, digits=2),
                str(p.plan.pictures),
                p.summary,
            ]
            for p in found
        ],
    )
    if found[0].reason:
        words.say(found[0].reason)


def _size(
    text: str | None, setup: fw.scan.StoredSetup | None, rig: fw.Rig | None
) -> tuple[int, int]:
    """Columns and rows of the projector, from the first that is given."""
    if text is not None:
        return size_of(text, "projector-size")
    if setup is not None:
        return setup.size_px
    if rig is not None:
        return rig.projector.width_px, rig.projector.height_px
    raise fw.InputError("--projector-size: expected, or --setup or --rig; got none of them")


def _of_setup(setup: fw.scan.StoredSetup, gray: bool) -> dict[str, float]:
    """What a set-up has measured, as ``propose`` takes it; for Gray codes also the optics."""
    optics: dict[str, float] = {}
    if gray and setup.camera_pixel_px is not None:
        optics = {"camera_pixel_px": setup.camera_pixel_px, "blur_px": setup.blur_px}
    return optics | {
        "noise": setup.noise_counts,
        "modulation": setup.modulation,
        "min_period_px": setup.min_period_px,
    }


def _figures(proposal: fw.patterns.Proposal) -> dict[str, Any]:
    return {
        "kind": proposal.kind,
        "sigma_px": proposal.sigma_px,
        "margin": proposal.margin,
        "frames": proposal.plan.pictures,
        "reason": proposal.reason,
        "plan": asdict(proposal.plan),
    }


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks patterns plan.toml --out shots/")
def patterns(
    plan_file: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (TOML).")],
    out: Folder,
    format: Annotated[
        PictureFormat,
        typer.Option(help="PNG files, one TIFF stack, or images of 24 bit for a DLPC350."),
    ] = (PictureFormat.png),
    response: Annotated[
        Path | None,
        typer.Option(help="Response file: levels are pre-distorted, and the light is a cosine."),
    ] = None,
    force: Force = False,
) -> None:
    """Draw the pictures of a plan in the order of projection."""
    from fringeworks.files.plan import repeating

    output.check_folder(out)
    layout = fw.files.read_plan(plan_file)
    if response is not None:
        layout = replace(layout, gamma=fw.files.read_response(response).gamma)
    with output.progress(layout.pictures) as progress:
        if format is PictureFormat.flash:
            written = fw.files.write_flash_images(out, layout, force=force, progress=progress)
        else:
            stack = format is PictureFormat.tiff
            written = fw.files.write_patterns(
                out, layout, stack=stack, force=force, progress=progress
            )
    place = out if len(written) > 1 else written[0]
    words = output.Output()
    words.found(repeating(layout))
    words.say(f"wrote {layout.pictures} patterns to {place}")
