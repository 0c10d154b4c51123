"""Several cameras that take the same pictures at the same time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import (
    Camera,
    CameraLimits,
    Closing,
    ColourCamera,
    Grab,
    Projector,
    TriggeredCamera,
)
from fringeworks.files.atomic import StrPath
from fringeworks.files.capture_writer import (
    refuse_replacing,
    settings_to_resume,
    writing_capture,
)
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.capture import saturation_of
from fringeworks.scan.frames import Progress, check_plan, seeing_colours, take_frames
from fringeworks.types import CameraSettings, Delay, DeviceProblem, InputError


class CameraGroup(Closing):
    """Several cameras as one, whose frames lie beside each other.

    Parameters
    ----------
    cameras : sequence of Camera
        Two or more.
    within_s : float, optional
        Largest time between the exposures of a moment, s, by the clock that all cameras have in
        common (``PtpCamera.synchronise``). By default it is not checked.

    Raises
    ------
    InputError for fewer cameras; for ``within_s`` where a frame has no common clock.

    Notes
    -----
    Settings are those of every camera. The caller closes the cameras.
    """

    def __init__(self, cameras: Sequence[Camera], *, within_s: float | None = None) -> None:
        if len(cameras) < 2:
            raise InputError(f"cameras: expected two or more, got {len(cameras)}")
        if within_s is not None and not within_s > 0.0:
            raise InputError(f"within_s: expected more than 0, got {within_s}")
        self._cameras = tuple(cameras)
        self._within_s = within_s
        self._sizes: tuple[tuple[int, int], ...] = ()
        self.settings: tuple[CameraSettings, ...] = ()
        """What each camera has reported last."""

    @property
    def name(self) -> str:
        """The names of all cameras."""
        return " + ".join(camera.name for camera in self._cameras)

    def limits(self) -> CameraLimits:
        """Size of the frames beside each other; exposures that all cameras have."""
        all_limits = [camera.limits() for camera in self._cameras]
        ranges = [one.exposure_ms for one in all_limits if one.exposure_ms is not None]
        shared = len(ranges) == len(all_limits)
        periods = [one.frame_s for one in all_limits if one.frame_s is not None]
        return CameraLimits(
            sum(one.width_px for one in all_limits),
            max(one.height_px for one in all_limits),
            (max(r[0] for r in ranges), min(r[1] for r in ranges)) if shared else None,
            frame_s=max(periods, default=None),
        )

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change the settings of all cameras; what all of them report alike is returned."""
        self.settings = tuple(camera.configure(settings) for camera in self._cameras)
        first = self.settings[0]
        differing = {
            name: None
            for name in ("exposure_ms", "gain_db", "region", "pixel_format", "triggered")
            if any(getattr(one, name) != getattr(first, name) for one in self.settings)
        }
        # A region is that of one sensor, and no part of frames that lie beside each other.
        return replace(first, **{**differing, "region": None})

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the next frame of every camera, beside each other; see ``Camera.grab``."""
        grabs = [camera.grab(timeout_s) for camera in self._cameras]
        self._check_times(grabs)
        self._sizes = tuple((grab.pixels.shape[0], grab.pixels.shape[1]) for grab in grabs)
        return Grab(
            joined([grab.pixels for grab in grabs]),
            max(grab.host_s for grab in grabs),
            grabs[0].device_s,
            grabs[0].number,
            all(grab.complete for grab in grabs),
            grabs[0].clock,
        )

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        for camera in self._cameras:
            if not isinstance(camera, ColourCamera):
                raise DeviceProblem(f"{camera.name}: expected a camera that sees colours")
        for camera in self._cameras:
            if isinstance(camera, ColourCamera):
                camera.deliver_colours(wanted)

    def waiting(self) -> int:
        """Number of moments of which all frames have arrived."""
        return min(camera.waiting() for camera in self._cameras)

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        for camera in self._cameras:
            camera.discard()

    def trigger(self) -> float:
        """Expose a frame of every camera; see ``TriggeredCamera.trigger``."""
        sent_s = time.monotonic()
        for camera in self._cameras:
            if not isinstance(camera, TriggeredCamera):
                raise DeviceProblem(f"{camera.name}: expected a camera that waits for triggers")
            sent_s = camera.trigger()
        return sent_s

    def split(self, frame: NDArray[Any]) -> list[NDArray[Any]]:
        """Return the frames of the cameras that lie beside each other in one."""
        edges = np.cumsum([columns for _, columns in self._sizes])[:-1]
        parts = np.split(frame, edges, axis=1)
        return [
            np.ascontiguousarray(part[:rows])
            for part, (rows, _) in zip(parts, self._sizes, strict=True)
        ]

    def _check_times(self, grabs: Sequence[Grab]) -> None:
        if self._within_s is None:
            return
        times = [g.device_s for g in grabs if g.clock == "ptp" and g.device_s is not None]
        if len(times) < len(grabs):
            raise InputError(
                f"{self.name}: within_s: expected cameras whose clocks follow the network's; call "
                "synchronise of each first"
            )
        apart_s = max(times) - min(times)
        if apart_s > self._within_s:
            raise DeviceProblem(
                f"{self.name}: expected frames within {1e3 * self._within_s:g} ms of each other, "
                f"got {1e3 * apart_s:.3g} ms: a frame was lost, or the cameras run freely; trigger "
                "them"
            )


def joined(frames: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return frames beside each other, lower ones with zeros below.

    Examples
    --------
    >>> joined([np.ones((1, 2), np.uint8), np.ones((2, 1), np.uint8)]).tolist()
    [[1, 1, 1], [0, 0, 1]]
    """
    rows = max(frame.shape[0] for frame in frames)
    beside = [(0, 0)] * (frames[0].ndim - 1)
    padded = [np.pad(frame, [(0, rows - frame.shape[0]), *beside]) for frame in frames]
    return np.concatenate(padded, axis=1)


