"""Numbers in words: digits by σ, shares as percent, in one place for all that people read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fringeworks.types.numbers import estimate, limit, number, percent, sigma_text

SOURCE = Path(__file__).resolve().parents[1] / "src" / "fringeworks"
ROOMS = ("report", "cli", "batch", "evaluate")
"""Rooms whose words people read as results."""
OWN_FORMAT = re.compile(r":[^}\"{]*\.(?:\d+[ge%]|[1-9]\d*f)\}")
"""A number with digits of its own; whole seconds (``.0f``) are none."""
OTHERS = {"batch/sequence.py", "evaluate/selftest/promises.py"}
"""A table of a file, and promises that have limits and no σ."""


@pytest.mark.parametrize(
    ("value", "sigma", "shown"),
    [
        (-0.0064836, 0.00037, "−0.00648"),
        (10.02337, 0.0021, "10.0234"),
        (10.02337, 0.00996, "10.023"),
        (1234.6, 123.0, "1230"),
        (-0.00001, 0.01, "0.000"),
        (0.02, 5.0, "0.0"),
        (17.0, None, "17.0"),
        (0.123456, np.nan, "0.123"),
        (0.0, None, "0"),
        (np.nan, 1.0, "–"),
        (None, None, "–"),
        (1.234e-12, None, "1.2e-12"),
        (-2.0e-11, 1.0e-12, "−2e-11"),
    ],
)
def test_the_sigma_decides_the_digits(value, sigma, shown):
    assert number(value, sigma).replace("e−", "e-") == shown
    assert number(value, sigma, "mm").endswith(" mm") == (shown != "–")


def test_values_lose_no_more_than_a_tenth_of_their_sigma():
    rng = np.random.default_rng(7)
    for sigma in 10.0 ** rng.uniform(-6, 3, 200):
        value = float(rng.normal(0.0, 30.0 * sigma))
        shown = float(number(value, sigma).replace("−", "-"))
        assert abs(shown - value) <= 0.0501 * sigma
        assert float(sigma_text(sigma)) == pytest.approx(sigma, rel=0.05)


def test_estimates_limits_and_shares():
    assert estimate(-3.14159, 0.012, "mm") == "−3.142 ± 0.012 mm"
    assert estimate(3.14159, None, "mm") == "3.14 mm"
    assert estimate(None, None, "mm") == "–"
    assert limit(-0.1) == "−0.1"
    assert limit(10.0125) == "10.0125"
    assert limit(None) == "–"
    assert [percent(s) for s in (0.175, 0.0, 1.0, 0.99997, 4e-5)] == [
        "17.5 %",
        "0.0 %",
        "100.0 %",
        "99.997 %",
        "0.004 %",
    ]


def test_results_have_no_formats_of_their_own():
    own = [
        f"{place}: {found}"
        for room in ROOMS
        for path in sorted((SOURCE / room).rglob("*.py"))
        if (place := path.relative_to(SOURCE).as_posix()) not in OTHERS
        for found in OWN_FORMAT.findall(path.read_text("utf-8"))
    ]
    assert not own


def test_the_page_shows_the_same_digits():
    own = [
        f"{path.name}: {found}"
        for path in sorted((SOURCE / "report").rglob("*.js"))
        if path.name != "numbers.js"
        for found in re.findall(r"\.toPrecision\([2-9]\)|\.toFixed\([1-9]\)", path.read_text())
    ]
    assert not own
