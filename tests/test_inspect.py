"""Parts judged by recipes: areas, quantities with their uncertainty, decisions, files."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate import inspect as inspect_module
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.inspect import decide, masked
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.evaluate.shares import Share
from fringeworks.rig.pinhole import rotation
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import Area, PartTolerance, PointCloud, Recipe
from fringeworks.types.recipe import QUANTITIES
from tests.inspected import AREAS, TRUE, measured, points, scene, step

pytestmark = pytest.mark.statistical

SHAPE = (60, 80)


def test_areas_are_pixels():
    box = fw.evaluate.Area(box=(2, 3, 5, 7)).pixels(SHAPE)
    assert box.sum() == 4 * 5
    assert box[3:8, 2:6].all()
    # Pixels whose centre lies inside; corners may lie between pixels, or outside of the frame.
    polygon = fw.evaluate.Area(polygon=((1.5, 2.5), (5.5, 2.5), (5.5, 7.5), (1.5, 7.5))).pixels(
        SHAPE
    )
    np.testing.assert_array_equal(polygon, box)
    triangle = fw.evaluate.Area(polygon=((-10, -10), (200, -10), (-10, 200))).pixels(SHAPE)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    np.testing.assert_array_equal(triangle, x + y < 190)
    ring = ((0, 0), (20, 0), (20, 20), (0, 20), (0, 0), (5, 5), (5, 15), (15, 15), (15, 5), (5, 5))
    assert not fw.evaluate.Area(polygon=ring).pixels(SHAPE)[10, 10]
    mask = y > 20
    np.testing.assert_array_equal(fw.evaluate.Area(mask=mask).pixels(SHAPE), mask)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: fw.evaluate.Area(), "a mask or a face, got none"),
        (
            lambda: fw.evaluate.Area(box=(0, 0, 1, 1), polygon=((0, 0), (1, 0), (1, 1))),
            "box and polygon",
        ),
        (lambda: fw.evaluate.Area(box=(5, 0, 1, 1)), "first column"),
        (lambda: fw.evaluate.Area(polygon=((0, 0), (1, 1))), "3 corners"),
        (lambda: fw.evaluate.Area(box=(100, 0, 120, 9)).pixels(SHAPE), "80 × 60, got none"),
        (lambda: fw.evaluate.Area(mask=np.ones((3, 3), bool)).pixels(SHAPE), "shape"),
    ],
)
def test_areas_that_are_none(make, said):
    with pytest.raises(fw.InputError, match=said):
        make()


@pytest.mark.parametrize("key", TRUE, ids=lambda key: key[0])
def test_quantities_have_their_true_value(key):
    found = measured(points(0), key)
    assert abs(found.value - TRUE[key]) <= 4 * found.sigma
    assert found.sigma < 0.1


def test_every_quantity_is_measured():
    assert set(MEASURED) == set(QUANTITIES)


@pytest.mark.parametrize(
    "key",
    [
        ("step_height", "top", "base"),
        pytest.param(("distance", "top", "base"), marks=pytest.mark.long),
        pytest.param(("sphere_diameter", "ball"), marks=pytest.mark.long),
        pytest.param(("sphere_spacing", "ball", "other"), marks=pytest.mark.long),
        pytest.param(("cylinder_diameter", "tube"), marks=pytest.mark.long),
        pytest.param(("volume", "top", "base"), marks=pytest.mark.long),
    ],
    ids=lambda key: key[0],
)
def test_stated_uncertainty_is_the_scatter(key):
    """Twelve measurements with other noise: their scatter is known to 21 %."""
    found = [measured(points(seed), key) for seed in range(12)]
    scatter = np.std([one.value for one in found], ddof=1)
    assert 0.5 <= scatter / np.mean([one.sigma for one in found]) <= 1.7


def test_flatness_knows_what_noise_adds():
    """A perfect plane under noise: the range that is seen is all noise, and none of the value."""
    found = measured(points(0), ("flatness", "base"))
    assert found.seen > 0.05
    assert found.value < min(0.5 * found.seen, 2.0 * found.sigma)
    bent = points(0)
    xyz = bent.xyz_mm.astype(float)
    xyz[..., 2] += 0.5 * np.cos(0.02 * np.arange(xyz.shape[0]))[:, None]
    bent = replace(bent, xyz_mm=xyz.astype(np.float32))
    found = measured(bent, ("flatness", "base"))
    assert found.value == pytest.approx(1.0, abs=0.12)
    assert abs(found.value - 1.0) < 4.0 * found.sigma + 0.01


def test_errors_in_common_do_not_average_out():
    """Calibration errors: a mean over thousands of pixels is no better than a patch."""
    cloud = points(0)
    common = np.float32(0.05)
    raised = replace(cloud, sigma_mm=np.hypot(cloud.noise_mm, common))
    one, other = (measured(c, ("step_height", "top", "base")).sigma for c in (cloud, raised))
    assert other > 0.4 * common
    assert one < 0.1 * common


def test_heights_over_a_plane_are_judged_as_well():
    found = fw.reconstruct(standard_scene("cube", size=300, bits=8, noise=1.0, seed=2)).surface
    areas = {
        "top": fw.evaluate.Area(box=(130, 130, 170, 170)),
        "base": fw.evaluate.Area(box=(3, 3, 30, 296)),
    }
    one = fw.evaluate.PartTolerance("height", "step_height", ("top", "base"), 99.0, 101.0)
    two = fw.evaluate.PartTolerance("volume", "volume", ("top", "base"), 1.0, None)
    checks = fw.evaluate.judge_part(found, fw.Recipe(areas=areas, tolerances=(one, two)))
    assert abs(checks[0].value - 100.0) <= 2 * checks[0].sigma
    # Rays run through the camera's pupil: what is nearer is smaller.
    area_mm2 = 41 * 41 * (found.pitch * (1 - checks[0].value / 5000.0)) ** 2
    assert checks[1].value == pytest.approx(checks[0].value * area_mm2, rel=0.02)


@pytest.mark.parametrize(
    ("seen", "noise", "low", "high", "expected"),
    [
        (1.0, 0.0, 0.0, 2.0, "pass"),
        (1.9, 0.0, 0.0, 2.0, "undecided"),
        (2.1, 0.0, 0.0, 2.0, "undecided"),
        (2.2, 0.0, 0.0, 2.0, "fail"),
        (-0.2, 0.0, 0.0, 2.0, "fail"),
        (0.1, 0.0, 0.0, None, "undecided"),
        (0.2, 0.0, 0.0, None, "pass"),
        (5.0, 0.0, 0.0, None, "pass"),
        # Noise may have raised the value: it is no proof that the limit is broken.
        (2.5, 1.0, None, 2.0, "undecided"),
        (3.5, 1.0, None, 2.0, "fail"),
        (1.5, 1.0, None, 2.0, "pass"),
    ],
)
def test_decisions_keep_a_guard_band(seen, noise, low, high, expected):
    found = Quantified(seen - noise, (Share("noise", 0.1),), "mm", noise)
    tolerance = fw.evaluate.PartTolerance("t", "flatness", ("a",), low, high)
    assert decide(found, tolerance, 0.05) == expected


def plate(height_mm, sigma_mm, rng):
    """A plate of 60 × 80 px whose left half is raised; noise and an error in common."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    z = 500.0 - height_mm * (x < 40) + rng.normal(0.0, sigma_mm, SHAPE)
    xyz = np.stack((0.5 * (x - 40), 0.5 * (y - 30), z), -1)
    along = np.full(SHAPE, sigma_mm)
    return fw.PointCloud(
        xyz.astype(np.float32),
        along.astype(np.float32),
        along.astype(np.float32),
        np.zeros(SHAPE, np.uint8),
    )


