"""Captures in: folders, image pairs, .npz and .mat; each fault is one clear sentence."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import scipy.io
import tifffile
from PIL import Image

from fringeworks import FileProblem, InputError, MissingPackage, Pair
from fringeworks.files import file_limits, read_capture, read_pair, write_pair
from fringeworks.files.atomic import replacing
from fringeworks.files.images import read_frame, read_frames, write_frame
from tests.conftest import scene


def save(path, array):
    Image.fromarray(array).save(path)
    return path


@pytest.fixture
def grey():
    return np.arange(40 * 50, dtype=np.uint16).reshape(40, 50).astype(np.uint8)


@pytest.mark.parametrize("bits", [0, 8, 16])
def test_round_trip(tmp_path, bits):
    original = scene("parabola", size=64, fringes=4, bits=bits, axis="y", sign=-1)
    mask = np.zeros((64, 64), bool)
    mask[5:50] = True
    masked = Pair(**{**vars(original), "mask": mask})
    description = write_pair(tmp_path / "c", masked)
    assert description.name == "capture.toml"
    found = read_capture(tmp_path / "c")
    for name in ("reference", "object", "mask", "truth_mm"):
        np.testing.assert_array_equal(getattr(found, name), getattr(masked, name))
        assert getattr(found, name).dtype == getattr(masked, name).dtype
    assert (found.axis, found.geometry) == ("y", original.geometry)


def test_minimal_toml_written_by_hand(tmp_path, grey):
    save(tmp_path / "a.png", grey)
    save(tmp_path / "b.png", grey)
    text = 'kind = "pair"\n[frames]\nreference = "a.png"\nobject = "b.png"\n'
    (tmp_path / "capture.toml").write_text(text)
    found = read_capture(tmp_path)
    assert found.axis is None
    assert found.geometry is None
    assert found.mask is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind = ", "expected TOML"),
        ('kind = "pair"\n', "missing key frames"),
        ('kind = "film"\n[frames]\nreference="a.png"\nobject="a.png"', "kind: .*'film'"),
        ('kind = "stack"\n[frames]\nreference="a.png"\nobject="a.png"', "frames"),
        (
            'kind="pair"\ncolour=1\n[frames]\nreference="a.png"\nobject="a.png"',
            "unknown key colour",
        ),
        (
            'kind="pair"\n[frames]\nreference="a.png"\nobject="a.png"\ndark="d.png"',
            "unknown key frames.dark",
        ),
        ('kind="pair"\naxis="z"\n[frames]\nreference="a.png"\nobject="a.png"', "axis: "),
        (
            'kind="pair"\n[frames]\nreference="a.png"\nobject="missing.png"',
            "missing.png: expected an image",
        ),
        (
            'kind="pair"\nmask="small.png"\n[frames]\nreference="a.png"\nobject="a.png"',
            "mask: expected shape",
        ),
        (
            'kind="pair"\n[frames]\nreference="a.png"\nobject="a.png"\n[geometry]\ndistance_mm=-1\nbaseline_mm=1\npitch_mm_per_px=1',
            "distance_mm > 0",
        ),
    ],
)
def test_faults_in_a_folder(tmp_path, grey, text, message):
    save(tmp_path / "a.png", grey)
    save(tmp_path / "small.png", grey[:5])
    (tmp_path / "capture.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_capture(tmp_path)


def test_places_that_hold_no_capture(tmp_path):
    with pytest.raises(InputError, match="expected a file capture.toml"):
        read_capture(tmp_path)
    with pytest.raises(InputError, match="got nothing there"):
        read_capture(tmp_path / "nowhere")
    other = tmp_path / "x.csv"
    other.write_text("1")
    with pytest.raises(InputError, match=r"got \.csv"):
        read_capture(other)


def test_sizes_that_differ(tmp_path, grey):
    a, b = save(tmp_path / "a.png", grey), save(tmp_path / "b.png", grey[:, :-1])
    with pytest.raises(
        InputError, match=r"equal sizes, got 50 × 40 in a\.png and 49 × 40 in b\.png"
    ):
        read_pair(a, b)


def test_colour_is_converted_and_said(tmp_path, grey):
    equal = np.dstack([grey] * 3)
    frame, notes = read_frame(save(tmp_path / "equal.png", equal))
    np.testing.assert_array_equal(frame, grey)
    assert frame.dtype == np.uint8
    assert "taken as grey" in notes[0]
    colour = np.dstack([grey, 255 - grey, grey // 2])
    frame, notes = read_frame(save(tmp_path / "colour.png", colour))
    np.testing.assert_allclose(frame, colour @ [0.299, 0.587, 0.114], rtol=1e-6)
    assert "luminance" in notes[0]
    opaque = np.dstack([equal, np.full_like(grey, 255)])
    assert read_frame(save(tmp_path / "rgba.png", opaque))[0].dtype == np.uint8
    glass = np.dstack([equal, grey])
    with pytest.raises(InputError, match="transparency"):
        read_frame(save(tmp_path / "glass.png", glass))


def test_depths_are_kept(tmp_path):
    deep = (np.arange(40 * 50, dtype=np.uint16) * 30).reshape(40, 50)
    for name, frame in (("a.png", deep), ("b.tif", deep), ("c.tif", deep.astype(np.float32) / 7)):
        write_frame(tmp_path / name, frame)
        found, notes = read_frame(tmp_path / name)
        np.testing.assert_array_equal(found, frame)
        assert found.dtype == frame.dtype
        assert notes == ()


def test_sixteen_bit_colour_png_is_refused(tmp_path, grey):
    path = save(tmp_path / "deep.png", np.dstack([grey] * 3))
    content = bytearray(path.read_bytes())
    content[24] = 16  # claim a depth of 16 bits; the reader must stop at the header
    path.write_bytes(content)
    with pytest.raises(InputError, match="16-bit colour"):
        read_frame(path)


def test_unreadable_images(tmp_path, grey):
    whole = save(
        tmp_path / "whole.png", np.random.default_rng(0).integers(0, 255, (90, 90), np.uint8)
    )
    truncated = tmp_path / "truncated.png"
    truncated.write_bytes(whole.read_bytes()[:3000])
    empty = tmp_path / "empty.png"
    empty.touch()
    text = tmp_path / "text.jpg"
    text.write_text("this is no image")
    broken = tmp_path / "broken.tif"
    broken.write_bytes(b"II*\0garbage")
    stack = tmp_path / "stack.tif"
    tifffile.imwrite(stack, np.zeros((7, 8, 9), np.uint8))
    for path, message in (
        (truncated, "truncated.png: expected a readable image"),
        (empty, "got an empty file"),
        (text, "text.jpg: expected a readable image"),
        (broken, "broken.tif: expected a readable TIFF"),
        (stack, "expected one grey or colour image"),
        (tmp_path / "none.png", "no such file"),
        (save(tmp_path / "x.gif", grey), r"got \.gif"),
    ):
        with pytest.raises(InputError, match=message):
            read_frame(path)


def test_npz(tmp_path):
    original = scene("parabola", size=64, fringes=4)
    path = tmp_path / "c.npz"
    np.savez(path, reference=original.reference, object=original.object, truth_mm=original.truth_mm)
    found = read_capture(path)
    np.testing.assert_array_equal(found.object, original.object)
    np.testing.assert_array_equal(found.truth_mm, original.truth_mm)
    np.savez(path, reference=original.reference)
    with pytest.raises(InputError, match="an array named object, got reference"):
        read_capture(path)
    path.write_bytes(b"PK nonsense")
    with pytest.raises(InputError, match="expected a pair of frames"):
        read_capture(path)


def test_matlab_version_5(tmp_path):
    original = scene("parabola", size=64, fringes=4, gamma=2.2)
    path = tmp_path / "SGamma2.2Parabola.mat"
    scipy.io.savemat(path, {"S": original.reference, "D": original.object})
    found = read_capture(path)
    np.testing.assert_array_equal(found.reference, original.reference)
    scipy.io.savemat(path, {"S": original.reference, "D": original.object[:-1]})
    with pytest.raises(InputError, match="equal sizes"):
        read_capture(path)
    scipy.io.savemat(path, {"S": original.reference, "E": 3.0})
    with pytest.raises(InputError, match="expected a variable D, got S, E"):
        read_capture(path)
    scipy.io.savemat(path, {"S": "text", "D": original.object})
    with pytest.raises(InputError, match="expected S as a real"):
        read_capture(path)


def test_matlab_frames_in_two_files(tmp_path):
    original = scene("parabola", size=64, fringes=4, gamma=2.2)
    a, b = tmp_path / "SGamma2.2Parabola.mat", tmp_path / "DGamma2.2Parabola.mat"
    scipy.io.savemat(a, {"S": original.reference})
    scipy.io.savemat(b, {"D": original.object})
    found = read_pair(a, b)
    np.testing.assert_array_equal(found.reference, original.reference)
    np.testing.assert_array_equal(found.object, original.object)
    with pytest.raises(InputError, match="expected a variable S, got D"):
        read_pair(b, a)


def test_matlab_version_7_3(tmp_path):
    import h5py

    original = scene("step", size=64, fringes=4)
    path = tmp_path / "pair.mat"
    with h5py.File(path, "w") as file:  # MATLAB's order: transposed
        file["S"], file["D"] = original.reference.T, original.object.T
    found = read_capture(path)
    np.testing.assert_array_equal(found.object, original.object)
    path.write_bytes(b"MATLAB 7.3 nothing")
    with pytest.raises(InputError, match="readable .mat"):
        read_capture(path)


def test_matlab_version_7_3_needs_a_package(tmp_path, monkeypatch):
    path = tmp_path / "pair.mat"
    path.write_bytes(b"\x89HDF\r\n\x1a\n")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingPackage, match=r"h5py for a file .* 'fringeworks\[matlab\]'"):
        read_capture(path)


def test_files_appear_whole_or_not_at_all(tmp_path):
    path = tmp_path / "result.bin"
    path.write_bytes(b"before")

    class PowerCutError(Exception):
        pass

    with pytest.raises(PowerCutError), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise PowerCutError
    assert path.read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == ["result.bin"]
    with replacing(path) as temporary:
        temporary.write_bytes(b"after")
    assert path.read_bytes() == b"after"
    with (
        pytest.raises(InputError, match="expected a writable folder"),
        replacing(tmp_path / "missing" / "x"),
    ):
        pass


def test_images_that_are_read_side_by_side_keep_order_and_limits(tmp_path):
    paths = [tmp_path / f"{k}.png" for k in range(7)]
    for k, path in enumerate(paths):
        write_frame(path, np.full((40, 50), k, np.uint8))
    assert [frame[0, 0] for frame in read_frames(paths, stack=True).frames] == list(range(7))
    with file_limits(max_gb=1e-6), pytest.raises(FileProblem, match=r"0\.png"):
        read_frames(paths, stack=True)
    paths[3].write_bytes(b"")
    paths[5].write_bytes(b"")
    with pytest.raises(FileProblem, match=r"3\.png: expected an image, got an empty file"):
        read_frames(paths, stack=True)
