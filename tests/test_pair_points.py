"""Two frames on a calibrated rig: points over a plane that was decoded once, or is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

import fringeworks as fw
from fringeworks.pipeline.pair_points import measure_pair
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.plane_coordinates import surface_coordinates
from fringeworks.rig.stated_plane import StatedPlane
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.rig_pair import photograph_pair
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig, truth_distance
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import InputError
from tests.commands import run
from tests.grids import quick
from tests.shared import shared

pytestmark = pytest.mark.statistical

RIG = standard_rig(scale=0.35)
WALL_MM = 560.0
PERIOD = 16.0


def at(x, y, z, turn=(0.0, 0.0, 0.0)):
    return pose(rotation(np.array(turn)), np.array([x, y, z], float))


WALL = Body(Plane(), at(0, 0, WALL_MM), 0.75)
SCENES = {
    "plane": [Body(Plane(), at(0, 0, WALL_MM - 3, (0.004, -0.004, 0)), 0.75)],
    "sphere": [Body(Sphere(60.0), at(0, 0, WALL_MM + 40), 0.75), WALL],
    "bust": bust(),
}


@shared
def view(name):
    return look(RIG, [WALL] if name == "wall" else SCENES[name])


@shared
def decoded(name, seed=1):
    plan = fringe_plan(RIG, both=False)
    return fw.decode(list(photograph(view(name), plan, Optics(seed=seed))), plan)


@shared
def pair(name):
    return photograph_pair(view("wall"), view(name), PERIOD, Optics(seed=3))


def far_from_cliffs(name):
    depth = np.nan_to_num(view(name).points_mm[..., 2])
    cliff = ndimage.maximum_filter(depth, 5) - ndimage.minimum_filter(depth, 5) > 3
    return ~ndimage.maximum_filter(cliff, 41) & view(name).lit


def test_the_plane_is_predicted_as_the_camera_sees_it():
    found = surface_coordinates(StatedPlane.of(RIG, (0, 0, 2, 2 * WALL_MM), "x"))
    truth = np.where(view("wall").lit, view("wall").projector_px[..., 0], np.nan)
    both = np.isfinite(truth) & np.isfinite(found.coordinate_px)
    assert both.mean() > 0.9
    np.testing.assert_allclose(found.coordinate_px[both], truth[both], atol=1e-9)
    with pytest.raises(InputError, match="plane: expected four numbers"):
        surface_coordinates(StatedPlane.of(RIG, (0, 0, 1), "x"))
    with pytest.raises(InputError, match="camera and projector see"):
        surface_coordinates(StatedPlane.of(RIG, (0, 0, 1, -500), "x"))


@pytest.mark.parametrize(
    ("known", "name"),
    [
        ("decoded", "sphere"),
        pytest.param("plane", "plane", marks=pytest.mark.long),
        pytest.param("decoded", "plane", marks=pytest.mark.long),
        pytest.param("plane", "sphere", marks=pytest.mark.long),
        pytest.param("decoded", "bust", marks=pytest.mark.long),
        pytest.param("plane", "bust", marks=pytest.mark.long),
    ],
)
def test_points_of_two_frames(name, known):
    given = (
        {"reference": decoded("wall")}
        if known == "decoded"
        else {"plane": (0.0, 0.0, 1.0, WALL_MM), "plane_sigma_mm": 0.0}
    )
    found = measure_pair(pair(name), RIG, **given).points
    error = np.abs(truth_distance(view(name).points_mm, found.xyz_mm))
    twelve = fw.triangulate(decoded(name, 13), RIG, axis="x")
    usual = np.abs(truth_distance(view(name).points_mm, twelve.xyz_mm))
    where = far_from_cliffs(name) & np.isfinite(error)
    assert where.mean() > 0.4
    assert np.median(error[where]) < 3 * np.nanmedian(usual[where])
    # The stated plane is exact: its own σ would cover all errors of the pixels.
    sigma = found.sigma_mm if known == "decoded" else found.noise_mm
    assert 0.55 < np.mean(error[where] < sigma[where]) < 0.9
    if name == "sphere":
        ball = where & (view(name).body == 0)
        form = fw.fit(found.xyz_mm[ball].astype(float), "sphere")
        assert form.figures["bodies"][0]["radius_mm"] == pytest.approx(60.0, abs=0.1)


def test_what_does_not_belong_together_is_refused(monkeypatch):
    one, found = pair("plane"), decoded("wall")
    with pytest.raises(InputError, match="expected those along x"):
        measure_pair(one, RIG, reference=replace(found.x, axis="y"), method="fourier")
    # The others are refused before anything is computed.
    monkeypatch.delattr("fringeworks.pipeline.pair_points.reconstructed")
    with pytest.raises(InputError, match="expected coordinates of the reference plane or a plane"):
        measure_pair(one, RIG)
    small = replace(one, reference=one.reference[:200], object=one.object[:200])
    with pytest.raises(InputError, match=r"expected shape \(200, 448\) of the frames"):
        measure_pair(small, RIG, reference=found)


@pytest.mark.parametrize(
    ("range_mm", "sure"), [((520.0, 534.0), True), ((505.0, 570.0), False), (None, False)]
)
def test_a_depth_range_tells_the_periods_of_a_body_that_fills_the_frame(range_mm, sure):
    plate = look(RIG, [Body(Plane(), at(0, 0, 527.0, (0.004, -0.008, 0)), 0.75)])
    one = photograph_pair(view("wall"), plate, PERIOD, Optics(seed=9))
    known = {"plane": (0.0, 0.0, 1.0, WALL_MM), "plane_sigma_mm": 0.0, "method": "fourier"}
    found = measure_pair(one, RIG, depth_mm=range_mm, **known).points
    error = np.abs(truth_distance(plate.points_mm, found.xyz_mm))
    measured = np.isfinite(error)
    assert np.mean((error < 2 * found.sigma_mm)[measured]) > 0.95
    assert bool(np.median(error[measured]) < 0.1) is sure
    assert bool(np.nanmedian(found.sigma_mm) < 0.2) is sure
    assert np.nanmedian(found.noise_mm) < 0.1
    assert any(f.kind == "whole periods" for f in found.findings)
    assert any(f.kind == "moved frame" for f in found.findings) is not sure


@pytest.mark.parametrize("known", quick(["coordinates", "plane"], "plane"))
def test_on_the_command_line(tmp_path, known):
    one = pair("plane")
    for name in ("reference", "object"):
        Image.fromarray(getattr(one, name)).save(tmp_path / f"{name}.png")
    fw.files.write_rig(tmp_path / "rig.toml", RIG)
    frames = ("--reference", tmp_path / "reference.png", "--object", tmp_path / "object.png")
    rig = ("--rig", tmp_path / "rig.toml")
    reference = ("--plane-equation", f"0,0,1,{WALL_MM}")
    if known == "coordinates":
        fw.files.write_coordinates(tmp_path / "wall.npz", decoded("wall"))
        reference = ("--plane-coordinates", tmp_path / "wall.npz")
    out = tmp_path / "part.ply"
    run(*("reconstruct", *frames, *rig, *reference), *("--method", "fourier", "--out", out))
    xyz = np.asarray(fw.files.read_points(out).xyz_mm)
    assert abs(np.median(xyz[:, 2]) - (WALL_MM - 3)) < 0.2
    message = run("reconstruct", *frames, "--plane-equation", "0,0,1,560", code=2).stderr
    assert "--plane-equation: expected together with --rig" in message
    message = run("reconstruct", *frames, *rig, code=2).stderr
    assert "expected coordinates of the reference plane or a plane" in message
