"""Painted objects: the albedo with sharp edges, and what two frames measure with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks import _core
from fringeworks.pair.methods.window_start import start_field
from fringeworks.pair.prepared import prepare
from fringeworks.pair.windows import Windows
from tests.oracles import albedo as oracle

pytestmark = pytest.mark.statistical

CAMERA = {"gamma": 2.2, "noise": 2.0, "bits": 8, "size": 500, "fringes": 10, "height_mm": 25.0}


def error(scene, **options):
    """Mean error of the heights, mm, and the analysis."""
    found = fw.reconstruct(scene, "windowed", **options)
    return np.nanmean(np.abs(found.surface.values - scene.truth_mm)), found.displacement


def stripes(shape, seed):
    """Hard edges of paint: a stripe and a disc, slightly blurred by a lens."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / shape[0]
    angle, (cx, cy) = rng.uniform(0, np.pi), rng.uniform(0.35, 0.65, 2)
    albedo = np.ones(shape)
    albedo[np.abs((x - 0.5) * np.cos(angle) + (y - 0.5) * np.sin(angle)) < 0.06] = 0.6
    albedo[np.hypot(x - cx, y - cy) < 0.12] *= 0.7
    return ndimage.gaussian_filter(albedo, 0.7)


@pytest.mark.parametrize("iterations", [(15,), (12, 9), (9, 7, 8)])
def test_the_kernel_agrees_with_its_oracle(iterations):
    rng = np.random.default_rng(0)
    shape = (37, 45)
    x = np.arange(shape[1])
    f = 1.5 + np.cos(2 * np.pi * x / 12) + 0 * rng.normal(size=shape)
    q = -np.sin(2 * np.pi * x / 12) + 0.1 * rng.normal(size=shape)
    d = np.where(x > 20, 0.6, 1.0) * f + 0.03 * rng.normal(size=shape)
    f[5:9, 30:34] = q[5:9, 30:34] = d[5:9, 30:34] = 0
    weight = rng.uniform(0.02, 0.2, shape)
    cliff = (rng.random(shape) < 0.02).astype(np.uint8)
    maps = [v.astype(np.float32) for v in (f, q, d, weight)]
    model = dict(zip(("value", "slope", "object", "edge_weight"), maps, strict=True))
    settings = {"stiffness": 0.8, "huber": 0.01, "iterations": list(iterations)}
    found = _core.joint_albedo({**model, "cliff": cliff}, **settings)
    expected = oracle.solve(*[v.astype(float) for v in maps], cliff, 0.8, 0.01, iterations)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-5)


def test_the_kernel_refuses_what_does_not_fit():
    one = np.ones((20, 30), np.float32)
    model = dict.fromkeys(("value", "slope", "object", "edge_weight"), one)
    model["cliff"] = np.zeros(one.shape, np.uint8)
    settings = {"stiffness": 1.0, "huber": 0.0, "iterations": [1]}
    with pytest.raises(ValueError, match=r"slope: expected shape \(20, 30\), got \(5, 30\)"):
        _core.joint_albedo({**model, "slope": one[:5]}, **settings)
    with pytest.raises(ValueError, match="iterations: expected one level"):
        _core.joint_albedo(model, **{**settings, "iterations": [1] * 9})
    with pytest.raises(ValueError, match="stiffness"):
        _core.joint_albedo(model, **{**settings, "stiffness": 0.0})


def test_windows_divide_by_a_known_albedo():
    scene = fw.simulate.standard_scene("parabola", **{**CAMERA, "size": 200, "fringes": 8}, seed=1)
    windows = Windows.of(prepare(scene)).above_dark()
    start = start_field(prepare(scene), 12.0).displacement_px
    plain = windows.fit(start, [16.0, 8.0, 4.0])
    half = windows.fit(start, [16.0, 8.0, 4.0], albedo=np.full(start.shape, 0.5, np.float32))
    same = plain.scale == half.scale
    assert same.mean() > 0.99
    kept = same & np.isfinite(plain.displacement_px)
    # The prior of the first windows expects the same gain, so that the two differ a little.
    difference = (plain.displacement_px - half.displacement_px)[kept]
    assert (np.abs(difference) < 0.5 * plain.sigma_px[kept]).all()
    np.testing.assert_allclose(
        0.5 * half.modulation_ratio[kept], plain.modulation_ratio[kept], rtol=0.01
    )
    with pytest.raises(ValueError, match="albedo: expected finite values above 0"):
        windows.fit(start, [8.0], albedo=np.zeros(start.shape, np.float32))


