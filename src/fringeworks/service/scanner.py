"""What the worker's process does: takes frames with devices that stay open, and measures them."""

from __future__ import annotations

import atexit
import shutil
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.devices.registry import load_plugin
from fringeworks.evaluate.inspect import Inspection, inspect, rig_of
from fringeworks.files.findings import findings_as_dicts
from fringeworks.files.limits import is_file
from fringeworks.files.recipe import read_recipe
from fringeworks.files.rig import read_rig
from fringeworks.files.setup import read_setup
from fringeworks.pipeline.inputs import capture_of
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.triangulate import Triangulator
from fringeworks.scan.bench import Bench, Take, open_bench, take, take_in_memory
from fringeworks.service.clouds import CLOUD_FILE, cloud_file, placed, write_cloud_in_half
from fringeworks.service.models import MeasureRequest, ScanRequest
from fringeworks.serving.worker import Link
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    DeviceProblem,
    FileProblem,
    Finding,
    InputError,
    Pair,
    PointCloud,
    Reason,
    Rig,
    RigMismatch,
    fingerprint,
)


@dataclass(frozen=True)
class Scanner:
    """Which devices scan, and with which rig; every scan of a service has the same."""

    rig: Path
    setup: Path | None = None
    projector: str | None = None
    camera: str | None = None
    plan: Path | None = None
    plugins: tuple[str, ...] = ()
    """Files that register kinds of devices."""


@dataclass(frozen=True)
class Places:
    """Files of a job."""

    half: Path
    """Folder of the result, before it is whole."""
    frames: Path
    """Folder of the frames."""
    keep_frames: bool
    recipe: Path | None


_OPEN: dict[Scanner, tuple[ExitStack, Bench]] = {}
"""The devices that are open in this process."""


def how_taken(wanted: ScanRequest) -> Take:
    """How the frames of a scan are taken.

    Raises
    ------
    InputError for what excludes each other.
    """
    return Take(
        auto_exposure=wanted.auto_exposure,
        hdr=wanted.hdr,
        average=wanted.average,
        fast=wanted.fast,
    )


def check_taking(scanner: Scanner, wanted: ScanRequest) -> None:
    """Refuse a scan that cannot be taken as it is wanted, before it waits.

    Raises
    ------
    InputError
    """
    how = how_taken(wanted)
    if how.fast and (scanner.setup is None or read_setup(scanner.setup).delay is None):
        raise InputError("fast: expected a set-up with a measured delay, got none")


def warm(link: Link, scanner: Scanner) -> None:
    """Open the devices and prepare the rig before the first scan needs them."""
    link.progress("opening the devices")
    _triangulator(scanner.rig)
    _bench(scanner)


def scan(link: Link, scanner: Scanner, wanted: ScanRequest, places: Places) -> dict[str, Any]:
    """Take frames, measure them and write the result; what is said of it."""
    how = how_taken(wanted)
    taken_on_disk = places.keep_frames or wanted.hdr > 1
    started = time.monotonic()
    frames: Any
    try:
        bench = _bench(scanner)
        if taken_on_disk:
            shutil.rmtree(places.frames, ignore_errors=True)
            take(bench, places.frames, how, progress=link.progress)
            frames = capture_of(places.frames)
        else:
            frames = take_in_memory(bench, how, progress=link.progress)
    except DeviceProblem:
        _close(scanner)  # the next scan opens the devices again: a camera may be plugged in again
        raise
    said = _result(scanner, wanted, frames, places, time.monotonic() - started)
    if taken_on_disk and not places.keep_frames:
        shutil.rmtree(places.frames, ignore_errors=True)
    return said


def measure_again(
    link: Link, scanner: Scanner, wanted: MeasureRequest, places: Places
) -> dict[str, Any]:
    """Measure frames that were kept and write the result; what is said of it."""
    link.progress("measuring")
    started = time.monotonic()
    frames = capture_of(places.frames)
    return _result(scanner, wanted, frames, places, time.monotonic() - started)


def _result(
    scanner: Scanner,
    wanted: ScanRequest | MeasureRequest,
    frames: Stack | tuple[Stack, ...] | Pair,
    places: Places,
    taking_s: float,
) -> dict[str, Any]:
    """Measure frames, judge the part, write the cloud; what is said of them."""
    started = time.monotonic()
    prepared = _triangulator(scanner.rig)
    inspection = None
    if places.recipe is None:
        if isinstance(frames, Pair):
            raise InputError("frames: expected those of a plan, got a pair")
        cloud = measure(frames, prepared).points
    else:
        inspection = _inspected(frames, places, prepared.rig)
        assert isinstance(inspection.surface, PointCloud)
        cloud = inspection.surface
    measured = time.monotonic()
    if not (cloud.reason == Reason.OK).any():
        raise InputError("scan: expected points, got none", findings=cloud.findings)
    shutil.rmtree(places.half, ignore_errors=True)
    places.half.mkdir(parents=True)
    write_cloud_in_half(places.half / CLOUD_FILE, cloud, "npz")
    for form in wanted.formats:
        if wanted.frame == "camera" or form == "depth":
            _write(places.half, cloud, form, "camera")
    if wanted.frame == "base":
        moved = placed(cloud, prepared.rig, wanted)
        for form in wanted.formats:
            if form != "depth":
                _write(places.half, moved, form, "base")
    times = {"taking_s": taking_s, "computing_s": measured - started, "measured": measured}
    return _said(cloud, inspection) | {"timing": times}


