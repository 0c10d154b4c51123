"""Fields of devices: in projections, in the kernel, in files and in other frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.files.rig import read_rig, write_rig
from fringeworks.rig.lens_field import correction, correction_slope
from fringeworks.rig.pinhole import look_at, project, project_with_derivatives, rays, transform
from fringeworks.rig.point_errors import point_errors
from fringeworks.rig.sensor_region import for_frames
from fringeworks.rig.triangulate import triangulate
from fringeworks.types import (
    CameraNoise,
    CoordinateMap,
    Decoded,
    InputError,
    LensField,
    PointCloud,
    Reason,
    Region,
)
from tests.oracles.triangulation import point_of
from tests.rigs import calibrated, rig

NOISE_PX = 0.01


def field_of(device, seed, size_px=0.3, sigma_px=0.0):
    """A random field over a device's frame, with eight intervals over its width."""
    step = device.width_px / 8
    shape = (int(np.ceil(device.height_px / step)) + 3, 11, 2)
    control = np.random.default_rng(seed).normal(0, size_px, shape)
    sigma = np.full(shape, sigma_px)
    return LensField((-0.5 - step, -0.5 - step), (step, step), control, sigma)


def bent(seed, **options):
    """The small rig with fields in both devices."""
    one = rig()
    return replace(
        one,
        camera=replace(one.camera, field=field_of(one.camera, seed, **options)),
        projector=replace(one.projector, field=field_of(one.projector, seed + 1, **options)),
    )


def test_a_ray_goes_back_to_its_pixel():
    camera = bent(3).camera
    rng = np.random.default_rng(0)
    pixels = rng.uniform((-20, -20), (660, 530), (500, 2))
    np.testing.assert_allclose(project(camera, 400.0 * rays(camera, pixels)), pixels, atol=1e-9)
    plain = replace(camera, field=None)
    moved = pixels - correction(camera.field, pixels)
    np.testing.assert_allclose(rays(camera, pixels), rays(plain, moved), atol=1e-15)


def test_derivatives_are_those_of_the_projection():
    projector = bent(5).projector
    points = np.random.default_rng(1).uniform((-80, -50, 450), (80, 50, 550), (40, 3))
    pixels, by_point, _ = project_with_derivatives(projector, points)
    np.testing.assert_allclose(pixels, project(projector, points), atol=1e-12)
    for k in range(3):
        step = 1e-4 * np.eye(3)[k]
        ends = [project(projector, points + sign * step) for sign in (1, -1)]
        np.testing.assert_allclose(by_point[..., k], (ends[0] - ends[1]) / 2e-4, atol=2e-6)
    # Beyond the frame the field is constant.
    assert not correction_slope(projector.field, np.array([[-900.0, -900.0]])).any()


@pytest.mark.parametrize("axes", ["x", "y", "xy"])
def test_points_are_those_of_the_oracle(axes):
    device = bent(7)
    if axes == "y":
        # The projector stands above the camera.
        T = look_at(np.array([8.0, 280.0, 0.0]), np.array([0.0, 0.0, 500.0]))
        device = replace(device, T_projector_camera=T)
    h, w = device.camera.shape
    v, u = np.mgrid[:h, :w]
    ray = rays(device.camera, np.stack((u, v), axis=-1).astype(float))
    depth = 500.0 + 15.0 * np.sin(u / 90.0) + 10.0 * np.cos(v / 70.0)
    seen = project(device.projector, transform(device.T_projector_camera, ray * depth[..., None]))
    ones = np.ones((h, w), np.float32)
    maps = {
        axis: CoordinateMap(
            seen[..., k].astype(np.float32),
            NOISE_PX * ones,
            ones,
            ones,
            np.full((h, w), Reason.OK, np.uint8),
            axis,
            (),
        )
        for k, axis in enumerate("xy")
        if axis in axes
    }
    decoded = Decoded(maps.get("x"), maps.get("y"), CameraNoise(0.0, 0.0))
    cloud = triangulate(decoded, device, epipolar_px=0.1)
    inside = np.isfinite(cloud.xyz_mm[..., 2])
    assert inside.mean() > 0.9
    off = cloud.xyz_mm[..., 2] - depth
    # Single precision of coordinates and of rays.
    assert np.abs(off[inside]).max() < 4e-3
    for row, column in ((60, 100), (400, 300), (250, 610)):
        goal = np.array([seen[row, column, k] if a in axes else np.nan for k, a in enumerate("xy")])
        expected = point_of(device, (column, row), goal, np.full(2, NOISE_PX))
        np.testing.assert_allclose(cloud.xyz_mm[row, column], expected, atol=2e-3)
    without = replace(device, projector=replace(device.projector, field=None))
    plain = triangulate(decoded, without, epipolar_px=1.0)
    assert np.nanstd(plain.xyz_mm[..., 2] - depth) > 10 * np.std(off[inside])


