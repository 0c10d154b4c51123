"""Run all examples, draw their pictures, and write docs/gallery.md: ``make gallery``."""

from __future__ import annotations

import ast
import io
import json
import os
import runpy
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"
PICTURES = ROOT / "docs" / "images" / "gallery"
WIDTH_PX = 900
"""Width of the pictures: the page shows them without scaling on most screens."""
MAX_BYTES = 60_000
"""Largest picture: the page stays quick, and the repository small."""
COLOURS = (256, 192, 128, 96)
"""Numbers of colours to try; the first whose picture stays below the limit is taken. With fewer,
colour maps would have visible steps."""
TIMED = {"live.py"}
"""Examples whose pictures depend on how quick the machine is; they are drawn only where missing."""
WITHOUT_PICTURE = {"vendor_camera.py"}
"""Examples that draw nothing."""


PAGE = ROOT / "docs" / "gallery.md"
SAMPLES = ROOT / "samples"
"""Folder of the archive that ``make samples`` makes."""
SECTIONS = {
    "pair.py": "A pair of photographs",
    "single_frame.py": "A single photograph",
    "compare.py": "Which method?",
    "own_method.py": "A method of one's own",
    "plan.py": "A plan of fringes",
    "stack.py": "A stack of frames",
    "calibrate.py": "Calibration",
    "measure.py": "Points in millimetres",
    "evaluate.py": "How good is it?",
    "deviation.py": "A part and its drawing",
    "live.py": "Live",
    "notebook.ipynb": "In a notebook",
    "vendor_camera.py": "A camera with its maker's own library",
}
"""Title of every example, in the order of the page."""
LONG = {"vendor_camera.py"}
"""Examples that are too long for the page."""
INTRODUCTION = """# Gallery

Every example is a short script in `examples/`. It runs as it is, without hardware, in a few
seconds:

    python examples/pair.py

What it measures is simulated: examples that need no other truth take the
[sample data](datasets.md#sample-data-of-this-package), which are [fetched once](python/fw-data.md),
also to a computer without a network. A comment says which line to change for files of your own.
`make gallery` runs all examples and writes this page.

Every result draws itself: `result.plot()` returns a matplotlib figure, which notebooks show and
`fw.save_figure` writes as PNG, PDF or SVG. Maps of values, standard deviations and reasons have
axes in camera pixels. Values that are not measured are hatched, and the legend says why. On the
command line, `--figure FILE` writes the same picture.

`result.profile(((x0, y0), (x1, y1)))` samples heights, points, displacements or coordinates along a
line of camera pixels. A sample is the pixel nearest to the line: nothing is interpolated, so no
value lies between the two sides of a cliff, and each sample has its own σ and reason. With
`level=True`, heights count over the straight line in space between the first and the last measured
sample, as over a ruler that lies on the surface.
"""


def examples() -> list[Path]:
    """All examples, sorted by name."""
    return sorted([*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")])


def cells(notebook: Path) -> list[dict[str, Any]]:
    """The cells of a notebook."""
    found: list[dict[str, Any]] = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return found


def page() -> str:
    """The text of docs/gallery.md."""
    parts = [INTRODUCTION]
    for name, title in SECTIONS.items():
        path = EXAMPLES / name
        if path.suffix == ".py":
            text = path.read_text(encoding="utf-8")
            said = ast.get_docstring(ast.parse(text)) or ""
            code = text[text.index('"""', 3) + 3 :].strip("\n")
        else:
            every = cells(path)
            said = "Results show themselves: no import of matplotlib is needed."
            code = "\n\n".join("".join(c["source"]) for c in every if c["cell_type"] == "code")
        parts.append(f"## {title}\n\n{said.splitlines()[0]} (`examples/{name}`)\n")
        if name not in WITHOUT_PICTURE:
            parts.append(f"![{title}](images/gallery/{path.stem}.png)\n")
        if name not in LONG:
            parts.append(f"```python\n{code}\n```\n")
    return "\n".join(parts)


@contextmanager
def inside(folder: Path) -> Iterator[None]:
    """Work in a folder, where the examples may write."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def run(example: Path) -> dict[str, Any]:
    """Run an example in the working folder; its variables. Of a notebook, the cells of code."""
    if example.suffix == ".py":
        return runpy.run_path(str(example), run_name="__main__")
    variables: dict[str, Any] = {}
    for cell in cells(example):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), str(example), "exec"), variables)
    return variables


def small_png(figure: Any) -> bytes:
    """A figure as a small PNG with a palette; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=WIDTH_PX / figure.get_figwidth(), format="png", metadata={})
    drawn = Image.open(buffer).convert("RGB")
    for colours in COLOURS:
        packed = io.BytesIO()
        # Colours are spread evenly: most pixels are white or one end of a colour map.
        few = drawn.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(packed, "png", optimize=True)
        if packed.tell() <= MAX_BYTES:
            return packed.getvalue()
    raise SystemExit(f"expected a picture below {MAX_BYTES} bytes, got {packed.tell()}")


def main() -> None:
    """Write the page and all pictures."""
    PAGE.write_text(page(), encoding="utf-8")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for example in examples():
        picture = PICTURES / f"{example.stem}.png"
        if example.name in WITHOUT_PICTURE or (example.name in TIMED and picture.is_file()):
            continue
        with tempfile.TemporaryDirectory() as folder, inside(Path(folder)):
            figure = run(example)["figure"]
        content = small_png(figure)
        picture.write_bytes(content)
        sys.stdout.write(f"{example.name}: {len(content) / 1000:.0f} kB\n")


if __name__ == "__main__":
    os.environ.setdefault("FRINGEWORKS_SAMPLES", str(SAMPLES))
    main()
