"""Vertices that the kernel packs are those of NumPy, byte by byte."""

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import _core
from fringeworks.files.point_table import PointTable
from fringeworks.files.white import WHITE, eight_bits, white_of
from fringeworks.types import Reason
from tests.measured_clouds import a_cloud


def by_numpy(cloud):
    """The vertices of a cloud by one structured array: the correct twin."""
    ok = cloud.reason == Reason.OK
    fields = [(name, "<f4") for name in ("x", "y", "z", "sigma", "noise")]
    if cloud.colour is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
    found = np.empty(int(ok.sum()), fields)
    found["x"], found["y"], found["z"] = cloud.xyz_mm[ok].T
    found["sigma"], found["noise"] = cloud.sigma_mm[ok], cloud.noise_mm[ok]
    if cloud.colour is not None:
        seen = np.asarray(cloud.colour)[ok]
        found["red"], found["green"], found["blue"] = eight_bits(seen, white_of(seen)).T
    return found.tobytes()


def coloured(cloud, rng):
    colour = rng.uniform(-5, 300, (*cloud.shape, 3)).astype(np.float32)
    colour[2, 3], colour[4, 5, 1], colour[6, 7, 0] = np.nan, np.inf, -np.inf
    return replace(cloud, colour=colour)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["grey", "colour", "none", "whole", "double"])
def test_the_kernel_packs_the_bytes_of_numpy(kind, seed):
    rng = np.random.default_rng(seed)
    cloud = a_cloud((70 + seed, 33), seed)
    if kind == "colour":
        cloud = coloured(cloud, rng)
    elif kind == "none":
        cloud = replace(cloud, colour=None)
    elif kind == "whole":
        cloud = replace(a_cloud((64, 48), seed), reason=np.zeros((64, 48), np.uint8))
        cloud = replace(cloud, xyz_mm=np.nan_to_num(cloud.xyz_mm))
    elif kind == "double":  # another precision goes by NumPy
        cloud = replace(cloud, colour=np.asarray(cloud.colour, np.float64) * 1.001)
    packed = b"".join(part.tobytes() for part in PointTable(cloud).parts())
    assert packed == by_numpy(cloud)


def test_shapes_that_do_not_fit_are_refused():
    flat, one = np.zeros((2, 9), np.float32), np.zeros((2, 3), np.float32)
    reason = np.zeros((2, 3), np.uint8)
    assert len(_core.pack_vertices(flat, one, one, reason)) == 6 * 20
    assert len(_core.pack_vertices(flat, one, one, reason, one, scale=WHITE)) == 6 * 23
    for wrong in (
        (one, one, one, reason),
        (flat, one[:1].copy(), one, reason),
        (flat, one, one, reason[:, :2].copy()),
        (flat, one, one, reason, flat[:, :6].copy()),
    ):
        with pytest.raises(ValueError, match="expected shape"):
            _core.pack_vertices(*wrong)
    with pytest.raises(ValueError, match="scale"):
        _core.pack_vertices(flat, one, one, reason, one, scale=-1.0)
