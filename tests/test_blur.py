"""The error of the camera's blur: how large it is, that it is removed, and what stays."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, board_poses, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.surface.clean import inside_surface
from tests.grids import quick

pytestmark = pytest.mark.statistical

RADIUS_MM = 25.0
BOARD = fw.rig.parse_board("charuco:10x10:20:15")


@cache
def rig():
    return standard_rig(scale=0.3)


@cache
def ball(optics: Optics, seed_count: int = 4, body=None):
    """Stacks of a ball that fills a fifth of the frame, with other noise each."""
    shape = body or Body(Sphere(RADIUS_MM), pose(np.eye(3), np.array([5.0, 3.0, 500.0])), 0.8)
    view, plan = look(rig(), [shape]), fringe_plan(rig(), both=False)
    shots = []
    for seed in range(seed_count):
        frames = np.stack(list(photograph(view, plan, Optics(**{**vars(optics), "seed": seed}))))
        shots.append(fw.Stack(frames, plan))
    return view, shots


def outward(view, points):
    """Errors along the true normals, (h, w), mm, mean over the stacks."""
    off = np.mean([p.xyz_mm for p in points], axis=0) - view.points_mm
    return np.sum(off * view.normals, axis=-1)


def inner_part(view, points):
    """Pixels well inside the ball that are not seen at a grazing angle."""
    facing = -np.sum(view.normals * view.points_mm, -1) / np.linalg.norm(view.points_mm, axis=-1)
    return np.all([inside_surface(p, 3) for p in points], axis=0) & (facing > 0.6)


def blur_of(sigma_px):
    """Standard deviation of the simulator's blur: a Gaussian at whole pixels, px."""
    at = np.arange(-4, 5)
    weight = np.exp(-0.5 * (at / sigma_px) ** 2)
    return float(np.sqrt(np.sum(weight * at**2) / weight.sum()))


@pytest.mark.parametrize("sigma_px", quick([0.5, 0.8, 1.2], 0.5))
def test_a_ball_gets_its_size_back(sigma_px):
    view, shots = ball(Optics(blur_px=sigma_px, noise=1.0))
    plain = [fw.measure(s, rig()).points for s in shots]
    found = [fw.measure(s, rig(), blur_px=blur_of(sigma_px)).points for s in shots]
    inner = inner_part(view, plain)
    before, after = (float(np.mean(outward(view, p)[inner])) for p in (plain, found))
    assert before < -0.003
    assert abs(after) < 0.15 * abs(before)


def test_the_correction_hardly_adds_noise():
    _, shots = ball(Optics(blur_px=0.5, noise=1.0))
    plain = fw.measure(shots[0], rig()).points
    found = fw.views.remove_blur(plain, rig(), 0.46)
    inner = inside_surface(plain, 3)
    scatter = [
        np.std(np.diff(np.where(inner, p.xyz_mm[..., 2], np.nan), 2, axis=1)[:, ::3][
            inner[:, 2:][:, ::3] & inner[:, :-2][:, ::3] & inner[:, 1:-1][:, ::3]
        ])
        for p in (plain, found)
    ]  # fmt: skip
    assert scatter[1] < 1.1 * scatter[0]
    assert (found.sigma_mm[inner] >= plain.sigma_mm[inner]).all()
    assert np.array_equal(found.reason, plain.reason)


def test_pixels_that_collect_light_blur_like_wide_lenses():
    view, shots = ball(Optics(blur_px=0.5, noise=1.0, pixel_px=1.0))
    plain = [fw.measure(s, rig()).points for s in shots]
    inner = inner_part(view, plain)
    left = {}
    for variance in (blur_of(0.5) ** 2, blur_of(0.5) ** 2 + 1 / 12):
        found = [fw.measure(s, rig(), blur_px=float(np.sqrt(variance))).points for s in shots]
        left[variance] = abs(float(np.mean(outward(view, found)[inner])))
    without, with_pixel = left.values()
    assert with_pixel < 0.5 * without, left


def test_a_plane_of_one_brightness_stays_where_it_is():
    wall = Body(Plane(400.0, 300.0), pose(np.eye(3), np.array([0.0, 0.0, 500.0])), 0.6)
    _, shots = ball(Optics(blur_px=0.8, noise=0.5), 1, wall)
    plain = fw.measure(shots[0], rig()).points
    found = fw.views.remove_blur(plain, rig(), 0.8)
    inner = inside_surface(plain, 3)
    moved = found.xyz_mm[inner][:, 2] - plain.xyz_mm[inner][:, 2]
    assert abs(float(np.mean(moved))) < 2e-3


def test_a_board_measures_the_blur():
    T = board_poses(BOARD, 1, seed=3)[0]
    view, plan = look(rig(), [board_body(BOARD, T)]), fringe_plan(rig(), both=False)
    found = []
    for sigma_px in (0.5, 0.9):
        frames = np.stack(list(photograph(view, plan, Optics(blur_px=sigma_px, noise=1.0))))
        cloud = fw.measure(fw.Stack(frames, plan), rig()).points
        found.append(fw.views.board_pose(cloud, BOARD).blur_px)
    # Reflectances are means over pixels, so that edges show the pixel's own blur as well.
    expected = [np.sqrt(blur_of(s) ** 2 + 1 / 12) for s in (0.5, 0.9)]
    assert np.abs(np.array(found) / expected - 1.0).max() < 0.15, (found, expected)


@pytest.mark.parametrize(
    ("blur_px", "message"), [(-0.1, "expected 0 to 3 px"), (4.0, "expected 0 to 3 px")]
)
def test_a_blur_out_of_range_is_refused(blur_px, message):
    _, shots = ball(Optics(blur_px=0.5, noise=1.0))
    cloud = fw.measure(shots[0], rig()).points
    with pytest.raises(fw.InputError, match=message):
        fw.views.remove_blur(cloud, rig(), blur_px)
