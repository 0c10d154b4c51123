"""The virtual rig: exact geometry, and optics as documented."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from fringeworks import InputError, PatternPlan, decode
from fringeworks.files import read_stack
from fringeworks.files.mesh import read_mesh
from fringeworks.files.stack import write_stack
from fringeworks.patterns import PhaseSteps, Uniform, equal_steps
from fringeworks.rig.pinhole import inverse, pose, project, rays, rotation, transform
from fringeworks.simulate.bodies import (
    Body,
    Box,
    Cylinder,
    Mesh,
    Paraboloid,
    Plane,
    Sphere,
    height_field,
)
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, bust, standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.rigs import ahead, board, head_on, rig, shoot

pytestmark = pytest.mark.statistical

TINY = standard_rig(scale=0.1)
TURN = rotation(np.array([0.4, -0.3, 0.2]))


def implicit(shape, p):
    """Value of a body's implicit equation at points: 0 on the surface."""
    if isinstance(shape, Plane):
        return p[:, 2]
    if isinstance(shape, Sphere):
        return np.linalg.norm(p, axis=1) - shape.radius_mm
    if isinstance(shape, Cylinder):
        side = np.hypot(p[:, 0], p[:, 2]) - shape.radius_mm
        end = np.abs(p[:, 1]) - 0.5 * shape.length_mm
        return np.maximum(side, end)
    if isinstance(shape, Box):
        return (np.abs(p) - 0.5 * np.array(shape.size_mm)).max(axis=1)
    return p[:, 2] - shape.height_mm * (1 - (p[:, 0] ** 2 + p[:, 1] ** 2) / shape.radius_mm**2)


BODIES = [
    Plane(90, 70),
    Sphere(40.0),
    Cylinder(25.0, 60.0),
    Box((60.0, 50.0, 40.0)),
    Paraboloid(45.0, 30.0),
]


@pytest.mark.parametrize("shape", BODIES, ids=lambda s: type(s).__name__)
def test_hits_lie_on_the_body_and_are_the_first(shape):
    # Turned by 180°, so that a paraboloid's cap opens away from the camera.
    T = pose(TURN @ rotation(np.array([np.pi, 0, 0])), np.array([3.0, -2, 500]))
    view = look(TINY, [Body(shape, T)])
    hit = view.body == 0
    assert hit.sum() > 500
    local = transform(inverse(T), view.points_mm[hit])
    np.testing.assert_allclose(implicit(shape, local), 0.0, atol=1e-9)
    # The ray is outside the body until the hit.
    before = transform(inverse(T), 0.999 * view.points_mm[hit])
    sign = np.sign(implicit(shape, transform(inverse(T), np.zeros((1, 3)))))
    assert np.mean(np.sign(implicit(shape, before)) == sign) > 0.98
    # The points project to the pixels of their rays.
    v, u = np.nonzero(hit)
    np.testing.assert_allclose(
        project(TINY.camera, view.points_mm[hit]), np.column_stack((u, v)), atol=1e-6
    )
    normal = view.normals[hit]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    assert (np.sum(normal * view.points_mm[hit], axis=1) < 0).all()


@pytest.mark.parametrize("shape", BODIES, ids=lambda s: type(s).__name__)
def test_normals_are_across_the_surface(shape):
    T = pose(TURN @ rotation(np.array([np.pi, 0, 0])), np.array([3.0, -2, 500]))
    view = look(rig(), [Body(shape, T)])
    across = view.points_mm[100:-100, 202:-200] - view.points_mm[100:-100, 200:-202]
    middle = view.normals[100:-100, 201:-201]
    cosine = np.sum(across * middle, axis=-1) / np.linalg.norm(across, axis=-1)
    assert np.nanmedian(np.abs(cosine)) < 0.01


def test_projector_pixels_are_those_of_the_points():
    view = look(TINY, [ahead(Sphere(40.0))])
    seen = project(TINY.projector, transform(TINY.T_projector_camera, view.points_mm))
    np.testing.assert_allclose(view.projector_px, seen)


def test_mesh_is_like_the_body_it_is_made_of():
    n = 60
    x = np.linspace(-50, 50, n)
    height = 20.0 * np.exp(-(x[:, None] ** 2 + x[None] ** 2) / 900.0)
    field = height_field(height, x[1] - x[0])
    T = pose(rotation(np.array([np.pi, 0, 0])), np.array([0.0, 0, 500]))
    view = look(TINY, [Body(field, T)])
    hit = view.body == 0
    local = transform(inverse(T), view.points_mm[hit])
    truth = 20.0 * np.exp(-(local[:, 0] ** 2 + local[:, 1] ** 2) / 900.0)
    np.testing.assert_allclose(local[:, 2], truth, atol=0.05)
    assert (view.normals[hit][:, 2] < 0).all()


