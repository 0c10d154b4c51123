"""Archives are NumPy's, whatever way their members are compressed."""

import io
import zipfile
import zlib

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.npz import write_members
from tests.measured_clouds import a_cloud


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
    xyz = a_cloud((300, 400)).xyz_mm + np.random.default_rng(1).normal(size=(300, 400, 3))
    xyz = xyz.astype(np.float32)
    write_members(tmp_path / "now.npz", {"xyz_mm": xyz})
    with zipfile.ZipFile(tmp_path / "now.npz") as archive:
        member = archive.getinfo("xyz_mm.npy")
        content = archive.read(member)
    how = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, zlib.Z_RLE)
    expected = len(how.compress(content)) + len(how.flush())
    assert member.compress_size == expected
    assert expected < 0.95 * xyz.nbytes


def test_words_that_repeat_are_looked_for(tmp_path):
    alike = {"sigma": np.full((200, 300), 0.0123, np.float32), "empty": np.zeros((0, 3))}
    write_members(tmp_path / "alike.npz", alike)
    assert (tmp_path / "alike.npz").stat().st_size < 3000
    with np.load(tmp_path / "alike.npz", allow_pickle=False) as found:
        assert all(np.array_equal(found[name], alike[name]) for name in alike)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype="<f4").reshape(2, 3, 4),
        np.arange(24, dtype=">f8").reshape(2, 3, 4),
        np.arange(24, dtype=np.uint8).reshape(4, 6)[:, ::2],
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.array([True, False]),
        np.array(3.5),
        np.zeros((0, 3), np.float32),
        np.array("text"),
    ],
    ids=lambda a: f"{a.dtype.str} {a.shape}",
)
def test_a_plain_archive_has_the_bytes_of_numpy(tmp_path, array):
    write_members(tmp_path / "a.npz", {"array": array}, compressed=False)
    expected = io.BytesIO()
    np.lib.format.write_array(expected, array, allow_pickle=False)
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.testzip() is None
        assert archive.read("array.npy") == expected.getvalue()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        np.testing.assert_array_equal(found["array"], array)
