"""Fits of planes, spheres and cylinders, and their evaluation in the terms of VDI/VDE 2634."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.surface.form import find_spheres, fit_form, report

RNG = np.random.default_rng(0)


def ball(centre, radius, n=20_000, noise=0.01, rng=RNG):
    d = rng.normal(size=(n, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    d = d[d[:, 2] < -0.3]
    return np.asarray(centre) + (radius + noise * rng.normal(size=(len(d), 1))) * d


def sheet(n=20_000, noise=0.01, z=530.0, slope=0.1, rng=RNG):
    x = rng.uniform(-80, 80, (n, 2))
    return np.column_stack(
        (x, z + slope * x[:, 0] + noise * np.hypot(1, slope) * rng.normal(size=n))
    )


def pipe(radius=20.0, n=20_000, noise=0.01, rng=RNG):
    a = rng.uniform(0.3, np.pi - 0.3, n)
    r = radius + noise * rng.normal(size=n)
    return np.column_stack((r * np.cos(a), rng.uniform(-40, 40, n), 500 - r * np.sin(a)))


def test_sphere():
    found = fit_form(ball([5, 3, 500], 25.0), "sphere")
    np.testing.assert_allclose(found.parameters["centre_mm"], [5, 3, 500], atol=2e-3)
    assert found.parameters["radius_mm"] == pytest.approx(25.0, abs=2e-3)
    assert found.deviation_mm == pytest.approx(0.01, rel=0.03)
    assert abs(found.parameters["radius_mm"] - 25.0) < 4 * found.sigma_mm
    assert found.used.all()


def test_sigma_of_a_radius_is_right():
    off = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        found = fit_form(ball([0, 0, 500], 25.0, 3000, rng=rng), "sphere")
        off.append((found.parameters["radius_mm"] - 25.0) / found.sigma_mm)
    assert np.std(off) == pytest.approx(1.0, abs=0.35)


def test_plane_and_its_side():
    found = fit_form(sheet(), "plane")
    normal = np.array(found.parameters["normal"])
    assert normal[2] < 0  # towards the camera
    np.testing.assert_allclose(normal, np.array([0.1, 0, -1]) / np.hypot(0.1, 1), atol=1e-4)
    assert found.sigma_mm is None
    assert found.deviation_mm == pytest.approx(0.01, rel=0.03)


def test_cylinder():
    found = fit_form(pipe(), "cylinder")
    assert found.parameters["radius_mm"] == pytest.approx(20.0, abs=5e-3)
    assert abs(found.parameters["axis"][1]) > 0.99999
    point = np.array(found.parameters["point_mm"])
    np.testing.assert_allclose(point[[0, 2]], [0, 500], atol=0.01)
    assert found.deviation_mm == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("body", ["sphere", "plane"])
def test_a_body_is_found_among_others(body):
    both = np.concatenate((ball([5, 3, 480], 25.0), sheet()))
    found = fit_form(both, body)
    on_sphere = len(both) - 20_000
    on_body = slice(0, on_sphere) if body == "sphere" else slice(on_sphere, None)
    assert found.used[on_body].mean() > 0.999
    assert found.used.mean() < 0.8
    assert found.deviation_mm < 0.02


def test_outliers_do_not_change_the_radius():
    points = ball([0, 0, 500], 25.0)
    points[::20] += RNG.uniform(0.2, 5.0, (len(points[::20]), 1))
    found = fit_form(points, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(25.0, abs=3e-3)


def test_spheres_and_their_spacing():
    points = np.concatenate(
        (ball([-50, 0, 500], 25.0), ball([50, 5, 510], 20.0), sheet(5000, z=560))
    )
    found = find_spheres(points, 2)
    radii = sorted(f.parameters["radius_mm"] for f in found)
    np.testing.assert_allclose(radii, [20, 25], atol=5e-3)
    assert all(f.distance_mm.shape == (len(points),) for f in found)
    with pytest.raises(InputError, match=r"expected (a sphere|3 spheres)"):
        find_spheres(ball([0, 0, 500], 25.0), 3)


def test_report_in_the_terms_of_vdi_2634():
    found = report(fit_form(ball([5, 3, 500], 25.0), "sphere"), diameter_mm=50.01)
    assert found["probing_error_size_PS_mm"] == pytest.approx(-0.01, abs=3e-3)
    # 99.7 % of normal errors span nearly six standard deviations.
    assert found["probing_error_form_PF_mm"] == pytest.approx(0.0594, rel=0.08)
    assert found["range_95_mm"] == pytest.approx(0.0392, rel=0.05)
    flat = report(fit_form(sheet(), "plane"))
    assert flat["flatness_error_F_mm"] == pytest.approx(0.0594, rel=0.08)
    with pytest.raises(InputError, match="diameter"):
        report(fit_form(sheet(), "plane"), diameter_mm=5.0)
    with pytest.raises(InputError, match="diameter"):
        report(fit_form(ball([0, 0, 500], 25.0), "sphere"), diameter_mm=-5.0)


def test_weights_count():
    points = ball([0, 0, 500], 25.0, noise=0.005)
    noisy = np.arange(len(points)) % 2 == 0
    points[noisy] += 0.2 * RNG.normal(size=(noisy.sum(), 3))
    sigma = np.where(noisy, 0.2, 0.005)
    plain, weighted = fit_form(points, "sphere"), fit_form(points, "sphere", sigma_mm=sigma)
    assert abs(weighted.parameters["radius_mm"] - 25.0) < 1e-3
    assert weighted.sigma_mm < 0.8 * plain.sigma_mm


@pytest.mark.parametrize(
    ("points", "body", "message"),
    [
        (np.zeros((5, 3)), "plane", "10 points"),
        (np.full((20, 3), np.nan), "plane", "finite"),
        (np.zeros((20, 2)), "plane", "finite"),
        (np.random.default_rng(1).normal(size=(500, 3)), "cone", "one of plane, sphere"),
        (np.random.default_rng(1).normal(size=(500, 3)), "sphere", "none that a tenth"),
        (np.repeat([[1.0, 2, 3]], 50, axis=0), "sphere", "determine a body"),
    ],
)
def test_invalid_points_are_refused(points, body, message):
    with pytest.raises(InputError, match=message):
        fit_form(points, body)
