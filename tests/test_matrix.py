"""The map of winners, and the reasons that it gives."""

from __future__ import annotations

import math

import pytest

from fringeworks.evaluate.best_method import best_methods, format_map
from fringeworks.evaluate.compare import compare


def row(method, error, **changes):
    return {
        "object": "parabola",
        "gamma": 1.0,
        "noise": 1.0,
        "bits": 8,
        "fringes": 10.0,
        "method": method,
        "mean_abs_error_mm": error,
        "std_error_mm": 1.0,
        "inner_mean_abs_error_mm": error,
        "edge_mean_abs_error_mm": math.nan,
        "failed_fraction": 0.0,
        **changes,
    }


def test_winners_and_ties():
    (cell,) = best_methods([row("fourier", 2.0), row("windowed", 1.0)])
    assert (cell.best, cell.error_mm, cell.why) == ("windowed", 1.0, "")
    assert cell.disturbed
    (cell,) = best_methods([row("fourier", 1.0), row("windowed", 1.01)])
    assert cell.best == "windowed"


@pytest.mark.parametrize(
    ("winner", "words"),
    [
        ({"noise": 0.0, "bits": 0}, "ideal frames"),
        ({"failed_fraction": 0.2}, "unmeasured"),
        ({"edge_mean_abs_error_mm": 3.0}, "cliffs"),
        ({"noise": 0.0}, "rounding without noise"),
        ({}, "errs less all over"),
    ],
)
def test_reasons(winner, words):
    common = {k: v for k, v in winner.items() if k in ("noise", "bits")}
    (cell,) = best_methods([row("exact", 1.0, **winner), row("windowed", 2.0, **common)])
    assert cell.best == "exact"
    assert words in cell.why
    assert cell.disturbed == bool(common.get("noise", 1.0) or common.get("bits", 8))


def test_map_of_a_sweep():
    rows = compare(
        ["parabola"],
        ["fourier", "windowed", "gsifa"],
        noises=[0.0, 2.0],
        bits=[8],
        fringes=[6.0, 12.0],
        height_mm=15.0,
        size=160,
    )
    cells = best_methods(rows)
    assert len(cells) == 4
    assert all(cell.best == "windowed" for cell in cells if cell.scene["noise"])
    lines = format_map(cells)
    assert [line["noise"] for line in lines] == [0.0, 2.0]
    assert set(lines[0]) == {"object", "gamma", "noise", "bits", "6 fringes", "12 fringes"}
