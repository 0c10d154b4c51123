"""The page of the benchmarks: tables, a plot, and what they were measured on."""

from __future__ import annotations

import os
import platform
import re
import textwrap
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt

from benchmarks.harness import Growth, Result, Row
from fringeworks.files.atomic import write_text

LABEL_LETTERS = 62
"""Letters of a line below a bar's name: the longest work fits."""
PICTURE = Path("images") / "benchmarks.png"

HEAD = """# Benchmarks

`make bench` measures the tables and writes this page. Most rows time our call and a peer's call
alternately on the same data, on {cores} cores. *Ratio* is the peer's median time divided by ours;
the brackets give the quartiles of the ratios of paired runs. *Bar* is our own requirement: the
smallest accepted ratio, or the longest accepted time; "missed" marks one that was not met. A peer
that is missing or crashes is left out, and `make bench` prints why. *Errors* applies the same
measure to both results: px for decoding and displacements, mm for points, rad for phases, the share
of wrong pixels for unwrapping. [Performance](performance.md) says where the time goes.

Measured on {day}: {machine}, {system}, Python {python}, NumPy {numpy}, SciPy {scipy}.

![Ratios to others, and growth with pixels]({picture})

| work | ours | peer | peer's time | ratio | bar | errors: ours, peer |
|---|---|---|---|---|---|---|
"""

GROWTH = """
## Growth

*Slope* is that of log(time) over log(size): 1 means that twice the size takes twice the time. Over
threads, -1 would be perfect. The bar is the largest accepted slope.

| work | over | sizes | times | slope | bar |
|---|---|---|---|---|---|
"""


def write_page(found: Sequence[Row], target: Path) -> None:
    """Write the page, and the plot beside it."""
    results = [row for row in found if isinstance(row, Result)]
    growth = [row for row in found if isinstance(row, Growth)]
    text = HEAD.format(
        cores=os.cpu_count(),
        day=date.today().isoformat(),
        machine=processor(),
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        numpy=version("numpy"),
        scipy=version("scipy"),
        picture=PICTURE.as_posix(),
    )
    text += "".join(f"{line(row)}\n" for row in results) + GROWTH
    text += "".join(f"{growth_line(row)}\n" for row in growth)
    draw(results, growth, target.parent / PICTURE)
    write_text(target, text)


def processor() -> str:
    """Name of the processor, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown processor"


def time_text(seconds: float | None) -> str:
    if seconds is None:
        return "–"
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}"


def line(row: Result) -> str:
    """A row of the first table."""
    ratio = "–"
    if row.ratio is not None:
        ratio = f"{row.ratio:.3g} ×"
        if row.spread is not None:
            ratio += f" ({row.spread[0]:.3g}…{row.spread[1]:.3g})"
    bars = []
    if row.limit_ratio is not None:
        bars.append(f"{row.limit_ratio:.3g} ×")
    if row.limit_seconds is not None:
        bars.append(time_text(row.limit_seconds))
    bar = ", ".join(bars) or "–"
    if bars and not row.reached:
        bar += " missed"
    errors = "–"
    if row.accuracy is not None:
        errors = f"{number(row.accuracy)}, {number(row.peer_accuracy)}"
    peer = f"{row.peer} (version {row.peer_version})" if row.peer_version else row.peer
    cells = (row.work, time_text(row.ours_seconds), peer, time_text(row.peer_seconds))
    return "| " + " | ".join((*cells, ratio, bar, errors)) + " |"


def growth_line(row: Growth) -> str:
    """A row of the second table."""
    sizes = ", ".join(f"{size:g}" for size in row.sizes)
    times = ", ".join(time_text(seconds) for seconds in row.seconds)
    bar = "–" if row.limit is None else f"{row.limit:g}"
    if not row.reached:
        bar += " missed"
    cells = (row.work, row.variable, sizes, times, f"{row.slope:.2f}", bar)
    return "| " + " | ".join(cells) + " |"


def label(row: Result) -> str:
    """What a bar shows: our work on one line, the peer below it; remarks in brackets stay in the
    table."""
    peer = re.sub(r" \([^)]*\)", "", row.peer)
    return "\n".join(textwrap.wrap(row.work, LABEL_LETTERS) + textwrap.wrap(peer, LABEL_LETTERS))


def draw(results: Sequence[Result], growth: Sequence[Growth], target: Path) -> None:
    """Ratios as bars, and times over pixels."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 12), width_ratios=(1.1, 1), layout="constrained"
    )
    colours = mpl.colormaps["tab20"].colors
    shown = [row for row in results if row.ratio is not None][::-1]
    places = range(len(shown))
    left.barh(places, [row.ratio for row in shown], color="#4477aa")
    for place, row in zip(places, shown, strict=True):
        if row.spread is not None:
            left.plot(row.spread, (place, place), color="black", linewidth=1)
        if row.limit_ratio is not None:
            left.plot(row.limit_ratio, place, "|", color="#cc3311", markersize=12, mew=2)
    left.set_yticks(list(places), [label(row) for row in shown], fontsize=7)
    left.set_ylim(-0.7, len(shown) - 0.3)
    left.set_xscale("log")
    left.axvline(1.0, color="grey", linewidth=0.8)
    left.set_xlabel("peer's time over ours; red: bar")
    over_pixels = [row for row in growth if row.variable == "megapixels"]
    for row, colour in zip(over_pixels, colours, strict=False):
        said = f"{row.work}: {row.slope:.2f}"
        right.loglog(row.sizes, row.seconds, "o-", color=colour, label=said)
    right.set_xlabel("megapixels")
    right.set_ylabel("time, s")
    right.grid(alpha=0.3)
    if right.lines:
        figure.legend(fontsize=7, title="slope", loc="outside right center")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=90, metadata={"Software": None})
    plt.close(figure)
