"""Frames as WebP, PGM and PPM, and as raw files and HEIF where their packages are installed."""

import sys
import tracemalloc
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.files.bayer_image import BayerImage
from fringeworks.files.images import read_frame, read_frames

GREY = (np.arange(20 * 24).reshape(20, 24) % 251).astype(np.uint8)


@pytest.mark.parametrize("lossless", [True, False])
def test_webp(tmp_path, lossless):
    path = tmp_path / "a.webp"
    Image.fromarray(GREY).save(path, lossless=lossless)
    found = read_frames([path], stack=True)
    assert found.lossy is not lossless
    assert np.abs(found.frames[0].astype(int) - GREY).max() <= (0 if lossless else 60)


def test_a_webp_with_metadata_is_still_lossless(tmp_path):
    path = tmp_path / "a.webp"
    Image.fromarray(GREY).save(path, lossless=True, icc_profile=b"x" * 33)
    assert not read_frames([path], stack=True).lossy


def test_moving_pictures_are_refused(tmp_path):
    path = tmp_path / "a.webp"
    Image.fromarray(GREY).save(path, save_all=True, append_images=[Image.fromarray(255 - GREY)])
    with pytest.raises(fw.FileProblem, match="expected one image, got 2 in one file"):
        read_frame(path)


@pytest.mark.parametrize("largest", [255, 4095, 65535])
@pytest.mark.parametrize("colour", [False, True])
def test_pgm_and_ppm_keep_their_counts(tmp_path, largest, colour):
    """Pillow would stretch 12 bits to 16."""
    kind = np.dtype(np.uint8 if largest < 256 else ">u2")
    counts = (np.linspace(0, largest, GREY.size).reshape(GREY.shape)).astype(kind)
    stored = np.stack((counts,) * 3, axis=-1).astype(kind) if colour else counts
    path = tmp_path / ("a.ppm" if colour else "a.pgm")
    head = f"P{6 if colour else 5}\n# a camera's comment\n24 20\n{largest}\n"
    path.write_bytes(head.encode() + stored.tobytes())
    frame, _ = read_frame(path)
    assert frame.dtype == kind.newbyteorder("=")
    assert np.array_equal(frame, counts)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(fw.FileProblem, match="expected a whole image, got a part"):
        read_frame(path)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (b"P5\n24 20\n70000\n", "a largest count of 1 to 65535, got 70000"),
        (b"P5\n24\n", "the head of a binary PGM"),
        (b"P2\n24 20\n255\n", "expected a readable image"),
        (b"P5\n999999 999999\n255\n", "px"),
    ],
)
def test_damaged_pgm_is_refused(tmp_path, head, message):
    path = tmp_path / "a.pgm"
    path.write_bytes(head + bytes(100))
    with pytest.raises(fw.FileProblem, match=message):
        read_frame(path)


def plan_of(frames):
    steps = fw.patterns.PhaseSteps("x", 64.0, fw.patterns.equal_steps(frames))
    return fw.PatternPlan(64, 48, (steps,))


@pytest.mark.parametrize(
    ("suffix", "package"),
    [(".CR2", "rawpy"), (".nef", "rawpy"), (".IIQ", "rawpy"), (".heic", "pillow-heif")],
)
def test_a_missing_package_is_named(tmp_path, monkeypatch, suffix, package):
    monkeypatch.setitem(sys.modules, package.replace("-", "_"), None)
    for k in range(3):
        (tmp_path / f"{k}{suffix}").write_bytes(b"x" * 100)
    with pytest.raises(fw.MissingPackage, match=f"pip install {package}, or convert"):
        fw.files.read_stack(tmp_path, plan_of(3))


def raw_package(calls):
    """What rawpy does with frames of a sensor: here, an array in the file."""

    class Raw:
        sizes = SimpleNamespace(width=24, height=20)

        def __init__(self, file):
            self.counts = np.frombuffer(file.read(), np.uint16).reshape(20, 24)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def postprocess(self, **options):
            calls.append(options)
            return np.stack((self.counts,) * 3, axis=-1)

    package = ModuleType("rawpy")
    package.imread = Raw
    package.DemosaicAlgorithm = SimpleNamespace(LINEAR="linear")
    package.ColorSpace = SimpleNamespace(raw="raw")
    return package


