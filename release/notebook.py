"""Runs the code cells of a notebook by the Python that calls this, as it is installed.

Cells that install something are left out. Files are written to a temporary folder.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).parent.parent / "docs" / "first_look.ipynb"
INSTALL = "%pip"
"""How a cell that installs begins."""


def cells(path: Path) -> list[str]:
    """Sources of the code cells that can run."""
    found = json.loads(path.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in found if cell["cell_type"] == "code"]
    return [source for source in sources if not source.startswith(INSTALL)]


def run(path: Path) -> str:
    """Run all cells, one after the other; what they print."""
    names: dict[str, Any] = {"__name__": "__main__"}
    said = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        before = Path.cwd()
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(said):
                for number, source in enumerate(cells(path), start=1):
                    exec(compile(source, f"cell {number}", "exec"), names)
        finally:
            os.chdir(before)
    return said.getvalue()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("notebook", type=Path, nargs="?", default=NOTEBOOK)
    path = parser.parse_args().notebook.resolve()
    os.environ.setdefault("MPLBACKEND", "Agg")
    lines = run(path).splitlines()
    print(f"{len(cells(path))} cells, {len(lines)} lines: {lines[-1] if lines else 'nothing'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
