"""Cg, Cgk, bias and linearity: worked examples, an independent fit, coverage of intervals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import fringeworks as fw

STUDIES = 1000
"""Simulated studies: 95 % is then found within 93.3 and 96.7 %."""


def test_cg_by_hand():
    """25 values of −1 and 25 of 1: s² = 50/49; tolerance 60, bias 0.5."""
    y = np.repeat([-1.0, 1.0], 25) + 0.5
    s = (50 / 49) ** 0.5
    found = fw.evaluate.gauge_type1(y, 0.0, 60.0)
    assert found.sigma == pytest.approx(s)
    assert found.cg == pytest.approx(12 / (6 * s))
    assert found.cgk == pytest.approx((6 - 0.5) / (3 * s))
    assert found.t == pytest.approx(0.5 / (s / 50**0.5))
    test = scipy.stats.ttest_1samp(y, 0.0)
    assert (found.t, found.significance) == pytest.approx((test.statistic, test.pvalue))
    assert found.bias_interval == pytest.approx(tuple(test.confidence_interval()))
    assert found.verdict == "pass"
    other = fw.evaluate.gauge_type1(y, 0.0, 60.0, share=0.15, spread=4.0)
    assert other.cg == pytest.approx(9 / (4 * s))
    assert other.cgk == pytest.approx((4.5 - 0.5) / (2 * s))
    assert fw.evaluate.gauge_type1(y, 0.0, 30.0).verdict == "fail"


def test_an_uncertain_reference_makes_a_bias_less_significant():
    y = np.repeat([-1.0, 1.0], 25) + 0.5
    sure = fw.evaluate.gauge_type1(y, 0.0, 60.0)
    unsure = fw.evaluate.gauge_type1(y, 0.0, 60.0, reference_sigma=0.4)
    assert sure.significance < 0.05 < unsure.significance
    assert unsure.bias_sigma == pytest.approx(np.hypot(sure.bias_sigma, 0.4))
    assert unsure.cgk == sure.cgk
    assert unsure.cgk_interval[0] < sure.cgk_interval[0]


@pytest.mark.parametrize(("n", "bias", "unsure"), [(10, 0.0, 0.0), (25, 0.7, 0.0), (50, 0.5, 0.3)])
def test_intervals_hold_the_true_index(n, bias, unsure):
    rng = np.random.default_rng(481)
    true = {"cg": 20.0 / 6.0, "cgk": (10.0 - bias) / 3.0, "bias": bias}
    held = dict.fromkeys(true, 0)
    for _ in range(STUDIES):
        reference = 5.0 + rng.normal(0.0, unsure)  # what the certificate says of 5
        y = rng.normal(5.0 + bias, 1.0, n)
        found = fw.evaluate.gauge_type1(y, reference, 100.0, reference_sigma=unsure)
        for name, value in true.items():
            low, high = getattr(found, f"{name}_interval")
            held[name] += low <= value <= high
    shares = {name: count / STUDIES for name, count in held.items()}
    assert all(0.933 <= share <= 0.967 for share in shares.values()), shares


def test_a_line_by_an_independent_fit():
    rng = np.random.default_rng(3)
    x = np.repeat([2.0, 4.0, 6.0, 8.0, 10.0], 12)
    y = x + 0.7 - 0.13 * x + rng.normal(0.0, 0.2, 60)
    found = fw.evaluate.gauge_linearity(y, x)
    line = scipy.stats.linregress(x, y - x)
    assert (found.slope, found.slope_sigma) == pytest.approx((line.slope, line.stderr))
    assert found.slope_significance == pytest.approx(line.pvalue)
    assert found.intercept == pytest.approx(line.intercept)
    assert found.intercept_sigma == pytest.approx(line.intercept_stderr)
    assert found.levels.tolist() == [2, 4, 6, 8, 10]
    assert found.mean_bias == pytest.approx((y - x).reshape(5, 12).mean(axis=1))
    columns = np.stack([np.ones(60), x], 1)
    rest = y - x - columns @ np.linalg.lstsq(columns, y - x, rcond=None)[0]
    cofactor = rest @ rest / 58 * np.linalg.inv(columns.T @ columns)
    at = np.stack([np.ones(5), found.levels], 1)
    band = scipy.stats.t.ppf(0.975, 58) * np.sqrt(np.einsum("ij,jk,ik->i", at, cofactor, at))
    assert found.band == pytest.approx(band)
    assert found.straight
    assert found.verdict == "fail"


def test_lines_through_three_points_by_hand():
    """Bias 0 ± 1, 1 ± 1, 2 ± 1 at 0, 1, 2: slope 1, rest 6 of 4 degrees of freedom, S = 4."""
    x = np.array([0.0, 0, 1, 1, 2, 2])
    found = fw.evaluate.gauge_linearity(x + np.array([-1.0, 1, 0, 2, 1, 3]), x)
    assert (found.slope, found.intercept) == pytest.approx((1.0, 0.0))
    assert found.sigma == pytest.approx(1.5**0.5)
    assert found.slope_sigma == pytest.approx((1.5 / 4) ** 0.5)
    assert found.curvature_significance == pytest.approx(1.0)


def test_a_bend_is_found_and_leaves_the_verdict_open():
    rng = np.random.default_rng(5)
    x = np.repeat(np.arange(5.0), 10)
    bent = fw.evaluate.gauge_linearity(x + 0.2 * (x - 2) ** 2 + rng.normal(0, 0.1, 50), x)
    assert not bent.straight
    assert bent.verdict == "undecided"


def test_false_alarms_are_as_rare_as_they_say():
    rng = np.random.default_rng(6)
    x = np.repeat([1.0, 2.0, 4.0, 8.0], 6)
    found = [fw.evaluate.gauge_linearity(x + rng.normal(0, 1, 24), x) for _ in range(STUDIES)]
    for name in ("slope_significance", "intercept_significance", "curvature_significance"):
        share = np.mean([getattr(one, name) < 0.05 for one in found])
        assert 0.033 <= share <= 0.067, name


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([1.0], 1.0, 1.0), "two values or more"),
        (([1.0, 1.0, 1.0], 1.0, 1.0), "values that differ"),
        (([0.1, np.inf], 1.0, 1.0), "got inf at index 1"),
        (([1.0, 2.0], np.nan, 1.0), "reference: expected a number"),
        (([1.0, 2.0], 1.0, 0.0), "tolerance: expected"),
        (([1.0, 2.0], "x", 1.0), "reference: expected"),
    ],
)
def test_what_is_no_study_of_a_reference_is_refused(arguments, said):
    with pytest.raises(fw.InputError, match=said):
        fw.evaluate.gauge_type1(*arguments)


@pytest.mark.parametrize(
    ("values", "references", "said"),
    [
        ([1.0, 2, 3], [1.0, 2], "expected 3 numbers"),
        ([1.0, 2, 3], [1.0, 2, 3], "two trials or more"),
        ([1.0, 2, 3, 4], [1.0, 1, 2, 2], "three different ones"),
        ([1.0, 1, 2, 2, 4, 4], [1.0, 1, 2, 2, 3, 3], "trials that scatter"),
    ],
)
def test_what_is_no_study_of_linearity_is_refused(values, references, said):
    with pytest.raises(fw.InputError, match=said):
        fw.evaluate.gauge_linearity(values, references)
