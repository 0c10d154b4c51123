"""The report of a sequence: how each area moved, its drift and its vibrations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fringeworks.batch.sequence import SequenceResult
from fringeworks.files.atomic import StrPath
from fringeworks.report.drawing import need_plots
from fringeworks.report.motion_chart import motion_chart
from fringeworks.report.page.blocks import Block, Chapter, Picture, Text
from fringeworks.report.page.parts import dict_table
from fringeworks.report.page.report import write_page
from fringeworks.types import made_by
from fringeworks.types.numbers import estimate, number

MOST_LISTED = 20
"""Vibrations of an area that are listed, the largest first."""


def write_sequence_report(path: StrPath, result: SequenceResult, *, title: str = "") -> Path:
    """Write the report of a sequence.

    Parameters
    ----------
    path : path
        ``.html`` or ``.pdf``.
    result : SequenceResult
    title : str
        By default the name of the results.

    Returns
    -------
    The path.

    Raises
    ------
    FileProblem for another suffix, or a folder that cannot be written to.
    """
    need_plots("a report")
    origin = made_by("write_sequence_report", options={"results": str(result.folder)})
    title = title or result.folder.stem
    chapters = [_area(name, result) for name in result.displacements]
    if not chapters:
        text = f"{result.moments} moments were measured; the recipe has no areas to follow."
        chapters = [Chapter("Sequence", (Text(text),))]
    return write_page(path, title, chapters, origin)


def motion_rows(result: SequenceResult) -> list[dict[str, Any]]:
    """Return a row for each area: its range, drift and largest vibration, as text."""
    per = "s" if result.rate_hz else "frame"
    rows = []
    for name, moved in result.displacements.items():
        known = moved.distance_mm[moved.distance_mm == moved.distance_mm]
        row = {"area": name, "moments": known.size, "range": "", "drift": "", "vibration": ""}
        if known.size:
            row["range"] = number(float(known.max() - known.min()), unit="mm")
        found = result.vibrations.get(name)
        if found is not None:
            row["drift"] = estimate(found.drift_mm_per_s, found.drift_sigma, f"mm/{per}")
            row["vibration"] = "none above the floor"
            if found.peaks:
                frequency, amplitude = found.peaks[0]
                unit = "Hz" if result.rate_hz else "/frame"
                row["vibration"] = (
                    f"{number(frequency, digits=4)} {unit}, {number(1000 * amplitude)} µm"
                )
        rows.append(row)
    return rows


def _area(name: str, result: SequenceResult) -> Chapter:
    moved, found = result.displacements[name], result.vibrations.get(name)
    figure = motion_chart(name, moved, found, rate_known=result.rate_hz is not None)
    text = (
        "Displacement of the area along its normal since the first moment. Amplitudes are those of "
        "sines; vibrations whose period is less than four cycles of the plan appear too small."
    )
    blocks: list[Block] = [Picture(figure, text)]
    if found is not None and found.peaks:
        unit = "Hz" if result.rate_hz else "1/frame"
        rows = [
            {f"frequency, {unit}": number(f, digits=4), "amplitude, µm": number(1000 * a)}
            for f, a in found.peaks[:MOST_LISTED]
        ]
        blocks.append(dict_table(rows, "Vibrations above the floor"))
    return Chapter(name, tuple(blocks))
