"""Geometrical tolerances of ISO 1101: values, uncertainty, datums, recipes and decisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.part_areas import PartAreas
from fringeworks.evaluate.tolerances import skins
from fringeworks.evaluate.tolerances.association import associate
from fringeworks.evaluate.tolerances.bodies import Body, everything, invariant, shared
from fringeworks.evaluate.tolerances.datums import System
from fringeworks.evaluate.tolerances.measure import prepared
from fringeworks.evaluate.tolerances.minimax import BOUND, _by_library, smallest_largest
from fringeworks.evaluate.tolerances.smooth import smooth
from fringeworks.evaluate.tolerances.uncertain import quantified
from fringeworks.rig.pinhole import rotation
from fringeworks.rig.point_errors import point_errors
from fringeworks.simulate.standard import standard_rig
from tests.oracles import tolerances as oracle
from tests.tolerance_bodies import (
    BODIES,
    NOISE_MM,
    PIPE_MM,
    SIDE,
    Case,
    case,
    grid,
    plane,
    profile_case,
    zone,
)

pytestmark = pytest.mark.statistical


def areas_of(recipe, cloud):
    known = {}

    def of_area(name):
        if name not in known:
            known[name] = area_points(cloud, recipe.areas[name])
        return known[name]

    return of_area


def true_value(one):
    """The value of the points without noise, by the package."""
    recipe = one.recipe()
    of_area = areas_of(recipe, one.cloud(np.random.default_rng(0), 0.0))
    value, skins = prepared(one.tolerance, recipe, of_area, of_area)
    return value([np.zeros(len(skin.foot)) for skin in skins])


def found(one, rng):
    recipe = one.recipe()
    of_area = areas_of(recipe, one.cloud(rng))
    return quantified(*prepared(one.tolerance, recipe, of_area, of_area))


def test_the_smallest_largest_value_is_that_of_the_library():
    rng = np.random.default_rng(3)
    for k in (1, 2, 4, 6):
        values, slopes = rng.normal(size=200), rng.normal(size=(200, k))
        both = np.concatenate((values, -values)), np.vstack((slopes, -slopes))
        one, other = smallest_largest(*both), _by_library(*both, np.full(k + 1, BOUND))
        np.testing.assert_allclose(one, other, atol=1e-7)
        half = 0.5 * float(np.abs(one).max())
        size = float(np.abs(values).max())
        bound = np.append(np.full(k, half / size), BOUND)
        near = smallest_largest(*both, within=half)
        assert np.abs(near).max() <= half * (1.0 + 1e-9)
        far = _by_library(both[0] / size, both[1], bound) * size
        np.testing.assert_allclose(near, far, atol=1e-7)


def test_motions_that_leave_bodies_as_they_are():
    rng = np.random.default_rng(1)
    axis = np.array([0.6, 0.0, 0.8])
    pivot = np.array([3.0, -2.0, 1.0])
    bodies = [Body(kind, rng.normal(size=3), axis, 5.0) for kind in ("plane", "cylinder", "sphere")]
    points = 10.0 * rng.normal(size=(50, 3))
    for body, count in zip(bodies, (3, 2, 3), strict=True):
        moves = invariant(body, pivot, 7.0)
        assert moves.shape == (6, count)
        for move in moves.T:
            moved = body.moved(1e-4 * move, pivot, 7.0)
            off = moved.distances(points) - body.distances(points)
            assert np.abs(off).max() < 1e-6
    # Three planes at right angles leave nothing free; a plane and an axis along it a rotation.
    x, y, z = np.eye(3)
    planes = tuple(Body("plane", pivot, n) for n in (x, y, z))
    assert [System(planes[:k]).free(pivot, 1.0).shape[1] for k in range(4)] == [6, 3, 1, 0]
    hole = Body("cylinder", pivot + x, z, 4.0)
    assert System((planes[2], hole)).free(pivot, 1.0).shape[1] == 1
    assert shared(everything(), np.zeros((6, 0))).shape == (6, 0)


@pytest.mark.parametrize("quantity", BODIES)
def test_values_are_those_of_another_solver(quantity, monkeypatch):
    """Brute force on the same noiseless points: within 1 % of the tolerance, which is the value."""

    def unsmoothed(*args, **options):
        return replace(smooth(*args, **options), resolved=False)

    monkeypatch.setattr(skins, "smooth", unsmoothed)  # all points count as they are
    monkeypatch.setattr(skins, "DISCARDED", 0.0)
    for seed in (0, 1):
        one = case(quantity, np.random.default_rng([seed, 77]))
        xyz = one.cloud(np.random.default_rng(0), 0.0).xyz_mm.astype(float)
        seen = dict(zip(one.points, np.split(xyz, len(one.points), axis=1), strict=True))
        expected = oracle.value(replace(one, points=seen))
        assert true_value(one) == pytest.approx(expected, rel=0.01), seed


@pytest.mark.parametrize("quantity", BODIES)
def test_noise_is_taken_out_within_sigma(quantity):
    for seed in (5, 6):
        rng = np.random.default_rng([seed, 11])
        one = case(quantity, rng)
        measured = found(one, rng)
        assert abs(measured.value - true_value(one)) < 4.0 * measured.sigma
        assert measured.seen >= measured.value >= 0.0
        assert 0.05 * NOISE_MM < measured.sigma < 20.0 * NOISE_MM


@pytest.mark.long
@pytest.mark.parametrize("quantity", BODIES)
def test_sigma_covers_noise(quantity):
    """Bodies with random form and noise. 60 of them know a share to 6 %."""
    over = []
    for seed in range(60):
        rng = np.random.default_rng([seed, BODIES.index(quantity)])
        one = case(quantity, rng)
        measured = found(one, rng)
        over.append(abs(measured.value - true_value(one)) / measured.sigma)
    assert np.mean(np.array(over) < 1.0) > 0.5
    assert np.mean(np.array(over) < 2.0) > 0.85


@pytest.mark.parametrize(
    "quantity",
    ["iso_flatness", "iso_perpendicularity", pytest.param("iso_position", marks=pytest.mark.long)],
)
def test_sigma_covers_the_calibration(quantity):
    """Ten rigs of one covariance, almost without noise: the feature and its datums move together."""
    rng = np.random.default_rng([3, 5])
    one = case(quantity, rng)
    rig = standard_rig(scale=0.3)
    sigma = np.array(
        [0.15, 0.15, 0.1, 0.1, 2e-4, 2e-3, 2e-5, 2e-5, 0.0] * 2 + [1e-4] * 3 + [0.05, 0.05, 0.1]
    )
    rig = replace(rig, covariance=np.diag((10.0 * sigma) ** 2))
    recipe, true = one.recipe(), true_value(one)
    over = []
    for _ in range(10):
        cloud = one.cloud(rng, 1e-4)
        xyz = cloud.xyz_mm.astype(float)
        errors = point_errors(rig, xyz.reshape(-1, 3), cloud)
        moved = xyz + (errors @ rng.normal(size=errors.shape[2])).reshape(xyz.shape)
        cloud = replace(cloud, xyz_mm=moved.astype(np.float32))
        areas = {name: area_points(cloud, area, rig) for name, area in recipe.areas.items()}
        measured = quantified(*prepared(one.tolerance, recipe, areas.get, areas.get))
        over.append((measured.value - true) / measured.sigma)
    # Ten values know their scatter to 22 %.
    assert 0.4 < np.sqrt(np.mean(np.square(over))) < 1.7


def test_smooth_surfaces_keep_form_and_lose_noise():
    rng = np.random.default_rng(2)
    places = rng.uniform(size=(3000, 2))
    true = 0.1 * np.sin(5.0 * places[:, 0]) * np.cos(3.0 * places[:, 1])
    noise = np.full(3000, 0.02)
    fitted = smooth(places, true + noise * rng.normal(size=3000), noise**2, stated=True)
    assert fitted.resolved
    error = fitted.at(places) - true
    draws = np.array([fitted.likely.draw(rng).likely[0] for _ in range(100)])
    stated = np.std(draws @ fitted.design(places).T, axis=0)
    assert np.std(error) < 0.006
    assert np.sqrt(np.mean((error / stated) ** 2)) == pytest.approx(1.0, abs=0.35)
    step = np.where(places[:, 0] > 0.5, 0.5, 0.0)
    order = np.lexsort((places[:, 0], (30 * places[:, 1]).astype(int)))
    edged = smooth(
        places[order], step[order] + noise * rng.normal(size=3000), noise**2, stated=True
    )
    assert not edged.resolved


def test_associations_differ_as_the_standard_says():
    turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    radius = 10.0 + 0.1 * np.cos(3.0 * turn)
    z = np.tile(np.linspace(-5.0, 5.0, 8), 50)
    points = np.column_stack((radius * np.cos(turn), radius * np.sin(turn), z))
    start = Body("cylinder", np.zeros(3), np.array([0.0, 0.0, 1.0]), 10.0)
    fitted = {
        by: associate(start, points, everything(), by)
        for by in ("minimum-zone", "least-squares", "circumscribed", "inscribed", "outside")
    }
    radii = {by: body.radius for by, body in fitted.items()}
    assert radii["circumscribed"] == pytest.approx(10.1, abs=2e-3)
    assert radii["inscribed"] == pytest.approx(9.9, abs=2e-3)
    assert radii["minimum-zone"] == pytest.approx(10.0, abs=2e-3)
    assert radii["outside"] == pytest.approx(10.1, abs=2e-3)
    half = points[turn < 2.5]
    with pytest.raises(fw.InputError, match="more than half"):
        associate(start, half, everything(), "inscribed")


def test_parts_near_their_limit_pass_within_the_risk():
    """Flatness: parts that break their limit by up to two standard deviations."""
    accepted, count = 0, 20
    for seed in range(count):
        rng = np.random.default_rng([seed, 123])
        one = case("iso_flatness", rng, 0.08)
        sigma = 0.004
        limit = true_value(one) - sigma * rng.uniform(0.0, 2.0)
        judged = replace(one, tolerance=replace(one.tolerance, high=limit))
        (check,) = fw.evaluate.judge_part(judged.cloud(rng), judged.recipe())
        accepted += check.verdict == "pass"
    assert accepted / count <= 0.05 + 3.0 * np.sqrt(0.05 / count)


def test_a_profile_of_a_plane_is_its_flatness():
    """Without datums the model may move to fit best; held by its pose it may not."""
    rng = np.random.default_rng(8)
    corners = np.array([[-60.0, -60, 500], [60, -60, 500], [-60, 60, 500], [60, 60, 500]])
    mesh = fw.TriangleMesh(corners, np.array([[0, 2, 1], [1, 2, 3]], np.uint32))
    model = fw.evaluate.PartModel(mesh, fw.evaluate.KnownPose(np.eye(4)), 2.0)
    points = {"part": plane(rng, 0.1, tilt=0.003)}
    lines = {"direction": (1.0, 0.0, 0.0)}
    cases = [
        Case(zone(quantity, **options), points, {}, model)
        for quantity, options in (
            ("iso_flatness", {}),
            ("iso_surface_profile", {}),
            ("iso_surface_profile", {"located": True}),
            ("iso_straightness", lines),
            ("iso_line_profile", lines),
        )
    ]
    cloud = cases[0].cloud(rng)
    flat, free, held, straight, line = (
        fw.evaluate.judge_part(cloud, one.recipe())[0] for one in cases
    )
    assert flat.verdict == "pass", flat.why
    assert free.value == pytest.approx(flat.value, abs=2 * flat.sigma)
    assert line.value == pytest.approx(straight.value, abs=2 * straight.sigma)
    n = np.array([0.0, 0.0, 1.0])
    off = 2.0 * np.abs((points["part"] - corners[0]) @ n).max()
    assert abs(held.value - off) < 3.0 * held.sigma
    assert held.value > free.value


def test_a_stated_direction_is_that_of_the_zone():
    """The direction that is found at right angles to the datums, and one that contradicts them."""
    one = case("iso_perpendicularity_system", np.random.default_rng([3, 41]))
    z = one.tolerance.zone
    free = true_value(one)
    stated = replace(z, direction=(0.0, 1.0, 0.0))
    same = replace(one, tolerance=replace(one.tolerance, zone=stated))
    assert true_value(same) == pytest.approx(free, rel=1e-9)
    wrong = replace(z, direction=(0.0, 1.0, 0.2))
    with pytest.raises(fw.InputError, match="expected 90.0° to the first datum"):
        true_value(replace(one, tolerance=replace(one.tolerance, zone=wrong)))
    aside = replace(z, direction=(1.0, 1.0, 0.0))
    with pytest.raises(fw.InputError, match="within 10.0° of its exact direction"):
        true_value(replace(one, tolerance=replace(one.tolerance, zone=aside)))


def test_two_holes_lock_the_turn_about_them():
    x, _, z = np.eye(3)
    plate = Body("plane", np.zeros(3), z)
    holes = tuple(Body("cylinder", k * 30.0 * x, z, 4.0) for k in range(2))
    assert not System((plate, holes[0])).locked
    assert System((plate, *holes)).locked
    turns = System((plate, *holes)).free_turns(np.zeros(3), 1.0)[:3]
    assert np.abs(turns).max() < 1e-9


@pytest.mark.parametrize("seed", [0, 1])
def test_profiles_are_those_of_another_solver(seed, monkeypatch):
    """A pipe and its triangles, against the analytic pipe: within 1 % of the value."""

    def unsmoothed(*args, **options):
        return replace(smooth(*args, **options), resolved=False)

    monkeypatch.setattr(skins, "smooth", unsmoothed)
    monkeypatch.setattr(skins, "DISCARDED", 0.0)
    monkeypatch.setattr(skins, "LINES", SIDE)  # the same lines as those of the pixels
    cases = [
        profile_case(quantity, np.random.default_rng([seed, 55]), **options)
        for quantity, options in (
            ("iso_surface_profile", {"located": True}),
            ("iso_surface_profile", {}),
            ("iso_line_profile", {"direction": (0.0, 1.0, 0.0)}),
        )
    ]
    cloud = cases[0].cloud(np.random.default_rng(0), 0.0)
    seen = {"part": cloud.xyz_mm.astype(float)}
    expected = (
        oracle.surface_profile(seen, PIPE_MM, located=True),
        oracle.surface_profile(seen, PIPE_MM, located=False),
        oracle.line_profile(seen, PIPE_MM),
    )
    for one, value in zip(cases, expected, strict=True):
        assert profile_of(one, cloud) == pytest.approx(value, rel=0.01), one.tolerance.quantity
    assert expected[0] > expected[1]


def trough(turn_deg=0.25, half_mm=34.0):
    """The trough z = 500 + x²/60 as triangles."""
    x = 30.0 * np.tan(np.radians(np.arange(-48.0, 48.01, turn_deg)))
    x, y = (one.ravel() for one in np.meshgrid(x, [-half_mm, half_mm], indexing="ij"))
    k = 2 * np.arange(len(x) // 2 - 1)
    faces = np.concatenate((np.stack((k, k + 1, k + 2), -1), np.stack((k + 1, k + 3, k + 2), -1)))
    mesh = fw.TriangleMesh(np.column_stack((x, y, 500.0 + x**2 / 60.0)), faces.astype(np.uint32))
    return fw.evaluate.PartModel(mesh, fw.evaluate.KnownPose(np.eye(4)), 2.0)


@pytest.mark.parametrize("quantity", ["iso_surface_profile", "iso_line_profile"])
def test_a_profile_without_datums_slides_along_its_model(quantity):
    """A trough that lies 2 mm along its own curve is a perfect trough elsewhere on it."""
    u, v = grid()
    x = 12.0 * u + 6.0
    lying = np.stack((x, 12.0 * v, x**2 / 60.0), axis=-1)
    # The tangent at x = 6 becomes level there, and the points move so that both curves touch.
    slope = 6.0 / 30.0
    turned_by = rotation(np.array([0.0, np.arctan(slope), 0.0]))
    moved = (lying - [6.0, 0.0, 0.6]) @ turned_by.T + [0.0, 0.0, 500.0]
    options = {} if quantity == "iso_surface_profile" else {"direction": (1.0, 0.0, 0.0)}
    one = Case(zone(quantity, **options), {"part": moved}, {}, trough())
    held = Case(zone("iso_surface_profile", located=True), {"part": moved}, {}, trough())
    cloud = one.cloud(np.random.default_rng(0), 0.0)
    assert profile_of(held, cloud) > 0.03
    # Facets of 0.25° lie 0.1 to 0.3 µm inside.
    assert profile_of(one, cloud) < 0.002


def profile_of(one, cloud):
    part = PartAreas(cloud, one.recipe(), None)
    value, surfaces = prepared(one.tolerance, one.recipe(), part.of_area, part.of_model)
    return value([np.zeros(len(surface.foot)) for surface in surfaces])


def test_profiles_hold_their_sigma():
    """Four pipes under noise, three profiles each."""
    over = []
    for seed in range(4):
        for quantity, options in (
            ("iso_surface_profile", {"located": True}),
            ("iso_surface_profile", {}),
            ("iso_line_profile", {"direction": (0.0, 1.0, 0.0)}),
        ):
            rng = np.random.default_rng([seed, 56])
            one = profile_case(quantity, rng, **options)
            true = profile_of(one, one.cloud(rng, 0.0))
            found = PartAreas(one.cloud(rng), one.recipe(), None).measure(one.tolerance)
            over.append((found.value - true) / found.sigma)
    assert np.abs(over).max() < 4.0
    # Twelve values, of three that share their noise each, know their scatter to 30 %.
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.7


def test_recipes_keep_datums_and_zones(tmp_path):
    one = case("iso_position", np.random.default_rng(0))
    recipe = one.recipe()
    fw.files.write_recipe(tmp_path / "r.toml", recipe)
    assert fw.files.read_recipe(tmp_path / "r.toml") == recipe


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: zone("iso_position", body="sphere"), "expected datums"),
        (lambda: zone("iso_flatness", datums=("A",)), "expected no datums"),
        (lambda: zone("iso_angularity", datums=("A",)), "an angle"),
        (lambda: zone("iso_flatness", angle_deg=30.0), "an angle"),
        (lambda: zone("iso_roundness"), "a cylinder for iso_roundness"),
        (lambda: zone("flatness", body="sphere"), "no datums or zone"),
        (lambda: zone("iso_flatness", body="cone"), "one of plane"),
        (lambda: zone("iso_position", datums=("A", "A")), "different"),
        (lambda: zone("iso_position", datums=("A",), direction=(0, 0, 0)), "length 0"),
        (lambda: zone("iso_position", datums=("A",), at_mm=(0, 0, np.nan)), "finite"),
        (lambda: fw.evaluate.Datum(()), "an area"),
        (lambda: fw.evaluate.Datum(("a",), "median"), "two areas"),
        (lambda: fw.evaluate.Datum(("a",), association="good"), "one of minimum-zone"),
    ],
)
def test_zones_that_are_none(make, said):
    with pytest.raises(fw.InputError, match=said):
        make()


def test_datums_that_a_recipe_lacks():
    one = case("iso_parallelism", np.random.default_rng(0))
    with pytest.raises(fw.InputError, match="datum 'A'"):
        replace(one.recipe(), datums={})


def test_datums_at_odd_angles_are_undecided():
    rng = np.random.default_rng(4)
    one = case("iso_position", rng)
    odd = {**one.points, "b": plane(rng, 0.0, (60.0, 0.0, 500.0), (0.3, 0.0, -1.0))}
    odd["a"] = plane(rng, 0.0, (-60.0, 0.0, 500.0))
    wrong = replace(one, points=odd)
    (check,) = fw.evaluate.judge_part(wrong.cloud(rng), wrong.recipe())
    assert check.verdict == "undecided"
    assert "0° or 90°" in check.why
