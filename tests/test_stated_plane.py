"""Two frames before a plane that is stated: it is compared with the fringes of the reference.

The frames are those of a ray-caster, ``two_frames``, which shares no code with the package.
"""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.pair.plane_evidence import plane_evidence
from fringeworks.pair.prepared import prepare
from fringeworks.rig.stated_plane import StatedPlane
from fringeworks.types import InputError, Pair, Pinhole, Reason, Rig
from tests.grids import thinned
from tests.shared import shared
from tests.two_frames import Bench, box, dome, flat, turn

pytestmark = pytest.mark.statistical

MIDDLE = 1000.0
"""Coordinate of the projector's axis, px; the bench has a bright fringe there."""
PERIOD_MM = 33.0
"""Height of a body that displaces the fringes by one period in the middle of the frame, mm."""


def bench(**options) -> Bench:
    return Bench(shape=(110, 150), period=9.0, **options)


def rig_of(one: Bench) -> Rig:
    """The devices of a bench as a rig in the coordinates of its camera."""
    h, w = one.shape
    T = np.eye(4)
    T[:3, :3] = one.projector.axes @ one.camera.axes.T
    T[:3, 3] = one.projector.axes @ (one.camera.at - one.projector.at)
    camera = Pinhole(w, h, (one.focal, one.focal), one.middle)
    size = round(2 * MIDDLE) + 1
    return Rig(camera, Pinhole(size, size, (one.projector.focal,) * 2, (MIDDLE, MIDDLE)), T)


def stated(one: Bench, tilt=(0.0, 0.0), off=0.0):
    """The plane of a bench, turned about the camera's axes (degrees) and farther away (mm)."""
    n = turn(0, tilt[0]) @ turn(1, tilt[1]) @ np.array([0.0, 0.0, 1.0])
    return (*n, n[2] * one.height + off)


@shared
def taken(kind):
    one = bench()
    return one.pair({"dome": dome(32.0, 5.0), "plate": box(25.0, 26.0), "box": _box()}[kind])


def _box():
    return box(25.0, PERIOD_MM)


def measured(kind, plane, surface, **options):
    """Points of a body, and their errors along the ray over σ where the projector lights it."""
    one = bench()
    reference, object_, _, lit = taken(kind)
    pair = Pair(reference, object_, axis="x")
    found = fw.measure(pair, rig_of(one), plane=plane, method="fourier", **options).points
    yy, xx = np.mgrid[: one.shape[0], : one.shape[1]].astype(float)
    points = one.meet(one.camera, surface, xx, yy)
    truth = np.linalg.norm(points - one.camera.at.reshape(3, 1, 1), axis=0)
    error = np.linalg.norm(found.xyz_mm, axis=-1) - truth
    inner = lit.copy()
    inner[:6] = inner[-6:] = inner[:, :6] = inner[:, -6:] = False
    return found, np.where(inner, error, np.nan)


def within(values, limit):
    """Share of the known values up to a limit."""
    known = np.abs(values[np.isfinite(values)])
    return np.mean(known < limit)


def finding(found, kind):
    return next((f for f in found.findings if f.kind == kind), None)


WRONG = {
    "right": {},
    "tilted along the fringes": {"tilt": (0.5, 0.0)},
    "tilted across": {"tilt": (0.0, 0.5)},
    "1 mm off": {"off": 1.0},
}
KNOWN = {
    "nothing": (),
    "the period": ("period_px",),
    "the pattern": ("period_px", "bright_px"),
}


@thinned(wrong=list(WRONG), known=list(KNOWN), strength=1)
def test_points_are_covered_by_their_sigma(wrong, known):
    one = bench()
    pattern = {"period_px": one.pitch, "bright_px": MIDDLE}
    options = {name: pattern[name] for name in KNOWN[known]}
    surface = dome(32.0, 5.0)
    found, error = measured("dome", stated(one, **WRONG[wrong]), surface, **options)
    z = np.abs(error / found.sigma_mm)
    z = z[np.isfinite(z)]
    assert z.size > 0.6 * error.size
    assert np.mean(z < 2) > 0.93
    assert np.mean(z > 5) < 0.001
    told = finding(found, "reference plane")
    shows = {"nothing": 1, "the period": 2, "the pattern": 3}[known]
    assert (told is not None) == (wrong in list(WRONG)[1 : 1 + shows] or _indirect(wrong, known))
    if told is not None and wrong.startswith("tilted"):
        assert told.figures["tilt_deg"] == pytest.approx(0.5, abs=0.03)
    if known == "the pattern":
        assert np.nanmedian(np.abs(error)) < 0.05
        assert np.median(found.sigma_mm[np.isfinite(error)]) < 0.1
        if wrong == "1 mm off":
            assert told.figures["offset_mm"] == pytest.approx(-1.0, abs=0.03)
    elif known == "nothing":
        assert "do not tell the distance" in finding(found, "plane distance").seen
        assert "a plane that is off by more is not noticed" in finding(found, "plane distance").seen
        shared_part = np.sqrt(found.sigma_mm**2 - found.noise_mm**2)
        assert np.nanmedian(shared_part) == pytest.approx(1.1, abs=0.1)


def _indirect(wrong, known):
    """With the period, the fringes show an offset too, as the tilt that explains them best."""
    return (wrong, known) == ("1 mm off", "the period")


