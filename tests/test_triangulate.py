"""Triangulation: against the oracle, its error bars, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from fringeworks import InputError, PatternPlan, Reason, Stack, decode
from fringeworks.patterns import GrayCode
from fringeworks.pipeline.stacks import check_projector
from fringeworks.rig.epipolar import calibration_share
from fringeworks.rig.pinhole import look_at, pose, project, rays, rotation, transform
from fringeworks.rig.point_findings import point_findings
from fringeworks.rig.triangulate import triangulate
from fringeworks.signal import CameraNoise
from fringeworks.simulate import bust, standard_rig
from fringeworks.simulate.bodies import Box, Plane, Sphere
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import truth_distance
from fringeworks.simulate.virtual_rig import look
from fringeworks.surface.cloud import cloud_triangles, height_over_plane, normals
from fringeworks.surface.form import fit_form
from fringeworks.types import CoordinateMap, Decoded, Pinhole, Rig, RigMismatch
from tests.grids import thinned
from tests.oracles.triangulation import point_of, sigma_of
from tests.rigs import ahead, calibrated, rig, scene, shoot

COVARIANCE = (
    np.diag([0.05, 0.05, 0.1, 0.1, 1e-4, 1e-3, 1e-5, 1e-5, 1e-3] * 2 + [2e-5] * 3 + [0.01] * 3) ** 2
)


def made_up(rig_, depth, *, sigma=(0.03, 0.05), noise=0.0, seed=0):
    """Coordinates that a surface at this depth (h, w) would have."""
    rng = np.random.default_rng(seed)
    h, w = rig_.camera.shape
    v, u = np.mgrid[:h, :w].astype(float)
    points = rays(rig_.camera, np.stack((u, v), -1)) * depth[..., None]
    pixel = project(rig_.projector, transform(rig_.T_projector_camera, points))
    maps = {}
    for k, axis in enumerate("xy"):
        values = pixel[..., k] + noise * sigma[k] * rng.standard_normal((h, w))
        spread = np.full((h, w), sigma[k], np.float32)
        blank = np.zeros((h, w), np.float32)
        maps[axis] = CoordinateMap(
            values.astype(np.float32),
            spread,
            blank,
            blank,
            np.zeros((h, w), np.uint8),
            axis,
            (30.0,),
        )
    return points, Decoded(maps["x"], maps["y"], CameraNoise(2.0))


def lens(curved: bool, shape=(90, 150)) -> Rig:
    h, w = shape
    k = (-0.15, 0.2, 1e-3, -2e-3, 0.1) if curved else (0.0,) * 5
    camera = Pinhole(w, h, (2.0 * w, 2.01 * w), (0.48 * w, 0.53 * h), k)
    projector = Pinhole(200, 120, (310.0, 305.0), (104.0, 57.0), k)
    T = rig().T_projector_camera
    return Rig(camera, projector, T, COVARIANCE, (0.01, 0.02))


def wave(shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 500.0 + 30.0 * np.sin(x / 20.0) * np.cos(y / 15.0)


@thinned(strength=1, curved=[False, True], axis=[None, "x"])
def test_against_the_oracle(curved, axis):
    r = lens(curved)
    points, decoded = made_up(r, wave(r.camera.shape), noise=1.0)
    cloud = triangulate(decoded, r, axis=axis)
    assert cloud.reason.max() == Reason.OK
    rng = np.random.default_rng(2)
    h, w = r.camera.shape
    for y, x in zip(rng.integers(0, h, 6), rng.integers(0, w, 6), strict=True):
        seen = np.array([decoded.x.coordinate_px[y, x], decoded.y.coordinate_px[y, x]], float)
        if axis == "x":
            seen[1] = np.nan
        sigma = np.array([0.03, 0.05])
        expected = point_of(r, (x, y), seen, sigma)
        np.testing.assert_allclose(cloud.xyz_mm[y, x], expected, rtol=2e-6)
        noise, every = sigma_of(r, (x, y), seen, sigma, COVARIANCE)
        assert cloud.noise_mm[y, x] == pytest.approx(noise, rel=2e-3)
        # Of both axes the calibration's part weighs both alike: near, not the same.
        assert cloud.sigma_mm[y, x] == pytest.approx(every, rel=0.05 if axis else 0.2)
    assert np.abs(cloud.xyz_mm - points).max() < 2.0


def test_rows_alone_measure_with_a_projector_above():
    r = lens(True)
    above = look_at(np.array([0.0, -200.0, 0.0]), np.array([0.0, 0.0, 500.0]))
    r = Rig(r.camera, r.projector, above, COVARIANCE)
    points, decoded = made_up(r, wave(r.camera.shape))
    cloud = triangulate(decoded, r, axis="y")
    ok = cloud.reason == Reason.OK
    assert ok.mean() > 0.9
    assert np.abs(cloud.xyz_mm - points)[ok].max() < 0.01


def test_exact_coordinates_give_exact_points():
    for curved in (False, True):
        r = lens(curved)
        points, decoded = made_up(r, wave(r.camera.shape))
        cloud = triangulate(decoded, r)
        assert np.abs(cloud.xyz_mm - points).max() < 5e-3
        assert np.abs(cloud.residual_px).max() < 1e-3


@pytest.mark.parametrize("name", ["sphere", "plane"])
def test_stated_errors_cover_the_true_ones(name):
    view, decoded = scene(name)
    cloud = triangulate(decoded, rig())
    ok = (cloud.reason == Reason.OK) & view.lit
    off = np.abs(truth_distance(view.points_mm, cloud.xyz_mm)[ok])
    z = off / cloud.sigma_mm[ok]
    # Towards the rim of a shaded body, σ holds a blur that this camera does not have.
    inner = ndimage.distance_transform_edt(ok)[ok] > 15.0
    # Of a body this narrow, brightness alone tells that the response is linear, to 0.005 rad, which
    # is a part of σ that this camera does not have either.
    more = 0.03 if name == "sphere" else 0.0
    assert 0.663 < np.mean(z[inner] < 1.0) < 0.703 + more
    assert 0.939 < np.mean(z[inner] < 2.0) < 0.969 + more
    assert np.mean(z[~inner] < 1.0) > 0.663
    assert np.mean(z[~inner] < 2.0) > 0.939


@pytest.mark.parametrize("rigs", [40, pytest.param(120, marks=pytest.mark.long)])
def test_calibration_covers_what_it_does_to_points(rigs):
    """Over rigs drawn from the covariance, 68 % of all points lie within one σ of the truth."""
    truth = lens(True)
    depth = wave(truth.camera.shape)
    points, decoded = made_up(truth, depth, sigma=(1e-4, 1e-4))
    rng = np.random.default_rng(0)
    from tests.oracles.triangulation import moved

    shares = []
    for _ in range(rigs):
        drawn = truth
        for k, step in enumerate(rng.standard_normal(24) * np.sqrt(np.diag(COVARIANCE))):
            drawn = moved(drawn, k, step)
        cloud = triangulate(decoded, drawn, residual_sigmas=1e3)
        off = np.abs(truth_distance(points, cloud.xyz_mm))
        shares.append(np.mean(off < cloud.sigma_mm))
    assert np.mean(shares) == pytest.approx(0.683, abs=0.1)


def test_axes_that_disagree_are_taken_out():
    r = lens(True)
    points, decoded = made_up(r, wave(r.camera.shape), noise=1.0)
    wrong = decoded.y.coordinate_px.copy()
    wrong[30:40, 50:90] += 2.0
    cloud = triangulate(replace(decoded, y=replace(decoded.y, coordinate_px=wrong)), r)
    assert (cloud.reason[30:40, 50:90] == Reason.RAYS_APART).all()
    assert np.isnan(cloud.xyz_mm[30:40, 50:90]).all()
    assert np.nanmedian(np.abs(cloud.residual_px[30:40, 50:90])) > 1.0
    rest = np.ones(cloud.shape, bool)
    rest[30:40, 50:90] = False
    assert (cloud.reason[rest] == Reason.OK).mean() > 0.9999
    assert np.abs(cloud.xyz_mm - points)[rest].max() < 2.0


def turned(r, angle_rad):
    """The rig with its projector turned about the baseline's direction as seen by the camera."""
    T = r.T_projector_camera
    return replace(
        r, T_projector_camera=pose(rotation([angle_rad, 0.0, 0.0]) @ T[:3, :3], T[:3, 3])
    )