@pytest.mark.parametrize(
    ("risk", "count"),
    [
        (0.2, 40),
        pytest.param(0.05, 1000, marks=pytest.mark.long),
        pytest.param(0.2, 1000, marks=pytest.mark.long),
    ],
)
def test_parts_near_their_limits_are_accepted_within_the_risk(risk, count):
    """Parts whose step breaks a limit by up to two standard deviations, or keeps it by that."""
    rng = np.random.default_rng(5)
    areas = {
        "top": fw.evaluate.Area(box=(2, 2, 37, 57)),
        "base": fw.evaluate.Area(box=(42, 2, 77, 57)),
    }
    limits = fw.evaluate.PartTolerance("step", "step_height", ("top", "base"), 0.9, 1.1)
    recipe = fw.Recipe(areas=areas, tolerances=(limits,), risk=risk)
    sigma = fw.evaluate.judge_part(plate(1.0, 0.05, rng), recipe)[0].sigma
    wrong, decided = {"accepted": [], "refused": []}, 0
    for k in range(count):
        limit = (0.9, 1.1)[k % 2]
        outward = (-1, 1)[k % 2]
        over = rng.uniform(-2.0, 2.0)
        (check,) = fw.evaluate.judge_part(plate(limit + outward * over * sigma, 0.05, rng), recipe)
        decided += check.verdict != "undecided"
        if over > 0:
            wrong["accepted"].append(check.verdict == "pass")
        else:
            wrong["refused"].append(check.verdict == "fail")
    for kind in wrong.values():
        # Three standard deviations of a share of half the parts.
        assert np.mean(kind) <= risk + 3 * np.sqrt(2 * risk / count)
    assert decided > 0.2 * count


