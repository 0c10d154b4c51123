"""Uncertainty budgets: parts, degrees of freedom, k, and Monte Carlo beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.budget import budget_of, coverage_factor
from fringeworks.evaluate.monte_carlo import compared, numerical_tolerance, shortest
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.evaluate.shares import Share, freedom_of, joined, total
from fringeworks.report.kind import words_of
from fringeworks.types import StatedUncertainty
from tests.inspected import AREAS, TRUE, points, scene

COVARIANCE = (
    np.diag([0.05] * 4 + [1e-5] * 5 + [0.05] * 4 + [1e-5] * 5 + [1e-4] * 3 + [0.02] * 3) ** 2
)


def rig_with_covariance():
    return replace(scene()[0], covariance=COVARIANCE)


def recipe(*quantities, **stated):
    tolerances = [
        fw.evaluate.PartTolerance(" ".join(key), key[0], key[1:], 0.0, 1000.0) for key in quantities
    ]
    return fw.Recipe(
        rig=rig_with_covariance(),
        areas=AREAS,
        tolerances=tuple(tolerances),
        datums={"A": fw.evaluate.Datum(("base",))},
        uncertainty=StatedUncertainty(**stated),
    )


def test_degrees_of_freedom_add_up_as_in_the_example_of_the_gum():
    # JCGM 100:2008, H.1: end gauges; u of 32 nm with 16 degrees of freedom.
    parts = [(25.0, 18), (9.7, 25.6), (2.9, 50), (16.6, 2)]
    shares = [Share("noise", size, freedom) for size, freedom in parts]
    assert total(shares) == pytest.approx(31.7, abs=0.1)
    assert np.floor(freedom_of(shares)) == 16
    (one,) = joined(shares)
    assert one.freedom == freedom_of(shares)


def test_k_is_a_value_of_students_t():
    # Table G.2 of the GUM for 95.45 %.
    for freedom, k in ((1, 13.97), (5, 2.65), (10, 2.28), (20, 2.13), (50, 2.05), (np.inf, 2.0)):
        assert coverage_factor(freedom) == pytest.approx(k, abs=0.005)
    assert coverage_factor(10.9) == coverage_factor(10)


def test_parts_of_every_quantity_make_its_sigma():
    cloud, rig = points(3), rig_with_covariance()
    for quantity, *names in TRUE:
        areas = [area_points(cloud, AREAS[name], rig) for name in names]
        found = MEASURED[quantity](*areas)
        budget = budget_of(found, areas)
        assert np.sqrt(sum(one.sigma**2 for one in budget.lines)) == pytest.approx(found.sigma)
        assert sum(one.share for one in budget.lines) == pytest.approx(1.0)
        for one in budget.lines:
            assert one.sensitivity * one.input_sigma == pytest.approx(one.sigma)
        # One part alone is what its part of the whole says.
        still = [area.without_noise() for area in areas]
        noise = {one.source: one.sigma for one in budget.lines}.get("noise", 0.0)
        if quantity not in ("flatness",):
            alone = MEASURED[quantity](*still).sigma
            assert np.hypot(alone, noise) == pytest.approx(found.sigma, rel=1e-3)


def test_stated_uncertainties_are_parts_of_the_one_sigma():
    keys = [("sphere_spacing", "ball", "other"), ("flatness", "base")]
    plain = fw.evaluate.judge_part(points(3), recipe(*keys))
    stated = fw.evaluate.judge_part(
        points(3),
        recipe(
            *keys,
            board_scale=1e-4,
            board_freedom=8.0,
            expansion_per_k=11.5e-6,
            temperature_k=5.0,
        ),
    )
    before, after = plain[0], stated[0]
    parts = {one.source: one for one in after.budget.lines}
    assert parts["board certificate"].sigma == pytest.approx(1e-4 * 58.0, rel=1e-3)
    assert parts["board certificate"].freedom == 8.0
    heat = 11.5e-6 * 5.0 / 3**0.5 * 58.0
    assert parts["temperature"].sigma == pytest.approx(heat, rel=1e-3)
    assert parts["temperature"].distribution == "uniform"
    assert parts["temperature"].sensitivity == pytest.approx(11.5e-6 * 58.0, rel=1e-3)
    expected = np.sqrt(before.sigma**2 + (1e-4 * 58.0) ** 2 + heat**2)
    assert after.sigma == after.budget.sigma == pytest.approx(expected, rel=1e-3)
    # The flatness of a plane hardly depends on the scale.
    assert stated[1].sigma == pytest.approx(plain[1].sigma, rel=1e-3)


def test_a_recipe_keeps_what_it_states(tmp_path):
    made = replace(recipe(board_scale=2e-5, temperature_k=2.0, expansion_per_k=1e-5), rig=None)
    fw.files.write_recipe(tmp_path / "r.toml", made)
    assert fw.files.read_recipe(tmp_path / "r.toml").uncertainty == made.uncertainty
    text = (tmp_path / "r.toml").read_text("utf-8")
    (tmp_path / "r.toml").write_text(text.replace("2e-05", "-1.0"), "utf-8")
    with pytest.raises(fw.FileProblem, match="from 0 on"):
        fw.files.read_recipe(tmp_path / "r.toml")


def test_monte_carlo_agrees_where_quantities_are_linear():
    key = ("step_height", "top", "base")
    (check,) = fw.evaluate.judge_part(points(5), recipe(key, board_scale=1e-4), draws=300)
    found = check.monte_carlo
    assert found.mean == pytest.approx(check.value, abs=0.4 * check.sigma)
    assert found.sigma == pytest.approx(check.sigma, rel=0.25)
    assert found.agrees is not False


def test_monte_carlo_tells_an_angle_near_zero_from_its_budget():
    key = ("angle", "top", "base")
    (check,) = fw.evaluate.judge_part(points(5), recipe(key), draws=120)
    # An angle cannot be negative: no interval about 0 has two sides.
    assert check.monte_carlo.interval[0] >= 0.0
    assert check.monte_carlo.agrees is False
    figures = fw.report.summarise(fw.inspect(points(5), recipe(key), draws=120))
    assert figures["checks"][0]["monte_carlo"]["agrees"] is False


def test_comparison_follows_the_numerical_tolerance():
    assert numerical_tolerance(0.0034) == pytest.approx(0.0005)
    assert numerical_tolerance(0.0096) == pytest.approx(0.005)
    assert numerical_tolerance(0.12) == pytest.approx(0.05)
    drawn = np.random.default_rng(8).normal(5.0, 0.02, 200_000)
    found = Quantified(5.0, (Share("noise", 0.02),), "mm")
    assert compared(drawn, found, budget_of(found, [])).agrees is True
    assert compared(drawn + 0.009, found, budget_of(found, [])).agrees is False
    assert compared(drawn[:200] + 0.002, found, budget_of(found, [])).agrees is None
    low, high = shortest(np.random.default_rng(1).exponential(size=100_000))
    assert low == pytest.approx(0.0, abs=1e-3)
    assert high == pytest.approx(-np.log(1.0 - 0.9545), rel=0.02)


def test_draws_are_checked():
    with pytest.raises(fw.InputError, match="draws: expected 100 to"):
        fw.evaluate.judge_part(points(5), recipe(), draws=5)


def test_reports_and_words_show_the_budget(tmp_path):
    key = ("step_height", "top", "base")
    found = fw.inspect(points(5), recipe(key, board_scale=1e-4), draws=100)
    fw.write_report(tmp_path / "r.html", {"part": found}, pdf=tmp_path / "r.pdf")
    page = (tmp_path / "r.html").read_text("utf-8")
    assert "Uncertainty budget: step_height top base" in page
    assert "board certificate" in page
    assert "Monte Carlo with 100 draws" in page
    said = [str(one) for one in words_of(found, fw.report.summarise(found))]
    assert any("Monte Carlo" in one for one in said)
    (tables,) = fw.report.summarise(found)["checks"]
    assert tables["budget"]["k"] == pytest.approx(2.0, abs=0.01)
