"""Fits of planes, spheres and cylinders, and their evaluation in the terms of VDI/VDE 2634."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fringeworks import HeightMap, InputError, _core, fit, reconstruct
from fringeworks.files import (
    read_capture,
    read_reference_plane,
    write_pair,
    write_reference_plane,
    write_surface,
)
from fringeworks.pair import ReferencePlaneGeometry
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.objects import make_object
from fringeworks.simulate.scene import standard_scene
from fringeworks.surface.form import _refine, _start, fit_form, fit_region
from fringeworks.surface.form_geometry import GEOMETRIES
from fringeworks.surface.form_report import find_spheres, report
from fringeworks.surface.height_map import height_map_points
from tests.grids import thinned
from tests.oracles.form import ROWS, distances, moments, refined

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


@pytest.mark.long
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


def test_a_dent_shows_in_the_flatness():
    points = sheet(noise=0.02)
    flat = report(fit_region(points, "plane"))
    dent = np.hypot(*(points[:, :2] - 20.0).T) < 15.6  # 3 % of the plate
    points[dent, 2] += 10.0
    form = fit_region(points, "plane")
    found = report(form)
    assert flat["flatness_error_F_mm"] < 0.2
    assert found["flatness_error_F_mm"] > 9.5
    assert found["discarded_share"] <= 0.003
    assert found["far_share"] == pytest.approx(dent.mean(), abs=0.002)
    notes = fit(points, "plane").figures["notes"]
    assert any("% of the points lie up to 9." in note for note in notes)


def test_a_few_wrong_points_are_discarded_and_stated():
    points = sheet()
    points[:40, 2] += 5.0  # 0.2 %
    found = report(fit_region(points, "plane"))
    assert found["flatness_error_F_mm"] < 0.1
    assert 0 < found["discarded_share"] <= 0.003
    assert found["far_share"] == pytest.approx(0.002)


def test_a_region_that_shows_more_than_the_body_is_refused():
    points = np.concatenate((ball([0, 0, 500], 25.0), sheet(5000)))
    with pytest.raises(InputError, match=r"of one sphere alone, got .* give the region"):
        fit(points, "sphere")
    figures = fit(points, "sphere", within=(0, 0, 500, 26)).figures
    assert figures["bodies"][0]["probing_error_form_PF_mm"] < 0.1


@thinned(strength=1, noise=[0.0, 0.02], body=["sphere", "cylinder"])
def test_a_wall_is_neither_a_sphere_nor_a_cylinder(body, noise):
    with pytest.raises(InputError, match="determine a|expected a "):
        fit_form(sheet(2000, noise), body)


def test_a_small_cap_does_not_determine_a_sphere():
    points = ball([0, 0, 500], 25.0, 400_000)
    near = points[np.hypot(points[:, 0], points[:, 1]) < 1.0]
    with pytest.raises(InputError, match="determine a sphere"):
        fit_form(near, "sphere")


def test_points_on_a_line_determine_no_plane():
    x = RNG.uniform(-80, 80, 2000)
    line = np.column_stack((x, x, 500 + 0 * x)) + 0.01 * RNG.normal(size=(2000, 3))
    with pytest.raises(InputError, match="determine a plane"):
        fit_form(line, "plane")


def test_common_errors_do_not_average():
    """A smooth error of 0.1 mm moves the radius by far more than noise of 0.1 mm would."""
    off = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points = ball([0, 0, 500], 25.0, 3000, noise=0.002, rng=rng)
        u, v = points[:, 0] / 25.0, points[:, 1] / 25.0
        smooth = np.stack((u * u, u * v, v * v, u, v, np.ones_like(u)))
        bend = rng.normal(size=6) @ smooth
        points[:, 2] += 0.1 * bend / np.std(bend)
        form = fit_region(points, "sphere", common_mm=0.1)
        off.append((form.parameters["radius_mm"] - 25.0) / form.sigma_mm)
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 2.0


def test_points_in_px_are_not_called_mm(tmp_path):
    values = np.tile(np.linspace(0.0, 5.0, 40), (30, 1))
    reason = np.zeros(values.shape, np.uint8)
    sigma = np.full(values.shape, 0.1)
    in_px = HeightMap(values, sigma, reason, "displacement", "px", 1.0)
    in_mm = HeightMap(values, sigma, reason, "height", "mm", 0.5)
    for suffix in (".ply", ".tif", ".npz", ".gsf"):
        path = write_read(tmp_path / f"px{suffix}", in_px)
        with pytest.raises(InputError, match="expected points in mm, got displacements in px"):
            fit(path, "plane")
    with pytest.raises(InputError, match="expected points in mm, got displacements in px"):
        fit(in_px, "plane")
    for suffix in (".ply", ".tif", ".npz", ".gsf", ".x3p"):
        path = write_read(tmp_path / f"mm{suffix}", in_mm)
        figures = fit(path, "plane").figures
        assert figures["bodies"][0]["points"] == values.size
        assert figures["bodies"][0]["flatness_error_F_mm"] < 1e-5


def write_read(path, surface):
    write_surface(path, surface)
    return path


def test_points_lie_on_the_rays_of_the_camera(tmp_path):
    """A sphere of 25 mm beside the axis, seen by a camera 500 mm above the plane."""
    pitch, distance, (rows, columns) = 1.0, 500.0, (240, 320)
    y, x = np.mgrid[:rows, :columns].astype(float)
    pupil = (0.5 * (columns - 1), 0.5 * (rows - 1), distance)
    eye = np.array([pupil[0] * pitch, -pupil[1] * pitch, distance])
    ray = np.stack((x * pitch, -y * pitch, 0 * x), axis=-1) - eye
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    to_centre = np.array([60.0, -60.0, 5.0]) - eye
    along = ray @ to_centre
    room = 25.0**2 - (to_centre @ to_centre - along**2)
    depth = along - np.sqrt(np.where(room > 0, room, np.nan))
    values = eye[2] + depth * ray[..., 2]
    reason = np.where(np.isfinite(values), 0, 1).astype(np.uint8)
    sigma = np.where(np.isfinite(values), 0.01, np.nan)
    straight = HeightMap(values, sigma, reason, "height", "mm", pitch)
    seen = replace(straight, pupil=pupil)
    body = fit(seen, "sphere", diameter_mm=50.0).figures["bodies"][0]
    assert abs(body["probing_error_size_PS_mm"]) < 1e-6
    np.testing.assert_allclose(body["centre_mm"], [60, -60, 5], atol=1e-6)
    wrong = fit(straight, "sphere").figures
    assert wrong["bodies"][0]["probing_error_form_PF_mm"] > 0.5
    assert "straight above their pixels" in wrong["notes"][0]
    for suffix in (".tif", ".npz", ".ply"):
        write_surface(tmp_path / f"s{suffix}", seen)
        body = fit(tmp_path / f"s{suffix}", "sphere").figures["bodies"][0]
        assert body["radius_mm"] == pytest.approx(25.0, abs=1e-4)


def test_heights_of_a_pair_know_the_camera():
    geometry = ReferencePlaneGeometry(500.0, 200.0, 0.5)
    result = reconstruct(standard_scene("parabola", size=200, fringes=8), geometry=geometry)
    assert result.surface.pupil == (99.5, 99.5, 500.0)
    assert any("rays through a camera above pixel (99.5, 99.5)" in note for note in result.notes)


def test_cropped_frames_keep_their_points(tmp_path):
    """Points of a cropped pair are those of the whole pair, where the principal point is stated."""
    whole = standard_scene("parabola", size=200, fringes=16)
    geometry = replace(whole.geometry, distance_mm=400.0, baseline_mm=200.0)
    part = (slice(20, 180), slice(60, 200))
    values = make_object("parabola", (200, 200), height_mm=100.0, radius_px=70.0)
    pair = capture_pair(values, geometry, PairSettings(fringes=16))
    cut = replace(
        pair, reference=pair.reference[part], object=pair.object[part], truth_mm=None, geometry=None
    )
    known = replace(geometry, principal_px=(99.5 - 60, 99.5 - 20))
    cropped = reconstruct(cut, "fourier", geometry=known)
    assert cropped.surface.pupil == (39.5, 79.5, 400.0)
    assert not any("not cropped" in note for note in cropped.notes)
    uncut = replace(cropped.surface, pupil=None)
    shift = height_map_points(cropped.surface)[0] - height_map_points(uncut)[0]
    x, y, height = height_map_points(uncut)[0].T
    pitch = geometry.pitch_mm_per_px
    np.testing.assert_allclose(shift[:, 0], (39.5 * pitch - x) * height / 400.0, atol=1e-9)
    np.testing.assert_allclose(shift[:, 1], (-79.5 * pitch - y) * height / 400.0, atol=1e-9)
    write_reference_plane(tmp_path / "g.toml", known)
    assert read_reference_plane(tmp_path / "g.toml") == known
    write_pair(tmp_path / "pair", replace(pair, geometry=known))
    assert read_capture(tmp_path / "pair").geometry == known
    with pytest.raises(InputError, match="principal_px"):
        replace(known, principal_px=(np.nan, 0.0))


def test_a_small_deep_dent_is_noted_even_if_it_is_discarded():
    """VDI/VDE 2634 lets 0.3 % of the points go, but a dent of 10 mm must not go unsaid."""
    rng = np.random.default_rng(0)
    points = np.column_stack((rng.uniform(-80, 80, (40_000, 2)), 0.02 * rng.normal(size=40_000)))
    assert fit(points, "plane").figures["notes"] == []
    dent = np.hypot(points[:, 0] - 20, points[:, 1]) < 4.0
    points[dent, 2] += 10.0
    assert 0 < dent.mean() < 0.003
    (note,) = fit(points, "plane").figures["notes"]
    assert "up to 10" in note
    assert "discarded" in note


def test_lengths_that_are_no_numbers_are_refused():
    points = np.concatenate((ball([-50, 0, 500], 25.0, 2000), ball([50, 5, 510], 25.0, 2000)))
    for length in (np.nan, np.inf, 0.0, -1.0):
        with pytest.raises(InputError, match="spacing: expected > 0 mm"):
            fit(points, "sphere", count=2, spacing_mm=length)
        with pytest.raises(InputError, match="diameter_mm: expected > 0 mm"):
            fit(points, "sphere", count=2, diameter_mm=length)


def test_weights_count():
    points = ball([0, 0, 500], 25.0, noise=0.005)
    noisy = np.arange(len(points)) % 2 == 0
    points[noisy] += 0.2 * RNG.normal(size=(noisy.sum(), 3))
    sigma = np.where(noisy, 0.2, 0.005)
    plain, weighted = fit_form(points, "sphere"), fit_form(points, "sphere", sigma_mm=sigma)
    assert abs(weighted.parameters["radius_mm"] - 25.0) < 1e-3
    assert weighted.sigma_mm < 0.8 * plain.sigma_mm


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("body", ["plane", "sphere", "cylinder"])
def test_fits_are_those_of_least_squares(body, weighted):
    rng = np.random.default_rng(5)
    make = {"plane": sheet, "sphere": partial(ball, [0, 0, 500], 25.0), "cylinder": pipe}[body]
    points = make(n=3000, noise=0.3, rng=rng)
    points = (points - points.mean(axis=0)) / 40.0
    weight = rng.uniform(0.2, 2.0, len(points)) if weighted else np.ones(len(points))
    geometry = GEOMETRIES[body]
    start, _ = _start(points, geometry, rng)
    values, unit = _refine(start, points, weight, np.ones(len(points), bool), geometry)
    twin, twin_unit = refined(body, start, points, weight)
    apart = _core.form_distances(body, values, points) - distances(body, twin, points)
    assert np.abs(apart).max() < 1e-7
    # Lengths and signs of directions are free, so that the values themselves may differ.
    known = geometry.parameters(values, np.zeros(3), 1.0)
    for name, value in geometry.parameters(twin, np.zeros(3), 1.0).items():
        np.testing.assert_allclose(np.abs(known[name]), np.abs(value), atol=1e-6)
    if body != "plane":
        np.testing.assert_allclose(unit[-1, -1], twin_unit[-1, -1], rtol=1e-5)
    at = geometry.direction or slice(0, 3)
    scale = [np.sum(one[at] ** 2) if geometry.direction else 1.0 for one in (values, twin)]
    np.testing.assert_allclose(
        np.trace(unit[at, at]) / scale[0], np.trace(twin_unit[at, at]) / scale[1], rtol=1e-5
    )


@pytest.mark.parametrize("body", ["plane", "sphere", "cylinder"])
def test_derivatives_of_distances_are_exact(body):
    rng = np.random.default_rng(6)
    geometry = GEOMETRIES[body]
    values = rng.normal(size={"plane": 4, "sphere": 4, "cylinder": 7}[body])
    points = rng.normal(size=(50, 3))
    rows = ROWS[body](values, points)
    np.testing.assert_allclose(rows[:, -1], distances(body, values, points), atol=1e-12)
    np.testing.assert_allclose(rows[:, -1], _core.form_distances(body, values, points), atol=1e-7)
    for k in range(values.size):
        step = 1e-6 * np.eye(values.size)[k]
        slope = (
            distances(body, values + step, points) - distances(body, values - step, points)
        ) / 2e-6
        np.testing.assert_allclose(rows[:, k], slope, atol=1e-7)
    for still in geometry.free(values):
        assert np.abs(rows[:, :-1] @ still).max() < 1e-12


@pytest.mark.parametrize("count", [1, 7, 8, 9, 5000])
@pytest.mark.parametrize("body", ["plane", "sphere", "cylinder"])
def test_kernels_agree_with_their_twins(body, count):
    rng = np.random.default_rng(count)
    values = rng.normal(size={"plane": 4, "sphere": 4, "cylinder": 7}[body])
    points, weight = rng.normal(size=(count, 3)), rng.uniform(0.1, 3.0, count)
    away = _core.form_distances(body, values, points)
    np.testing.assert_allclose(away, distances(body, values, points), rtol=0, atol=1e-13)
    sums, expected = (
        _core.form_moments(body, values, points, weight),
        moments(body, values, points, weight),
    )
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(sums - expected) <= 1e-13 * size).all()
    assert np.array_equal(sums, sums.T)


def test_kernels_refuse_what_is_no_body():
    with pytest.raises(ValueError, match="plane, sphere or cylinder"):
        _core.form_distances("cone", np.zeros(4), np.zeros((3, 3)))
    with pytest.raises(ValueError, match="values: expected 7 values"):
        _core.form_distances("cylinder", np.zeros(4), np.zeros((3, 3)))
    with pytest.raises(ValueError, match="points: expected shape"):
        _core.form_distances("plane", np.ones(4), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="weight: expected 3 values"):
        _core.form_moments("plane", np.ones(4), np.zeros((3, 3)), np.ones(2))


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


@pytest.mark.parametrize("body", ["plane", "sphere", "cylinder"])
def test_scores_are_quantiles_of_distances(body):
    rng = np.random.default_rng(21)
    points = rng.normal(size=(301, 3))
    bodies = rng.normal(size=(9, 7 if body == "cylinder" else 4))
    away = [np.abs(distances(body, one, points)) for one in bodies]
    for share in (0.0, 0.1, 0.37, 1.0):
        found = _core.form_scores(body, bodies, points, share)
        np.testing.assert_allclose(found, np.quantile(away, share, axis=1), rtol=1e-9, atol=1e-12)
    assert _core.form_scores(body, bodies[:0], points, 0.1).shape == (0,)
    with pytest.raises(ValueError, match="share"):
        _core.form_scores(body, bodies, points, 1.5)


def test_groups_of_points_are_near_each_other_and_every_such_group_is_as_likely():
    # Three places with 3, 4 and 1 points: the first and second have triples, 1 and 4 of them.
    places = np.repeat([[0.0, 0, 0], [9, 0, 0], [0, 9, 0]], (3, 4, 1), axis=0)
    found = _core.near_groups(places, 3, 40_000, 1.0, 5)
    triples, count = np.unique(np.sort(found, axis=1), axis=0, return_counts=True)
    assert triples.tolist() == [[0, 1, 2], [3, 4, 5], [3, 4, 6], [3, 5, 6], [4, 5, 6]]
    # Of eight random points three, four and one lie at these places.
    share = np.array([3, 1, 1, 1, 1]) / 8
    assert np.abs(count / 40_000 - share).max() < 5 * np.sqrt(0.25 / 40_000)
    # All orders within a group are as likely, also where a group is drawn from a list.
    far = np.concatenate((places, 1000.0 + np.arange(300)[:, None] * [50.0, 0, 0]))
    for points in (places, far):
        found = _core.near_groups(points, 3, 100_000, 1.0, 6)
        first = np.bincount(found[np.sort(found, axis=1)[:, 2] == 2, 0], minlength=3)
        assert np.abs(first / first.sum() - 1 / 3).max() < 0.08
    again = _core.near_groups(places, 3, 100, 1.0, 5)
    assert np.array_equal(again, _core.near_groups(places, 3, 100, 1.0, 5))
    assert _core.near_groups(places, 9, 100, 1e9, 5).shape == (0, 9)
    with pytest.raises(ValueError, match="count"):
        _core.near_groups(places, 0, 100, 1.0, 5)
    with pytest.raises(ValueError, match="groups"):
        _core.near_groups(places, 3, 10**7, 1.0, 5)


def test_spheres_go_through_their_points():
    rng = np.random.default_rng(22)
    points = rng.normal(size=(500, 4, 3))
    points[0] = points[0, 0] + np.outer(rng.normal(size=4), [1.0, 2.0, 3.0])
    found = GEOMETRIES["sphere"].through(points)
    assert 300 < len(found) < 500
    residual = np.abs(
        np.linalg.norm(points[:, None] - found[None, :, None, :3], axis=-1)
        - found[None, :, None, 3]
    ).max(axis=2)
    assert residual.min(axis=0).max() < 1e-8