def test_sigma_holds_that_of_the_field():
    one = calibrated().rig
    sure, unsure = (
        replace(one, projector=replace(one.projector, field=field_of(one.projector, 1, 0.0, s)))
        for s in (0.0, 0.05)
    )
    x, y = np.meshgrid(np.linspace(-30, 30, 9), np.linspace(-30, 30, 9))
    points = np.stack((x, y, np.full_like(x, 500.0)), axis=-1).reshape(-1, 3)
    none = np.zeros((9, 9))
    cloud = PointCloud(points.reshape(9, 9, 3), none, none, none.astype(np.uint8))
    spread = [np.sum(point_errors(of, points, cloud) ** 2, axis=(1, 2)) for of in (sure, unsure)]
    as_scalar = point_errors(replace(one, structure_px=0.05), points, cloud)
    np.testing.assert_allclose(
        spread[1] - spread[0],
        np.sum(as_scalar**2, axis=(1, 2)) - spread[0],
        rtol=1e-6,
    )


def test_files_keep_fields(tmp_path):
    device = bent(11, sigma_px=0.02)
    again = read_rig(write_rig(tmp_path / "rig.toml", device))
    for one, other in ((device.camera, again.camera), (device.projector, again.projector)):
        assert one.field.first_px == pytest.approx(other.field.first_px)
        np.testing.assert_allclose(one.field.control_px, other.field.control_px, atol=1e-8)
        np.testing.assert_allclose(one.field.sigma_px, other.field.sigma_px, atol=1e-8)
    assert "field" not in write_rig(tmp_path / "plain.toml", rig()).read_text().split("kind =")[1]
    with pytest.raises(InputError, match="camera has a field, which a file of OpenCV cannot hold"):
        write_rig(tmp_path / "rig.xml", device)
    text = (
        (tmp_path / "rig.toml")
        .read_text()
        .replace("columns_px = [\n    [", "columns_px = [\n    [0.0, ", 1)
    )
    (tmp_path / "wrong.toml").write_text(text)
    with pytest.raises(InputError, match="four tables of the same rows and columns"):
        read_rig(tmp_path / "wrong.toml")


@pytest.mark.parametrize("change", [{"region": Region(100, 60, 400, 300)}, {"binning": 2}])
def test_other_frames_look_the_same_way(change):
    device = bent(13)
    other = for_frames(device, **change)
    pixel = np.array([[50.3, 40.7], [120.0, 90.0]])
    region = change.get("region", Region(0, 0, 640, 512))
    factor = change.get("binning", 1)
    before = (pixel + 0.5) * factor - 0.5 + (region.x_px, region.y_px)
    np.testing.assert_allclose(rays(other.camera, pixel), rays(device.camera, before), atol=1e-12)


WRONG = {
    "steps > 0": {"step_px": (0.0, 1.0)},
    "4 control points or more": {
        "control_px": np.zeros((3, 9, 2)),
        "sigma_px": np.zeros((3, 9, 2)),
    },
    "standard deviations >= 0": {"sigma_px": -np.ones((8, 9, 2))},
    "fold the image": {"control_px": np.eye(8, 9)[..., None] * np.ones(2)},
    "finite control points": {"control_px": np.full((8, 9, 2), np.nan)},
}


@pytest.mark.parametrize("message", WRONG)
def test_wrong_fields_are_refused(message):
    good = {"control_px": np.zeros((8, 9, 2)), "sigma_px": np.zeros((8, 9, 2))}
    with pytest.raises(InputError, match=message):
        LensField(**({"first_px": (0.0, 0.0), "step_px": (1.0, 1.0)} | good | WRONG[message]))