def test_mesh_files_are_read(tmp_path):
    import trimesh

    for suffix in (".stl", ".ply"):
        path = tmp_path / f"ball{suffix}"
        trimesh.creation.icosphere(subdivisions=4, radius=2.5).export(path)
        ball = read_mesh(path, scale=10.0)
        view = look(TINY, [ahead(ball)])
        exact = look(TINY, [ahead(Sphere(25.0))])
        both = (view.body == 0) & (exact.body == 0)
        assert both.sum() > 0.98 * (exact.body == 0).sum()
        off = np.linalg.norm(view.points_mm - exact.points_mm, axis=-1)[both]
        assert np.median(off) < 0.05
    (tmp_path / "bad.stl").write_bytes(b"solid nothing")
    with pytest.raises(InputError, match=r"bad.stl: expected"):
        read_mesh(tmp_path / "bad.stl")
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path / "none.stl")


def test_invalid_meshes_are_refused():
    corners = np.eye(3)
    with pytest.raises(InputError, match="corners below 3"):
        Mesh(corners, np.array([[0, 1, 3]]))
    with pytest.raises(InputError, match="triangles"):
        Mesh(corners, np.empty((0, 3), int))
    with pytest.raises(InputError, match="finite vertices"):
        Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="height field"):
        height_field(np.zeros((1, 5)), 1.0)


def test_a_body_throws_a_shadow_away_from_the_projector():
    ball, wall = ahead(Sphere(20.0), z=450.0), ahead(Plane(), z=540.0)
    view = look(TINY, [ball, wall])
    dark = (view.body == 1) & ~view.lit
    free = look(TINY, [wall])
    dark &= free.lit
    assert dark.sum() > 50
    # The projector is on the right, so the shadow is left of the ball.
    assert view.points_mm[dark][:, 0].mean() < -20.0
    # The line from every dark point to the projector goes through the ball.
    pupil = TINY.projector_centre_mm
    points = view.points_mm[dark]
    line = (pupil - points) / np.linalg.norm(pupil - points, axis=1, keepdims=True)
    centre = np.array([0.0, 0.0, 450.0])
    foot = points + np.sum((centre - points) * line, axis=1, keepdims=True) * line
    assert np.linalg.norm(foot - centre, axis=1).max() < 20.0 + 1e-6


def test_shading_is_lambert_over_distance_squared():
    view = look(TINY, [ahead(Plane(120, 100), turn=(0.3, 0.2, 0))])
    lit = view.lit
    way = TINY.projector_centre_mm - view.points_mm[lit]
    length = np.linalg.norm(way, axis=1)
    law = np.sum(way * view.normals[lit], axis=1) / length**3
    ratio = view.shading[lit] / law
    np.testing.assert_allclose(ratio, ratio[0])


def test_pixels_and_defocus_lower_the_contrast_of_fringes():
    period, blur = 8.0, 1.1
    plan = PatternPlan(64, 64, (PhaseSteps("x", period, equal_steps(4)),), bits=16)
    optics = Optics(defocus_px=blur, blur_px=0, ambient=0, black=0, noise=0, bits=16)
    view = look(head_on(), [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)])
    frames = np.stack(list(photograph(view, plan, optics))).astype(float)[:, 20:44, 16:48]
    wave = frames[0] - frames[2] + 1j * (frames[1] - frames[3])
    contrast = np.abs(wave).mean() / frames.mean() / 2
    # A camera pixel samples at its centre, so only the projector's pixels and its blur count.
    k = np.pi / period
    square = np.sin(k) / k
    assert contrast == pytest.approx(square * np.exp(-2 * (k * blur) ** 2), rel=2e-3)


def test_pictures_of_two_dimensions_are_projected_as_well():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)),))
    dithered = replace(plan, dither=True)
    optics = Optics(defocus_px=2.0, blur_px=0, noise=0, bits=16)
    view = look(head_on(), [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)])
    for plain, other in zip(
        photograph(view, plan, optics), photograph(view, dithered, optics), strict=True
    ):
        inner = np.s_[12:52, 12:52]
        np.testing.assert_allclose(plain[inner], other[inner].astype(float), atol=300)


def test_gamma_bends_the_fringes():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 64.0, equal_steps(8)), Uniform("white")), bits=16)
    optics = Optics(gamma=2.2, defocus_px=0.5, blur_px=0, noise=0, black=0, ambient=0, bits=16)
    view = look(head_on(), [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)])
    frames = [f.astype(float) for f in photograph(view, plan, optics)]
    x = np.arange(20, 44)
    sent = 0.5 + 0.5 * np.cos(2 * np.pi * x / 64)
    np.testing.assert_allclose(frames[0][30, 20:44] / frames[-1][30, 20:44], sent**2.2, atol=2e-3)


