"""``python docs/make_notebook.py``: run ``docs/first_look.ipynb`` and store what its cells show.

The cells run in this process; texts and pictures become outputs as Jupyter stores them. The cell
that installs the package in Colab is left alone. The sample data are those of ``make samples``, or
of the folder that FRINGEWORKS_SAMPLES names.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt

NOTEBOOK = Path(__file__).with_name("first_look.ipynb")
INSTALL = "%pip"
"""How the cell that installs begins."""
DPI = 60
"""Resolution of pictures: the file stays below 300 kB."""
CELLS = (
    (
        "markdown",
        "# fringeworks, a first look\n\nSix cells: install, read the sample data of the release, "
        "measure, see σ, compare with the truth, write files. The first cell installs the package "
        "in Colab.",
    ),
    ("code", "%pip install -q 'fringeworks[data,plots]'"),
    (
        "code",
        "import numpy as np\n\nimport fringeworks as fw\n\n"
        "folder = fw.data.bust()  # fetched once, 18 MB\n"
        'rig = fw.files.read_rig(folder / "rig.toml")\nstack = fw.read(folder / "bust")\n'
        'print(stack.plan.frames, "frames of", stack.frames[0].shape, "pixels")',
    ),
    ("code", "found = fw.measure(stack, rig)\nprint(found.points)\nfound.points.plot()"),
    (
        "code",
        "sigma = found.points.sigma_mm\nreasons, counts = np.unique(found.points.reason, "
        "return_counts=True)\nfor reason, count in zip(reasons, counts, strict=True):\n"
        '    print(fw.Reason(reason).name.lower(), f"{count / sigma.size:.1%}")\n'
        'print(f"median σ {np.nanmedian(sigma):.3f} mm")',
    ),
    (
        "code",
        'truth_mm = np.load(folder / "bust" / "truth.npz")["depth_mm"]\n'
        "error = found.points.xyz_mm[..., 2] - truth_mm\nknown = np.isfinite(error)\n"
        'print(\n    f"rms error {np.sqrt(np.mean(error[known] ** 2)):.3f} mm,",\n'
        '    f"{np.mean(np.abs(error[known]) <= sigma[known]):.0%} within 1 σ",\n)',
    ),
    (
        "code",
        'for name in ("bust.ply", "bust.vtp", "bust.vti", "bust.npz"):\n'
        "    print(fw.write(name, found.points))",
    ),
)
"""Kind and source of every cell."""


def shown(value: Any) -> list[dict[str, Any]]:
    """Output of the last line of a cell."""
    if not hasattr(value, "savefig"):
        return []
    buffer = io.BytesIO()
    value.savefig(buffer, dpi=DPI, metadata={"Software": None})
    plt.close(value)
    picture = base64.b64encode(buffer.getvalue()).decode("ascii")
    data = {"image/png": picture, "text/plain": ["<Figure>"]}
    return [{"output_type": "display_data", "metadata": {}, "data": data}]


def run(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a cell; what it prints, and what its last line gives."""
    body = ast.parse(source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    said = io.StringIO()
    value = None
    with contextlib.redirect_stdout(said):
        exec(compile(ast.Module(body, []), "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    text = said.getvalue().splitlines(keepends=True)
    stream = [{"output_type": "stream", "name": "stdout", "text": text}] if text else []
    return [*stream, *shown(value)]


def make() -> dict[str, Any]:
    """The notebook with its outputs; files are written to the working folder."""
    cells, names, count = [], {}, 0
    for k, (kind, source) in enumerate(CELLS):
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{k}", "metadata": {}}
        cell["source"] = source.splitlines(keepends=True)
        if kind == "code":
            count += 1
            cell["execution_count"] = count
            cell["outputs"] = [] if source.startswith(INSTALL) else run(source, names)
        cells.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


if __name__ == "__main__":
    import os
    import tempfile

    os.environ.setdefault("FRINGEWORKS_SAMPLES", str(NOTEBOOK.parent.parent / "samples"))
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        made = make()
    text = json.dumps(made, indent=1, ensure_ascii=False, sort_keys=True)
    NOTEBOOK.write_text(text + "\n", encoding="utf-8")
