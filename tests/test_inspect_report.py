"""Reports of inspections hold the verdict, and each tolerance with value, uncertainty and area."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.report.kind import Rows, words_of
from fringeworks.report.windows import window_of
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.types.numbers import percent
from tests.inspected import AREAS, points, scene, step


def tolerances(low=9.9, high=10.1):
    """A step that may fail, and a flatness that is kept."""
    return (
        *step(low, high).tolerances,
        fw.evaluate.PartTolerance("flat", "flatness", ("base",), None, 0.9, 0.0),
    )


def recipe(low=9.9, high=10.1):
    return fw.Recipe(areas=AREAS, tolerances=tolerances(low, high), risk=0.01)


def rows_of(page, caption):
    """Cells of the table with a caption."""
    table = re.search(f"<caption>{caption}</caption>.*?</table>", page, re.S)[0]
    rows = re.findall("<tr.*?</tr>", table, re.S)
    return [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row) for row in rows]


@pytest.mark.parametrize(
    ("limits", "verdict", "said"),
    [
        ((9.9, 10.1), "pass", "PASS: all 2 tolerances are kept."),
        ((10.5, 11.0), "fail", "FAIL: 1 of 2 tolerances is not kept."),
    ],
)
def test_a_report_says_what_the_terminal_says(tmp_path, limits, verdict, said):
    found = fw.inspect(points(4), recipe(*limits))
    written = fw.write_report(tmp_path / "r.html", {"part 7": found}, pdf=tmp_path / "r.pdf")
    assert written.kept == (verdict == "pass")
    page = (tmp_path / "r.html").read_text("utf-8")
    assert f'<p class="verdict {verdict}">{said}</p>' in page
    head, one, two = rows_of(page, "Tolerances")
    assert head == [
        "tolerance",
        "measured",
        "nominal",
        "min",
        "max",
        "value",
        "U (95 %)",
        "verdict",
    ]
    check = found.checks[0]
    decimals = len(one[5].split()[0].partition(".")[2])
    assert one[0] == "step"
    assert one[3:5] == [f"{v:g} mm" for v in limits]
    assert float(one[2].split()[0]) == pytest.approx(np.mean(limits))
    assert float(one[5].split()[0]) == pytest.approx(check.value, abs=0.5 * 10.0**-decimals)
    assert float(one[6].split()[0]) == pytest.approx(
        check.budget.expanded, abs=0.5 * 10.0**-decimals
    )
    assert one[7].startswith(verdict)
    assert two[2:5] == ["0 mm", "–", "0.9 mm"]
    # A picture of each tolerance's area, and the surface to turn.
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    assert any(text.startswith("step: step height of top and base.") for text in captions)
    assert any(text.startswith("flat: flatness of base.") for text in captions)
    assert "fringe-viewer-mount" in page


def test_a_failure_says_which_limit_is_broken():
    (check, _) = fw.inspect(points(4), recipe(10.5, 11.0)).checks
    assert check.verdict == "fail"
    assert re.fullmatch(
        r"(9\.99|10\.00)\d+ mm is 0\.\d+ mm below the smallest allowed 10\.5 mm", check.why
    )


def test_the_command_reports_the_judgement(tmp_path):
    rig, plan, view = scene()
    fw.files.write_stack(tmp_path / "B-0042", list(photograph(view, plan, Optics(seed=9))), plan)
    fw.files.write_rig(tmp_path / "rig.toml", rig)
    fw.files.write_recipe(
        tmp_path / "recipe.toml", replace(recipe(10.5, 11.0), rig=tmp_path / "rig.toml")
    )
    words = ["inspect", str(tmp_path / "B-0042"), "--recipe", str(tmp_path / "recipe.toml")]
    page, picture = tmp_path / "r.html", tmp_path / "r.png"
    assert run([*words, "--report", str(page), "--figure", str(picture)]) == 3
    assert "FAIL: 1 of 2 tolerances is not kept." in page.read_text("utf-8")
    assert picture.stat().st_size > 20_000


def test_pictures_are_cropped_to_what_was_measured():
    reason = np.full((100, 200), fw.Reason.MASKED, np.uint8)
    reason[20:60, 90:150] = fw.Reason.OK
    window = window_of(reason)
    assert (window.left, window.top, window.right, window.bottom) == (87, 17, 152, 62)
    assert window_of(np.full((4, 5), 9, np.uint8)).width == 5
    within = replace(recipe(), within="top")
    found = fw.inspect(points(4), within)
    left, _, right, _ = AREAS["top"].box
    shown = found.plot("part").subfigs[0].axes[0]
    assert left - 15 < min(shown.get_xlim()) < left < right < max(shown.get_xlim()) < right + 15


def test_shares_are_percent_and_limits_have_units():
    share = fw.evaluate.PartTolerance("seen", "valid_share", ("base",), 0.5, 0.75)
    judged = replace(recipe(), tolerances=(*tolerances(), share))
    found = fw.inspect(points(4), judged)
    seen = percent(found.checks[-1].value)
    assert found.checks[-1].why == f"{seen} is above the largest allowed 75 %"
    figures = fw.report.summarise(found)
    assert 0.75 < figures["checks"][-1]["value"] <= 1.0  # files keep the share
    shown = [
        row for word in words_of(found, figures) if isinstance(word, Rows) for row in word.rows
    ]
    assert [row[3] for row in shown] == ["9.9 … 10.1 mm", "≤ 0.9 mm", "50 … 75 %"]
    assert [row[1:3] for row in shown][-1] == [seen, "–"]