def test_too_little_measured_is_undecided():
    cloud = points(0)
    dark = np.where(np.arange(cloud.shape[1]) < 101, np.uint8(fw.Reason.SHADOW), cloud.reason)
    cloud = replace(cloud, reason=dark.astype(np.uint8))
    flat = fw.evaluate.PartTolerance("flat", "flatness", ("base",), None, 1.0)
    share = fw.evaluate.PartTolerance("share", "valid_share", ("base",), 0.9, None)
    checks = fw.evaluate.judge_part(cloud, fw.Recipe(areas=AREAS, tolerances=(flat, share)))
    assert [check.verdict for check in checks] == ["undecided", "undecided"]
    assert "base: " in checks[0].why
    assert np.isnan(checks[1].value)


def test_volumes_need_all_of_their_area():
    cloud = points(0)
    hole = cloud.reason.copy()
    hole[140:150, 170:180] = fw.Reason.SATURATED
    tolerance = fw.evaluate.PartTolerance("v", "volume", ("top", "base"), 1.0, None)
    recipe = fw.Recipe(areas=AREAS, tolerances=(tolerance,))
    (check,) = fw.evaluate.judge_part(replace(cloud, reason=hole), recipe)
    assert check.verdict == "undecided"
    assert "99.0 %" in check.why