def test_raw_files_are_read_in_proportion_to_the_light(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setitem(sys.modules, "rawpy", raw_package(calls))
    for k in range(3):
        (tmp_path / f"{k}.dng").write_bytes((GREY.astype(np.uint16) + 1000 * k).tobytes())
    stack = fw.files.read_stack(tmp_path, plan_of(3))
    assert [int(f[0, 0]) for f in stack.frames] == [0, 1000, 2000]
    assert not stack.lossy
    # Each frame has the scale of the sensor: no gamma, no balance, no brightest pixel of its own.
    assert all(c["gamma"] == (1, 1) and c["no_auto_bright"] for c in calls)
    assert all(c["user_wb"] == [1.0] * 4 and c["adjust_maximum_thr"] == 0.0 for c in calls)


@pytest.mark.parametrize("suffix", [".heic", ".HIF"])
def test_heif_is_read_where_its_package_is_there(tmp_path, monkeypatch, suffix):
    class Photograph:
        def __init__(self, file):
            self.counts = np.frombuffer(file.read(), np.uint8).reshape(20, 24)
            self.size = (24, 20)

        def __array__(self, dtype=None, copy=None):
            return np.stack((self.counts,) * 3, axis=-1)

    package = ModuleType("pillow_heif")
    package.open_heif = lambda file, **_: Photograph(file)
    monkeypatch.setitem(sys.modules, "pillow_heif", package)
    for k in range(3):
        (tmp_path / f"{k}{suffix}").write_bytes((GREY // (k + 1)).tobytes())
    stack = fw.files.read_stack(tmp_path, plan_of(3))
    assert stack.lossy
    assert np.array_equal(stack.frames[1], GREY // 2)


def test_the_jpeg_beside_a_raw_file_is_no_frame_of_its_own(tmp_path):
    for k in range(3):
        Image.fromarray(GREY).save(tmp_path / f"{k}.jpg")
        (tmp_path / f"{k}.cr2").write_bytes(b"x")
    assert len(fw.files.read_stack(tmp_path, plan_of(3)).frames) == 3


PATTERNS = ([[0, 1], [3, 2]], [[1, 0], [2, 3]], [[2, 3], [1, 0]], [[3, 2], [0, 1]])


def mosaic_of(planes, pattern, black, white):
    """Raw counts of light (h, w, 3), shares of the full scale, behind a mosaic."""
    number = np.tile(pattern, (planes.shape[0], planes.shape[1]))[: planes.shape[0]]
    number = number[:, : planes.shape[1]]
    channel = np.array([0, 1, 2, 1])[number]
    light = np.take_along_axis(planes, channel[..., None], axis=2)[..., 0]
    return np.rint(black + light * (white - black)).astype(np.uint16)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("shape", [(20, 24), (31, 17)])
def test_a_mosaic_is_interpolated_linearly(pattern, shape):
    y, x = np.mgrid[: shape[0], : shape[1]]
    ramps = np.stack((0.1 + 0.02 * x, 0.8 - 0.02 * y, 0.1 + 0.01 * (x + y)), axis=-1)
    raw = mosaic_of(ramps, np.array(pattern), 500, 15000)
    image = BayerImage(raw, np.array(pattern), [500] * 4, 15000)
    whole = image.whole()
    assert whole.shape == image.shape
    # To the rounding of the raw counts; at the border there is nothing to interpolate between.
    np.testing.assert_allclose(whole[1:-1, 1:-1] / 65535, ramps[1:-1, 1:-1], atol=1e-4)
    np.testing.assert_allclose(whole / 65535, ramps, atol=0.025)
    assert np.array_equal(image[5:14], whole[5:14])
    assert np.array_equal(image.channel(2), whole[..., 2])


def mosaic_package():
    """``raw_package`` of a camera with filters, from 500 counts in the dark to 15000."""
    package = raw_package([])
    package.imread.raw_pattern = np.array(PATTERNS[0])
    package.imread.num_colors = 3
    package.imread.color_desc = b"RGBG"
    package.imread.black_level_per_channel = [500] * 4
    package.imread.white_level = 15000
    return package


def test_a_raw_file_with_a_mosaic_has_colour(tmp_path, monkeypatch):
    package = mosaic_package()
    package.imread.raw_image_visible = property(lambda self: self.counts)
    sizes = SimpleNamespace(width=24, height=20, iwidth=24, iheight=20, pixel_aspect=1.0)
    package.imread.sizes = sizes
    monkeypatch.setitem(sys.modules, "rawpy", package)
    paint = np.broadcast_to((0.6, 0.4, 0.2), (20, 24, 3))
    for k in range(4):
        light = paint * (1.0 + 0.5 * np.cos(np.arange(24) / 5 + k * np.pi / 2))[None, :, None]
        raw = mosaic_of(light, np.array(PATTERNS[0]), 500, 15000)
        (tmp_path / f"{k}.dng").write_bytes(raw.tobytes())
    stack = fw.files.read_stack(tmp_path, plan_of(4))
    assert stack.frames[0].dtype == np.float32
    inner = stack.colour[2:-2, 2:-2] / 65535
    np.testing.assert_allclose(inner, paint[2:-2, 2:-2], rtol=0.01)
    green = fw.files.read_stack(tmp_path, plan_of(4), channels="g")
    assert green.frames[0].dtype == np.uint16
    np.testing.assert_allclose(green.colour, stack.colour, rtol=1e-4)


@pytest.mark.parametrize(
    "words",
    [{}, {"channels": "g"}, {"channels": "best"}, {"channels": "b", "mosaic": "file"}],
    ids=["luminance", "green", "best", "plane"],
)
def test_raw_files_need_less_than_a_colour_frame_beside_what_they_give(
    tmp_path, monkeypatch, words
):
    """One frame: red, green and blue as float32, 12 bytes per pixel."""
    height, width = 2000, 3000
    package = mosaic_package()
    package.imread.raw_image_visible = property(lambda self: self.counts.reshape(height, width))
    package.imread.sizes = SimpleNamespace(
        width=width, height=height, iwidth=width, iheight=height, pixel_aspect=1.0
    )
    package.imread.__init__ = lambda self, file: setattr(
        self, "counts", np.frombuffer(file.read(), np.uint16)
    )
    monkeypatch.setitem(sys.modules, "rawpy", package)
    rng = np.random.default_rng(0)
    for k in range(4):
        raw = rng.integers(600, 14000, height * width, dtype=np.uint16)
        (tmp_path / f"{k:02d}.dng").write_bytes(raw.tobytes())
    tracemalloc.start()
    stack = fw.files.read_stack(tmp_path, plan_of(4), **words)
    now, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(stack.frames) == 4
    assert peak - now < 12 * height * width
