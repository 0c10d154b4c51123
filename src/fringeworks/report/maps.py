"""Sheets of maps: values, standard deviations and reasons side by side, all drawn in one way."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from io import BytesIO

import numpy as np

from fringeworks.report.drawing import Axes, BoundaryNorm, Figure, ListedColormap, Patch
from fringeworks.report.reason_words import REASON_COLOURS, REASON_WORDS
from fringeworks.report.sheets import PanelKind, Sheet
from fringeworks.types import ByteMap, FloatMap, Reason, reason_counts
from fringeworks.types.numbers import percent

DPI = 110
"""Dots per inch of a PNG: text of 10 points is then 15 px high, easily read at full size."""
UNMEASURED = {"facecolor": "white", "edgecolor": "#a0a0a0", "hatch": "/////"}
"""Look of pixels without a value: hatched, which no colour map can be mistaken for."""
MAP_PERCENTILES = (0.2, 99.8)
"""Range of values that a map's colours span, percent: outliers do not flatten the rest."""
SIGMA_PERCENTILE = 98.0
"""Percentile of σ at the end of its colour scale; σ has a long tail at rims."""
SIGMA_MEDIANS = 4.0
"""Most medians of σ at the end of its scale: where the rims of a round part are more than one pixel
in fifty, the rest is not all dark. Chosen by eye on two parts, one of them a ball."""
GREY_PERCENTILE = 99.5
"""Percentile of brightness and modulation that is drawn white: highlights do not darken the
rest."""
MAP_SIDE_INCH = {1: 5.4, 2: 4.4, 3: 3.9, 4: 2.8}
"""Longer side of a map by the number of columns on a sheet, inches: every sheet is between 800 and
1900 px wide, and fits on a screen."""
BESIDE_INCH = 1.6
"""Width that labels, colour scale and legend take beside a map, inches."""
ABOVE_INCH = 0.75
"""Height that title and labels take above and below a map, inches."""
TITLE_INCH = 0.22
"""Height of a line above the maps, inches."""
SMALL_INCH = 0.18
"""Height of a line of the small print, inches."""
LETTERS_PER_INCH = 14
"""Letters of the small print on an inch of a sheet's width."""
SHOWN_FINDINGS = 4
"""Findings that a sheet lists; more would crowd out the maps. The rest is counted."""

COLOURS: dict[PanelKind, str] = {
    "values": "viridis",
    "depth": "viridis_r",
    "sigma": "magma",
    "signed": "coolwarm",
    "grey": "gray",
    "phase": "twilight",
}
"""Colour map of every kind of panel. Sequential ones are perceptually uniform, and all can be read
without seeing red and green apart. Only differences have a diverging one."""


