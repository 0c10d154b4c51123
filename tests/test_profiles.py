"""Profiles along a line of pixels, and differences of two surfaces."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.surface.section import pixels_on_line
from fringeworks.types import CameraNoise, CoordinateMap, Decoded, PointCloud, Reason
from tests.surfaces import heights, plane_cloud


def test_pixels_are_the_nearest_to_the_line():
    assert pixels_on_line(((1, 1), (4, 2)), (5, 6)).tolist() == [[1, 1], [2, 1], [3, 2], [4, 2]]
    back = pixels_on_line(((4, 2), (1, 1)), (5, 6))
    assert back[0].tolist() == [4, 2]
    assert back[-1].tolist() == [1, 1]
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b = rng.integers(0, 40, (2, 2))
        if (a == b).all():
            continue
        found = pixels_on_line((tuple(a), tuple(b)), (40, 40))
        assert len(found) == np.abs(b - a).max() + 1
        assert len(np.unique(found, axis=0)) == len(found)
        u = (b - a) / np.linalg.norm(b - a)
        off = np.abs((found - a) @ np.array([-u[1], u[0]]))
        assert off.max() <= 0.5


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (((0, 0), (3, 0)), "frame of 3 × 2, got"),
        (((0, -1), (2, 0)), "frame of 3 × 2, got"),
        (((1, 1), (1, 1)), "two different pixels"),
        (((0.5, 0), (2, 0)), "whole pixels"),
        ((0, 0), "whole pixels"),
    ],
)
def test_lines_that_are_none(line, message):
    with pytest.raises(fw.InputError, match=message):
        heights(np.zeros((2, 3))).profile(line)


def test_nothing_is_mixed_over_a_cliff_and_gaps_stay_gaps():
    values = np.zeros((9, 20))
    values[:, 10:] = 50.0
    values[4, 5] = np.nan
    found = heights(values).profile(((0, 2), (19, 6)))
    measured = found.values[np.isfinite(found.values)]
    assert set(measured.tolist()) <= {0.0, 50.0}
    row = heights(values).profile(((0, 4), (19, 4)))
    assert np.flatnonzero(np.isnan(row.values)).tolist() == [5]
    assert row.reason[5] == Reason.SHADOW
    assert np.isnan(row.sigma[5])
    assert row.failed_fraction == 1 / 20
    assert row.along_mm[[0, 4, 6, 19]].tolist() == [0.0, 8.0, 12.0, 38.0]
    assert np.isnan(row.along_mm[5])


def test_distances_of_a_slanted_line():
    found = heights(np.zeros((31, 41))).profile(((0, 0), (40, 30)))
    assert found.along_px[-1] == pytest.approx(50.0)
    assert found.along_mm[-1] == pytest.approx(100.0)
    assert len(found.values) == 41


def test_a_levelled_plane_is_flat_and_as_long_as_it_is():
    cloud = plane_cloud()
    line = ((2, 3), (38, 3))
    plain, flat = cloud.profile(line), cloud.profile(line, level=True)
    assert np.allclose(plain.values, cloud.xyz_mm[3, 2:39, 2])
    assert np.abs(flat.values).max() < 1e-9
    ends = cloud.xyz_mm[3, 38] - cloud.xyz_mm[3, 2]
    assert flat.along_mm[-1] == pytest.approx(np.linalg.norm(ends))
    assert plain.along_mm[-1] == pytest.approx(np.linalg.norm(ends[:2]))
    assert flat.levelled
    assert flat.quantity == "height over the line"


def test_levelling_is_that_of_a_ruler_on_the_surface():
    """Heights by the formula of elementary geometry: the distance from the chord."""
    y, x = np.mgrid[:31, :41].astype(float)
    dome = heights(0.5 * x + 8 * np.exp(-((x - 20) ** 2 + (y - 15) ** 2) / 50))
    found = dome.profile(((5, 15), (35, 15)), level=True)
    points = np.column_stack((2.0 * np.arange(5, 36), dome.values[15, 5:36]))
    chord = points[-1] - points[0]
    normal = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    assert np.allclose(found.values, (points - points[0]) @ normal)
    assert found.values.max() > 6


def test_sigma_of_points_is_the_scatter_of_their_depth_and_height():
    """σ along the ray, projected: held by 4,000 disturbed samples, with exact ends."""
    cloud, sigma = plane_cloud(normal=(0.6, 0.0, -1.0)), 0.05
    rng = np.random.default_rng(1)
    line = ((0, 2), (40, 2))
    plain, flat = cloud.profile(line), cloud.profile(line, level=True)
    ray = cloud.xyz_mm / np.linalg.norm(cloud.xyz_mm, axis=-1, keepdims=True)
    depths, levelled = [], []
    for _ in range(4000):
        error = rng.normal(0, sigma, cloud.shape)[..., None]
        error[2, [0, 40]] = 0.0
        noisy = PointCloud(cloud.xyz_mm + error * ray, cloud.sigma_mm, cloud.noise_mm, cloud.reason)
        depths.append(noisy.profile(line).values)
        levelled.append(noisy.profile(line, level=True).values)
    inner = slice(1, -1)
    assert np.allclose(np.std(depths, axis=0)[inner], plain.sigma[inner], rtol=0.06)
    assert np.allclose(np.std(levelled, axis=0)[inner], flat.sigma[inner], rtol=0.06)
    assert (plain.sigma < sigma).all()


def test_sigma_of_heights_on_rays():
    """Levelled heights of a map with a pupil change by their rays, not straight up."""
    x = np.tile(np.arange(41.0), (11, 1))
    pupil = (0.0, 5.0, 50.0)
    values = (1.2 * x).astype(np.float32)
    line = ((0, 5), (40, 5))
    first = heights(values, pitch=1.0, pupil=pupil).profile(line, level=True)
    shift = np.zeros_like(values)
    shift[5, 20] = 0.01
    moved = heights(values + shift, pitch=1.0, pupil=pupil).profile(line, level=True)
    assert abs(moved.values - first.values)[20] == pytest.approx(first.sigma[20], rel=2e-3)


def test_gaps_at_the_ends():
    hole = np.zeros((31, 41), bool)
    hole[:, :6] = True
    found = plane_cloud(hole=hole).profile(((0, 10), (40, 10)), level=True)
    assert np.isnan(found.values[:6]).all()
    assert found.along_mm[6] == 0.0
    assert np.nanmax(np.abs(found.values)) < 1e-9
    hole[:] = True
    with pytest.raises(fw.InputError, match="two or more measured pixels"):
        plane_cloud(hole=hole).profile(((0, 10), (40, 10)), level=True)
    assert np.isnan(plane_cloud(hole=hole).profile(((0, 10), (40, 10))).along_mm).all()


def coordinates(axis):
    reason = np.zeros((4, 6), np.uint8)
    x = np.tile(np.arange(6.0), (4, 1))
    flat = np.full((4, 6), 0.1)
    return CoordinateMap(x, flat, flat, flat, reason, axis, (20.0,))


def test_maps_without_a_scale():
    one = coordinates("x")
    both = Decoded(one, coordinates("y"), CameraNoise(1.0, 0.0))
    found = both.profile(((0, 0), (5, 0)), axis="x")
    assert found == one.profile(((0, 0), (5, 0)))
    assert found.values.tolist() == [0, 1, 2, 3, 4, 5]
    assert found.along_mm is None
    assert Decoded(one, None, CameraNoise(1.0, 0.0)).profile(((0, 0), (5, 0))) == found
    with pytest.raises(fw.InputError, match="axis: expected 'x' or 'y', got None"):
        both.profile(((0, 0), (5, 0)))
    with pytest.raises(fw.InputError, match="level: expected points, or heights"):
        one.profile(((0, 0), (5, 0)), level=True)
    no_pitch = heights(np.zeros((4, 6)), pitch=None)
    assert no_pitch.profile(((0, 0), (5, 0))).along_mm is None


def test_difference_of_clouds_is_along_the_ray():
    one = plane_cloud()
    ray = one.xyz_mm / np.linalg.norm(one.xyz_mm, axis=-1, keepdims=True)
    other = PointCloud(one.xyz_mm + 0.3 * ray, one.sigma_mm, one.noise_mm, one.reason)
    values, sigma = fw.surface.difference(one, other)
    assert np.allclose(values, 0.3)
    assert np.allclose(sigma, 0.05 * np.sqrt(2))
    with pytest.raises(fw.InputError, match="two point clouds or two height maps"):
        fw.surface.difference(one, heights(np.zeros((31, 41))))
    with pytest.raises(fw.InputError, match="same pitch twice, got 2.0 and 1.0"):
        fw.surface.difference(heights(np.zeros((2, 2))), heights(np.zeros((2, 2)), pitch=1.0))
