"""Charts of gauge studies: components, ranges, means, values by part, interaction, bias."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fringeworks.evaluate.capability import CONTROL_SIGMAS
from fringeworks.evaluate.gauge_anova import GaugeStudy
from fringeworks.evaluate.gauge_bias import GaugeLinearity, GaugeType1
from fringeworks.report.drawing import Axes, Figure
from fringeworks.types.numbers import limit, number

SHEET_INCH = (11.0, 10.0)
"""Width and height of the sheet of all charts, inches."""
CHART_INCH = (6.6, 3.6)
"""Width and height of one chart, inches."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""Colours of operators, told apart by eyes that confuse red and green (Okabe and Ito)."""
MARKS = "osD^vX*"
"""Marks of operators, for prints without colour."""
RANGES = {
    2: (1.128, 0.853),
    3: (1.693, 0.888),
    4: (2.059, 0.880),
    5: (2.326, 0.864),
    6: (2.534, 0.848),
    7: (2.704, 0.833),
    8: (2.847, 0.820),
    9: (2.970, 0.808),
    10: (3.078, 0.797),
}
"""Mean and standard deviation of the range of n normal values, in their standard deviations: d₂ and
d₃ (ISO 7870-2)."""
MOST_NAMES = 40
"""Names below an axis that fit beside each other when they stand upright."""
NAME_LETTERS = 14
"""Letters of a name that are shown."""
MOST_LEGEND = 12
"""Operators that a legend names."""
PERCENT = 100.0
"""Percent of a whole."""


def _bars(axes: Axes, study: GaugeStudy) -> None:
    """Shares of the components."""
    names = [one.name for one in study.components]
    place = np.arange(len(names))
    sets = [("of the total variation", [one.total_share for one in study.components],
             [one.total_interval for one in study.components])]  # fmt: skip
    if study.tolerance is not None:
        sets.append(
            ("of the tolerance", [one.tolerance_share for one in study.components],
             [one.tolerance_interval for one in study.components])
        )  # fmt: skip
    wide = 0.8 / len(sets)
    for number_of, (label, shares, intervals) in enumerate(sets):
        x = place + (number_of - 0.5 * (len(sets) - 1)) * wide
        axes.bar(x, PERCENT * np.array(shares), wide, color=COLOURS[number_of], label=label)
        for at, (low, high) in zip(x, intervals, strict=True):
            axes.plot([at, at], [PERCENT * low, PERCENT * high], color="#444444", linewidth=1)
    highest = PERCENT * max(max(shares) for _, shares, _ in sets)
    axes.set_ylim(0.0, 1.6 * highest)  # intervals of few operators would flatten the bars
    axes.set_xticks(place, names, fontsize=7)
    axes.set_ylabel("share of standard deviations, %")
    axes.legend(frameon=False, fontsize=8)


def _by_operator(axes: Axes, study: GaugeStudy, values: np.ndarray) -> None:
    """A value of each part, operator after operator."""
    p = len(study.parts)
    for k, name in enumerate(study.operators):
        x = np.arange(p) + k * p
        axes.plot(x, values[k], f"{MARKS[k % len(MARKS)]}-", color=COLOURS[k % len(COLOURS)],
                  ms=4, linewidth=0.8)  # fmt: skip
        if k:
            axes.axvline(k * p - 0.5, color="#bbbbbb", linewidth=0.8)
        middle = (k + 0.5) / len(study.operators)
        text = axes.text(middle, 1.0, _short(name), transform=axes.transAxes, parse_math=False)
        text.set(ha="center", va="bottom", fontsize=8)
    axes.set_xlim(-0.5, p * len(study.operators) - 0.5)
    _name(axes, list(study.parts) * len(study.operators))


def _ranges(axes: Axes, study: GaugeStudy) -> None:
    """Range of the trials of each part by each operator."""
    values, trials = np.ptp(study.values, axis=2), study.values.shape[2]
    _by_operator(axes, study, values)
    axes.axhline(float(values.mean()), color="#009e73", linewidth=1)
    if trials in RANGES:
        mean, scatter = RANGES[trials]
        top = (mean + CONTROL_SIGMAS * scatter) * _trial_sigma(study)
        axes.axhline(top, color="#009e73", linewidth=1, linestyle="--")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("range of the trials")


def _means(axes: Axes, study: GaugeStudy) -> None:
    """Mean of the trials of each part by each operator."""
    values = study.values.mean(axis=2)
    _by_operator(axes, study, values)
    half = CONTROL_SIGMAS * _trial_sigma(study) / float(np.sqrt(study.values.shape[2]))
    for at, style in ((-half, "--"), (0.0, "-"), (half, "--")):
        axes.axhline(float(values.mean()) + at, color="#009e73", linewidth=1, linestyle=style)
    axes.set_ylabel("mean of the trials")


def _parts(axes: Axes, study: GaugeStudy) -> None:
    """All values by part."""
    by_part = study.values.transpose(1, 0, 2).reshape(len(study.parts), -1)
    x = np.arange(len(study.parts))
    axes.plot(np.repeat(x, by_part.shape[1]), by_part.ravel(), "o", color="#999999", ms=3)
    axes.plot(x, by_part.mean(axis=1), "D-", color=COLOURS[0], ms=5, linewidth=0.8)
    _name(axes, list(study.parts))
    axes.set_ylabel("value")


