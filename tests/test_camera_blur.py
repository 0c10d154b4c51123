"""The camera's blur as part of a rig: measured with it, stored with it, and removed by default.

The photographs are those of the second simulator (``tests/ray_caster.py``), whose rims, creases and
grazing views are mixed within each pixel.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.rig.calibration.camera_blur import camera_blur
from fringeworks.rig.pinhole import project, rotation, transform
from fringeworks.simulate.standard import board_poses, fringe_plan, standard_rig
from tests import rigs
from tests.grids import quick
from tests.ray_caster import Ball, Photographs, Sheet, Tube

pytestmark = pytest.mark.statistical

SCALE = 0.3


def pixel_px2(over=3):
    """Variance that pixels themselves add to the blur, px², seen by so many rays on a side."""
    return (1.0 - 1.0 / over**2) / 12.0


WALL = Sheet(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 545], [0, 0, 0, 1]]))
BODIES = {
    "ball 15": Ball((12.0, -8.0, 510.0), 15.0),
    "ball 45": Ball((-10.0, 5.0, 510.0), 45.0),
    "tube 25": Tube((3.0, 2.0, 515.0), (0.9, 0.4, 0.1), 25.0),
    "tube 15": Tube((3.0, 2.0, 510.0), (0.2, 0.95, -0.1), 15.0),
}
BOARD = fw.rig.parse_board("chessboard:11x8:12")


@cache
def rig():
    return standard_rig(scale=SCALE)


@cache
def photographs(name):
    return Photographs(rig(), [BODIES[name], WALL])


def area(body, share):
    """The part of a body up to a share of its radius, as the camera sees it."""
    if isinstance(body, Ball):
        turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
        rim = np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=-1)
        points = np.array(body.centre_mm) + body.radius_mm * share * rim
    else:
        along = np.array(body.axis) / np.linalg.norm(body.axis)
        across = np.cross(along, [0.0, 0.0, 1.0])
        across *= share * body.radius_mm / np.linalg.norm(across)
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        points = np.array([30.0 * s * along + t * across for s, t in corners]) + body.point_mm
    outline = project(rig().camera, points)
    return fw.evaluate.Area(polygon=tuple(map(tuple, outline.tolist())))


def diameter_error(cloud, name, share):
    """Error of a diameter, mm, and its standard deviation."""
    body = BODIES[name]
    kind = "sphere_diameter" if isinstance(body, Ball) else "cylinder_diameter"
    found = MEASURED[kind](area_points(cloud, area(body, share)))
    return found.value - 2.0 * body.radius_mm, found.sigma


@pytest.mark.parametrize("blur_px", quick([0.1, 0.3, 0.6, 0.9, 1.2], 0.3, 0.9))
def test_diameters_hold_their_sigma_up_to_the_rim(blur_px):
    plan = fringe_plan(rig(), both=False)
    known = replace(
        rig(), blur=fw.rig.CameraBlur.everywhere(float(np.sqrt(blur_px**2 + pixel_px2())))
    )
    z = {}
    for k, name in enumerate(BODIES):
        stack = photographs(name).stack(plan, blur_px=blur_px, noise=1.0, seed=k)
        cloud = fw.measure(stack, known).points
        for share in (0.7, 0.9, 1.0):
            error, sigma = diameter_error(cloud, name, share)
            z[name, share] = error / sigma
    assert max(map(abs, z.values())) <= 3.0, z


def test_each_axis_has_its_own_fringes():
    """Fringes fade where a surface is steep across them: x and y do so in different places."""
    known = replace(rig(), blur=fw.rig.CameraBlur.everywhere(float(np.sqrt(0.7**2 + pixel_px2()))))
    stack = photographs("ball 45").stack(fringe_plan(rig(), both=True), blur_px=0.7)
    error, sigma = diameter_error(fw.measure(stack, known).points, "ball 45", 0.9)
    assert abs(error) <= 3.0 * sigma
    assert sigma < 0.003


def test_the_noise_of_a_sharpened_plane_is_stated():
    """Sharpened coordinates carry the noise of the light as well, that of the finest set alone."""
    tilted = np.eye(4)
    tilted[:3, :3] = rotation(np.array([0.15, 0.2, 0.0]))
    tilted[:3, 3] = (0.0, 0.0, 520.0)
    seen = Photographs(rig(), [Sheet(tilted)])
    for blur_px in (0.7, 1.1):
        variance = blur_px**2 + pixel_px2()
        known = replace(rig(), blur=fw.rig.CameraBlur.everywhere(float(np.sqrt(variance))))
        stack = seen.stack(fringe_plan(rig(), both=False), blur_px=blur_px, noise=1.5, seed=7)
        cloud = fw.measure(stack, known).points
        inside = np.zeros(cloud.shape, bool)
        inside[20:-20, 40:-40] = True
        used = inside & (cloud.reason == 0)
        points = cloud.xyz_mm[used].astype(float)
        ways = points / np.linalg.norm(points, axis=1)[:, None]
        off = np.linalg.norm(points, axis=1) - tilted[:3, 3] @ tilted[:3, 2] / (
            ways @ tilted[:3, 2]
        )
        scatter = np.std((off - np.median(off)) / cloud.noise_mm[used])
        assert 0.95 <= scatter <= 1.06


def rings(name, blur_px, levels=200):
    """Mean distance from a ball's surface in its middle and near its rim, µm, to either side."""
    ball = BODIES[name]
    known = replace(
        rig(), blur=fw.rig.CameraBlur.everywhere(float(np.sqrt(blur_px**2 + pixel_px2())))
    )
    stack = photographs(name).stack(
        fringe_plan(rig(), both=False), blur_px=blur_px, noise=0.2, levels=levels
    )
    cloud = fw.measure(stack, known).points
    off = 1e3 * (np.linalg.norm(cloud.xyz_mm - ball.centre_mm, axis=-1) - ball.radius_mm)
    middle = project(rig().camera, np.array([ball.centre_mm]))[0]
    rim_px = rig().camera.focal_px[0] * ball.radius_mm / ball.centre_mm[2]
    row, column = np.indices(cloud.shape)
    far = np.hypot(row - middle[1], column - middle[0]) / rim_px
    measured = cloud.reason == 0
    found = {}
    for low, high in ((0.0, 0.4), (0.7, 0.8)):
        for side, here in (("left", column < middle[0]), ("right", column >= middle[0])):
            used = measured & here & (far >= low) & (far < high)
            found[low, side] = float(np.mean(off[used]))
    return found


