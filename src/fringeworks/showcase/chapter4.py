"""The dissertation's chapter 4 as a report: its figures by number, and its table beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fringeworks.report.drawing import Figure
from fringeworks.report.page.blocks import Block, Chapter, Picture, Text
from fringeworks.report.page.parts import dict_table

TITLE = "Chapter 4, computed again"
"""Title of the report."""
PARTS: dict[str, dict[str, str]] = {
    "Part 1: a signal in one dimension": {
        "4_01_reference_signal": "Figure 4.1: the reference signal, 0 at its minima and 255 at its "
        "maxima.",
        "4_02_object_height": "Figure 4.2: the height of the artificial object, over samples 250 "
        "to 750.",
        "4_03_deformed_signal": "Figure 4.3: the signal that the object deforms.",
        "4_04_comparison": "Figure 4.4: both signals. They differ where the object is.",
    },
    "Part 2: frames of three bodies": {
        "4_05_reference_pattern": "Figure 4.5: the reference pattern.",
        "4_06_cube": "Figure 4.6: the cube.",
        "4_07_cube_deformed": "Figure 4.7: the pattern on the cube.",
        "4_08_parabola": "Figure 4.8: the parabola.",
        "4_09_parabola_deformed": "Figure 4.9: the pattern on the parabola.",
        "4_10_cylinder": "Figure 4.10: the cylinder.",
        "4_11_cylinder_deformed": "Figure 4.11: the pattern on the cylinder.",
    },
    "Part 3: monotone parts": {
        "4_12_extrema": "Figure 4.12: the extrema of both signals.",
        "4_13_monotone_part": "Figure 4.13: one monotone part of each, inverted: the position as a "
        "function of the intensity. Their distance is the displacement.",
        "4_14_calculated_height": "Figure 4.14: the height that was calculated, and the true one.",
        "4_14b_height_error": "Not in the dissertation: the difference of the two.",
    },
    "Parts 4 to 6: the parabola by each method": {
        "4_15_parabola": "Figure 4.15: the artificial parabola.",
        "4_16_ifa": "Figure 4.16: the parabola by IFA.",
        "4_17_ifa_error": "Figure 4.17: error of IFA.",
        "4_18_ifa_absolute_error": "Figure 4.18: absolute error of IFA.",
        "4_19_sifa": "Figure 4.19: the parabola by spline IFA.",
        "4_20_sifa_error": "Figure 4.20: error of spline IFA.",
        "4_21_sifa_absolute_error": "Figure 4.21: absolute error of spline IFA.",
        "4_22_gsifa": "Figure 4.22: the parabola by global spline IFA.",
        "4_23_gsifa_error": "Figure 4.23: error of global spline IFA.",
        "4_24_gsifa_absolute_error": "Figure 4.24: absolute error of global spline IFA.",
        "4_24a_exact": "Not in the dissertation: the parabola by the exact inversion.",
        "4_24b_exact_error": "Not in the dissertation: error of the exact inversion.",
        "4_24c_exact_absolute_error": "Not in the dissertation: absolute error of the exact "
        "inversion.",
    },
    "All methods": {
        "4_24_errors_gamma_1": "Figure 4.24, as the dissertation numbers it a second time: the "
        "errors of all methods.",
        "4_25_absolute_errors_gamma_1": "Figure 4.25: the absolute errors of all methods.",
        "4_24_errors_gamma_2_2": "The errors at γ = 2.2, the response straightened.",
        "4_25_absolute_errors_gamma_2_2": "The absolute errors at γ = 2.2, the response "
        "straightened.",
        "4_26_errors_gamma_2_2_not_straightened": "At γ = 2.2 as published, on the curved "
        "response (straighten=False).",
        "table_4_1_comparison": "Table 4.1 as bars: the mean absolute error that is published, and "
        "ours.",
    },
}
"""Captions of the figures by the names of their files, in the order of the dissertation."""
COLUMNS = (
    "method",
    "gamma",
    "straightened",
    "published_mean_mm",
    "mean_abs_error_mm",
    "published_std_mm",
    "std_error_mm",
    "max_abs_error_mm",
    "failed_fraction",
)
"""Columns of table 4.1 that differ between its rows; the files have all."""


def printed(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of table 4.1 with the columns that a reader compares."""
    return [{name: row[name] for name in COLUMNS} for row in rows]


def chapters(
    figures: Mapping[str, Figure], rows: Sequence[Mapping[str, Any]], caption: Sequence[str]
) -> list[Chapter]:
    """Return the chapters of the report.

    Parameters
    ----------
    figures : mapping of names to Figure
        Each under a name of ``PARTS``.
    rows : rows of table 4.1
    caption : paragraphs on how to read it
    """
    found = []
    for title, captions in PARTS.items():
        pictures = tuple(
            Picture(figures[name], text) for name, text in captions.items() if name in figures
        )
        found.append(Chapter(title, pictures))
    blocks: tuple[Block, ...] = (
        dict_table(
            printed(rows),
            "Errors of the parabola, published and here",
        ),
        *(Text(paragraph) for paragraph in caption),
    )
    return [*found, Chapter("Table 4.1", blocks)]
