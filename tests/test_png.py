"""Grey PNG are read by a kernel of their own: the same counts as Pillow's, and the same refusals."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks import _core


def pixels(shape, kind, seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = np.indices(shape)
    most = np.iinfo(kind).max
    waves = 0.5 * most * (1 + np.cos(columns / 7.0 + rows / 31.0)) + rng.normal(0, most / 60, shape)
    return np.clip(waves, 0, most).astype(kind)


def png_of(values, **options):
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, "PNG", **options)
    return buffer.getvalue()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (67, 131), (240, 320)])
@pytest.mark.parametrize("level", [0, 1, 9])
def test_counts_are_those_that_were_written(kind, shape, level, tmp_path):
    values = pixels(shape, kind)
    content = png_of(values, compress_level=level)
    found = _core.read_grey_png(content)
    assert found is not None
    assert found.dtype == kind
    np.testing.assert_array_equal(found.reshape(shape), values)
    (tmp_path / "frame.png").write_bytes(content)
    frame, notes = fw.files.read_frame(tmp_path / "frame.png")
    assert frame.dtype == kind
    assert frame.dtype.isnative
    assert not notes
    np.testing.assert_array_equal(frame, values)


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def filtered_png(values, kind_of_filter):
    """A PNG whose rows all use one filter, and whose compressed data lie in several chunks."""
    depth = 8 * values.itemsize
    rows = values.astype(values.dtype.newbyteorder(">")).view(np.uint8).reshape(len(values), -1)
    step = values.itemsize
    previous = np.zeros(rows.shape[1], int)
    lines = []
    for row in rows.astype(int):
        left = np.concatenate((np.zeros(step, int), row[:-step]))
        corner = np.concatenate((np.zeros(step, int), previous[:-step]))
        paeth = left + previous - corner
        away = [np.abs(paeth - v) for v in (left, previous, corner)]
        best = np.where(
            (away[0] <= away[1]) & (away[0] <= away[2]),
            left,
            np.where(away[1] <= away[2], previous, corner),
        )
        expected = [0 * row, left, previous, (left + previous) // 2, best][kind_of_filter]
        lines.append(bytes([kind_of_filter]) + ((row - expected) % 256).astype(np.uint8).tobytes())
        previous = row
    packed = zlib.compress(b"".join(lines))
    size = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], depth, 0, 0, 0, 0)
    parts = [packed[k : k + 1000] for k in range(0, len(packed), 1000)]
    data = b"".join(chunk(b"IDAT", part) for part in parts)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + data + chunk(b"IEND", b"")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("kind_of_filter", range(5))
def test_every_filter_of_rows(kind, kind_of_filter):
    values = pixels((40, 53), kind)
    content = filtered_png(values, kind_of_filter)
    np.testing.assert_array_equal(_core.read_grey_png(content).reshape(values.shape), values)


@pytest.mark.parametrize("mode", ["1", "P", "RGB", "RGBA", "LA"])
def test_other_kinds_are_left_to_pillow(mode, tmp_path):
    image = Image.fromarray(pixels((20, 30), np.uint8)).convert(mode)
    image.save(tmp_path / "frame.png")
    assert _core.read_grey_png((tmp_path / "frame.png").read_bytes()) is None
    assert fw.files.read_frame(tmp_path / "frame.png")[0].shape == (20, 30)


def test_damaged_files_are_refused_as_a_whole(tmp_path):
    content = png_of(pixels((60, 80), np.uint8))
    path = tmp_path / "frame.png"
    rng = np.random.default_rng(1)
    middle = content.index(b"IDAT") + 4
    for cut in (len(content) // 2, len(content) - 20, 30, 20):
        path.write_bytes(content[:cut])
        with pytest.raises(fw.FileProblem):
            fw.files.read_frame(path)
    for place in rng.integers(middle, len(content) - 20, 40):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        # The check sum of the data does not hold any more.
        with pytest.raises(fw.FileProblem):
            fw.files.read_frame(path)


def test_a_size_beyond_the_limit_is_refused_before_it_is_allocated(tmp_path):
    size = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    path = tmp_path / "bomb.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IEND", b""))
    with pytest.raises(fw.FileProblem, match="60000 × 60000"):
        fw.files.read_frame(path)