def test_a_rig_whose_residuals_are_unknown_is_not_perfect():
    """An epipolar error of 0.3 px, as rigs of other programs have, is no reason to refuse them."""
    r = lens(True)
    _, decoded = made_up(r, wave(r.camera.shape), sigma=(0.003, 0.005), noise=1.0)
    off = turned(r, 0.3 / r.projector.focal_px[1])
    unknown = replace(off, covariance=None, residual_px=None)
    cloud = triangulate(decoded, unknown)
    assert 0.2 < np.nanmedian(np.abs(cloud.residual_px)) < 0.4
    assert (cloud.reason == Reason.OK).mean() > 0.999
    # A rig that states a perfect calibration is taken at its word, or at the caller's.
    perfect = replace(unknown, residual_px=(0.0, 0.0))
    with pytest.raises(InputError, match="pass each other"):
        triangulate(decoded, perfect)
    assert (triangulate(decoded, perfect, epipolar_px=0.3).reason == Reason.OK).mean() > 0.999
    with pytest.raises(InputError, match="pass each other"):
        triangulate(decoded, unknown, epipolar_px=0.01)
    with pytest.raises(InputError, match="epipolar_px: expected >= 0"):
        triangulate(decoded, unknown, epipolar_px=float("nan"))
    # A rig that does not fit is still refused: its rays pass each other by many px.
    with pytest.raises(InputError, match="pass each other"):
        triangulate(decoded, turned(unknown, 40.0 / r.projector.focal_px[1]))


