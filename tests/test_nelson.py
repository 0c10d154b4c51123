"""Nelson's rules: each on a series that is made for it, and on chance."""

from __future__ import annotations

import json
from dataclasses import replace
from math import comb, factorial

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.nelson import LENGTHS, RULES, control_series
from fringeworks.files.check_history import CHARTED
from fringeworks.rig.calibration.drift import RigCheck
from tests import commands

TAIL = {1: 0.158655, 2: 0.0227501, 3: 0.00134990}
"""Share of normal values beyond 1, 2, 3 σ on one side."""
EULER_14 = 199_360_981
"""Number of orders of fourteen values that rise and fall in turn, and begin with a rise."""

SERIES = {
    1: ([0.5, -0.5, 3.1], 2),
    2: ([0.4, -0.4, *[0.5, 0.2] * 4, 0.3], 10),
    3: ([0.5, -0.9, -0.6, -0.3, 0.1, 0.4, 0.7], 6),
    4: ([0.5, 0.7, -0.2, 0.4, *[-0.3, 0.2] * 5], 13),
    5: ([0.1, 2.2, -0.4, 2.5], 3),
    6: ([-0.2, -1.2, -1.3, 0.1, -1.7, -1.5], 5),
    7: ([1.5, *[0.3, 0.5, -0.2, 0.1, -0.6] * 3], 15),
    8: ([0.2, 1.5, -1.2, 1.1, -1.7, -1.3, 1.9, -1.1, 1.4], 8),
}
"""A series in σ that completes one pattern, and where."""


def found(values, rule=None):
    signals = control_series(values, mean=0.0, sigma=1.0).signals
    return [one.last for one in signals if rule is None or one.rule == rule]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_rule_finds_its_pattern_where_it_is_complete(rule, side):
    values, last = SERIES[rule]
    values = side * np.array(values)
    assert found(values, rule) == [last]
    assert found(values[:-1], rule) == []
    (signal,) = [s for s in control_series(values, mean=0, sigma=1).signals if s.rule == rule]
    assert signal.last - signal.first + 1 == LENGTHS[rule]
    assert RULES[rule] in str(signal)


def test_patterns_that_are_nearly_complete_are_none():
    assert found([0.3] * 8) == []
    assert found([0.3] * 4 + [0.0] + [0.3] * 8, 2) == []  # a value on the mean is on no side
    assert found([-0.9, -0.6, -0.3, -0.3, 0.4, 0.7], 3) == []  # two equal values
    assert found([2.2, 0.1, 0.1, 2.5], 5) == []
    assert found([2.2, -2.5], 5) == []
    assert found([1.2, 1.3, 0.2, 0.1, 1.5, 1.4], 6) == []


def test_values_that_were_not_measured_interrupt_no_run():
    values = np.array([0.5] * 5 + [np.nan] + [0.5] * 4)
    (signal,) = control_series(values, mean=0.0, sigma=1.0).signals
    assert (signal.rule, signal.first, signal.last) == (2, 0, 9)


def test_rates_of_false_alarms_are_those_of_chance():
    n = 100_000
    one, two, three = (TAIL[k] for k in (1, 2, 3))
    expected = {
        1: 2 * three,
        2: 2 * 0.5**9,
        3: 2 / factorial(6),
        4: 2 * EULER_14 / factorial(14),
        5: 2 * two * (1 - (1 - two) ** 2),
        6: 2 * one * sum(comb(4, k) * one**k * (1 - one) ** (4 - k) for k in (3, 4)),
        7: (1 - 2 * one) ** 15,
        8: (2 * one) ** 8,
    }
    for seed in (11, 12):
        values = np.random.default_rng(seed).normal(7.0, 0.3, n)
        series = control_series(values, mean=7.0, sigma=0.3)
        counts = np.bincount([signal.rule for signal in series.signals], minlength=9)
        for rule, rate in expected.items():
            # Runs that grow signal several times: their counts scatter more than Poisson's.
            assert abs(counts[rule] - n * rate) < 6.0 * (n * rate) ** 0.5 + 3, rule
        alarms = len({signal.last for signal in series.signals}) / n
        assert 1 / alarms == pytest.approx(44.0, rel=0.05)
        # Limits from the values themselves change little.
        own = control_series(values)
        assert own.sigma == pytest.approx(0.3, rel=0.02)
        assert len(own.signals) == pytest.approx(len(series.signals), rel=0.05)


def test_a_shift_of_one_sigma_is_found_soon():
    waits = []
    for seed in range(200):
        values = np.random.default_rng([5, seed]).normal(1.0, 1.0, 400)
        waits.append(found(values)[0])
    assert np.median(waits) < 10


def test_series_that_are_none_are_refused():
    for values in (np.zeros((2, 3)), ["a"], [np.inf, 1.0]):
        with pytest.raises(fw.InputError, match="values"):
            control_series(values)
    with pytest.raises(fw.InputError, match="sigma"):
        control_series([1.0], sigma=0.0)
    assert control_series([1.0]).signals == ()
    assert control_series([2.0, 2.0, 2.0]).signals == ()
    assert control_series([]).signals == ()


def check(drift, scale=1.0, verdict="holds"):
    three = np.zeros(3)
    return RigCheck(
        verdict, drift, 0.02, 0.1, 0.05, 0.4, 0.3, (), three, three, three, three,
        0.1, 0.12, 0.01, scale, 1e-4, 500.0,
    )  # fmt: skip


def test_checks_of_a_rig_make_a_history(tmp_path):
    table = tmp_path / "checks.csv"
    rng = np.random.default_rng(3)
    for k in range(30):
        drift = 0.05 + 0.01 * rng.normal() + (0.03 if k >= 20 else 0.0)
        known = fw.files.append_check(table, check(drift, 1.0 + 1e-4 * rng.normal()))
    assert len(known.dates) == 30
    assert set(CHARTED) < set(known.figures)
    figures = fw.report.summarise(fw.files.read_check_history(table))
    patterns = figures["figures"]["drift_mm"]["signals"]
    assert any(one["rule"] == 2 and one["last"] >= 20 for one in patterns)
    page, out = tmp_path / "r.html", tmp_path / "h.json"
    done = commands.run("rig", "history", table, "--report", page, "--json", out)
    assert "Patterns (Nelson)" in page.read_text("utf-8")
    assert "usual cause" in done.stdout + done.stderr
    assert json.loads(out.read_text())["checks"] == 30


def test_tables_of_something_else_are_no_history(tmp_path):
    table = tmp_path / "t.csv"
    table.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(fw.FileProblem, match="column 'date'"):
        fw.files.append_check(table, check(0.05))
    assert table.read_text("utf-8") == "a,b\n1,2\n"
    with pytest.raises(fw.FileProblem, match="csv"):
        fw.files.append_check(tmp_path / "t.txt", check(0.05))
    fw.files.append_check(tmp_path / "h.csv", check(0.05))
    text = (tmp_path / "h.csv").read_text("utf-8").replace("holds", "maybe")
    (tmp_path / "h.csv").write_text(text, encoding="utf-8")
    with pytest.raises(fw.FileProblem, match="'maybe'"):
        fw.files.read_check_history(tmp_path / "h.csv")


def test_an_empty_series_has_a_chart():
    assert replace(control_series([]), mean=0.0, sigma=1.0).limits == (-3.0, 3.0)
