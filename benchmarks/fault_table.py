"""Faults of captures × plans: what the decoder refuses, notes or measures wrongly.

``python -m benchmarks.fault_table --out table.json [--seeds 0,1] [--plans A,B] [--conditions C,D]
[--scenes bust,plane,steps]``, from the root of the source tree.

``lost:*``, ``dark-frame:*`` and ``swapped:*`` are conditions that go through every frame or pair;
``rare`` stands for the faults of ``tests.faults_rare``.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fringeworks.files.atomic import write_text
from fringeworks.report.tables import to_json
from tests.fault_measure import BANDS, Outcome, Tally, capture, expand, measure
from tests.fault_scenes import SCENES, plans
from tests.fault_stage import Stage
from tests.faults import FAULTS
from tests.faults_rare import RARE

MAX_WRONG = 100.0
"""Wrong orders, and pixels beyond 5 σ, per million measured pixels that a cell may have.

The aim of the project for every condition and plan.
"""

MIN_COVERAGE = 0.6
"""Share of pixels within 1 σ that a cell must have; 0.68 is right. The aim of the project."""

FEW = 3
"""Wrong pixels in a range of the modulation that may be chance."""

TEXT = 100
"""Characters of a verdict that are printed."""


@dataclass(frozen=True)
class Cell:
    """One condition under one plan, over all scenes and seeds."""

    condition: str
    plan: str
    outcomes: list[Outcome]

    def tally(self, band: str = "all") -> Tally:
        """Pixels of all outcomes."""
        return sum((outcome.bands[band] for outcome in self.outcomes), Tally())

    @property
    def refused(self) -> int:
        """Number of outcomes that were refused."""
        return sum(bool(outcome.refused) for outcome in self.outcomes)

    @property
    def failings(self) -> list[str]:
        """What the cell does not reach."""
        tally = self.tally()
        if any(outcome.crashed for outcome in self.outcomes):
            return ["crashed"]
        if not tally.ok:
            return [] if self.refused == len(self.outcomes) else ["nothing measured"]
        found = []
        every = [outcome.bands["all"].wrong_per_million for outcome in self.outcomes]
        if max(every) > MAX_WRONG:
            bad = sum(wrong > MAX_WRONG for wrong in every)
            found.append("wrong" if len(every) == 1 else f"wrong in {bad} of {len(every)}")
        for band in BANDS:
            part = self.tally(band)
            if band != "all" and part.wrong >= FEW and part.wrong_per_million > MAX_WRONG:
                found.append(f"wrong at {band}")
        if tally.beyond_per_million > MAX_WRONG:
            found.append("5 σ")
        if tally.coverage[0] < MIN_COVERAGE:
            found.append("1 σ")
        return found


def main() -> int:
    """Fill the table, print it and write it."""
    every = plans()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--plans", default=",".join(every))
    parser.add_argument("--conditions", default=",".join(FAULTS))
    parser.add_argument("--scenes", default="bust", help=", ".join(SCENES))
    arguments = parser.parse_args()
    arguments.conditions = arguments.conditions.replace("rare", ",".join(RARE))
    seeds = [int(seed) for seed in arguments.seeds.split(",")]
    start = time.perf_counter()
    cells, rows = [], []
    for name in arguments.plans.split(","):
        stages = [Stage(scene, every[name]) for scene in arguments.scenes.split(",")]
        for condition in arguments.conditions.split(","):
            outcomes = []
            exact = expand(condition, every[name])
            for stage, seed, one in itertools.product(stages, seeds, exact):
                outcome = measure(capture(one, stage, seed), stage)
                outcomes.append(outcome)
                key = {"condition": one, "plan": name, "scene": stage.scene, "seed": seed}
                rows.append(key | outcome.as_dict())
            cells.append(Cell(condition, name, outcomes))
    for line in report(cells):
        print(line)
    print(f"{len(rows)} shots in {time.perf_counter() - start:.0f} s")
    write_text(arguments.out, to_json(rows))
    return 0


def report(cells: list[Cell]) -> Iterator[str]:
    """The table in full, then one character of verdict per condition and plan."""
    conditions = list(dict.fromkeys(cell.condition for cell in cells))
    names = list(dict.fromkeys(cell.plan for cell in cells))
    place = {(cell.condition, cell.plan): cell for cell in cells}
    bands = [band for band in BANDS if band != "all"]
    yield (
        f"{'condition':16} {'plan':20} {'ok %':>6} {'wrong/M':>8} {'>5σ/M':>8} "
        f"{'1σ':>5} {'2σ':>5} {'5σ':>7}  wrong/M and 1σ at modulation {', '.join(bands)}"
    )
    for condition in conditions:
        for name in names:
            yield from lines(place[condition, name], bands)
    yield ""
    yield "Wrong orders per million measured pixels; R: refused, -: nothing measured,"
    yield "*: fewer than 60 % within 1 σ, !: more than 100 per million beyond 5 σ, n: noted."
    yield " " * 16 + "".join(f"{name[:15]:>16}" for name in names)
    for condition in conditions:
        row = "".join(f"{brief(place[condition, name]):>16}" for name in names)
        yield f"{condition:16}{row}"
    failed = sum(bool(cell.failings) for cell in cells)
    yield f"{failed} of {len(cells)} cells fail"


def lines(cell: Cell, bands: list[str]) -> Iterator[str]:
    """Figures of a cell and its verdicts."""
    head = f"{cell.condition:16} {cell.plan:20} "
    tally = cell.tally()
    if tally.ok:
        one, two, five = tally.coverage
        head += f"{100 * tally.ok_share:6.1f} {tally.wrong_per_million:8.0f} "
        head += f"{tally.beyond_per_million:8.0f} {one:5.2f} {two:5.2f} {five:7.5f} "
        for band in bands:
            part = cell.tally(band)
            head += f"{part.wrong_per_million:8.0f} {part.coverage[0]:.2f}" if part.ok else " " * 13
    yield head + ("  FAILS: " + ", ".join(cell.failings) if cell.failings else "")
    for outcome in {o.verdict: o for o in cell.outcomes}.values():
        yield " " * 8 + outcome.verdict[:TEXT]


def brief(cell: Cell) -> str:
    """A cell in a few characters."""
    tally = cell.tally()
    if "crashed" in cell.failings:
        return "CRASH"
    refused = "R" if cell.refused else ""
    if refused and cell.refused < len(cell.outcomes):
        refused = f"R{cell.refused}/{len(cell.outcomes)} "
    if not tally.ok:
        return refused or "-"
    marks = "*" * ("1 σ" in cell.failings) + "!" * ("5 σ" in cell.failings)
    marks += "n" * any(outcome.notes for outcome in cell.outcomes)
    return f"{refused}{tally.wrong_per_million:.0f}{marks}"


if __name__ == "__main__":
    raise SystemExit(main())
