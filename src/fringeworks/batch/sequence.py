"""A sequence from its frames to points, displacements of areas, drift and vibration."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.batch.sequence_store import SequenceStore
from fringeworks.evaluate.inspect import masked, rig_of
from fringeworks.evaluate.vibrations import AreaTracker, Displacement, Vibration, vibration
from fringeworks.files.atomic import StrPath, refuse_overwrite, write_text
from fringeworks.files.recipe import read_recipe
from fringeworks.files.sequence import FrameSequence, read_sequence
from fringeworks.pipeline.sequences import measure_sequence
from fringeworks.stack.sequence import SequenceOptions, check_every
from fringeworks.types import Frozen, InputError, PointCloud, Recipe, Rig, made_by
from fringeworks.types.packages import need_opencv

OPTIONS = frozenset(SequenceOptions.__annotations__) - {"every", "noise"}
"""Options of a recipe that sequences know."""


@dataclass(frozen=True, eq=False, repr=False)
class SequenceResult(Frozen):
    """What came of a sequence."""

    folder: Path
    """Zarr group with the moments."""
    table: Path
    """Displacements of the areas, as CSV."""
    moments: int
    displacements: dict[str, Displacement]
    """By the name of the area."""
    vibrations: dict[str, Vibration]
    """By the name of the area, where there are moments enough."""
    rate_hz: float | None
    """Frames per second, where known."""


def run_sequence(
    source: StrPath | Iterable[NDArray[Any]],
    recipe: Recipe | StrPath,
    out: StrPath,
    *,
    rate_hz: float | None = None,
    every: int = 1,
    maps: bool = True,
    progress: Callable[[int, int | None], None] = lambda *_: None,
) -> SequenceResult:
    """Measure a scene that moves, and how its areas drift and vibrate.

    Parameters
    ----------
    source : path or iterable of (h, w) arrays
        As for ``read_sequence``; frame k shows pattern k modulo the plan's number of frames.
    recipe : Recipe or path
        With rig and plan. Its areas are followed; tolerances are not judged.
    out : path
        New folder for a Zarr group (format 3), whose name ends with ``.zarr``. Moments are written
        as they come; the table of the areas lies beside it as ``NAME.csv``.
    rate_hz : float > 0, optional
        Frames per second. Without it, times are in frames.
    every : int ≥ 1
        Moments are this many frames apart.
    maps : bool
        Whether to store the points of all pixels, 17 bytes each before compression; otherwise
        areas only.
    progress : callable
        Called with the number of moments that are done, and of all where that is known.

    Returns
    -------
    SequenceResult

    Raises
    ------
    InputError for a recipe without rig or plan, options that sequences do not know, frames that
    contradict the plan, and values out of range; FileProblem for files; MissingPackage without the
    extra ``batch``.
    """
    refuse_overwrite(out, source, recipe)
    known = recipe if isinstance(recipe, Recipe) else read_recipe(recipe)
    rig, place = _checked(known, Path(out), rate_hz)
    check_every(every)
    frames: Any = read_sequence(source) if isinstance(source, (str, Path)) else source
    whole = moments_of(frames, known, every) if isinstance(frames, FrameSequence) else None
    moments = measure_sequence(frames, rig, known.plan, every=every, **known.options)
    # Frames that cannot be used are refused before there are results.
    started = list(islice(moments, 1))
    tracker = AreaTracker({n: a for n, a in known.areas.items() if n != known.within})
    origin = made_by("run_sequence", options={"every": every, "rate_hz": rate_hz})
    unit = "frames" if rate_hz is None else "s"
    store = SequenceStore(place, origin.as_dict(), time_unit=unit, maps=maps)
    count = 0
    try:
        for moment in chain(started, moments):
            time = moment.time_frames / (rate_hz or 1.0)
            points = _within(moment.points, known)
            tracker.add(moment.time_frames, points)
            store.add(time, points)
            count += 1
            progress(count, whole)
    finally:
        # What was measured stays, also where the frames end with an error.
        displacements = _displacements(tracker, known, rate_hz, every)
        table = write_text(place.with_suffix(".csv"), _table(displacements, unit))
    store.end()
    vibrations = {}
    for name, moved in displacements.items():
        with suppress(InputError):
            vibrations[name] = vibration(moved)
    return SequenceResult(place, table, count, displacements, vibrations, rate_hz)


def moments_of(frames: FrameSequence, recipe: Recipe, every: int) -> int:
    """Return how many moments a sequence has."""
    cycle = 1 if recipe.plan is None else recipe.plan.frames
    return max(0, -(-(len(frames) - cycle + 1) // every))


def _checked(recipe: Recipe, place: Path, rate_hz: float | None) -> tuple[Rig, Path]:
    need_opencv("a sequence")
    if recipe.rig is None or recipe.plan is None:
        missing = "a rig" if recipe.rig is None else "a plan"
        raise InputError(f"recipe: expected {missing} for a sequence, got none")
    unknown = set(recipe.options) - OPTIONS
    if unknown:
        raise InputError(
            f"recipe: expected options of sequences, {', '.join(sorted(OPTIONS))}, got "
            f"{', '.join(sorted(unknown))}"
        )
    if rate_hz is not None and not 0 < rate_hz < np.inf:
        raise InputError(f"rate_hz: expected > 0 frames per second, got {rate_hz}")
    if place.suffix != ".zarr":
        raise InputError(f"{place}: expected a name that ends with .zarr")
    return rig_of(recipe), place


def _within(points: PointCloud, recipe: Recipe) -> PointCloud:
    if recipe.within is None:
        return points
    found = masked(points, recipe.areas[recipe.within])
    assert isinstance(found, PointCloud)
    return found


def _displacements(
    tracker: AreaTracker, recipe: Recipe, rate_hz: float | None, every: int
) -> dict[str, Displacement]:
    shared = recipe.plan.frames / every
    return {
        name: tracker.displacement(name, rate_hz=rate_hz or 1.0, frames_shared=shared)
        for name in tracker.names
    }


def _table(displacements: dict[str, Displacement], unit: str) -> str:
    """Displacements of all areas, a row for each moment."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(displacements)
    writer.writerow(
        [f"time {unit}", *(f"{name}{part}" for name in names for part in (" mm", " σ mm"))]
    )
    series = [displacements[name] for name in names]
    for k in range(len(series[0].time_s) if series else 0):
        cells = [x for one in series for x in (one.distance_mm[k], one.sigma_mm[k])]
        writer.writerow([f"{series[0].time_s[k]:.6g}", *(f"{x:.6g}" for x in cells)])
    return text.getvalue()