def test_noise_is_as_specified_and_repeatable():
    wall = [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.5)]
    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)), Uniform("white")))
    view = look(head_on(), wall)
    brightness = 0.5 * 255 * (1 + 0.02)
    for noise, shot in ((2.0, 0.0), (1.0, 0.1)):
        last = list(photograph(view, plan, Optics(noise=noise, gain=shot, seed=3)))[-1]
        inner = last[4:-4, 4:-4].astype(float)
        inner -= ndimage.uniform_filter(inner, 15)
        expected = np.sqrt(noise**2 + shot * brightness + 1 / 12) * np.sqrt(1 - 1 / 225)
        assert inner[8:-8, 8:-8].std() == pytest.approx(expected, rel=0.05)
    one, other = (list(photograph(view, plan, Optics(seed=5))) for _ in range(2))
    assert all((a == b).all() for a, b in zip(one, other, strict=True))
    assert any(
        (a != b).any() for a, b in zip(one, photograph(view, plan, Optics(seed=6)), strict=True)
    )


def test_frames_clip_and_have_their_depth():
    wall = [Body(Plane(), pose(np.eye(3), np.array([0.0, 0, 500])), 0.9)]
    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)),))
    frames = list(photograph(look(head_on(), wall), plan, Optics(exposure=3.0, bits=12)))
    assert frames[0].dtype == np.uint16
    assert frames[0].max() == 4095
    assert frames[0].min() >= 0


def test_edges_of_paint_are_in_the_right_place():
    """The mean albedo of a pixel is the painted share of it, also for edges along the pixel grid."""
    target = board("chessboard:5x4:20")
    for shift in (0.0, 0.013, 0.27, 0.5):
        place = pose(np.eye(3), np.array([-40.0 + shift, -30.0, 1000.0]))
        view = look(head_on(96), [Body(Plane(200, 200), place, target.albedo)])
        # A millimetre is a pixel: the edge at x = 0 lies at column −40 + shift + 47.5.
        edge = -40.0 + shift + 47.5
        rows = view.albedo[22:36]  # within one field, which is dark on one side
        white, black = rows.max(), rows.min()
        share = (rows[:, 4:12] - black) / (white - black)
        rising = share[0, -1] > 0.5
        covered = np.mean(np.sum(1 - share if rising else share, axis=1))
        assert 3.5 + covered == pytest.approx(edge, abs=0.004)


def test_a_plan_of_a_smaller_projector_is_refused():
    view = look(TINY, [ahead(Plane(120, 100))])
    small = PatternPlan(64, 64, (PhaseSteps("x", 16.0, equal_steps(4)),))
    with pytest.raises(InputError, match="expected one for the view's projector, got 64 × 64"):
        next(photograph(view, small))


def test_optics_and_bodies_refuse_nonsense():
    for change in ({"gamma": 0}, {"noise": -1}, {"bits": 9}, {"black": 1.0}, {"exposure": 0}):
        with pytest.raises(InputError, match=next(iter(change))):
            Optics(**change)


def test_a_virtual_capture_is_like_a_real_one(tmp_path):
    view, plan, frames = shoot(bust(), Optics(seed=1), both=False)
    folder = write_stack(
        tmp_path / "bust", frames, plan, camera="a", projector="b", truth=view.truth
    )
    stack = read_stack(folder)
    assert stack.plan == plan
    assert (stack.camera, stack.projector) == ("a", "b")
    assert all((a == b).all() for a, b in zip(stack.frames, frames, strict=True))
    found = decode(stack.frames, stack.plan)
    with np.load(folder / "truth.npz") as truth:
        assert set(truth.files) == {"points_mm", "projector_px", "body", "lit", "albedo"}
        off = found.x.coordinate_px - truth["projector_px"][..., 0]
        assert np.nanmedian(np.abs(off[truth["lit"]])) < 0.05
    with pytest.raises(InputError, match="the plan has 12, got 3"):
        write_stack(tmp_path / "short", frames[:3], plan)
    assert not (tmp_path / "short" / "capture.toml").exists()


def test_rays_of_neighbours_are_apart():
    """Lens distortion does not fold the camera's image anywhere."""
    v, u = np.mgrid[0:512:64, 0:640:64]
    x = rays(rig().camera, np.stack((u, v), -1).astype(float))[..., 0]
    assert all((b > a).all() for a, b in pairwise(x.T))


def test_board_is_seen_from_its_front():
    T = pose(np.eye(3), np.array([-60.0, -40.0, 500.0]))
    view = look(rig(), [board_body(board(), T)])
    assert (view.body == 0).mean() > 0.3
