"""``python -m benchmarks [--work NAME] --out results.json``."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import asdict
from pathlib import Path

from benchmarks import decoding, inversion, phases, triangulation  # noqa: F401
from benchmarks.harness import WORKS, PeerMissing, Result
from fringeworks.files.atomic import write_text
from fringeworks.report.tables import to_json


def main() -> int:
    """Run the chosen kinds of work, print ratios and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", choices=list(WORKS), help="one kind only")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    names = [arguments.work] if arguments.work else list(WORKS)
    results: list[Result] = []
    print(f"{os.cpu_count()} cores")
    for name in names:
        try:
            found = WORKS[name]()
        except PeerMissing as error:
            print(f"{name}: skipped, {error}")
            continue
        for result in found:
            results.append(result)
            show(result)
    write_text(arguments.out, to_json([asdict(r) for r in results]))
    missed = [r.work for r in results if not reached(r)]
    for work in missed:
        print(f"limit missed: {work}")
    return 1 if missed else 0


def reached(result: Result) -> bool:
    """Whether a result keeps its limits."""
    in_time = result.limit_seconds is None or result.ours_seconds <= result.limit_seconds
    fast = result.limit_ratio is None or result.ratio is None or result.ratio >= result.limit_ratio
    return in_time and fast


def show(result: Result) -> None:
    """One result, for people."""
    print(f"{result.work}: {result.ours_seconds:.3f} s, peak {result.peak_mb:.0f} MB")
    if result.peer_seconds is not None:
        print(
            f"    {result.peer} {result.peer_version}: {result.peer_seconds:.3f} s, "
            f"ratio {result.ratio:.2f}"
            + (f" (limit {result.limit_ratio:.2f})" if result.limit_ratio else "")
        )
    print(f"    accuracy {result.accuracy:.3g}, peer {result.peer_accuracy:.3g}")


if __name__ == "__main__":
    sys.exit(main())