def _interaction(axes: Axes, study: GaugeStudy) -> None:
    """Means of the parts, a line for each operator."""
    x = np.arange(len(study.parts))
    for k, (name, means) in enumerate(zip(study.operators, study.values.mean(axis=2), strict=True)):
        axes.plot(x, means, f"{MARKS[k % len(MARKS)]}-", color=COLOURS[k % len(COLOURS)], ms=4,
                  linewidth=1, label=_short(name) if k < MOST_LEGEND else None)  # fmt: skip
    _name(axes, list(study.parts))
    axes.set_ylabel("mean of the trials")
    legend = axes.legend(frameon=False, fontsize=8)
    for text in legend.get_texts():
        text.set_parse_math(False)


Draw = Callable[[Axes, GaugeStudy], None]

CHARTS: dict[str, tuple[Draw, str]] = {
    "Components of variation": (
        _bars,
        "Components of variation with their intervals of 95 %; long ones are cut.",
    ),
    "Ranges by operator": (
        _ranges,
        "Range of the trials of each part, by operator: above the dashed limit, trials differ "
        "more than usual.",
    ),
    "Means by operator": (
        _means,
        "Mean of the trials of each part, by operator. Between the dashed limits, the gauge does "
        "not tell the part from the mean: most parts should lie outside.",
    ),
    "Values by part": (_parts, "All values by part, and their means."),
    "Operators × parts": (
        _interaction,
        "Means of each part by operator: lines that cross are an interaction.",
    ),
}
"""Charts by their titles, with captions."""


def _charts(study: GaugeStudy) -> dict[str, tuple[Draw, str]]:
    """Charts that say something: without operators, lines by operator do not."""
    several = len(study.operators) > 1
    return {title: one for title, one in CHARTS.items() if several or one[0] is not _interaction}


def charts_of(study: GaugeStudy) -> list[tuple[Figure, str]]:
    """Every chart of a study as a figure, with its caption."""
    found = []
    for title, (draw, caption) in _charts(study).items():
        figure = Figure(figsize=CHART_INCH, layout="constrained")
        axes = figure.add_subplot()
        _finish(axes, study, draw, title)
        found.append((figure, caption))
    return found


def gauge_sheet(title: str, study: GaugeStudy) -> Figure:
    """Draw all charts of a study on one sheet.

    Parameters
    ----------
    title : str
    study : GaugeStudy
    """
    figure = Figure(figsize=SHEET_INCH, layout="constrained")
    figure.suptitle(title, parse_math=False)
    for place, (name, (draw, _)) in enumerate(_charts(study).items(), start=1):
        _finish(figure.add_subplot(3, 2, place), study, draw, name)
    return figure


def type1_chart(title: str, found: GaugeType1) -> Figure:
    """Draw the trials of one reference in their order."""
    figure = Figure(figsize=CHART_INCH, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(np.arange(1, found.values.size + 1), found.values, "o-", color=COLOURS[0], ms=3,
              linewidth=0.8)  # fmt: skip
    label = f"reference {limit(found.reference)}"
    axes.axhline(found.reference, color="black", linewidth=1.2, label=label)
    label = f"mean {number(found.mean, found.sigma)}"
    axes.axhline(found.mean, color="#009e73", linewidth=1, label=label)
    half = 0.5 * found.share * found.tolerance
    for at in (found.reference - half, found.reference + half):
        axes.axhline(at, color="black", linewidth=1, linestyle="--")
    axes.plot([], [], "--", color="black", label=f"± {limit(0.5 * found.share)} T")
    axes.set(xlabel="trial", ylabel="value")
    axes.set_title(title, fontsize=11, parse_math=False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return figure


def linearity_chart(title: str, found: GaugeLinearity) -> Figure:
    """Draw the bias over the references, with the line and its band."""
    figure = Figure(figsize=CHART_INCH, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(found.references, found.values - found.references, "o", color="#999999", ms=3,
              label="trials")  # fmt: skip
    axes.plot(found.levels, found.mean_bias, "D", color=COLOURS[1], ms=5, label="means")
    axes.plot(found.levels, found.line, color=COLOURS[0], linewidth=1.2, label="line")
    low, high = found.line - found.band, found.line + found.band
    axes.fill_between(found.levels, low, high, color=COLOURS[0], alpha=0.25, linewidth=0,
                      label="95 % at the references")  # fmt: skip
    axes.axhline(0.0, color="black", linewidth=1)
    axes.set(xlabel="reference value", ylabel="bias")
    axes.set_title(title, fontsize=11, parse_math=False)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return figure


def _finish(axes: Axes, study: GaugeStudy, draw: Draw, title: str) -> None:
    draw(axes, study)
    axes.set_title(title, fontsize=11, pad=16)
    axes.grid(color="#dddddd", linewidth=0.6, axis="y")
    axes.set_axisbelow(True)


def _trial_sigma(study: GaugeStudy) -> float:
    """Standard deviation of the trials alone, without a pooled interaction."""
    row = next(one for one in study.table if one.source == "repeatability")
    return float(np.sqrt(row.mean_square))


def _short(name: str) -> str:
    return name if len(name) <= NAME_LETTERS else f"…{name[1 - NAME_LETTERS :]}"


def _name(axes: Axes, names: list[str]) -> None:
    """Names of the parts below an axis, or of every k-th one."""
    every = -(-len(names) // MOST_NAMES)
    shown = [_short(name) for name in names[::every]]
    axes.set_xticks(np.arange(0, len(names), every), shown, rotation=90, fontsize=7)
    for label in axes.get_xticklabels():
        label.set_parse_math(False)
