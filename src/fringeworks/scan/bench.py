"""A bench of open devices, and one call that takes the frames of its plan.

The command line, the studio and its scripts take all frames through it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from fringeworks.devices.memory_projector import MemoryProjector
from fringeworks.devices.opening import open_devices
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.files.atomic import StrPath
from fringeworks.files.plan import read_plan
from fringeworks.files.setup import StoredSetup, read_setup
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.capture import capture, capture_in_memory
from fringeworks.scan.frames import Grabbed, Progress
from fringeworks.scan.hdr import capture_hdr
from fringeworks.scan.saturation import MOST_SATURATED
from fringeworks.stack.frames import Stack
from fringeworks.types import CameraSettings, Delay, InputError


@dataclass(frozen=True)
class Take:
    """How the frames of a plan are taken.

    Raises
    ------
    InputError for ``fast`` together with ``auto_exposure`` or ``hdr``.
    """

    auto_exposure: bool = False
    """Whether exposure and gain are chosen for fringes first; with ``resume``, those of the
    interrupted capture are taken."""
    hdr: int = 1
    """Number of exposures, which ``exposure_series`` chooses; each is a capture of its own."""
    average: int = 1
    """Number of frames that are averaged for each picture."""
    fast: bool = False
    """Whether frames are taken at the delay that the set-up has measured."""
    most_saturated: float = MOST_SATURATED
    """Largest share of the lit pixels that may be saturated, 0…1; for a single exposure."""
    resume: bool = False
    """Whether the frames of an interrupted capture are kept."""
    force: bool = False
    """Whether a folder with other things in it is written into."""

    def __post_init__(self) -> None:
        if self.hdr < 1:
            raise InputError(f"hdr: expected 1 exposure or more, got {self.hdr}")
        if self.fast and (self.hdr > 1 or self.auto_exposure):
            raise InputError(
                "fast cannot be combined with hdr or auto_exposure: the delay depends on the "
                "exposure"
            )

    @property
    def changed(self) -> dict[str, Any]:
        """The fields that differ from their defaults, by name."""
        values = {field.name: (getattr(self, field.name), field.default) for field in fields(self)}
        return {name: value for name, (value, default) in values.items() if value != default}

    def __repr__(self) -> str:
        return f"Take({', '.join(f'{name}={value!r}' for name, value in self.changed.items())})"


@dataclass(frozen=True)
class Bench:
    """Open devices, and what is known of them."""

    projector: Projector
    camera: Camera
    settings: CameraSettings = field(default_factory=CameraSettings)
    """Asked for before the first frame."""
    setup: StoredSetup | None = None
    """The set-up of these devices."""
    chosen_plan: PatternPlan | None = None
    """Shown in place of the set-up's plan."""

    @property
    def plan(self) -> PatternPlan:
        """The plan that was chosen, that in the memory of the projector, or that of the set-up.

        Raises
        ------
        InputError where there is none of them.
        """
        if self.chosen_plan is not None:
            return self.chosen_plan
        if isinstance(self.projector, MemoryProjector):
            return self.projector.plan
        if self.setup is None:
            raise InputError("plan: expected a plan, or a set-up with its plan; got neither")
        return self.setup.plan

    @property
    def delay(self) -> Delay:
        """The delay that the set-up has measured.

        Raises
        ------
        InputError where there is none.
        """
        if self.setup is None or self.setup.delay is None:
            raise InputError("fast: expected a set-up with a measured delay, got none")
        return self.setup.delay


@contextmanager
def open_bench(
    setup: StrPath | None = None,
    *,
    projector: str | None = None,
    camera: str | None = None,
    settings: CameraSettings | None = None,
    plan: PatternPlan | StrPath | None = None,
) -> Iterator[Bench]:
    """Open the devices of a set-up, or others, and close them at the end.

    Parameters
    ----------
    setup : path, optional
        Set-up file: devices, settings, delay and plan.
    projector, camera : str, optional
        Words as for ``open_devices``, in place of the set-up's.
    settings : CameraSettings, optional
        What they leave open is taken from the set-up.
    plan : PatternPlan or path, optional
        Plan to show; by default that of the projector's memory or of the set-up.

    Yields
    ------
    Bench

    Raises
    ------
    InputError where neither words nor a set-up name a device; FileProblem for files that cannot be
    read; DeviceProblem for devices that do not open.

    Examples
    --------
    >>> from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
    >>> plan = PatternPlan(576, 360, (PhaseSteps("x", 24.0, equal_steps(4)),))
    >>> with open_bench(projector="virtual", camera="virtual:sphere", plan=plan) as bench:
    ...     bench.camera.name, bench.plan.frames
    ('virtual', 4)
    """
    stored = None if setup is None else read_setup(setup)
    shown = plan if plan is None or isinstance(plan, PatternPlan) else read_plan(plan)
    projector = projector or (stored.projector if stored else None)
    camera = camera or (stored.camera if stored else None)
    if projector is None or camera is None:
        raise InputError("devices: expected a projector and a camera, or a set-up; got neither")
    settings = settings or CameraSettings()
    if stored is not None:
        settings = settings.over(stored.settings)
    shows, films = open_devices(projector, camera)
    with shows, films:
        yield Bench(shows, films, settings, stored, shown)


def take(
    bench: Bench, folder: StrPath, how: Take | None = None, *, progress: Progress = lambda _: None
) -> Path:
    """Take the frames of a bench's plan into a folder.

    Parameters
    ----------
    bench : Bench
    folder : path
        As for ``capture``.
    how : Take, optional
        By default one frame of each picture, by agreement, with the settings of the bench.
    progress : callable
        Called with the label of every frame that was taken: ``plan.pictures * how.hdr`` times.

    Returns
    -------
    The folder; ``measure`` takes it.

    Raises
    ------
    As ``capture`` and ``capture_hdr``.
    """
    how = how or Take()
    delay = bench.delay if how.fast else None
    where = bench.projector, bench.camera, bench.plan, folder
    common: dict[str, Any] = {"average": how.average, "resume": how.resume, "force": how.force}
    if how.hdr > 1:
        # The exposures are chosen for the format and the region that were asked for.
        bench.camera.configure(bench.settings)
        return capture_hdr(*where, how.hdr, progress=progress, **common)
    return capture(
        *where,
        settings=bench.settings,
        exposure="auto" if how.auto_exposure else "given",
        delay=delay,
        most_saturated=how.most_saturated,
        progress=progress,
        **common,
    )


def take_in_memory(
    bench: Bench,
    how: Take | None = None,
    *,
    progress: Progress = lambda _: None,
    grabbed: Grabbed = lambda *_: None,
) -> Stack:
    """Take the frames of a bench's plan and keep them in memory; see ``take``, and ``take_frames``
    for ``grabbed``.

    Raises
    ------
    InputError for ``hdr``, whose exposures are captures of their own, and as ``take``.
    """
    how = how or Take()
    if how.hdr > 1 or how.resume:
        raise InputError("hdr and resume need a folder, which keeps the frames")
    return capture_in_memory(
        bench.projector,
        bench.camera,
        bench.plan,
        settings=bench.settings,
        exposure="auto" if how.auto_exposure else "given",
        delay=bench.delay if how.fast else None,
        average=how.average,
        most_saturated=how.most_saturated,
        progress=progress,
        grabbed=grabbed,
    )
