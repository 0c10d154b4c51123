"""What the tables of devices and of scenes that move share: plans, and the run that fills them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fringeworks import PatternPlan
from fringeworks.files.atomic import write_text
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.report.tables import to_json


def plans(columns: int, rows: int, longer_px: tuple[float, ...]) -> dict[str, PatternPlan]:
    """Fringes of 16 px of four steps: beside longer ones, and beside a Gray code."""
    fine = PhaseSteps("x", 16.0, equal_steps(4))
    longer = (PhaseSteps("x", period, equal_steps(4)) for period in longer_px)
    code = GrayCode("x", 8.0, columns, offset_px=-4.0)
    return {
        "hierarchical": PatternPlan(columns, rows, (*longer, fine)),
        "Gray": PatternPlan(columns, rows, (code, fine, Uniform("white"), Uniform("black"))),
    }


def fill_table(
    about: str | None,
    cases: Iterable[str],
    head: str,
    outcomes: Callable[[str, int], Iterable[Any]],
    line: Callable[[Any], str],
) -> int:
    """Fill a table of the outcomes of cases and seeds, print it line by line and write it."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--cases", default=";".join(cases), help="names, separated by ;")
    arguments = parser.parse_args()
    found: list[Any] = []
    print(head)
    for name in arguments.cases.split(";"):
        for seed in map(int, arguments.seeds.split(",")):
            for outcome in outcomes(name, seed):
                found.append(outcome)
                print(line(outcome), flush=True)
    failed = sum(bool(outcome.failing) for outcome in found)
    print(f"{failed} of {len(found)} outcomes fail")
    written = [asdict(outcome) | {"failing": outcome.failing} for outcome in found]
    write_text(arguments.out, to_json(written))
    return 0
