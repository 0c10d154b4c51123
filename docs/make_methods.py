"""Write the measured tables of docs/methods/ from a self-test: python docs/make_methods.py FILE."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

PAGES = Path(__file__).parent / "methods"
BODIES = ("plane", "sphere", "step")
MARKED = re.compile(r"(<!-- selftest -->\n).*?(<!-- end -->)", re.S)


def table(cases: list[dict[str, Any]], way: str) -> str:
    """Typical error and coverage of a method, a row for each disturbance."""
    lines = [
        "| disturbance | plane: error, within 1 σ / 2 σ | sphere | step |",
        "|---|---|---|---|",
    ]
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for case in cases:
        if case["way"] == way:
            rows.setdefault(case["disturbance"], {})[case["body"]] = case
    for disturbance, row in rows.items():
        cells = [
            f"{c['typical']:.4f} px, {c['within_1_sigma']:.0%} / {c['within_2_sigma']:.0%}"
            for c in (row[body] for body in BODIES)
        ]
        lines.append(f"| {disturbance} | {' | '.join(cells).replace('%', ' %')} |")
    return "\n".join(lines) + "\n"


def main(source: Path) -> None:
    """Replace the table of every page that has one."""
    cases = json.loads(source.read_text(encoding="utf-8"))["cases"]
    for path in sorted(PAGES.glob("*.md")):
        text = path.read_text(encoding="utf-8")
        made = table(cases, path.stem)
        path.write_text(
            MARKED.sub(lambda m, made=made: f"{m[1]}\n{made}\n{m[2]}", text), encoding="utf-8"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