def test_the_mean_of_three_sets_is_sharpened_as_such():
    """Blur fades and shifts sets of different periods differently: taken as the finest, the middle
    comes out 0.4 and 0.9 µm too low at 1.2 px."""
    found = rings("ball 45", 1.2)
    assert max(abs(found[0.0, side]) for side in ("left", "right")) < 0.3, found


def test_what_decoding_has_removed_is_given_back_as_it_was():
    """Small balls have edges of light that ``decode`` corrects by slopes of its own."""
    found = rings("ball 15", 1.2)
    assert max(abs(found[0.0, side]) for side in ("left", "right")) < 1.2, found


def test_a_surface_goes_on_beyond_its_end():
    """Continued by its nearest value, the surface comes out 1 µm too low near the rim."""
    found = rings("ball 45", 0.9)
    assert max(map(abs, found.values())) < 0.3, found


def test_without_removal_the_rim_is_far_off():
    """The fault that is removed: it is in the photographs."""
    plan = fringe_plan(rig(), both=False)
    stack = photographs("tube 15").stack(plan, blur_px=0.9, noise=1.0)
    kept = fw.measure(stack, rig()).points
    assert kept.blur_mm is None
    error, sigma = diameter_error(kept, "tube 15", 0.9)
    assert abs(error) > 0.01
    assert abs(error) > 5.0 * sigma


def views_of(blur, *, error=0.03, seed=0):
    """Corners of a board in eight poses, with the blur that their edges show, and the poses."""
    rng, views = np.random.default_rng(seed), []
    poses = board_poses(BOARD, 8, seed=seed)
    shape = rig().camera.shape
    for T in poses:
        points = transform(T, BOARD.points_mm)
        pixels = project(rig().camera, points)
        variance = blur.variance_px2(shape, pixels, points[:, 2])
        seen = np.sqrt(variance * (1.0 + error * rng.standard_normal(len(points))))
        index = np.arange(len(points))
        views.append(fw.rig.BoardView(index, pixels, blur_px=seen))
    return views, poses