@pytest.mark.parametrize(
    ("fringes", "seed"), [(10, 1), pytest.param(20, 2, marks=pytest.mark.long)]
)
def test_hard_paint_leaves_no_marks(fringes, seed):
    scene = fw.simulate.standard_scene(
        "parabola", **{**CAMERA, "fringes": fringes}, painted=True, seed=seed
    )
    before, _ = error(scene, paint=False)
    after, found = error(scene)
    assert found.details["painted"]
    assert after < 0.4 * before
    assert np.mean(found.reason != fw.Reason.OK) <= 0.006
    truth = fw.pair.displacement_from_height(scene.truth_mm, scene.geometry)
    rim = int(found.period_px)
    z = (np.abs(found.displacement_px - truth) / found.sigma_px)[rim:-rim, rim:-rim]
    assert np.nanmean(z < 1) > 0.55
    assert np.nanmean(z < 2) > 0.9


def test_the_albedo_is_that_of_the_paint():
    scene = fw.simulate.standard_scene("parabola", **CAMERA, seed=3)
    albedo = stripes(scene.object.shape, 4)
    painted = np.clip(np.rint(scene.object * albedo), 0, 255).astype(np.uint8)
    found = fw.analyse(replace(scene, object=painted), "windowed").albedo
    inner = ndimage.maximum_filter(ndimage.morphological_gradient(albedo, 3), 5) < 0.02
    difference = (found / albedo)[inner]
    assert np.median(np.abs(difference - 1)) < 0.01
    assert np.quantile(np.abs(difference - 1), 0.95) < 0.04


@pytest.mark.parametrize("body", ["parabola", "sphere"])
def test_smooth_unpainted_objects_are_measured_as_before(body):
    scene = fw.simulate.standard_scene(body, **CAMERA, seed=1)
    before, found = error(scene, paint=False), error(scene)
    assert not found[1].details["painted"]
    np.testing.assert_array_equal(found[1].displacement_px, before[1].displacement_px)


@pytest.mark.parametrize("body", ["cylinder", pytest.param("cube", marks=pytest.mark.long)])
def test_cliffs_are_not_taken_for_paint(body):
    scene = fw.simulate.standard_scene(body, **CAMERA, seed=1)
    assert error(scene)[0] < 1.02 * error(scene, paint=False)[0]


@pytest.mark.parametrize(
    "light", [pytest.param({"ambient": 0.3, "contrast": 0.6}, marks=pytest.mark.long), {"jpeg": 75}]
)
def test_paint_in_other_light(light):
    scene = fw.simulate.standard_scene("parabola", **CAMERA, painted=True, seed=2, **light)
    assert error(scene)[0] < 0.6 * error(scene, paint=False)[0]


def test_an_object_in_its_own_light_is_painted_too():
    """Offset and gain do not belong together: the camera's black level, a lamp on the object."""
    scene = fw.simulate.standard_scene("parabola", **CAMERA, seed=2)
    albedo = stripes(scene.object.shape, 5)
    lit = 12 + albedo * (0.7 * scene.object.astype(float) + 25)
    painted = replace(scene, object=np.clip(np.rint(lit), 0, 255).astype(np.uint8))
    assert error(painted)[0] < 0.5 * error(painted, paint=False)[0]


def photographs(real_data, name):
    folder = real_data / name
    return fw.files.read_pair(folder / "reference.jpg", folder / "object.jpg")


@pytest.fixture(scope="module")
def plain_cone(real_data):
    """Displacements of the cone without paint."""
    pair = photographs(real_data, "pair_cone")
    return fw.analyse(pair, "windowed", paint=False).displacement_px


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.long) for k in (2, 3))])
def test_paint_on_a_photographed_cone(real_data, plain_cone, seed):
    pair, plain = photographs(real_data, "pair_cone"), plain_cone
    albedo = stripes(pair.object.shape, seed)
    painted = replace(pair, object=np.rint(pair.object * albedo).astype(np.uint8))
    edges = ndimage.morphological_gradient(albedo, 3) > 0.1
    near = ndimage.maximum_filter(edges, 15)
    marks = [
        np.nanmean(np.abs(fw.analyse(painted, "windowed", paint=p).displacement_px - plain)[near])
        for p in (False, True)
    ]
    assert marks[1] < 0.5 * marks[0]


@pytest.mark.long
def test_creases_of_a_photographed_pyramid_stay_sharp(real_data):
    """Each face reflects its own share of the light: there is an edge of albedo on every crease."""
    pair = photographs(real_data, "pair_pyramid")
    y, x = np.mgrid[: pair.object.shape[0], : pair.object.shape[1]]

    def plane(u, where):
        inside = np.zeros(u.shape, bool)
        inside[where] = True
        inside &= np.isfinite(u)
        terms = np.stack([x, y, np.ones_like(x)], axis=-1).astype(float)
        return terms @ np.linalg.lstsq(terms[inside], u[inside].astype(float), rcond=None)[0]

    errors = []
    for paint in (False, True):
        found = fw.analyse(pair, "windowed", paint=paint)
        u = found.displacement_px
        top, right = plane(u, np.s_[60:100, 210:290]), plane(u, np.s_[140:230, 330:370])
        crease = (np.abs(top - right) < 6)[60:150, 270:370]
        errors.append(np.abs(u - np.minimum(top, right))[60:150, 270:370][crease].mean())
    assert errors[1] < 1.02 * errors[0]