def test_only_the_area_is_measured():
    cloud = points(0)
    found = masked(cloud, AREAS["top"])
    inside = AREAS["top"].pixels(cloud.shape)
    assert (found.reason[~inside] == fw.Reason.MASKED).all()
    assert np.isnan(found.xyz_mm[~inside]).all()
    np.testing.assert_array_equal(found.xyz_mm[inside], cloud.xyz_mm[inside])
    assert found.failed_fraction == (cloud.reason[inside] != fw.Reason.OK).mean()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A capture of the scene, its rig, and recipes."""
    made = tmp_path_factory.mktemp("parts")
    rig, plan, view = scene()
    fw.files.write_stack(made / "part", list(photograph(view, plan, Optics(seed=3))), plan)
    fw.files.write_rig(made / "rig.toml", rig)
    fw.files.write_pair(made / "pair", standard_scene("cube", size=200, bits=8, noise=1.0, seed=2))
    return made


@pytest.mark.parametrize(
    ("low", "high", "code"), [(9.9, 10.1, 0), (10.5, 11.0, 3), (None, 11.0, 4)]
)
def test_the_command_says_it_by_its_exit_code(folder, tmp_path, capsys, low, high, code):
    if low is None:
        free = replace(step(0.0, 11.0), rig=folder / "rig.toml")
        low = fw.inspect(folder / "part", free).checks[0].value
    recipe = replace(step(low, high), rig=folder / "rig.toml")
    fw.files.write_recipe(folder / "recipe.toml", recipe)
    assert fw.files.read_recipe(folder / "recipe.toml") == recipe
    figures = tmp_path / "f.json"
    words = ["inspect", str(folder / "part"), "--recipe", str(folder / "recipe.toml")]
    target = tmp_path / "part.ply"
    assert run([*words, "--json", str(figures), "--out", str(target)]) == code
    found = json.loads(figures.read_text())
    assert found["verdict"] == {0: "pass", 3: "fail", 4: "undecided"}[code]
    assert found["checks"][0]["value"] == pytest.approx(10.0, abs=0.01)
    assert len(fw.files.read_points(target).xyz_mm) == found["points"]
    assert "step" in capsys.readouterr().out


def test_a_stack_needs_a_rig(folder):
    with pytest.raises(fw.InputError, match="recipe with a rig"):
        fw.inspect(folder / "part", step(0.0, 1.0))


def test_pairs_are_measured_within_the_area(folder):
    area = fw.evaluate.Area(box=(60, 60, 140, 140))
    flat = fw.evaluate.PartTolerance("flat", "valid_share", ("part",), 0.5, None)
    recipe = fw.Recipe(method="fourier", areas={"part": area}, within="part", tolerances=(flat,))
    found = fw.inspect(folder / "pair", recipe)
    assert found.verdict == "pass"
    assert found.surface.method == "fourier"
    assert (found.surface.reason != fw.Reason.MASKED).sum() == 81 * 81


def test_masks_lie_beside_the_recipe(tmp_path):
    mask = np.zeros(SHAPE, bool)
    mask[10:20, 30:50] = True
    recipe = fw.Recipe(areas={"m": fw.evaluate.Area(mask=mask)}, within="m")
    fw.files.write_recipe(tmp_path / "r.toml", recipe)
    assert fw.files.read_recipe(tmp_path / "r.toml") == recipe


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "recipe"\ncolour = 1', "unknown key colour"),
        ('kind = "recipe"\nrisk = 0.7', "risk"),
        ('kind = "recipe"\nwithin = "x"', "area 'x'"),
        ('kind = "recipe"\nrig = "../rig.toml"', "outside"),
        ('kind = "recipe"\n[areas.a]\nbox = [0, 0, 5]', "areas.a.box"),
        ('kind = "recipe"\n[areas.a]\nbox = [0, 0, 999999999, 5]', "within"),
        ('kind = "recipe"\n[areas.a]\nmask = "/etc/passwd"', "outside"),
        ('kind = "recipe"\n[[tolerances]]\nname = "t"\nquantity = "size"\nareas = ["a"]', "quantity"),
        ('kind = "recipe"\n[areas.a]\nbox=[0,0,5,5]\n[[tolerances]]\nname = "t"\n'
         'quantity = "flatness"\nareas = ["a"]', "smallest or largest"),
        ('kind = "recipe"\n[areas.a]\nbox=[0,0,5,5]\n[[tolerances]]\nname = "t"\n'
         'quantity = "volume"\nareas = ["a"]\nmin = 1', "2 areas"),
        ('kind = "recipe"\n[areas.a]\nbox=[0,0,5,5]\n[[tolerances]]\nname = "t"\n'
         'quantity = "volume"\nareas = ["a", "a"]\nmin = 1', "different areas"),
    ],
)  # fmt: skip
def test_recipes_that_cannot_be_used(tmp_path, text, said):
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(fw.InputError, match=said):
        fw.files.read_recipe(tmp_path / "r.toml")


def test_results_are_converted(tmp_path, capsys):
    fw.write(tmp_path / "a.npz", points(0))
    assert run(["convert", str(tmp_path / "a.npz"), str(tmp_path / "b.ply")]) == 0
    assert len(fw.files.read_points(tmp_path / "b.ply").xyz_mm) == (points(0).reason == 0).sum()
    assert run(["convert", str(tmp_path / "b.ply"), str(tmp_path / "c.npz")]) == 2
    assert "c.npz: expected one of .ply" in capsys.readouterr().err


def calibrated(rig, seed):
    """A rig as a calibration with this one's covariance might have found it."""
    off = np.random.default_rng(seed).multivariate_normal(np.zeros(24), rig.covariance)
    camera, projector = (
        replace(
            device,
            focal_px=tuple(np.add(device.focal_px, part[:2])),
            principal_px=tuple(np.add(device.principal_px, part[2:4])),
            distortion=tuple(np.add(device.distortion, part[4:9])),
        )
        for device, part in ((rig.camera, off[:9]), (rig.projector, off[9:18]))
    )
    moved = rig.T_projector_camera.copy()
    moved[:3, :3] = rotation(off[18:21]) @ moved[:3, :3]
    moved[:3, 3] += off[21:]
    return replace(rig, camera=camera, projector=projector, T_projector_camera=moved)


