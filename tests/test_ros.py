"""Points as ROS 2 bags, read back by the package that ROS users read them with."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from tests.surfaces import H, W, cloud_of

pytest.importorskip("rosbags")


def read_bag(path):
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        ((connection, _, raw),) = list(reader.messages())
        return connection.topic, store.deserialize_cdr(raw, connection.msgtype)


@pytest.mark.parametrize("kind", ["points", "normals"])
def test_a_bag_holds_the_points_in_metres(tmp_path, kind):
    depth = np.full((H, W), 500.0)
    depth[:5] = np.nan
    cloud = cloud_of(depth)
    path = tmp_path / "part.mcap"
    fw.files.write_points(path, cloud, kind=kind)
    assert [p.name for p in tmp_path.iterdir()] == ["part.mcap"]
    topic, message = read_bag(path)
    assert topic == "/points"
    assert message.width * message.height == np.count_nonzero(cloud.reason == 0)
    fields = [f.name for f in message.fields]
    table = message.data.view([(name, "<f4") for name in fields])
    assert message.point_step == table.itemsize
    ok = cloud.reason == 0
    for k, name in enumerate("xyz"):
        assert np.allclose(table[name], cloud.xyz_mm[ok][:, k] * 1e-3, rtol=1e-6)
    assert np.allclose(table["sigma"], cloud.sigma_mm[ok] * 1e-3, rtol=1e-6)
    assert ("nz" in fields) == (kind == "normals")


def test_triangles_have_no_place_in_a_bag(tmp_path):
    with pytest.raises(fw.InputError, match="MCAP cannot hold"):
        fw.files.write_points(tmp_path / "part.mcap", cloud_of(np.full((H, W), 500.0)), kind="mesh")
    assert not list(tmp_path.iterdir())
