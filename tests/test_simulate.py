"""Simulated objects and fringes: shapes, equations, noise, repeatability."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.simulate.fringes import PairSettings, capture_pair, deformed_row
from fringeworks.simulate.objects import OBJECTS, make_object, paint, parabola_1d
from fringeworks.simulate.scene import STANDARD_GEOMETRY, standard_scene
from fringeworks.types import ReferencePlaneGeometry


@pytest.mark.parametrize("name", OBJECTS)
def test_objects_have_their_height(name):
    body = make_object(name, (101, 121), height_mm=20.0, radius_px=40.0)
    assert body.shape == (101, 121)
    expected = {"plane": 0.0, "tilt": None}.get(name, 20.0)
    if expected is not None:
        assert body.max() == pytest.approx(expected)
        assert body.min() == pytest.approx(0.0)


def test_shapes():
    parabola = make_object("parabola", (101, 101), height_mm=10.0, radius_px=40.0)
    assert parabola[50, 70] == pytest.approx(10 * (1 - 0.25))
    cylinder = make_object("cylinder", (101, 101), height_mm=40.0, radius_px=40.0)
    assert cylinder[50, 74] == pytest.approx(32.0)  # 3-4-5
    assert cylinder[80, 50] == pytest.approx(40.0)
    assert cylinder[95, 50] == 0
    sphere = make_object("sphere", (101, 101), height_mm=40.0, radius_px=40.0)
    assert sphere[50, 74] == pytest.approx(32.0)
    assert make_object("step", (4, 11))[0].tolist() == [0.0] * 6 + [100.0] * 5


def test_one_dimensional_parabola():
    h = parabola_1d()
    assert h.size == 1001
    assert h[500] == 100.0
    assert h[250] == h[750] == 0.0
    assert np.nonzero(h)[0][[0, -1]].tolist() == [251, 749]


def test_forward_model():
    geometry = ReferencePlaneGeometry(distance_mm=800.0, baseline_mm=300.0)
    row = deformed_row(parabola_1d(height_mm=100.0), geometry)
    t = np.arange(1001)
    np.testing.assert_allclose(row.reference, 127.5 + 127.5 * np.cos(2 * np.pi * 10 * t / 1001))
    u = 300 * row.height_mm / (800 - row.height_mm)
    np.testing.assert_allclose(
        row.object, 127.5 + 127.5 * np.cos(2 * np.pi * 10 * (t - u) / 1001), atol=1e-9
    )


@pytest.mark.parametrize(
    ("bits", "dtype", "top"),
    [(8, "u1", 255), (10, "u2", 1023), (12, "u2", 4095), (16, "u2", 65535), (0, "f8", 255)],
)
def test_quantisation(bits, dtype, top):
    capture = standard_scene("plane", size=64, bits=bits)
    assert capture.reference.dtype == np.dtype(dtype)
    assert capture.reference.max() == pytest.approx(top)
    assert capture.reference.min() == pytest.approx(0, abs=1)


def test_noise_is_as_stated_and_repeatable():
    settings = {"size": 400, "fringes": 10.0, "noise": 2.0}
    a = standard_scene("plane", seed=5, **settings)
    b = standard_scene("plane", seed=5, **settings)
    c = standard_scene("plane", seed=6, **settings)
    np.testing.assert_array_equal(a.object, b.object)
    assert (a.object != c.object).any()
    clean = standard_scene("plane", size=400, fringes=10.0)
    assert (a.object - clean.object).std() == pytest.approx(2.0, rel=0.02)
    assert (
        abs(
            np.corrcoef((a.object - clean.object).ravel(), (a.reference - clean.reference).ravel())[
                0, 1
            ]
        )
        < 0.01
    )
    shot = standard_scene("plane", size=400, fringes=10.0, gain=0.5, seed=1)
    bright, dark = clean.reference > 230, clean.reference < 25
    noise = shot.reference - clean.reference
    assert noise[bright].var() == pytest.approx(0.5 * clean.reference[bright].mean(), rel=0.1)
    assert noise[dark].var() < 0.1 * noise[bright].var()


def test_response_ambient_albedo_and_axis():
    dim = standard_scene("plane", size=100, gamma=2.2, ambient=0.2)
    assert dim.reference.min() == pytest.approx(51.0)
    body = make_object("plane", (50, 60))
    painted = capture_pair(body, STANDARD_GEOMETRY, PairSettings(fringes=5), albedo=paint((50, 60)))
    assert (painted.object <= painted.reference + 1e-9).all()
    assert (painted.object < 0.8 * painted.reference).any()
    along_y = capture_pair(body, STANDARD_GEOMETRY, PairSettings(fringes=5, axis="y"))
    assert np.ptp(along_y.reference, axis=1).max() == 0
    assert np.ptp(along_y.reference, axis=0).min() > 200


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: make_object("teapot"), "object: expected one of parabola"),
        (lambda: make_object("sphere", height_mm=900.0), "sphere: expected a height"),
        (lambda: PairSettings(bits=9), "bits: expected one of"),
        (lambda: PairSettings(gamma=0.0), "gamma: expected > 0"),
        (lambda: PairSettings(noise=-1.0), "noise: expected >= 0"),
        (lambda: standard_scene("cube", height_mm=5000.0), "below the pupils"),
        (lambda: standard_scene(size=3), "size: expected at least 16"),
        (lambda: capture_pair(np.zeros(5), STANDARD_GEOMETRY), "height: expected shape"),
        (
            lambda: capture_pair(np.zeros((5, 5)), STANDARD_GEOMETRY, albedo=np.ones((2, 2))),
            "albedo: expected shape",
        ),
        (
            lambda: capture_pair(np.zeros((5, 5)), STANDARD_GEOMETRY, albedo=1.5),
            "albedo: expected values",
        ),
        (lambda: paint((5, 5), darkest=0.0), "darkest"),
        (lambda: parabola_1d(3), "n: expected"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InputError, match=message):
        call()
