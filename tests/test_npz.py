"""Archives are NumPy's, whatever way their members are compressed."""

import zipfile
import zlib

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.npz import write_members
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


def test_plain_numpy_reads_every_array(tmp_path):
    cloud = a_cloud()
    fw.files.write_points(tmp_path / "cloud.npz", cloud)
    with np.load(tmp_path / "cloud.npz", allow_pickle=False) as found:
        for name in ("xyz_mm", "sigma_mm", "noise_mm", "reason", "colour"):
            assert found[name].tobytes() == getattr(cloud, name).tobytes(), name
        assert all(found[name].dtype.kind != "O" for name in found.files)
    with zipfile.ZipFile(tmp_path / "cloud.npz") as archive:
        assert archive.testzip() is None
    assert fw.files.read_cloud(tmp_path / "cloud.npz") == cloud


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_archives_of_earlier_versions_are_read(save, tmp_path):
    cloud = a_cloud()
    names = ("xyz_mm", "sigma_mm", "noise_mm", "reason", "colour")
    arrays = {name: getattr(cloud, name) for name in names}
    save(tmp_path / "old.npz", findings=np.array("[]"), **arrays)
    assert fw.files.read_cloud(tmp_path / "old.npz") == cloud


def test_floats_are_compressed_without_looking_for_repeats(tmp_path):
    xyz = a_cloud((300, 400)).xyz_mm
    write_members(tmp_path / "now.npz", {"xyz_mm": xyz})
    with zipfile.ZipFile(tmp_path / "now.npz") as archive:
        member = archive.getinfo("xyz_mm.npy")
        content = archive.read(member)
    how = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, zlib.Z_RLE)
    expected = len(how.compress(content)) + len(how.flush())
    assert member.compress_size == expected
    assert expected < 0.95 * xyz.nbytes
