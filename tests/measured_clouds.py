"""Small clouds that have everything a measured one has."""

import numpy as np

from fringeworks.types import PointCloud


def a_cloud(shape=(60, 80), seed=3):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    z = 500 + 0.02 * x + rng.normal(0, 0.01, shape)
    reason = np.where(rng.random(shape) < 0.1, 3, 0).astype(np.uint8)
    xyz = np.stack((0.1 * x, 0.1 * y, z), axis=-1).astype(np.float32)
    xyz[reason > 0] = np.nan
    noise = rng.uniform(0.005, 0.02, shape).astype(np.float32)
    colour = np.rint(rng.uniform(0, 255, shape)).astype(np.float32)
    return PointCloud(
        xyz_mm=xyz,
        sigma_mm=2 * noise,
        noise_mm=noise,
        reason=reason,
        colour=colour,
    )
