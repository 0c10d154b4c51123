"""Options of the commands that read stacks and decode them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import fringeworks as fw

if TYPE_CHECKING:
    import typer

    from fringeworks.cli.options import CameraName, PlanFile, ProjectorName, ResponseFile


@dataclass(frozen=True)
class StackOptions:
    """How a stack is read, and what is known of its frames."""

    plan: PlanFile = None
    setup: Annotated[
        Path | None,
        typer.Option(help="Set-up file: its noise is used and not measured in the frames."),
    ] = None
    noise: Annotated[
        float | None,
        typer.Option(help="Standard deviation of the camera's noise, counts; measured by default."),
    ] = None
    gain: Annotated[
        float | None, typer.Option(help="Shot noise, variance per count; with --noise.")
    ] = None
    saturation: Annotated[
        float | None, typer.Option(help="Counts from which on a sample is not trusted.")
    ] = None
    min_modulation: Annotated[float, typer.Option(help="Least modulation, counts.")] = 0.0
    channels: Annotated[
        str | None,
        typer.Option(
            help="Channels of colour images that are a frame each: g for green alone, rgb for "
            "three frames in every image; best for the combination with the least noise. "
            "Luminance by default."
        ),
    ] = None
    mosaic: Annotated[
        str | None,
        typer.Option(
            help="Filters of raw frames that are not interpolated, as rggb; file for raw "
            "photographs. Of the one of --channels, only its own pixels are measured."
        ),
    ] = None
    camera_name: CameraName = None
    projector_name: ProjectorName = None

    @property
    def options(self) -> fw.stack.DecodeOptions:
        """As the library takes them."""
        if self.noise is None and self.gain is not None:
            raise fw.InputError("--gain: expected together with --noise")
        found: fw.stack.DecodeOptions = {}
        if self.min_modulation:
            found["min_modulation"] = self.min_modulation
        if self.noise is not None:
            found["noise"] = fw.signal.CameraNoise(self.noise, self.gain or 0.0)
        elif self.setup is not None:
            found["noise"] = fw.files.read_setup(self.setup).noise
        if self.saturation is not None:
            found["saturation"] = self.saturation
        return found

    def read(self, path: Path) -> fw.Stack:
        """Read a stack."""
        from fringeworks.files.stack import read_stack

        return self.named(read_stack(path, self.plan, channels=self.channels, mosaic=self.mosaic))

    def read_captured(self, path: Path) -> fw.Stack | tuple[fw.Stack, ...]:
        """Read a stack, or the stacks of several exposures of a scene."""
        from fringeworks.files.exposures import is_exposures

        if self.plan is not None or not is_exposures(path):
            return self.read(path)
        if self.setup is not None:
            raise fw.InputError(
                "--setup: expected frames of one exposure, the set-up's; got several exposures, "
                "whose noise differs"
            )
        return tuple(self.named(stack) for stack in fw.files.read_exposures(path))

    def poses(self, folder: Path) -> Iterator[tuple[str, fw.Stack]]:
        """Read the stacks of a calibration."""
        poses = fw.files.read_poses(folder, self.plan, channels=self.channels, mosaic=self.mosaic)
        for name, stack in poses:
            yield name, self.named(stack)

    def named(self, stack: fw.Stack) -> fw.Stack:
        """Return the stack with the names of its devices, where they are given."""
        return replace(
            stack,
            camera=self.camera_name or stack.camera,
            projector=self.projector_name or stack.projector,
        )


@dataclass(frozen=True)
class DecodingOptions(StackOptions):
    """How a stack is decoded."""

    estimate_steps: Annotated[
        bool,
        typer.Option(
            "--estimate-steps/--planned-steps",
            help="Estimate the real phase steps and gains from the frames, or take those of the "
            "plan.",
        ),
    ] = True
    estimate_response: Annotated[
        bool,
        typer.Option(
            "--estimate-response",
            help="Refuse frames that do not show the response of projector and camera.",
        ),
    ] = False
    response: ResponseFile = None

    @property
    def options(self) -> fw.stack.DecodeOptions:
        """As the library takes them."""
        found = super().options
        if not self.estimate_steps:
            found["estimate_steps"] = False
        if self.estimate_response:
            found["estimate_response"] = True
        if self.response is not None:
            found["response"] = fw.files.read_response(self.response)
        return found
