"""Captures of one scene, one after another, whose number and exposures are not known before."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from fringeworks.files.atomic import StrPath
from fringeworks.files.exposures import GrowingExposures, growing_exposures
from fringeworks.files.stack import read_stack
from fringeworks.scan.bench import Bench, Take, take
from fringeworks.scan.frames import Progress
from fringeworks.stack.frames import Stack
from fringeworks.types import InputError

UNKNOWN_OVERHEAD = 1.0
"""Time of a frame without its exposure, over the exposure, before one was measured."""


class CaptureSeries:
    """Takes captures of a bench's plan with exposures relative to the first one.

    ``capture_series`` makes it; ``fw.evaluate.scan_until`` takes captures through ``take``.
    """

    def __init__(
        self, bench: Bench, growing: GrowingExposures, how: Take, progress: Progress
    ) -> None:
        self._bench, self._growing, self._how, self._progress = bench, growing, how, progress
        self._first_ms = bench.settings.exposure_ms
        self.overhead = UNKNOWN_OVERHEAD
        """Time of a frame without its exposure, over the first exposure; measured by each
        capture."""

    @property
    def exposures(self) -> tuple[float, float]:
        """Smallest and largest exposure, over the first; (1, 1) where the camera's is not known."""
        limits = self._bench.camera.limits().exposure_ms
        if self._first_ms is None or limits is None or self._how.fast:
            return 1.0, 1.0
        return limits[0] / self._first_ms, limits[1] / self._first_ms

    def take(self, factor: float = 1.0) -> Stack:
        """Take a capture with an exposure, over that of the first one.

        Raises
        ------
        As ``capture``.
        """
        settings = self._bench.settings
        if self._first_ms is not None:
            settings = replace(settings, exposure_ms=self._first_ms * factor)
        folder = self._growing.add(settings)
        bench = replace(self._bench, settings=settings)
        # A longer exposure may saturate what is not of interest.
        how = self._how if factor == 1.0 else replace(self._how, most_saturated=1.0)
        started = time.monotonic()
        take(bench, folder, how, progress=self._progress)
        if self._first_ms is not None:
            frame_ms = (
                1e3 * (time.monotonic() - started) / (bench.plan.pictures * self._how.average)
            )
            self.overhead = max(frame_ms / self._first_ms - factor, 0.0)
        return read_stack(folder)


@contextmanager
def capture_series(
    bench: Bench, folder: StrPath, how: Take | None = None, *, progress: Progress = lambda _: None
) -> Iterator[CaptureSeries]:
    """Take captures of one scene into a folder until the caller has enough.

    Parameters
    ----------
    bench : Bench
    folder : path
        New, empty, or an earlier result. ``measure`` reads it when the series has ended.
    how : Take, optional
        How each capture is taken; without several exposures or ``resume``.
    progress : callable
        Called with the label of every frame that was taken.

    Raises
    ------
    InputError for several exposures, an automatic one or ``resume``.

    Examples
    --------
    >>> import tempfile
    >>> import fringeworks as fw
    >>> from fringeworks.devices.clock import SimulatedClock
    >>> projector, camera = fw.devices.virtual_bench("plane", clock=SimulatedClock())
    >>> plan = fw.simulate.fringe_plan(fw.devices.virtual_rig(), both=False)
    >>> bench = fw.scan.Bench(projector, camera, chosen_plan=plan)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     with fw.scan.capture_series(bench, f"{place}/part") as series:
    ...         stacks = [series.take(), series.take()]
    ...     read = fw.files.read_exposures(f"{place}/part")
    >>> len(read) == len(stacks)
    True
    """
    how = how or Take()
    if how.hdr > 1 or how.resume or how.auto_exposure:
        raise InputError(
            "hdr, resume and auto_exposure cannot be combined with a series, which chooses its "
            "exposures itself"
        )
    with growing_exposures(folder, force=how.force) as growing:
        yield CaptureSeries(bench, growing, replace(how, force=False), progress)
