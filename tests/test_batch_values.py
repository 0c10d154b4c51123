"""Tables and charts of a batch: digits, limits, colours on dark pages."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.batch.judgement import Judgement, as_values, judgement_from
from fringeworks.batch.report import shown_values
from fringeworks.batch.run import BatchResult
from fringeworks.batch.store import Store
from fringeworks.evaluate import PartTolerance
from fringeworks.files.study_table import read_study
from fringeworks.report.control_chart import control_chart
from fringeworks.report.page.blocks import Picture
from fringeworks.report.page.html import _picture
from tests.inspected import plate
from tests.inspected import share_recipe as recipe


def test_all_values_of_a_tolerance_have_the_same_decimals():
    tolerances = (
        PartTolerance("height", "step_height", ("a", "b"), 19.9, 20.1),
        PartTolerance("seen", "valid_share", ("a",), 0.5, None),
    )
    # By its own σ, each height would have another number of decimals.
    heights, sigmas = (19.98541, 20.0, 19.9, None), (0.0096, 0.012, 0.031, None)
    rows = tuple(
        {"scan": str(k), "height": h, "height σ": s, "seen": 0.742, "seen σ": 0.0}
        for k, (h, s) in enumerate(zip(heights, sigmas, strict=True))
    )
    known = replace(recipe(), tolerances=tolerances, areas={"a": AREA, "b": AREA})
    found = BatchResult(Path("out"), Path("out.csv"), tolerances, rows, recipe=known)
    values = shown_values(found, tolerances, 4)
    assert [one[0] for one in values] == ["19.985", "20.000", "19.900", "–"]
    assert {one[1] for one in values} == {"74.2 %"}


AREA = fw.evaluate.Area(box=(2, 2, 9, 9))


@pytest.mark.parametrize("seed", [1, 2])
def test_no_control_limit_is_below_what_a_quantity_can_be(seed):
    values = np.abs(np.random.default_rng(seed).normal(0.0, 0.001, 40))
    arguments = ("flatness", values, 0.0 * values, ["pass"] * 40, (None, 0.05))
    free, bound = control_chart(*arguments), control_chart(*arguments, least=0.0)
    dashed = [
        [float(np.min(line.get_ydata())) for line in figure.axes[0].lines if limit_line(line)]
        for figure in (free, bound)
    ]
    assert min(dashed[0]) < 0 < min(dashed[1])


def limit_line(line):
    """Whether a line of a chart is one of its control limits."""
    return line.get_linestyle() == "--" and len(line.get_ydata())


def test_charts_turn_over_on_dark_pages_and_pictures_do_not():
    values = np.linspace(0.0, 1.0, 9)
    chart = control_chart("seen", values, values, ["pass"] * 9, (0.0, 1.0))
    assert "lines" in _picture(Picture(chart, ""))["kind"].split()
    assert "lines" not in _picture(Picture(plate().plot("part"), ""))["kind"].split()


def test_what_a_report_of_a_part_needs_is_kept(tmp_path):
    flat = PartTolerance("flat", "flatness", ("face",), None, 0.1)
    found = fw.inspect(plate(), replace(recipe(), tolerances=(flat,)))
    assert found.checks[0].budget.lines
    kept = judgement_from(as_values(found), "part")
    budgets = {c.tolerance.name: c.budget for c in found.checks if c.budget is not None}
    assert {name: str(one) for name, one in kept.budgets.items()} == {
        name: str(one) for name, one in budgets.items()
    }
    assert judgement_from({}, "part") == Judgement()
    with pytest.raises(fw.FileProblem, match="part: expected budgets"):
        judgement_from({"budgets": {"a": {}}, "findings": [], "provenance": None}, "part")
    for name in ("out", "out.zarr"):
        store = Store(tmp_path / name)
        store.begin({})
        store.write("one", plate(), {"value": 1}, as_values(found))
        assert store.row("one") == {"value": 1}
        assert store.judgement("one") == json.loads(json.dumps(as_values(found)))
        assert store.judgement("two") == {}


def test_a_summary_for_excel_begins_with_its_mark_and_reads_alike(tmp_path):
    rows = [{"scan": f"{p}_{o}_{t}", "l σ": 1.0 + p + 0.1 * t} for p, o, t in np.ndindex(3, 2, 2)]
    found = []
    for excel in (False, True):
        store = Store(tmp_path / str(excel), excel=excel)
        store.folder.mkdir()
        store.write_summary(rows)
        found.append(read_study(store.summary, "l σ", names="{part}_{operator}_{trial}"))
        assert store.summary.read_bytes().startswith(b"\xef\xbb\xbf") == excel
    assert np.array_equal(found[0].values, found[1].values)
    assert found[0].parts == found[1].parts
