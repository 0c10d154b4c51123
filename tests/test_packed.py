"""Packed surfaces: every point within σ/8, every reason kept, hostile content refused or kept."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.points import Points
from fringeworks.report.viewer.coding import FINEST_RATIO, coded, deflated, geometric, logarithms
from fringeworks.report.viewer.page import viewer_fragment, viewer_page
from fringeworks.report.viewer.placing import _chebyshev_fit, camera_lattice
from fringeworks.rig.pinhole import rays
from fringeworks.surface.section import organised_points
from tests.oracles.unpacked import unpacked
from tests.surfaces import (
    HOSTILE,
    coordinate_map,
    height_map,
    measured_bust,
    random_cloud,
    small_rig,
    without_values,
)

pytestmark = pytest.mark.statistical


def assert_within(found, points, sigma, reason):
    """Points within σ/8, σ within 1.5 % where the range allows, and the same reasons."""
    np.testing.assert_array_equal(found.reason, reason)
    ok = reason == 0
    error = np.linalg.norm(found.points[ok] - points[ok], axis=-1)
    assert (error <= sigma[ok] / 8).all(), (error / sigma[ok]).max()
    assert np.isnan(found.points[~ok, 2]).all()
    ratio = found.header["sigma"]["ratio"]
    assert (found.low_sigma[ok] <= sigma[ok]).all()
    np.testing.assert_allclose(found.sigma[ok], sigma[ok], rtol=np.sqrt(ratio) - 1 + 1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("on_rays", [True, False])
def test_random_clouds_stay_within_an_eighth_of_sigma(seed, on_rays):
    cloud = random_cloud(seed, on_rays=on_rays)
    packed = fw.report.pack_surface(cloud)
    assert packed.header["points"]["coding"] == ("z" if on_rays else "xyz")
    assert_within(unpacked(packed.data), organised_points(cloud), cloud.sigma_mm, cloud.reason)


@pytest.mark.parametrize("camera", [True, False], ids=["camera given", "camera fitted"])
def test_a_measured_bust(camera):
    measured = measured_bust()
    packed = fw.report.pack_surface(measured, camera=small_rig() if camera else None, title="bust")
    cloud = measured.points
    found = unpacked(packed.data)
    assert packed.header["points"]["coding"] == "z"
    assert_within(found, organised_points(cloud), cloud.sigma_mm, cloud.reason)
    modulation = measured.decoded.maps["x"].modulation
    strong = modulation > np.nanmax(modulation) / 1000
    np.testing.assert_allclose(found.layers["modulation"][strong], modulation[strong], rtol=0.02)
    bright = cloud.colour < np.percentile(cloud.colour, 99)
    step = packed.header["layers"][-1]["factor"]
    error = np.abs(found.layers["texture"][..., 0] - cloud.colour)[bright]
    assert error.max() <= 0.5001 * step
    places = packed.header["points"]["blocks"][0]
    assert sum(size for _, size, _ in places) < 1.0 * packed.header["count"]
    assert len(packed.data) < 2.5 * cloud.reason.size


@pytest.mark.parametrize("pupil", [True, False])
def test_height_maps(pupil):
    surface = height_map(pupil=pupil)
    packed = fw.report.pack_surface(surface)
    assert packed.header["points"]["coding"] == "z"
    assert packed.header["metric"]
    assert_within(unpacked(packed.data), organised_points(surface), surface.sigma, surface.reason)


def test_heights_of_unknown_pitch_and_displacements_are_no_lengths_in_space():
    surface = height_map()
    for other in (
        replace(surface, pitch=None, pupil=None),
        replace(surface, quantity="displacement", unit="px", pitch=1.0, pupil=None),
    ):
        packed = fw.report.pack_surface(other)
        assert not packed.header["metric"]
        assert packed.header["lateral_unit"] == "px"
        assert packed.header["stretch"] == pytest.approx(0.25 * 29 / 5, rel=0.2)


def test_coordinate_maps():
    found = coordinate_map()
    read = unpacked(fw.report.pack_surface(found).data)
    row, column = np.indices(found.reason.shape)
    points = np.stack((column, -row, found.coordinate_px), axis=-1).astype(float)
    assert_within(read, points, found.sigma_px, found.reason)


def test_lists_of_points_and_unknown_sigma_are_exact():
    xyz = np.random.default_rng(0).normal(0, 100, (50, 3))
    single = xyz.astype(np.float32)
    for points, coding in ((single, "float32"), (xyz, "float64")):
        packed = fw.report.pack_surface(Points(points, None))
        assert packed.header["points"]["coding"] == coding
        np.testing.assert_array_equal(unpacked(packed.data).points[0], points)
    cloud = random_cloud(0)
    for sigma in (np.nan, 0.0):
        unknown = replace(cloud, sigma_mm=np.full(cloud.shape, sigma, np.float32))
        found = unpacked(fw.report.pack_surface(unknown).data)
        np.testing.assert_array_equal(found.points, organised_points(unknown))


def test_points_with_sigma_stay_within_an_eighth():
    xyz = np.random.default_rng(0).normal(0, 100, (400, 3))
    sigma = np.random.default_rng(1).uniform(0.01, 1, 400)
    found = unpacked(fw.report.pack_surface(Points(xyz, sigma)).data)
    assert_within(found, xyz[None], sigma[None], np.zeros((1, 400)))


def test_some_unknown_sigma_take_the_finest_step():
    cloud = random_cloud(3)
    sigma = cloud.sigma_mm.copy()
    sigma[::2] = np.nan
    found = unpacked(fw.report.pack_surface(replace(cloud, sigma_mm=sigma)).data)
    ok = cloud.reason == 0
    error = np.linalg.norm(found.points - cloud.xyz_mm, axis=-1)
    assert (error[ok] <= np.where(np.isnan(sigma), np.nanmin(sigma), sigma)[ok] / 8).all()
    assert np.isnan(found.sigma[::2]).all()


def test_deviations_are_as_exact_as_points():
    cloud = random_cloud(1)
    deviation = np.random.default_rng(2).normal(0, 0.3, cloud.shape)
    deviation[5] = np.nan
    found = unpacked(fw.report.pack_surface(cloud, deviation=deviation).data).layers["deviation"]
    known = (cloud.reason == 0) & np.isfinite(deviation)
    assert (np.abs(found - deviation)[known] <= cloud.sigma_mm[known] / 8 * 1.0001).all()
    assert np.isnan(found[~known]).all()
    blind = replace(cloud, sigma_mm=np.full(cloud.shape, np.nan, np.float32))
    found = unpacked(fw.report.pack_surface(blind, deviation=deviation).data).layers["deviation"]
    assert np.abs(found - deviation)[known].max() < 2e-5 * np.ptp(deviation[known])


def test_polynomials_follow_the_rays_of_a_strong_lens():
    lens = (-0.3, 0.12, 1e-3, -5e-4, -0.02)
    camera = fw.rig.Pinhole(640, 480, (620.0, 618.0), (305.0, 251.0), lens)
    for every in (1, 4):
        shape = (480 // every, 640 // every)
        row, column = (every * index.astype(float) for index in np.indices(shape))
        expected = rays(camera, np.stack((column, row), axis=-1))
        found = camera_lattice(shape, camera, every).directions
        assert np.abs(found - expected).max() < 1e-7


@pytest.mark.parametrize("missing", [False, True])
def test_polynomials_of_a_grid_are_those_of_least_squares(missing):
    nodes = np.cos(np.pi * (np.arange(32) + 0.5) / 32)
    values = np.random.default_rng(1).normal(size=(32, 32, 2))
    values[:3, :2] = np.nan if missing else 7.0
    u, v = np.meshgrid(nodes, nodes)
    known = np.isfinite(values[..., 0])
    terms = np.polynomial.chebyshev.chebvander2d(u[known], v[known], [13, 13])
    expected = np.linalg.lstsq(terms, values[known], rcond=None)[0]
    found = _chebyshev_fit(values, nodes).reshape(-1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_every_second_pixel():
    measured = measured_bust()
    found = unpacked(fw.report.pack_surface(measured, camera=small_rig(), every=2).data)
    cloud = measured.points
    points = organised_points(cloud)[::2, ::2]
    assert_within(found, points, cloud.sigma_mm[::2, ::2], cloud.reason[::2, ::2])
    surface = height_map()
    found = unpacked(fw.report.pack_surface(surface, every=3).data)
    points = organised_points(surface)[::3, ::3]
    assert_within(found, points, surface.sigma[::3, ::3], surface.reason[::3, ::3])


def test_colours_keep_their_channels():
    cloud = random_cloud(0)
    colour = np.random.default_rng(0).integers(0, 256, (*cloud.shape, 3)).astype(np.float32)
    found = unpacked(fw.report.pack_surface(replace(cloud, colour=colour)).data).layers["texture"]
    assert np.abs(found - np.minimum(colour, found.max())).max() <= 0.51


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1)])
def test_the_smallest_rasters(shape):
    cloud = random_cloud(0, shape)
    cloud = replace(
        cloud,
        reason=np.zeros(shape, np.uint8),
        xyz_mm=np.ones((*shape, 3), np.float32),
        sigma_mm=np.full(shape, 0.1, np.float32),
    )
    found = unpacked(fw.report.pack_surface(cloud).data)
    assert_within(found, organised_points(cloud), cloud.sigma_mm, cloud.reason)


def test_nothing_but_reasons():
    cloud = without_values(random_cloud(0))
    packed = fw.report.pack_surface(cloud, deviation=np.full(cloud.shape, np.nan))
    assert packed.header["count"] == 0
    np.testing.assert_array_equal(unpacked(packed.data).reason, cloud.reason)


def test_a_point_that_is_no_number_is_masked_and_unknown_reasons_are_refused():
    cloud = random_cloud(0)
    xyz, reason = cloud.xyz_mm.copy(), cloud.reason.copy()
    ok = np.argwhere(reason == 0)
    xyz[tuple(ok[0])] = np.inf
    found = unpacked(fw.report.pack_surface(replace(cloud, xyz_mm=xyz)).data)
    assert found.reason[tuple(ok[0])] == fw.Reason.MASKED
    reason[tuple(ok[1])] = 200
    with pytest.raises(fw.InputError, match="reason: expected values of 0 to 12, got 0 to 200"):
        replace(cloud, reason=reason)


def test_a_hundred_million_points_are_refused_before_anything_is_computed():
    zero = np.zeros((1, 1), np.float32)
    zero.setflags(write=False)
    many = np.broadcast_to(zero, (10_000, 10_000))
    reason = np.broadcast_to(zero.astype(np.uint8), (10_000, 10_000))
    reason.base.setflags(write=False)
    surface = fw.HeightMap(many, many, reason, "height", "mm", 1.0)
    with pytest.raises(fw.InputError, match=r"8,000,000 pixels .* got 100,000,000; .* every = 4"):
        fw.report.pack_surface(surface)


def test_names_and_notes_are_bounded_and_stay_text():
    packed = fw.report.pack_surface(
        random_cloud(0), title=HOSTILE * 10, notes=tuple(f"{k} {HOSTILE}" for k in range(10_000))
    )
    assert len(packed.header["title"]) == 200
    assert packed.header["note_count"] == 10_000
    assert len(packed.header["notes"]) == 201
    assert packed.header["notes"][-1] == "… and 9800 more notes"
    page = viewer_page(packed, title=HOSTILE)
    assert "window.hacked" not in page.replace("&lt;script&gt;window.hacked", "").replace(
        "onerror=&#x27;window.hacked", ""
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"modulation": np.zeros((3, 3))}, r"modulation: expected numbers of shape \(23, 31\)"),
        ({"texture": np.zeros((23, 31, 4))}, "texture: expected numbers of shape"),
        ({"deviation": np.full((23, 31), "a")}, "deviation: expected numbers"),
        ({"every": 0}, "every: expected a whole number of 1 or more"),
        (
            {"camera": small_rig()},
            r"camera: it is for frames of 320 × 256 px, got a cloud of 31 × 23",
        ),
    ],
)
def test_refusals(options, message):
    with pytest.raises(fw.InputError, match=message):
        fw.report.pack_surface(random_cloud(0), **options)


def test_a_camera_that_has_not_seen_the_cloud_is_refused():
    other = replace(small_rig().camera, principal_px=(140.0, 100.0))
    with pytest.raises(fw.RigMismatch, match="rays pass the points at"):
        fw.report.pack_surface(measured_bust(), camera=other)
    with pytest.raises(fw.InputError, match="camera: expected none for a HeightMap"):
        fw.report.pack_surface(height_map(), camera=small_rig())
    with pytest.raises(fw.InputError, match="got str"):
        fw.report.pack_surface("bust")


def test_codes():
    values = np.array([[5.0, np.nan, -7.25], [1e6, 0.0, 3.0]])
    symbols, decoded = coded(values, 0.5, 4.0)
    assert symbols.dtype == np.uint32
    assert symbols[0, 1] == 0
    assert np.abs(decoded - values)[np.isfinite(values)].max() <= 0.25
    with pytest.raises(fw.InputError, match="2³¹ steps"):
        coded(values, 1e-6, 0.0)
    with pytest.raises(fw.InputError, match="factor of 1e.60, got 1e-300 to 1e.300"):
        logarithms(np.array([1e-300, 1e300]), bounded=True)
    codes, table = logarithms(np.array([1e-6, 1.0, 1e6]), bounded=True)
    assert (table[codes] <= [1e-6, 1.0, 1e6]).all()
    assert codes.max() < 256
    codes, _ = logarithms(np.array([0.0, 1.0, np.nan, -1.0]), bounded=False)
    assert codes.tolist() == [0, 0, -1, -1]
    assert geometric(2.0, FINEST_RATIO)[1] == 2.0 * FINEST_RATIO
    assert len(deflated(bytes(10_000))) < 50


def test_the_header_says_its_length():
    packed = fw.report.pack_surface(random_cloud(0))
    (size,) = struct.unpack("<I", packed.data[8:12])
    assert packed.data[12 : 12 + size].decode().startswith("{")


def test_fragments_hold_one_or_two_surfaces():
    packed = fw.report.pack_surface(random_cloud(0))
    assert viewer_fragment(packed, packed).count("<script") == 2
    for wrong in ((), (packed,) * 3):
        with pytest.raises(fw.InputError, match="expected one or two"):
            viewer_fragment(*wrong)
