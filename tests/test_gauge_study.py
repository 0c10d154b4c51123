"""Gauge studies: the table against dense least squares, worked examples, coverage of intervals."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from tests.oracles.gauge_anova import anova

STUDIES = 1000
"""Simulated studies of a check of coverage: 95 % is then found with a standard deviation of 0.7 %."""
LEAST = 0.926
"""Share of the intervals that hold the true value, at least: 3.5 standard deviations below 95 %, as
there are 32 such checks."""


def design(rng, o, p, r):
    """Labels of a crossed design in random order."""
    operator, part, _ = (a.ravel() for a in np.meshgrid(*map(np.arange, (o, p, r)), indexing="ij"))
    order = rng.permutation(o * p * r)
    return operator[order], part[order]


def values_of(rng, operator, part, sigmas):
    """Values of a random model: standard deviations of operators, parts, interaction, trials."""
    o, p = operator.max() + 1, part.max() + 1
    of_operator, of_part, crossed, trial = sigmas
    return (
        rng.normal(0, of_operator, o)[operator]
        + rng.normal(0, of_part, p)[part]
        + rng.normal(0, crossed, (o, p))[operator, part]
        + rng.normal(0, trial, operator.size)
    )


def random_study(seed):
    rng = np.random.default_rng(seed)
    operator, part = design(rng, *(int(rng.integers(2, high)) for high in (5, 12, 5)))
    y = 1e3 * rng.normal() + values_of(rng, operator, part, 10.0 ** rng.uniform(-2, 1, 4))
    return y, part, operator


@pytest.mark.parametrize("seed", range(20))
def test_the_table_is_that_of_dense_least_squares(seed):
    y, part, operator = random_study(seed)
    rows = {row.source: row for row in fw.evaluate.gauge_study(y, part, operator).table}
    for name, (squares, freedom) in anova(y, part, operator).items():
        assert rows[name].freedom == freedom
        assert rows[name].squares == pytest.approx(squares, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("seed", range(20))
def test_the_table_is_that_of_statsmodels(seed):
    api = pytest.importorskip("statsmodels.formula.api")
    from statsmodels.stats.anova import anova_lm

    y, part, operator = random_study(100 + seed)
    pandas = pytest.importorskip("pandas")
    data = pandas.DataFrame({"y": y, "p": part.astype(str), "o": operator.astype(str)})
    found = anova_lm(api.ols("y ~ C(o) * C(p)", data).fit())
    rows = {row.source: row for row in fw.evaluate.gauge_study(y, part, operator).table}
    names = {"C(o)": "operators", "C(p)": "parts", "C(o):C(p)": "interaction"}
    for theirs, ours in (names | {"Residual": "repeatability"}).items():
        assert rows[ours].freedom == found.loc[theirs, "df"]
        assert rows[ours].squares == pytest.approx(found.loc[theirs, "sum_sq"], rel=1e-6, abs=1e-8)
    crossed = found.loc["C(o):C(p)"]
    assert rows["interaction"].ratio == pytest.approx(crossed["F"], rel=1e-6)
    assert rows["interaction"].significance == pytest.approx(crossed["PR(>F)"], rel=1e-6)


def test_a_study_by_hand():
    """Two operators, two parts, two trials: 1 ± 1 and 5 ± 1, and 3 ± 1 and 7 ± 1.

    Operators 3 and 5: 8 · 1² = 8. Parts 2 and 6: 8 · 2² = 32. No interaction. Trials: 8 · 1² = 8 of
    4 degrees of freedom. Pooled error 8/5; operators (8 − 8/5)/4, parts (32 − 8/5)/4.
    """
    y = [0.0, 2, 4, 6, 2, 4, 6, 8]
    found = fw.evaluate.gauge_study(np.array(y), [*"aabb", *"aabb"], [*"xxxxyyyy"], tolerance=60.0)
    squares = {row.source: row.squares for row in found.table}
    assert squares == pytest.approx(
        {"operators": 8, "parts": 32, "interaction": 0, "repeatability": 8, "total": 48}
    )
    assert found.pooled
    assert found.component("repeatability").sigma == pytest.approx(1.6**0.5)
    assert found.component("operators").sigma == pytest.approx(1.6**0.5)
    assert found.component("parts").sigma == pytest.approx(7.6**0.5)
    assert found.component("gauge").sigma == pytest.approx(3.2**0.5)
    assert found.component("total").sigma == pytest.approx(10.8**0.5)
    assert found.component("gauge").total_share == pytest.approx((3.2 / 10.8) ** 0.5)
    assert found.component("gauge").tolerance_share == pytest.approx(6 * 3.2**0.5 / 60)
    assert found.categories == 2  # 1.41 √(7.6 / 3.2) = 2.17
    assert found.verdict == "undecided"
    rows = {row.source: row for row in found.table}
    assert rows["operators"].ratio == pytest.approx(5.0)
    assert rows["parts"].ratio == pytest.approx(20.0)


def test_an_interaction_is_kept_where_it_is_significant():
    y = np.array([0.0, 0.1, 4, 4.1, 4, 4.1, 0, 0.1])
    found = fw.evaluate.gauge_study(y, [*"aabb", *"aabb"], [*"xxxxyyyy"])
    assert not found.pooled
    assert found.component("interaction").sigma == pytest.approx(((16 * 2 - 0.005) / 2) ** 0.5 / 1)


def test_without_operators_there_is_repeatability_only():
    y = np.array([1.0, 3, 7, 9, 4, 6])
    found = fw.evaluate.gauge_study(y, [*"aabbcc"])
    assert [one.name for one in found.components] == ["repeatability", "gauge", "parts", "total"]
    assert found.component("repeatability").sigma == pytest.approx(2**0.5)
    assert found.component("parts").sigma == pytest.approx((18 - 2) ** 0.5 / 2**0.5)
    assert found == fw.evaluate.gauge_study(y, [*"aabbcc"], [""] * 6)
    low, high = found.component("repeatability").interval  # √(6 / χ²) of three degrees of freedom
    assert (low, high) == pytest.approx((0.801, 5.27), rel=0.02)


@pytest.mark.parametrize("factor", [1e-9, 1e12])
def test_a_study_does_not_depend_on_the_unit(factor):
    y, part, operator = random_study(7)
    one = fw.evaluate.gauge_study(y - y.mean(), part, operator, tolerance=5.0)
    other = fw.evaluate.gauge_study(factor * (y - y.mean()), part, operator, tolerance=5.0 * factor)
    assert other.component("gauge").sigma == pytest.approx(factor * one.component("gauge").sigma)
    assert other.judged_share == pytest.approx(one.judged_share)
    assert other.categories == one.categories


@pytest.mark.parametrize(
    ("sigmas", "shape"),
    [
        ((0.5, 3.0, 0.5, 1.0), (3, 10, 3)),
        ((0.5, 3.0, 0.0, 1.0), (3, 10, 2)),
        ((2.0, 3.0, 1.0, 0.3), (4, 10, 2)),
        ((1.0, 2.0, 0.3, 1.0), (2, 5, 3)),
    ],
)
def test_intervals_hold_the_true_components(sigmas, shape):
    rng = np.random.default_rng(4801)
    operator, crossed = sigmas[0] ** 2, sigmas[2] ** 2
    gauge, part = operator + crossed + sigmas[3] ** 2, sigmas[1] ** 2
    true = {"repeatability": sigmas[3] ** 2, "operators": operator, "interaction": crossed}
    true |= {"gauge": gauge, "parts": part, "total": gauge + part}
    held = dict.fromkeys([*true, "share", "ndc"], 0)
    for _ in range(STUDIES):
        who, what = design(rng, *shape)
        found = fw.evaluate.gauge_study(values_of(rng, who, what, sigmas), what, who)
        for name, variance in true.items():
            low, high = found.component(name).interval
            held[name] += low <= variance**0.5 <= high
        low, high = found.component("gauge").total_interval
        held["share"] += low <= (gauge / (gauge + part)) ** 0.5 <= high
        low, high = found.categories_interval
        held["ndc"] += low <= 1.41 * (part / gauge) ** 0.5 <= high
    shares = {name: count / STUDIES for name, count in held.items()}
    # Generalised intervals are conservative for components near 0, never the other way.
    assert min(shares.values()) >= LEAST, shares
    for name in ("repeatability", "parts"):
        assert shares[name] <= 0.974, shares


@pytest.mark.parametrize(
    ("values", "parts", "operators", "said"),
    [
        ([1.0, 2, 3, 4], [*"aabb"], [*"xyx"], "operators: expected 4 labels"),
        ([1.0, 2, 3, np.nan], [*"aabb"], None, "got nan at index 3"),
        ([1.0, 2, 3], [*"aab"], None, "part b has 1"),
        ([1.0, 2, 3, 4, 5, 6], [*"aabbaa"], [*"xxxxyy"], "part b by operator y has 0"),
        ([1.0, 2, 3, 4], [*"abcd"], None, "two trials or more"),
        ([1.0, 2, 3, 4], [*"aaaa"], None, "two parts or more"),
        ([1.0, 1, 2, 2], [*"aabb"], None, "trials that differ"),
        ([0.1, 0.1, 0.1, 0.7, 0.7, 0.7], [*"aaabbb"], None, "trials that differ"),
        (["a", "b"], [*"aa"], None, "expected a list of numbers"),
        ([[1.0, 2], [3, 4]], [*"aabb"], None, "expected a list of numbers"),
        ([1.0, 2, 3, 4], "aabb", None, "parts: expected a label for each value"),
        ([1.0, 2, 3, 4], [1, 1, 2, 2], 5, "operators: expected a label for each value"),
    ],
)
def test_what_is_no_study_is_refused_in_a_sentence(values, parts, operators, said):
    with pytest.raises(fw.InputError, match=said):
        fw.evaluate.gauge_study(values, parts, operators)


def test_limits_and_names_are_checked():
    y, parts = np.array([1.0, 2, 3, 5]), [*"aabb"]
    for tolerance in (0.0, -1.0, np.nan, "x"):
        with pytest.raises(fw.InputError, match="tolerance: expected"):
            fw.evaluate.gauge_study(y, parts, tolerance=tolerance)
    with pytest.raises(fw.InputError, match="spread: expected"):
        fw.evaluate.gauge_study(y, parts, spread=0)
    with pytest.raises(fw.InputError, match="component: expected one of repeatability, gauge"):
        fw.evaluate.gauge_study(y, parts).component("operators")