@pytest.mark.parametrize(
    "factors",
    [
        (0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.5, 0.0, 0.0, 0.0, -1.0, 20.0),
        (0.4, 0.1, -0.05, 0.3, 0, 0),
    ],
    ids=["even", "by distance", "by place"],
)
def test_blur_is_fitted_by_place_and_distance(factors):
    true = fw.rig.CameraBlur(factors, 500.0, (400.0, 600.0), 0.0)
    views, poses = views_of(true)
    shape = rig().camera.shape
    found = camera_blur(views, poses, BOARD, shape)
    at = [
        (v.pixels, transform(T, BOARD.points_mm)[:, 2]) for v, T in zip(views, poses, strict=True)
    ]
    off = [found.variance_px2(shape, p, z) / true.variance_px2(shape, p, z) - 1.0 for p, z in at]
    assert np.sqrt(np.mean(np.square(off))) < 0.03
    assert found.relative_sigma < 0.05


def test_poses_that_disagree_about_the_blur_make_it_uncertain():
    views, poses = views_of(fw.rig.CameraBlur.everywhere(0.6))
    moved = [replace(v, blur_px=v.blur_px * (0.8 + 0.05 * k)) for k, v in enumerate(views)]
    found = camera_blur(moved, poses, BOARD, rig().camera.shape)
    assert 0.15 < found.relative_sigma < 0.5


def test_circles_show_no_blur():
    views, poses = views_of(fw.rig.CameraBlur.everywhere(0.6))
    hidden = [replace(v, blur_px=None) for v in views]
    assert camera_blur(hidden, poses, BOARD, rig().camera.shape) is None


def test_calibration_finds_the_blur_and_files_keep_it(tmp_path):
    found = rigs.calibrated().rig
    assert found.blur is not None
    # A Gaussian of 0.5 px at whole pixels has 0.46 px; the board's print is that of whole pixels.
    assert abs(found.blur.middle_px / np.sqrt(0.46**2 + 1.0 / 12.0) - 1.0) < 0.15
    assert found.blur.relative_sigma < 0.1
    fw.write(tmp_path / "rig.toml", found)
    assert fw.read(tmp_path / "rig.toml").blur == found.blur


def test_a_rig_with_blur_measures_without_it_and_says_so(tmp_path):
    known = replace(rig(), blur=fw.rig.CameraBlur.everywhere(0.8, relative_sigma=0.05))
    stack = photographs("ball 15").stack(fringe_plan(rig(), both=False), blur_px=0.75)
    plain, kept = fw.measure(stack, rig()).points, fw.measure(stack, known, blur_px=0.0).points
    sharp = fw.measure(stack, known).points
    ok = sharp.reason == 0
    assert np.allclose(kept.xyz_mm[ok], plain.xyz_mm[ok], atol=1e-4)
    assert (np.abs(sharp.xyz_mm - plain.xyz_mm)[ok].max(axis=-1) > 0.01).any()
    assert (sharp.sigma_mm[ok] >= np.abs(sharp.blur_mm[ok])).all()
    assert np.isnan(sharp.blur_mm[~ok]).all()
    for suffix in (".npz", ".mat"):
        path = tmp_path / f"points{suffix}"
        fw.write(path, sharp)
        if suffix == ".npz":
            assert np.array_equal(fw.read(path).blur_mm, sharp.blur_mm, equal_nan=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"factors_px2": (0.3, 0.0)}, "expected 6 finite numbers"),
        ({"factors_px2": (np.nan, 0.0, 0.0, 0.0, 0.0, 0.0)}, "expected 6 finite numbers"),
        ({"depth_mm": (500.0, 400.0)}, "expected distances > 0"),
        ({"middle_mm": 0.0}, "expected distances > 0"),
        ({"relative_sigma": -0.1}, "expected an error >= 0"),
    ],
)
def test_a_blur_that_is_none_is_refused(change, message):
    with pytest.raises(fw.InputError, match=message):
        replace(fw.rig.CameraBlur.everywhere(0.5), **change)


def test_a_rig_without_blur_needs_one():
    stack = photographs("ball 15").stack(fringe_plan(rig(), both=False), blur_px=0.5)
    with pytest.raises(fw.InputError, match="expected that of the camera, got none"):
        fw.views.remove_blur(fw.measure(stack, rig()).points, rig())
