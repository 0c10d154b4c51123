"""``python -m benchmarks [--work NAME] [--out results.json] [--page page.md]``."""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

from benchmarks import (  # noqa: F401
    decoding,
    evaluating,
    files,
    growth,
    inversion,
    moving,
    phases,
    triangulation,
)
from benchmarks.harness import WORKS, Growth, PeerMissing, Result, Row
from benchmarks.page import growth_line, line, write_page
from fringeworks.files.atomic import write_text
from fringeworks.report.tables import to_json


def main() -> int:
    """Run the chosen kinds of work, print ratios and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", choices=list(WORKS), help="one kind only")
    parser.add_argument("--out", type=Path, help="results as JSON")
    parser.add_argument("--page", type=Path, help="page with tables and a plot; wants all kinds")
    arguments = parser.parse_args()
    if arguments.page and arguments.work:
        parser.error("--page: expected all kinds of work, got --work")
    names = [arguments.work] if arguments.work else sorted(WORKS, key=_is_growth)
    found: list[Row] = []
    print(f"{os.cpu_count()} cores")
    for name in names:
        try:
            rows = WORKS[name]()
        except PeerMissing as error:
            print(f"{name}: skipped, {error}")
            continue
        for row in rows:
            found.append(row)
            print(line(row) if isinstance(row, Result) else growth_line(row), flush=True)
    if arguments.out:
        write_text(arguments.out, to_json([as_dict(row) for row in found]))
    if arguments.page:
        write_page(found, arguments.page)
    missed = [row.work for row in found if not row.reached]
    for work in missed:
        print(f"bar missed: {work}")
    return 0


def _is_growth(name: str) -> bool:
    """Growth comes last, on the page as well."""
    return name.startswith("growth")


def as_dict(row: Row) -> dict[str, object]:
    return asdict(row) | ({"slope": row.slope} if isinstance(row, Growth) else {})


if __name__ == "__main__":
    raise SystemExit(main())