class Picture(Figure):
    """A matplotlib figure that notebooks show by themselves, without pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, dpi=DPI, format="png")
        return buffer.getvalue()


def draw_sheet(sheet: Sheet) -> Picture:
    """Draw maps in rows on one sheet."""
    panels = sheet.panels
    columns = min(sheet.columns, len(panels))
    lines = -(-len(panels) // columns)
    drawn = [panel for panel in panels if panel is not None]
    rows_, columns_ = drawn[0].values.shape
    if sheet.window is not None:
        rows_, columns_ = sheet.window.height, sheet.window.width
    side = MAP_SIDE_INCH[min(columns, max(MAP_SIDE_INCH))]
    scale = side / max(rows_, columns_)
    width = columns * (columns_ * scale + BESIDE_INCH)
    small = small_print([finding.seen for finding in sheet.findings], width)
    height = lines * (rows_ * scale + ABOVE_INCH) + TITLE_INCH * (2 + sheet.facts.count("\n"))
    height += SMALL_INCH * (small.count("\n") + bool(small))
    figure = Picture(figsize=(width, height), layout="compressed")
    title = f"{sheet.title}\n{sheet.facts}" if sheet.facts else sheet.title
    if title:
        figure.suptitle(title, fontsize=12)
    if small:
        figure.supxlabel(small, x=0.01, ha="left", fontsize=9)
    for number, panel in enumerate(panels):
        if panel is None:
            continue
        axes = figure.add_subplot(lines, columns, number + 1)
        axes.set_title(panel.title, fontsize=11)
        axes.set_xlabel("x / px")
        axes.set_ylabel("y / px")
        if panel.kind == "reasons":
            draw_reasons(axes, panel.values.astype(np.uint8))
        else:
            alike = [p.values for p in drawn if p.shares == panel.shares]
            ends = panel.limits or limits_of(panel.kind, alike)
            draw_map(axes, panel.values, panel.kind, ends, panel.unit)
        if sheet.window is not None:
            window = sheet.window
            axes.set_xlim(window.left - 0.5, window.right + 0.5)
            axes.set_ylim(window.bottom + 0.5, window.top - 0.5)
    return figure


def small_print(findings: Sequence[str], width_inch: float) -> str:
    """Findings as lines that fit below a picture; empty for none."""
    letters = int(LETTERS_PER_INCH * width_inch)
    lines = [textwrap.fill(f"Found: {text}", letters) for text in findings[:SHOWN_FINDINGS]]
    if len(findings) > SHOWN_FINDINGS:
        lines.append(f"Findings that are not shown here: {len(findings) - SHOWN_FINDINGS}.")
    return "\n".join(lines)


def limits_of(kind: PanelKind, maps: Sequence[FloatMap]) -> tuple[float, float]:
    """The range of colours that suits all maps of a quantity."""
    if kind == "phase":
        return -np.pi, np.pi
    all_finite = [m[np.isfinite(m)].ravel() for m in maps if np.isfinite(m).any()]
    if not all_finite:
        return 0.0, 1.0
    # The median of the maps' own limits: one method that fails does not flatten the others.
    if kind == "signed":
        limit = float(np.median([_above(np.abs(f), SIGMA_PERCENTILE) for f in all_finite]))
        return -limit, limit
    if kind in ("sigma", "grey"):
        finite = np.concatenate(all_finite)
        if kind == "grey":
            return 0.0, _above(finite, GREY_PERCENTILE)
        usual = SIGMA_MEDIANS * float(np.median(finite))
        most = _above(finite, SIGMA_PERCENTILE)
        return 0.0, min(most, usual) if usual > 0 else most
    low, high = np.median([np.percentile(f, MAP_PERCENTILES) for f in all_finite], axis=0)
    return (float(low), float(high)) if high > low else (float(low) - 0.5, float(low) + 0.5)


def _above(finite: FloatMap, percentile: float) -> float:
    found = float(np.percentile(finite, percentile))
    return found if found > 0 else 1e-6


def draw_map(
    axes: Axes, values: FloatMap, kind: PanelKind, limits: tuple[float, float], unit: str
) -> None:
    """Draw a map with its colour scale; pointed ends show that values lie beyond it."""
    axes.patch.set(**UNMEASURED)
    picture = axes.imshow(
        values, cmap=COLOURS[kind], vmin=limits[0], vmax=limits[1], interpolation="nearest"
    )
    finite = values[np.isfinite(values)]
    beyond = (bool((finite < limits[0]).any()), bool((finite > limits[1]).any()))
    ends = {(False, False): "neither", (True, False): "min", (False, True): "max"}
    # Inside the map's own frame, so that it stays beside the map in every layout.
    place = axes.inset_axes((1.03, 0.05, 0.045, 0.9))
    bar = axes.figure.colorbar(picture, cax=place, extend=ends.get(beyond, "both"))
    bar.set_label(unit)
    if kind == "depth":
        bar.ax.invert_yaxis()


def draw_reasons(axes: Axes, reason: ByteMap) -> None:
    """Draw why pixels have no value, with a legend of the reasons that occur."""
    size = len(Reason)
    axes.imshow(
        reason,
        cmap=ListedColormap([REASON_COLOURS[r] for r in Reason]),
        norm=BoundaryNorm(np.arange(size + 1) - 0.5, size),
        interpolation="nearest",
    )
    axes.legend(
        handles=reason_patches(reason),
        loc="upper left",
        bbox_to_anchor=(1.02, 1.0),
        borderaxespad=0.0,
        fontsize=9,
        handlelength=1.2,
        frameon=False,
    )


def reason_patches(reason: ByteMap) -> list[Patch]:
    """A legend's patches: the reasons that occur, the most frequent first, with their shares."""
    counts = reason_counts(reason)
    occurring = sorted((r for r in Reason if counts[r]), key=lambda r: -counts[r])
    return [
        Patch(
            facecolor=REASON_COLOURS[r],
            edgecolor="#666666",
            linewidth=0.6,
            label=f"{REASON_WORDS[r].label}\n{percent(counts[r] / reason.size)}",
        )
        for r in occurring
    ]