@cache
def calibration():
    """Covariance of a usual calibration of the rig of the scene, from boards."""
    rig, _, _ = scene()
    sigma = np.array(
        [0.15, 0.15, 0.1, 0.1, 2e-4, 2e-3, 2e-5, 2e-5, 0.0] * 2 + [1e-4] * 3 + [0.05, 0.05, 0.1]
    )
    mixing = np.random.default_rng(1).normal(size=(24, 24))
    correlation = mixing @ mixing.T + 6.0 * np.eye(24)
    scale = sigma / np.sqrt(np.diag(correlation))
    return replace(rig, covariance=scale[:, None] * correlation * scale)


@pytest.mark.parametrize(
    "key",
    [
        pytest.param(("step_height", "top", "base"), marks=pytest.mark.long),
        *(
            pytest.param(key, marks=pytest.mark.long)
            for key in TRUE
            if key[0] not in ("flatness", "step_height")
        ),
    ],
    ids=lambda key: key[0],
)
def test_calibration_errors_move_all_areas_together(key):
    """Forty rigs measure the same frames: the scatter of a quantity is what is stated."""
    _, plan, view = scene()
    rig = calibration()
    frames = list(photograph(view, plan, Optics(noise=0.5, seed=1)))
    decoded = fw.decode(frames, plan)
    quantity, *names = key
    found = []
    for seed in range(40):
        cloud = fw.triangulate(decoded, calibrated(rig, seed), axis="x")
        found.append(MEASURED[quantity](*(area_points(cloud, AREAS[n], rig) for n in names)))
    scatter = np.std([one.value for one in found], ddof=1)
    # Forty values know their standard deviation to 11 %.
    assert 0.7 < scatter / np.median([one.sigma for one in found]) < 1.4


def test_one_rig_errs_alike_everywhere():
    """A baseline that is 1 % too long makes all lengths 1 % too long: nothing averages out."""
    rig, _, _ = scene()
    covariance = np.zeros((24, 24))
    along = rig.T_projector_camera[:3, 3]
    covariance[21:, 21:] = np.outer(along, along) * 1e-4
    cloud = points(0)
    one, other = (
        area_points(cloud, AREAS[n], replace(rig, covariance=covariance)) for n in ("ball", "other")
    )
    found = MEASURED["sphere_spacing"](one, other)
    assert found.sigma == pytest.approx(0.01 * found.value, rel=0.05)


def test_quantities_side_by_side_are_those_one_by_one(monkeypatch):
    rng = np.random.default_rng(8)
    y, x = 0.1 * np.mgrid[:120, :160]
    z = np.where(x < 8.0, 500.0 + 0.01 * x, 495.0) + rng.normal(0.0, 0.005, x.shape)
    cloud = PointCloud(
        xyz_mm=np.stack((x, y, z), axis=-1).astype(np.float32),
        sigma_mm=np.full(x.shape, 0.01, np.float32),
        noise_mm=np.full(x.shape, 0.005, np.float32),
        reason=np.zeros(x.shape, np.uint8),
    )
    areas = {"base": Area(box=(2, 2, 70, 110)), "top": Area(box=(90, 2, 150, 110))}
    names = ("flatness", "parallelism", "step_height", "angle", "volume", "sphere_diameter")
    tolerances = tuple(
        PartTolerance(
            name,
            name,
            ("base",) if name in ("flatness", "sphere_diameter") else ("top", "base"),
            0,
            1,
        )
        for name in names
    )
    recipe = Recipe(areas=areas, tolerances=tolerances)
    found = []
    for cores in (1, 4, 4):
        monkeypatch.setattr(inspect_module.os, "cpu_count", lambda cores=cores: cores)
        found.append([(c.value, c.sigma, c.why) for c in inspect_module.judge_part(cloud, recipe)])
    assert repr(found[0]) == repr(found[1]) == repr(found[2])
    assert "sphere" in found[0][-1][2]  # a plane is none: said once for its area