def test_covariance_enters_the_epipolar_error():
    r = replace(lens(True), residual_px=(0.0, 0.0))
    _, decoded = made_up(r, wave(r.camera.shape), sigma=(0.003, 0.005), noise=1.0)
    uncertain = r.covariance.copy()
    uncertain[18:21, 18:21] = np.eye(3) * (0.3 / r.projector.focal_px[1]) ** 2
    off = turned(replace(r, covariance=uncertain), 0.6 / r.projector.focal_px[1])
    assert (triangulate(decoded, off).reason == Reason.OK).mean() > 0.999
    with pytest.raises(InputError, match="pass each other"):
        triangulate(decoded, replace(off, covariance=None))


def test_a_small_object_has_the_covariance_of_the_whole_frame():
    """It enters the epipolar error however few pixels of the frame are decoded."""
    r = replace(lens(True, (180, 300)), covariance=COVARIANCE, residual_px=(0.01, 0.01))
    _, decoded = made_up(r, wave((180, 300)))
    whole = calibration_share(r, decoded.maps)
    assert whole > 0.05
    for down, across in ((40, 70), (30, 50), (25, 35)):
        small = {}
        for axis, found in decoded.maps.items():
            values = np.full_like(found.coordinate_px, np.nan)
            place = np.s_[60 : 60 + down, 90 : 90 + across]
            values[place] = found.coordinate_px[place]
            small[axis] = replace(found, coordinate_px=values)
        assert 0.5 * whole < calibration_share(r, small) < 2.0 * whole, (down, across)


