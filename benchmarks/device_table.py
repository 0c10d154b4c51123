"""Projectors and cameras × plans × ways to take frames: what is refused, named or wrong.

``python -m benchmarks.device_table --out table.json [--seeds 0,1] [--cases A;B]``, from
the root of the source tree. Devices live on a clock that jumps: a case takes seconds.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.device_camera import ModelCamera
from benchmarks.device_cases import CASES, Case
from benchmarks.device_light import COLUMNS, ROWS, ModelProjector
from benchmarks.outcomes import fill_table, plans
from fringeworks import decode
from fringeworks.files.setup import StoredSetup
from fringeworks.scan.bench import Bench, Take, take, take_in_memory
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.setup import SetupStopped, set_up
from fringeworks.types import CameraSettings, Decoded, InputError

MOST_BEYOND = 300.0
"""Pixels beyond 5 σ, per million, that a case may have without being refused or named."""
LEAST_MEASURED = 0.98
"""Share of the pixels that clean devices must measure."""
LONGEST_SETUP_S = 90.0
"""Device time that a set-up may take, s."""

PLANS = plans(COLUMNS, ROWS, (256.0, 64.0))


@dataclass
class Outcome:
    """What came of one scan, or of a set-up."""

    case: str
    seed: int
    plan: str
    way: str
    refused: str = ""
    findings: list[str] = field(default_factory=list)
    measured: float = 0.0
    beyond_per_million: float = 0.0
    gross_per_million: float = 0.0
    """Errors of more than half a pixel."""
    within: tuple[float, float] = (0.0, 0.0)
    """Shares within 1 and 2 σ."""
    setup_s: float = 0.0
    """Device time of the set-up, s."""
    real_s: float = 0.0

    @property
    def failing(self) -> str:
        """What the outcome does not reach."""
        clean = CASES[self.case].clean
        if self.way == "setup":
            long = self.setup_s > LONGEST_SETUP_S
            bad = clean and (self.refused or self.findings)
            return "set-up is long" if long else ("false finding" if bad else "")
        if self.refused:
            return "refused" if clean else ""
        if self.beyond_per_million > MOST_BEYOND and not self.findings:
            return "silent"
        if clean and self.measured < LEAST_MEASURED:
            return "missing"
        return "false finding" if clean and self.findings else ""


def scans(name: str, seed: int) -> Iterator[Outcome]:
    """The set-up of a case, and its scans."""
    case = CASES[name]
    start = time.perf_counter()
    projector, camera = case.open(seed)
    begin_s = camera.clock.now_s()
    stored, first = _set_up(case, projector, camera)
    first.case, first.seed = name, seed
    first.setup_s = camera.clock.now_s() - begin_s
    first.real_s = time.perf_counter() - start
    yield first
    given = CameraSettings(exposure_ms=case.given_ms or case.open(seed)[1].exposure_ms)
    for plan_name, plan in PLANS.items():
        for way in ("agreement", "fast"):
            if way == "fast" and (stored is None or stored.delay is None or case.hdr > 1):
                continue
            start = time.perf_counter()
            settings = given if stored is None else stored.settings
            outcome = Outcome(name, seed, plan_name, way, findings=list(first.findings))
            bench = Bench(projector, camera, settings, stored, plan)
            _scan(outcome, bench, case)
            outcome.real_s = time.perf_counter() - start
            yield outcome


def _set_up(
    case: Case, projector: ModelProjector, camera: ModelCamera
) -> tuple[StoredSetup | None, Outcome]:
    """The set-up, with its findings of a warning or more."""
    outcome = Outcome("", 0, "", "setup")
    given = CameraSettings() if case.given_ms is None else CameraSettings(exposure_ms=case.given_ms)
    try:
        found = set_up(projector, camera, settings=given)
    except SetupStopped as error:
        outcome.refused = str(error)
        outcome.findings = [f.line for f in error.findings]
        return None, outcome
    outcome.findings = [f.line for f in found.findings if f.rank]
    stored = found.stored("model", "model")
    if case.triggered:
        camera.configure(stored.settings)
        delay = measure_delay(projector, camera, triggered=True)
        stored = replace(stored, delay=delay)
    return stored, outcome


def _scan(outcome: Outcome, bench: Bench, case: Case) -> None:
    """Take frames, decode them and compare with the truth."""
    try:
        decoded = _decoded(bench, Take(fast=outcome.way == "fast", hdr=case.hdr))
    except InputError as error:
        outcome.refused = str(error)
        return
    found = decoded.x
    assert found is not None
    outcome.findings += [f.line for f in decoded.findings if f.rank]
    assert isinstance(bench.camera, ModelCamera)
    off = found.coordinate_px - bench.camera.truth_px
    used = np.isfinite(off)
    outcome.measured = float(used.mean())
    if used.any():
        normal = np.abs(off[used] / found.sigma_px[used])
        outcome.beyond_per_million = 1e6 * float((normal > 5.0).mean())
        outcome.gross_per_million = 1e6 * float((np.abs(off[used]) > 0.5).mean())
        outcome.within = float((normal < 1.0).mean()), float((normal < 2.0).mean())


def _decoded(bench: Bench, how: Take) -> Decoded:
    if how.hdr == 1:
        return decode(take_in_memory(bench, how))
    with tempfile.TemporaryDirectory() as folder:
        return decode(take(bench, Path(folder) / "scan", how))


def line(outcome: Outcome) -> str:
    """An outcome in a line."""
    head = f"{outcome.case:31} {outcome.seed:4} {outcome.plan:12} {outcome.way:9} "
    failing = f"  FAILS: {outcome.failing}" if outcome.failing else ""
    said = outcome.refused or (outcome.findings[0] if outcome.findings else "")
    if outcome.way == "setup":
        return f"{head}{outcome.setup_s:5.0f} s {outcome.real_s:4.0f} s{failing} {said}"
    if outcome.refused:
        return f"{head}refused{failing} {said}"
    one, two = outcome.within
    return (
        f"{head}{outcome.measured:6.1%} {outcome.beyond_per_million:7.0f} "
        f"{outcome.gross_per_million:7.0f} {one:5.2f} {two:5.2f} {failing} {said}"
    )


def main() -> int:
    """Fill the table, print it and write it."""
    head = f"{'case':31} {'seed':>4} {'plan':12} {'way':9} measured >5σ/M gross/M    1σ    2σ"
    return fill_table(__doc__, CASES, head, scans, line)


if __name__ == "__main__":
    raise SystemExit(main())