def test_a_stated_sigma_that_the_fringes_contradict_is_replaced():
    one = bench()
    plane = stated(one, tilt=(0.5, 0.0))
    found, error = measured("dome", plane, dome(32.0, 5.0), plane_sigma_mm=0.05)
    assert "contradict the stated plane" in finding(found, "reference plane").seen
    assert within(error / found.sigma_mm, 2.0) > 0.93
    exact, error = measured("dome", stated(one), dome(32.0, 5.0), plane_sigma_mm=0.05)
    assert finding(exact, "reference plane") is None
    assert within(error / exact.sigma_mm, 2.0) > 0.93
    assert np.nanmedian(exact.sigma_mm) < 0.1


def test_the_evidence_has_the_error_that_it_states():
    """Planes of several benches, off by up to 1.5 mm and 0.5°."""
    squares = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        one = bench(seed=seed, roll=rng.uniform(-10, 10), beside=rng.uniform(150, 400))
        frame = one.frame(one.camera, flat, 0.0, seed)
        tilt, off = rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.5, 1.5)
        plane = StatedPlane.of(rig_of(one), stated(one, tilt, off), "x")
        prepared = prepare(Pair(frame, frame, axis="x"))
        found = plane_evidence(prepared, plane, 1.0, period_px=one.pitch, bright_px=MIDDLE)
        pixels = np.stack(np.meshgrid(np.arange(5.0, 150, 12), np.arange(5.0, 110, 12)), -1)
        shapes = plane.shapes(pixels.reshape(-1, 2))
        points = one.meet(one.camera, flat, pixels[..., 0].ravel(), pixels[..., 1].ravel())
        points = one.camera.axes @ (points - one.camera.at[:, None])
        error = shapes @ found.modes_mm - (plane.normal @ points - plane.distance_mm)
        variance = np.einsum("ni,ij,nj->n", shapes, found.covariance, shapes)
        squares.append(np.mean(error**2 / variance))
        assert np.abs(error).max() < 0.05
    assert 0.2 < np.sqrt(np.mean(squares)) < 1.3


@pytest.mark.long
def test_fringes_along_y_give_the_same_points():
    one = bench()
    reference, object_, _, _ = taken("dome")
    rig, (a, b, c, d) = rig_of(one), stated(one, tilt=(0.5, 0.0))
    swap = np.eye(4)[[1, 0, 2, 3]]
    turned = Rig(
        Pinhole(110, 150, rig.camera.focal_px, rig.camera.principal_px[::-1]),
        rig.projector,
        swap @ rig.T_projector_camera @ swap,
    )
    known = {"period_px": one.pitch, "bright_px": MIDDLE, "method": "fourier"}
    x = fw.measure(Pair(reference, object_, axis="x"), rig, plane=(a, b, c, d), **known).points
    y = fw.measure(
        Pair(reference.T.copy(), object_.T.copy(), axis="y"), turned, plane=(b, a, c, d), **known
    ).points
    np.testing.assert_allclose(y.xyz_mm[..., 2].T, x.xyz_mm[..., 2], atol=0.01)
    np.testing.assert_allclose(y.sigma_mm.T, x.sigma_mm, rtol=0.05)


def test_a_body_of_a_period_is_named():
    one = bench()
    found, error = measured("box", stated(one), _box(), plane_sigma_mm=0.05)
    assert within(error, 5.0) < 0.95
    # What contradicts the shadows is removed, and the rest may be off.
    assert finding(found, "shadows").severity == "warning"
    told = finding(found, "whole periods")
    assert told.figures["period_mm"] == pytest.approx(PERIOD_MM, rel=0.2)
    calm, _ = measured("dome", stated(one), dome(32.0, 5.0))
    assert finding(calm, "whole periods").severity == "note"


def test_a_depth_range_tells_the_order():
    one, surface = bench(), box(25.0, 26.0)
    plane = stated(one)
    depth = (one.height - 28.0, one.height + 1.0)
    ranged, error = measured("plate", plane, surface, plane_sigma_mm=0.05, depth_mm=depth)
    assert within(error, 5.0) > 0.95
    assert finding(ranged, "depth range").figures["moved_share"] > 0.03
    nothing, _ = measured("plate", plane, surface, depth_mm=(500.0, 510.0))
    assert np.all(nothing.reason != Reason.OK)
    assert finding(nothing, "depth range").severity == "warning"


@pytest.mark.long
def test_paint_on_the_reference_is_no_shadow():
    one = bench(paint=lambda x, y: np.where((abs(x + 70) < 9) & (abs(y) < 30), 0.08, 1.0))
    reference, object_, _, _ = one.pair(dome(28.0, 4.0))
    pair = Pair(reference, object_, axis="x")
    found = fw.measure(pair, rig_of(one), plane=stated(one), method="fourier").points
    assert finding(found, "whole periods").severity == "note"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bright_px": 3.0}, "bright_px: expected a coordinate in px together with period_px"),
        ({"period_px": 0.0}, "period_px: expected > 0 px"),
        ({"plane_sigma_mm": -1.0}, "plane_sigma_mm: expected >= 0 mm together with a plane"),
        ({"depth_mm": (5.0, 1.0)}, "depth range: expected two depths in mm"),
    ],
)
def test_what_cannot_be_used_is_refused(options, message, monkeypatch):
    monkeypatch.delattr("fringeworks.pipeline.pair_points.reconstructed")
    one = bench()
    frame = np.ones(one.shape, np.uint8)
    with pytest.raises(InputError, match=message):
        fw.measure(Pair(frame, frame), rig_of(one), plane=stated(one), **options)