def test_a_large_share_of_rays_apart_is_a_finding():
    r = lens(False)
    _, decoded = made_up(r, wave(r.camera.shape), sigma=(0.03, 0.03), noise=1.0)
    h = r.projector.height_px
    assert point_findings(triangulate(decoded, r), r, h) == ()
    rows = decoded.y.coordinate_px.copy()
    rows[: rows.shape[0] // 3] += 8.0
    spoiled = replace(decoded, y=replace(decoded.y, coordinate_px=rows))
    points = triangulate(spoiled, r)
    (finding,) = point_findings(points, r, h)
    assert "rays apart" in finding.text
    assert "likely" in finding.text
    assert finding.pixels.count == np.count_nonzero(points.reason == Reason.RAYS_APART)


def test_a_plan_may_light_a_part_of_the_projector():
    r = rig()
    w, h = r.projector.width_px, r.projector.height_px

    def check(width, height):
        plan = PatternPlan(width, height, (GrayCode("x", 8.0, width),))
        check_projector(r, Stack(np.zeros((plan.frames, 4, 4), np.uint8), plan))

    check(w, h)
    check(w, h - 40)
    _, decoded = made_up(r, wave(r.camera.shape), sigma=(0.03, 0.03), noise=0.0)
    points = triangulate(decoded, r)
    assert "taken as its upper part" in point_findings(points, r, h - 40)[0].text
    assert point_findings(points, r, h) == ()
    for size in ((w // 2, h // 2), (w + 8, h), (w - 8, h), (w, h + 8)):
        with pytest.raises(InputError, match="for a projector of"):
            check(*size)


def test_reasons_are_handed_on():
    r = lens(False)
    _, decoded = made_up(r, wave(r.camera.shape))
    reason = decoded.x.reason.copy()
    reason[0, 0], reason[2, 149] = Reason.SHADOW, Reason.SATURATED
    rows = decoded.y.reason.copy()
    rows[5, 5] = Reason.LOW_MODULATION
    rows[0, 0] = Reason.LOW_MODULATION
    cloud = triangulate(
        replace(decoded, x=replace(decoded.x, reason=reason), y=replace(decoded.y, reason=rows)), r
    )
    assert cloud.reason[0, 0] == Reason.SHADOW
    assert cloud.reason[2, 149] == Reason.SATURATED
    assert cloud.reason[5, 5] == Reason.LOW_MODULATION
    assert np.isnan(cloud.xyz_mm[[0, 2, 5], [0, 149, 5]]).all()
    assert np.isnan(cloud.sigma_mm[[0, 2, 5], [0, 149, 5]]).all()
    assert cloud.failed_fraction == pytest.approx(3 / reason.size)


@pytest.mark.long
def test_bars_of_a_sphere_and_a_plane():
    """Calibrated with noise, then measured with noise, at half the pixels of the standard rig."""
    _, decoded = scene("sphere")
    cloud = triangulate(decoded, calibrated().rig)
    found = fit_form(cloud.xyz_mm[cloud.reason == Reason.OK], "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(25.0, abs=0.01)
    assert found.deviation_mm < 0.04
    _, decoded = scene("plane")
    cloud = triangulate(decoded, calibrated().rig)
    flat = fit_form(cloud.xyz_mm[cloud.reason == Reason.OK], "plane")
    assert flat.deviation_mm < 0.04
    assert (~flat.used).mean() < 0.01


def test_memory_of_an_earlier_result_is_used():
    r = lens(True)
    _, decoded = made_up(r, wave(r.camera.shape))
    first = triangulate(decoded, r)
    again = triangulate(decoded, r, out=first)
    assert again.xyz_mm is first.xyz_mm
    with pytest.raises(InputError, match="out"):
        triangulate(decoded, r, axis="x", out=first)


def test_maps_of_any_layout_are_read_and_not_changed():
    r = lens(True)
    _, decoded = made_up(r, wave(r.camera.shape))
    plain = triangulate(decoded, r)
    odd = {}
    for axis, found in decoded.maps.items():
        wide = np.repeat(found.coordinate_px, 2, axis=1)[:, ::2]
        assert not wide.flags.c_contiguous
        odd[axis] = replace(found, coordinate_px=wide, sigma_px=np.asfortranarray(found.sigma_px))
    before = odd["x"].coordinate_px.copy()
    found = triangulate(replace(decoded, **odd), r)
    np.testing.assert_array_equal(found.xyz_mm, plain.xyz_mm)
    np.testing.assert_array_equal(odd["x"].coordinate_px, before)


def test_what_does_not_belong_together_is_refused():
    r = lens(True)
    _, decoded = made_up(r, wave(r.camera.shape))
    other = replace(r, camera=replace(r.camera, width_px=151))
    with pytest.raises(InputError, match="camera of 151 × 90 px, got frames of 150 × 90"):
        triangulate(decoded, other)
    small = replace(r, projector=replace(r.projector, width_px=40))
    with pytest.raises(InputError, match="projector of 40 × 120 px, got coordinates up to"):
        triangulate(decoded, small)
    with pytest.raises(InputError, match="absolute"):
        triangulate(replace(decoded, x=replace(decoded.x, repeats_px=30.0)), r)
    with pytest.raises(InputError, match="expected one of x, got y"):
        triangulate(replace(decoded, y=None), r, axis="y")
    with pytest.raises(InputError, match="got none"):
        triangulate(Decoded(None, None, CameraNoise(1.0)), r)
    with pytest.raises(InputError, match="colour"):
        triangulate(decoded, r, colour=np.zeros((3, 3)))
    with pytest.raises(InputError, match="residual_sigmas"):
        triangulate(decoded, r, residual_sigmas=0)


def test_points_behind_a_device_are_an_error():
    r = lens(True)
    _, decoded = made_up(r, wave(r.camera.shape))
    # A projector on the other side of the camera.
    T = r.T_projector_camera
    mirrored = Rig(r.camera, r.projector, pose(T[:3, :3], -T[:3, 3]))
    with pytest.raises(InputError, match="behind the camera or the projector"):
        triangulate(decoded, mirrored)


def test_columns_and_rows_swapped_are_an_error():
    r = lens(True, (90, 150))
    _, decoded = made_up(r, wave(r.camera.shape))
    swapped = replace(
        decoded,
        x=replace(decoded.y, axis="x"),
        y=replace(decoded.x, axis="y", coordinate_px=decoded.x.coordinate_px * 0.55),
    )
    with pytest.raises(InputError, match="does not belong to this capture"):
        triangulate(swapped, r)


def test_rigs_that_are_none_are_refused():
    r = lens(False)
    with pytest.raises(InputError, match="rotation"):
        replace(r, T_projector_camera=np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match="baseline"):
        replace(r, T_projector_camera=np.eye(4))
    with pytest.raises(InputError, match="covariance"):
        replace(r, covariance=np.eye(3))
    assert r.baseline_mm == pytest.approx(np.linalg.norm(r.T_projector_camera[:3, 3]))


def test_normals_are_those_of_the_surface():
    view, decoded = scene("sphere")
    cloud = triangulate(decoded, rig())
    found = normals(cloud, window=9)
    ok = np.isfinite(found[..., 0]) & (view.shading > 0.5)
    assert ok.sum() > 5000
    cosine = np.sum(found * view.normals, axis=-1)[ok]
    assert np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))) < 2.0
    assert np.mean(cosine > np.cos(np.radians(10))) > 0.99
    assert np.isnan(found[~(cloud.reason == Reason.OK)]).all()
    with pytest.raises(InputError, match="odd number"):
        normals(cloud, window=4)


def test_triangles_do_not_bridge_cliffs():
    bodies = [ahead(Box((40.0, 40.0, 40.0)), z=480.0), ahead(Plane(), z=560.0)]
    view, plan, frames = shoot(bodies, Optics(seed=3, exposure=0.8), both=False)
    cloud = triangulate(decode(frames, plan), rig())
    faces = cloud_triangles(cloud)
    assert len(faces) > 100_000
    depth = cloud.xyz_mm.reshape(-1, 3)[:, 2][faces]
    assert np.ptp(depth, axis=1).max() < 25.0
    bodies_seen = view.body.reshape(-1)[faces]
    assert (np.ptp(bodies_seen, axis=1) > 0).mean() < 1e-3


def test_heights_over_a_plane():
    r = rig()
    T = pose(rotation(np.array([0.25, 0.1, 0.0])), np.array([0.0, 0.0, 520.0]))
    base = ahead(Plane(160, 120), z=520.0, turn=(0.25, 0.1, 0.0))
    cap = replace(ahead(Sphere(30.0)), T_world_body=T)
    view = look(r, [base, cap])
    assert (view.body == 1).any()
    _, plan, frames = shoot([base, cap], Optics(seed=4), both=False)
    cloud = triangulate(decode(frames, plan), r)
    found = height_over_plane(cloud, T[:3, 3], T[:3, 2], pitch_mm=0.5)
    assert found.unit == "mm"
    assert found.pitch == 0.5
    values = found.values[np.isfinite(found.values)]
    assert np.median(np.abs(values)) < 0.05  # most of it is the plane
    # The top of the ball stands a radius above.
    assert np.nanpercentile(found.values, 99.99) == pytest.approx(30.0, abs=0.2)
    assert np.nanmedian(found.sigma) < 0.1
    with pytest.raises(InputError, match="pitch"):
        height_over_plane(cloud, T[:3, 3], T[:3, 2], pitch_mm=0)
    with pytest.raises(InputError, match="normal"):
        height_over_plane(cloud, T[:3, 3], np.zeros(3), pitch_mm=1)
    with pytest.raises(InputError, match="grid below"):
        height_over_plane(cloud, T[:3, 3], T[:3, 2], pitch_mm=1e-4)


@pytest.mark.parametrize("what", ["mirrored", "other sensor", "mirrored rows"])
def test_rigs_that_do_not_belong_are_refused_by_all_losses_together(what):
    """Each loss alone is common: light between surfaces, or a device that moved a little."""
    r = standard_rig(scale=0.2)
    view = look(r, bust())
    lit = np.where(view.lit[..., None], view.projector_px, np.nan).astype(np.float32)
    seen = {axis: np.ascontiguousarray(lit[..., k]) for k, axis in enumerate("xy")}
    if what == "other sensor":
        focal = tuple(1.4 * f for f in r.camera.focal_px)
        other = replace(r, camera=replace(r.camera, focal_px=focal))
    else:
        turn = np.s_[:, ::-1] if what == "mirrored" else np.s_[::-1]
        seen, other = {axis: np.ascontiguousarray(u[turn]) for axis, u in seen.items()}, r
    rng = np.random.default_rng(7)
    maps = {}
    for axis, u in seen.items():
        ok = np.isfinite(u)
        noisy = u + rng.normal(0.0, 0.05, u.shape).astype(np.float32)
        reason = np.where(ok, Reason.OK, Reason.SHADOW).astype(np.uint8)
        sigma = np.where(ok, np.float32(0.05), np.float32(np.nan))
        light = np.full(u.shape, 90.0, np.float32)
        maps[axis] = CoordinateMap(noisy, sigma, light, light, reason, axis, (16.0,))
    decoded = Decoded(**maps, noise=CameraNoise(1.0))
    with pytest.raises(RigMismatch, match=r"epipolar error is .* px|pass each other|lie behind"):
        triangulate(decoded, other)


@pytest.mark.parametrize("off_px", [0.0, 1.5, 3.0])
def test_a_misfit_that_is_seen_is_in_sigma(off_px):
    """An error of the columns that also shows across the epipolar lines."""
    r = replace(rig(), residual_px=(1.0, 1.0), covariance=None)
    _, decoded = made_up(r, wave(r.camera.shape), sigma=(0.03, 0.03), noise=1.0)
    right = triangulate(decoded, r)
    moved = {a: replace(m, coordinate_px=m.coordinate_px + off_px) for a, m in decoded.maps.items()}
    points = triangulate(replace(decoded, **moved), r)
    ok = (points.reason == Reason.OK) & (right.reason == Reason.OK)
    assert ok.mean() > 0.5
    off = np.linalg.norm(points.xyz_mm - right.xyz_mm, axis=-1)[ok]
    assert np.mean(off < 2.0 * points.sigma_mm[ok]) > 0.9
    if not off_px:
        np.testing.assert_array_equal(points.sigma_mm[ok], right.sigma_mm[ok])


def other_lens(name):
    """A rig without errors of its own whose lens or focus is not that of the capture."""
    right = replace(lens(True, (180, 300)), covariance=None, residual_px=None)
    camera, projector = right.camera, right.projector
    if name == "camera":
        return right, replace(right, camera=replace(camera, distortion=(0.5, 0.2, 0, 0, 0)))
    if name == "projector":
        return right, replace(right, projector=replace(projector, distortion=(0.3, 0, 0, 0, 0)))
    if name == "focus":
        longer = replace(camera, focal_px=tuple(1.01 * f for f in camera.focal_px))
        return right, replace(right, camera=longer)
    return right, right


@pytest.mark.parametrize("name", ["camera", "projector", "focus", "none"])
def test_a_rig_that_is_off_is_told_and_in_sigma(name):
    """Its epipolar errors are small enough for points, but far larger than their noise."""
    right, wrong = other_lens(name)
    true, decoded = made_up(right, wave(right.camera.shape), sigma=(0.03, 0.03), noise=1.0)
    points = triangulate(decoded, wrong)
    ok = points.reason == Reason.OK
    assert ok.mean() > 0.8
    told = [f for f in points.findings if f.kind == "epipolar error"]
    assert len(told) == (name != "none")
    off = np.linalg.norm(points.xyz_mm - true, axis=-1)[ok]
    # What is off along the epipolar lines is of the same size, but not the same.
    assert np.mean(off < 2.0 * points.sigma_mm[ok]) > 0.65
    if name == "none":
        assert np.array_equal(points.sigma_mm[ok], points.noise_mm[ok])