def capture_together(
    projector: Projector,
    cameras: Sequence[Camera],
    plan: PatternPlan,
    folders: Sequence[StrPath],
    *,
    settings: CameraSettings | None = None,
    within_s: float | None = None,
    delay: Delay | None = None,
    resume: bool = False,
    progress: Progress = lambda _: None,
) -> list[Path]:
    """Show the pictures of a plan once, and take a frame of each with several cameras.

    Parameters
    ----------
    projector : Projector
    cameras : sequence of Camera
        Two or more.
    plan : PatternPlan
        With ``colours``, projector and cameras must show and see them, as for ``capture``.
    folders : sequence of paths
        One for each camera; new or empty.
    settings : CameraSettings, optional
        Of all cameras.
    within_s : float, optional
        Largest time between the exposures of a picture, s; see ``CameraGroup``.
    delay : Delay, optional
        For the fast way of taking frames, measured with a ``CameraGroup``; see ``take_frames``.
    resume : bool
        Keep the frames of captures that were interrupted, with their settings, and take the
        pictures of which any camera has none.
    progress : callable
        Called with the label of every picture that was taken.

    Returns
    -------
    The folders: one capture for each camera, as ``measure`` and ``calibrate`` take them.

    Raises
    ------
    As ``capture``; InputError for a number of folders other than that of the cameras, or one folder
    for two of them.

    Examples
    --------
    >>> import tempfile
    >>> import fringeworks as fw
    >>> from fringeworks.devices.clock import SimulatedClock
    >>> projector, camera = fw.devices.virtual_bench("plane", clock=SimulatedClock())
    >>> plan = fw.simulate.fringe_plan(fw.devices.virtual_rig(), both=False)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     both = [f"{place}/left", f"{place}/right"]
    ...     taken = capture_together(projector, [camera, camera], plan, both)
    ...     [len(fw.files.read_stack(folder).frames) for folder in taken]
    [12, 12]
    """
    if len(folders) != len(cameras):
        raise InputError(f"folders: expected one for each of {len(cameras)} cameras, got "
                         f"{len(folders)}")  # fmt: skip
    if len({Path(folder).resolve() for folder in folders}) < len(folders):
        raise InputError("folders: expected another one for each camera, got one twice")
    group = CameraGroup(cameras, within_s=within_s)
    check_plan(projector, plan, colours=True)
    if not resume:
        for folder in folders:
            refuse_replacing(folder)
    with seeing_colours(group, plan):
        group.configure(settings or CameraSettings())
        if resume:
            group.settings = _as_before(cameras, folders, settings or CameraSettings())
    with ExitStack() as open_captures:
        writers = [
            open_captures.enter_context(
                writing_capture(
                    folder,
                    plan,
                    camera=camera.name,
                    projector=projector.name,
                    settings=used,
                    saturation=saturation_of(used, 1),
                    resume=resume,
                )
            )
            for folder, camera, used in zip(folders, cameras, group.settings, strict=True)
        ]
        missing = [set(writer.missing) for writer in writers]
        only = sorted(set().union(*missing))
        frames = take_frames(projector, group, plan, delay=delay, only=only, progress=progress)
        for number, frame in frames if only else ():
            for writer, needed, part in zip(writers, missing, group.split(frame), strict=True):
                if number in needed:
                    writer.add(number, part)
    return [Path(folder) for folder in folders]


def _as_before(
    cameras: Sequence[Camera], folders: Sequence[StrPath], settings: CameraSettings
) -> tuple[CameraSettings, ...]:
    """Give each camera the settings of its interrupted capture, where no others are given."""
    return tuple(
        camera.configure(settings.over(settings_to_resume(folder)))
        for camera, folder in zip(cameras, folders, strict=True)
    )
