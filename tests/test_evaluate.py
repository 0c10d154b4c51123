"""Errors, tables and fits."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from fringeworks import HeightMap, InputError, Reason, compare
from fringeworks.evaluate.truth_errors import edge_band, errors
from fringeworks.report.tables import format_table
from fringeworks.simulate.scene import standard_scene
from tests.commands import COLUMNS
from tests.map_fits import fit_cone, fit_plane


def surface(values, sigma=1.0, unit="mm"):
    values = np.asarray(values, float)
    reason = np.where(np.isnan(values), Reason.OUTSIDE, Reason.OK).astype(np.uint8)
    quantity = "height" if unit == "mm" else "displacement"
    return HeightMap(values, np.full(values.shape, sigma), reason, quantity, unit, 1.0)


def test_figures():
    found = errors(surface([[1.0, -3.0], [np.nan, 2.0]], sigma=2.0), np.zeros((2, 2)))
    assert found.mean_abs_error_mm == pytest.approx(2.0)
    assert found.mean_error_mm == pytest.approx(0.0)
    assert found.std_error_mm == pytest.approx(np.std([1, -3, 2]))
    assert found.max_abs_error_mm == 3.0
    assert found.failed_fraction == 0.25
    assert found.within_1_sigma == pytest.approx(2 / 3)
    assert found.within_2_sigma == 1.0
    assert np.isnan(found.edge_mean_abs_error_mm)


def test_masked_pixels_do_not_count_as_failed():
    measured = surface([[1.0, np.nan, np.nan]])
    reason = measured.reason.copy()
    reason[0, 1] = Reason.MASKED
    measured = replace(measured, reason=reason)
    assert errors(measured, np.zeros((1, 3))).failed_fraction == 0.5
    assert measured.failed_fraction == 0.5


def test_edge_band():
    truth = np.zeros((30, 40))
    truth[:, 20:] = 10.0
    band = edge_band(truth, 1.0)
    assert band[:, 15:25].all()
    assert not band[:, :13].any()
    assert not band[:, 27:].any()
    measured = surface(truth + np.where(band, 3.0, 0.5))
    found = errors(measured, truth)
    assert found.edge_mean_abs_error_mm == pytest.approx(3.0)
    assert found.inner_mean_abs_error_mm == pytest.approx(0.5)
    assert not edge_band(np.add.outer(np.arange(9.0), np.arange(9.0)), 1.0).any()


def test_what_cannot_be_evaluated():
    with pytest.raises(InputError, match="expected heights in mm"):
        errors(surface([[1.0]], unit="px"), np.zeros((1, 1)))
    with pytest.raises(InputError, match="truth: expected shape"):
        errors(surface([[1.0]]), np.zeros((2, 1)))
    with pytest.raises(InputError, match="at least one measured pixel"):
        errors(surface([[np.nan]]), np.zeros((1, 1)))


def test_comparison_runs_every_combination():
    seen = []
    rows = compare(
        ["parabola", "plane"],
        ["gsifa", "fourier"],
        gammas=(1.0, 2.2),
        size=100,
        fringes=(5.0,),
        timing=True,
        on_result=lambda row, result: seen.append((row["method"], result.surface.method)),
    )
    assert len(rows) == len(seen) == 8
    assert all(a == b for a, b in seen)
    assert set(rows[0]) >= COLUMNS


def test_options_of_scenes_are_numbers_or_sequences_by_either_name():
    few = {"methods": ["fourier"], "size": 80}
    one = compare(noise=2, bits=8, gamma=1.5, fringes=5, **few)
    other = compare(noises=(2,), bits=(8,), gammas=[1.5], fringes=[5], **few)
    assert str(one) == str(other)  # NaN is unlike itself
    assert [(r["noise"], r["bits"], r["gamma"], r["fringes"]) for r in one] == [(2, 8, 1.5, 5)]
    with pytest.raises(InputError, match=r"noisy: expected an option of scenes \(gammas, noises"):
        compare(noisy=2, **few)
    with pytest.raises(InputError, match="noise: expected either noise or noises, got both"):
        compare(noise=2, noises=[2], **few)
    scene = standard_scene("parabola", size=60, fringes=4)
    for given in (scene, [scene]):
        with pytest.raises(InputError, match="pairs belong to captures"):
            compare(given, ["fourier"])


def test_tables():
    rows = [
        {"object": "a", "mean": 0.123456, "edge": float("nan")},
        {"object": "b|c", "mean": 2.0, "edge": 1.0},
    ]
    assert json.loads(format_table(rows, "json"))[0] == {
        "object": "a",
        "mean": 0.123456,
        "edge": None,
    }
    assert list(csv.DictReader(io.StringIO(format_table(rows, "csv"))))[1]["mean"] == "2.0"
    assert format_table(rows, "markdown").splitlines()[2] == "| a | 0.123 | – |"
    text = format_table(rows).splitlines()
    assert text[0].split() == ["object", "mean", "edge"]
    assert text[1].split() == ["a", "0.123", "–"]
    assert format_table([], "json") == "[]\n"
    rows = [{"name": "a_b", "mean_mm": -0.5, "kept": True}]
    assert format_table(rows, "latex") == (
        "\\begin{tabular}{lrl}\n\\hline\nname & mean mm & kept \\\\\n\\hline\n"
        "a\\_b & $-$0.500 & yes \\\\\n\\hline\n\\end{tabular}\n"
    )


def test_plane_fit():
    y, x = np.mgrid[:30, :40]
    values = 2 + 0.1 * x - 0.3 * y
    values[5, 5] = np.nan
    noise = np.random.default_rng(0).normal(0, 0.05, values.shape)
    fit = fit_plane(values + noise)
    assert fit.rms == pytest.approx(0.05, rel=0.05)
    assert fit.parameters["slope_x"] == pytest.approx(0.1, abs=1e-3)
    with pytest.raises(InputError, match="at least 3"):
        fit_plane(values, np.zeros(values.shape, bool))
    with pytest.raises(InputError, match="where: expected shape"):
        fit_plane(values, np.zeros((2, 2), bool))


def test_cone_fit():
    y, x = np.mgrid[:100, :120].astype(float)
    angle = np.arctan2(y - 48, x - 63)
    r = np.hypot(x - 63, y - 48)
    values = 20 - r * (0.4 + 0.03 * np.cos(angle) - 0.05 * np.sin(2 * angle))
    fit = fit_cone(values, r < 40)
    assert fit.rms < 1e-6
    assert fit.parameters["apex"] == pytest.approx(20)
    assert fit.parameters["x"] == pytest.approx(63, abs=1e-4)
    rounded = np.where(r < 10, 20 - 4.0, values)
    assert fit_cone(rounded, r < 40).rms > 0.1
