"""Points as ROS 2 bags, read back by the package that ROS users read them with."""

from __future__ import annotations

from dataclasses import replace

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
    assert (message.height, message.width) == (H, W)
    assert message.row_step * H == len(message.data)
    assert not message.is_dense
    assert message.header.frame_id == "camera"
    assert message.header.stamp.sec > 1e9
    fields = [f.name for f in message.fields]
    table = message.data.view([(name, "<f4") for name in fields])
    assert message.point_step == table.itemsize
    ok = cloud.reason == 0
    table = table.reshape(H, W)
    assert np.array_equal(np.isfinite(table["x"]), ok)
    table = table[ok]
    for k, name in enumerate("xyz"):
        assert np.allclose(table[name], cloud.xyz_mm[ok][:, k] * 1e-3, rtol=1e-6)
    assert np.allclose(table["sigma"], cloud.sigma_mm[ok] * 1e-3, rtol=1e-6)
    assert ("nz" in fields) == (kind == "normals")


def test_a_bag_names_the_frame_and_the_time_of_the_cloud(tmp_path):
    cloud = cloud_of(np.full((H, W), 500.0))
    made = fw.Provenance("measure", date="2026-03-04T05:06:07Z")
    moved = replace(cloud, provenance=made).transformed(np.eye(4), frame="base")
    fw.files.write_points(tmp_path / "part.mcap", moved, kind="frame")
    _, message = read_bag(tmp_path / "part.mcap")
    assert message.header.frame_id == "base"
    assert message.header.stamp.sec == 1772600767
    assert message.is_dense


def test_triangles_have_no_place_in_a_bag(tmp_path):
    with pytest.raises(fw.InputError, match="MCAP cannot hold"):
        fw.files.write_points(tmp_path / "part.mcap", cloud_of(np.full((H, W), 500.0)), kind="mesh")
    assert not list(tmp_path.iterdir())