def _write(folder: Path, cloud: PointCloud, form: Any, frame: Any) -> None:
    path = cloud_file(folder, form, frame)
    if not path.exists():
        write_cloud_in_half(path, cloud, form)


def _said(cloud: PointCloud, inspection: Inspection | None) -> dict[str, Any]:
    """What is said of a result, as JSON values."""
    ok = cloud.reason == Reason.OK
    findings = cloud.findings if inspection is None else inspection.findings
    rows, columns = cloud.shape
    return {
        "rows": rows,
        "columns": columns,
        "points": int(ok.sum()),
        "median_sigma_mm": float(np.median(cloud.sigma_mm[ok])) if ok.any() else None,
        "verdict": None if inspection is None else inspection.verdict,
        "checks": [] if inspection is None else [_check(one) for one in inspection.checks],
        "findings": said_findings(findings),
    }


def said_findings(findings: tuple[Finding, ...]) -> list[dict[str, Any]]:
    """Findings as the service tells them."""
    told = ("kind", "severity", "text", "seen", "causes", "advice")
    return [
        {name: list(one[name]) if name == "causes" else one[name] for name in told}
        | {"figures": {name: _number(value) for name, value in one["figures"].items()}}
        for one in findings_as_dicts(findings)
    ]


def _check(check: Any) -> dict[str, Any]:
    tolerance = check.tolerance
    return {
        "name": tolerance.name,
        "quantity": tolerance.quantity,
        "value": _number(check.value),
        "sigma": _number(check.sigma),
        "unit": check.unit,
        "low": tolerance.low,
        "high": tolerance.high,
        "verdict": check.verdict,
        "why": check.why,
    }


def _number(value: float) -> float | None:
    """A number for JSON, which has no NaN."""
    return float(value) if np.isfinite(value) else None


def check_recipe(path: Path) -> None:
    """Refuse a recipe that cannot judge a scan, before the scan.

    Raises
    ------
    FileProblem that names what to change.
    """
    rig = read_recipe(path).rig
    if isinstance(rig, PathLike | str) and not is_file(Path(rig)):
        raise FileProblem(
            f"{path.name}: expected no rig, or that of the service beside the recipe, got "
            f"{Path(rig).name}, which is not there; delete the line: the service has its own"
        )


def _inspected(frames: Stack | tuple[Stack, ...] | Pair, places: Places, rig: Rig) -> Inspection:
    """A part judged by a recipe, with the rig of the service."""
    assert places.recipe is not None
    recipe = read_recipe(places.recipe)
    if recipe.rig is not None and not _same(rig_of(recipe), rig):
        raise RigMismatch(
            f"{places.recipe.name}: its rig is another one than that of the service; leave rig "
            "out of it"
        )
    known = replace(recipe, rig=rig)
    if isinstance(frames, tuple):
        # Several exposures are one capture, which is read again.
        return inspect(frames[0] if len(frames) == 1 else places.frames, known)
    return inspect(frames, known)


def _same(one: Rig, other: Rig) -> bool:
    """Whether two rigs give the same points in camera coordinates."""
    alone = [replace(rig, provenance=None, robot=None) for rig in (one, other)]
    return fingerprint(alone[0]) == fingerprint(alone[1])


@lru_cache(maxsize=1)
def _triangulator(path: Path) -> Triangulator:
    """The prepared rig, once in the life of this process."""
    return Triangulator(read_rig(path))


def _bench(scanner: Scanner) -> Bench:
    """The devices, opened where they are not open."""
    if scanner not in _OPEN:
        for path in scanner.plugins:
            load_plugin(path)
        opened = ExitStack()
        bench = opened.enter_context(
            open_bench(
                scanner.setup,
                projector=scanner.projector,
                camera=scanner.camera,
                plan=scanner.plan,
            )
        )
        _OPEN[scanner] = opened, bench
        atexit.register(_close, scanner)
    return _OPEN[scanner][1]


def _close(scanner: Scanner) -> None:
    """Release the devices: what one that has failed says of that is known already."""
    opened = _OPEN.pop(scanner, None)
    if opened is not None:
        with suppress(DeviceProblem):
            opened[0].close()
