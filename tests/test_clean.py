"""Cleaning of clouds: what no surface supports goes, the surface stays."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from tests.surfaces import H, W, cloud_of


@pytest.mark.parametrize("seed", range(3))
def test_mixed_pixels_between_two_depths_go_and_both_surfaces_stay(seed):
    rng = np.random.default_rng(seed)
    depth = np.full((H, W), 500.0)
    depth[:, 40:] = 540.0
    # Each row has one or two pixels anywhere between front and back, as an edge gives them.
    mixed = np.zeros((H, W), bool)
    for row in range(H):
        width = rng.integers(1, 3)
        mixed[row, 40 : 40 + width] = True
        depth[row, 40 : 40 + width] = np.sort(rng.uniform(505, 535, width))
    found = fw.surface.clean_cloud(cloud_of(depth + rng.normal(0, 0.02, depth.shape)))
    kept = found.reason == fw.Reason.OK
    assert np.mean(kept[mixed]) < 0.1
    assert kept[:, :39].all()
    assert kept[:, 43:].all()
    assert (found.reason[mixed & ~kept] == fw.Reason.ISOLATED).all()


def test_specks_go_and_points_before_the_surface_do():
    depth = np.full((H, W), np.nan)
    depth[:, :50] = 500.0
    depth[10:14, 60:64] = 500.0
    depth[30, 20] = 400.0
    found = fw.surface.clean_cloud(cloud_of(depth))
    assert (found.reason[10:14, 60:64] == fw.Reason.ISOLATED).all()
    assert found.reason[30, 20] == fw.Reason.ISOLATED
    assert np.isnan(found.xyz_mm[30, 20]).all()
    assert np.isnan(found.sigma_mm[30, 20])
    lost = (found.reason != fw.Reason.OK) & np.isfinite(depth)
    assert np.count_nonzero(lost) == 16 + 1
    assert (
        fw.surface.clean_cloud(cloud_of(depth), min_island_px=10).reason[10:14, 60:64] == 0
    ).all()


def test_steep_but_real_surfaces_stay():
    slope = np.tan(np.radians(75.0)) / 500  # change of depth per px at 500 mm, near enough
    depth = 500.0 * (1 + slope * (np.arange(W) - W / 2))[None, :] * np.ones((H, 1))
    assert (fw.surface.clean_cloud(cloud_of(depth)).reason == fw.Reason.OK).all()


def test_large_sigmas_go():
    cloud = cloud_of(np.full((H, W), 500.0))
    assert (fw.surface.clean_cloud(cloud, max_sigma_mm=0.01).reason == fw.Reason.ISOLATED).all()
    assert (fw.surface.clean_cloud(cloud, max_sigma_mm=0.03).reason == fw.Reason.OK).all()


def test_crops_keep_what_is_inside():
    cloud = cloud_of(np.full((H, W), 500.0))
    x = cloud.xyz_mm[..., 0]
    box = [[-10.0, -np.inf, 0.0], [10.0, np.inf, 600.0]]
    boxed = fw.surface.crop_cloud(cloud, box_mm=box)
    assert ((boxed.reason == fw.Reason.OK) == (np.abs(x) <= 10)).all()
    assert (boxed.reason[np.abs(x) > 10] == fw.Reason.MASKED).all()
    side = fw.surface.crop_cloud(cloud, plane=([5.0, 0.0, 0.0], [2.0, 0.0, 0.0]))
    assert ((side.reason == fw.Reason.OK) == (x >= 5)).all()
    mask = np.zeros((H, W), bool)
    mask[5:9] = True
    both = fw.surface.crop_cloud(boxed, mask=mask)
    assert ((both.reason == fw.Reason.OK) == (mask & (np.abs(x) <= 10))).all()


def test_what_had_no_point_keeps_its_reason():
    depth = np.full((H, W), 500.0)
    depth[:, :10] = np.nan
    cloud = cloud_of(depth)
    for found in (
        fw.surface.clean_cloud(cloud),
        fw.surface.crop_cloud(cloud, mask=np.zeros((H, W), bool)),
    ):
        assert (found.reason[:, :10] == fw.Reason.SHADOW).all()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda c: fw.surface.clean_cloud(c, min_island_px=0), "min_island_px: expected 1 or more"),
        (lambda c: fw.surface.clean_cloud(c, max_sigma_mm=0.0), "max_sigma_mm: expected > 0"),
        (lambda c: fw.surface.crop_cloud(c, box_mm=np.zeros((2, 3))), "box_mm: expected smallest"),
        (lambda c: fw.surface.crop_cloud(c, plane=([0, 0, 0], [0, 0, 0])), "plane: expected"),
        (lambda c: fw.surface.crop_cloud(c, mask=np.ones((2, 2), bool)), "mask: expected bool"),
    ],
)
def test_wrong_limits_are_refused(call, said):
    with pytest.raises(fw.InputError, match=said):
        call(cloud_of(np.full((H, W), 500.0)))
