"""``fringeworks study``: tables of trials, what is said of them, and reports."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.study_table import read_study
from fringeworks.report.gauge_charts import RANGES, charts_of
from fringeworks.report.kind import words_of
from tests import commands


def run(*arguments, code=0):
    """What a command says, on either stream."""
    done = commands.run(*arguments, code=code)
    return done.stdout + done.stderr


def trials(seed=1, operators=3, parts=6, count=2, sigma=0.01):
    """Rows of part, operator, trial and value."""
    rng = np.random.default_rng(seed)
    of_part = rng.normal(0.0, 0.1, parts)
    return [
        (f"P{p}", f"O{o}", t, 5.0 + of_part[p] + rng.normal(0.0, sigma))
        for p in range(parts)
        for o in range(operators)
        for t in range(count)
    ]


def write_table(path, rows, head="part,operator,trial,length", separator=","):
    lines = [head, *(separator.join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return write_table(tmp_path_factory.mktemp("study") / "trials.csv", trials())


def test_a_table_gives_what_the_function_gives(table, tmp_path):
    target = tmp_path / "study.json"
    said = run("study", table, "--quantity", "length", "--tolerance-width", 2, "--json", target)
    rows = trials()
    direct = fw.evaluate.gauge_study(
        [row[3] for row in rows], [row[0] for row in rows], [row[1] for row in rows], tolerance=2.0
    )
    figures = json.loads(target.read_text())
    assert figures["verdict"] == direct.verdict == "pass"
    assert [one["sigma"] for one in figures["components"]] == [c.sigma for c in direct.components]
    assert figures["categories"] == direct.categories
    assert "pass: the gauge takes" in said
    assert "3 operators × 6 parts × 2 trials" in said


@pytest.mark.parametrize(("width", "code"), [(2.0, 0), (0.3, 4), (0.1, 3)])
def test_exit_codes_are_those_of_the_verdict(table, width, code):
    run("study", table, "--quantity", "length", "--tolerance-width", width, code=code)


def test_the_table_of_a_batch_is_read_by_the_names_of_its_scans(tmp_path):
    rows = [(f"P{p[1:]}-by-{o}-{t}", v) for p, o, t, v in trials()]
    folder = tmp_path / "results"
    folder.mkdir()
    write_table(folder / "summary.csv", rows, "scan,step")
    names = "{part}-by-{operator}-{trial}"
    asked = ("--quantity", "step", "--names", names, "--tolerance-width", 2)
    for place in (folder, folder / "summary.csv"):
        said = run("study", place, *asked)
        assert "3 operators × 6 parts × 2 trials" in said
    known = read_study(folder / "summary.csv", "step", names=names)
    assert set(known.operators) == {"O0", "O1", "O2"}
    assert known.parts[0] == "P0"
    zarr = tmp_path / "line.zarr"
    zarr.mkdir()
    write_table(tmp_path / "line.csv", rows, "scan,step")
    run("study", zarr, *asked)


def test_a_folder_without_results_is_no_table(tmp_path):
    done = commands.run("study", ".", cwd=tmp_path, code=2)
    assert "summary.csv: expected a table (CSV), got no such file" in done.stderr


def test_one_reference_and_several(tmp_path):
    rng = np.random.default_rng(3)
    one = write_table(tmp_path / "one.csv", [(v,) for v in rng.normal(20, 0.01, 50)], "value")
    said = run("study", one, "--calibrated", 20, "--tolerance-width", 1, code=0)
    assert "Cg = 0.2 T / (6 s): " in said
    given = ("--calibrated", 20, "--tolerance-width", 1, "--share", 0.15, "--spread", 4)
    said = run("study", one, *given, "--calibrated-sigma", 0.01, code=0)
    assert "Cgk = (0.075 T − |bias|) / (2 s): " in said
    levels = np.repeat([1.0, 2.0, 3.0], 8)
    rows = [(f"{v:.4f}".replace(".", ","), f"{x:g}") for v, x in zip(
        1.1 * levels + rng.normal(0, 0.01, 24), levels, strict=True
    )]  # fmt: skip
    several = write_table(tmp_path / "several.csv", rows, "value;true", ";")
    said = run("study", several, "--calibrated", "true", code=3)
    assert "slope: 0.1" in said
    assert "fail: the band leaves a bias of 0 out" in said


@pytest.mark.parametrize(
    ("rows", "head", "options", "said"),
    [
        ([(1, 2)], "part,value", (), "two parts or more"),
        ([("a", "x")], "part,value", (), "row 1: expected a number in 'value', got 'x'"),
        ([("a", "")], "scan,value", ("--calibrated", "x"), "row 1 (a): expected a number"),
        ([("a", 1)], "piece,value", (), "expected a column 'part', got none"),
        ([("a", 1)], "part,size", (), "expected a column 'value', got 'part', 'size'"),
        ([("a", 1)], "part,value", ("--operator", "who"), "expected a column 'who'"),
        ([("a", 1, 3)], "part,value", (), "row 1: expected 2 cells, got 3"),
        ([("a", 1, 2), ("a", 1, 3)], "part,trial,value", (), "got trial 1 of part a again"),
        ([("", 1)], "part,value", (), "row 1: expected a label in 'part', got an empty cell"),
        ([("a_1", 1)], "scan,value", ("--names", "{part}-{trial}"), "scan 'a_1': expected a name"),
        ([("a_1", 1)], "scan,value", ("--names", "{part}{trial}"), "expected letters between"),
        ([("a_1", 1)], "scan,value", ("--names", "{piece}"), "names: expected {part}"),
        ([("a", 1)], "part,value", ("--names", "{part}"), "expected a column 'scan'"),
        ([("a", 1)], "part,value", ("--calibrated", "1"), "together with --tolerance-width"),
        ([("a", 1)], "part,value", ("--calibrated-sigma", "1"), "together with a number"),
        ([("a", 1)], "part,value", ("--share", "1"), "--share: expected together with a number"),
        ([("a", 1)], "part,x", ("--calibrated", "x", "--spread", 4), "--spread cannot be combined"),
        (
            [("a", 1), ("b", 2)],
            "part,value",
            ("--calibrated", 1, "--tolerance-width", 1),
            "expected trials of one part, got 2",
        ),
        (
            [("A", 1), ("B", 2)],
            "operator,value",
            ("--calibrated", 1, "--tolerance-width", 1),
            "expected trials of one operator, got 2",
        ),
        ([], "part,value", (), "expected a row of names and rows of values"),
    ],
)
def test_what_is_no_table_of_a_study_is_refused(tmp_path, rows, head, options, said):
    place = write_table(tmp_path / "bad.csv", rows, head)
    assert said in run("study", place, *options, code=2)


def test_tables_of_excel_are_read(tmp_path):
    text = "part;operator;value\na;Jürgen;1,5\na;Jürgen;1,7\n"
    for encoding in ("cp1252", "utf-8-sig", "utf-16"):
        place = tmp_path / f"{encoding}.csv"
        place.write_bytes(text.encode(encoding))
        known = read_study(place, "value")
        assert known.values.tolist() == [1.5, 1.7]
        assert known.operators == ("Jürgen", "Jürgen")


def test_any_bytes_are_a_table_or_a_sentence(tmp_path):
    good = "\n".join(["part,value", *(f"{k % 3},{k}" for k in range(9))]).encode()
    said = []
    for seed in range(200):
        rng = random.Random(seed)
        content = bytearray(good if seed % 2 else rng.randbytes(rng.randrange(80)))
        for _ in range(rng.randrange(4)):
            if content:
                content[rng.randrange(len(content))] = rng.randrange(256)
        place = tmp_path / "any.csv"
        place.write_bytes(content)
        try:
            assert np.isfinite(read_study(place, "value").values).all()
        except fw.InputError as error:
            said.append(str(error))
    assert 50 < len(said) < 200
    assert all("any.csv" in one for one in said)


def test_reports_have_the_charts_of_the_handbooks(table, tmp_path):
    for target in ("study.html", "study.pdf"):
        given = ("--quantity", "length", "--tolerance-width", 2, "--report", tmp_path / target)
        run("study", table, *given)
    page = (tmp_path / "study.html").read_text(encoding="utf-8")
    for text in ("PASS: the gauge is accepted", "Components of variation", "Analysis of variance", "Range of the trials",
                 "Mean of the trials", "All values by part", "lines that cross"):  # fmt: skip
        assert text in page


def test_studies_without_operators_draw_no_interaction():
    rows = trials(operators=1)
    found = fw.evaluate.gauge_study([row[3] for row in rows], [row[0] for row in rows])
    assert len(charts_of(found)) == 4
    both = trials()
    several = fw.evaluate.gauge_study(
        [r[3] for r in both], [r[0] for r in both], [r[1] for r in both]
    )
    assert len(charts_of(several)) == 5
    assert len(found.plot("scanner").axes) == 4
    assert "interaction" not in "".join(str(w) for w in words_of(found, fw.report.summarise(found)))


def test_odd_names_are_drawn_as_they_are(tmp_path):
    rows = [(f"$\\frac{p}", "$x$" * 9, t, v) for p, _, t, v in trials(operators=1)]
    rows += [(p, "<b>", t, v + 0.001) for p, _, t, v in rows]
    place = write_table(tmp_path / "odd.csv", rows)
    run(
        "study",
        place,
        "--quantity",
        "length",
        "--tolerance-width",
        2,
        "--report",
        tmp_path / "odd.html",
    )
    assert "<b>" not in (tmp_path / "odd.html").read_text(encoding="utf-8").replace("<b>P", "")


def test_factors_of_ranges_are_those_of_normal_values():
    rng = np.random.default_rng(9)
    for count, (mean, scatter) in RANGES.items():
        ranges = np.ptp(rng.normal(size=(100_000, count)), axis=1)
        assert ranges.mean() == pytest.approx(mean, abs=0.012)
        assert ranges.std() == pytest.approx(scatter, abs=0.012)
