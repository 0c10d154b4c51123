"""Light of one colour: plans and cameras that name it, and raw frames of its pixels alone."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.opening import open_camera
from fringeworks.files.bayer_image import BayerImage
from fringeworks.files.mosaic import MOSAICS, first_px, plane_of, plane_of_image
from fringeworks.rig.pinhole import project
from fringeworks.rig.sensor_region import rig_for_region
from fringeworks.simulate.bayer import Bayer
from fringeworks.simulate.bodies import Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import ColourPlane, Region
from tests import rigs

COLOURS = ("red", "green", "blue")
SHARES = {"red": (1.0, 0.1, 0.02), "green": (0.06, 1.0, 0.15), "blue": (0.03, 0.12, 1.0)}
"""Light of one colour that the filters of a camera pass, red, green and blue."""
RIG = standard_rig(scale=0.25)
"""Frames of 320 × 256 px, whose planes have a quarter of the pixels."""
CROPS = {"rggb": (0, 0), "grbg": (1, 0), "gbrg": (0, 1), "bggr": (1, 1)}
"""Columns and rows to cut from a mosaic that begins with red."""


@lru_cache
def mosaics(colour, *, seed=1, mosaic="rggb", noise=1.5, rig=RIG):
    """View, plan in one colour, and raw frames of a camera behind a mosaic."""
    plan = replace(fw.simulate.fringe_plan(rig, both=False), channel=colour)
    view = look(rig, [rigs.ahead(Sphere(45.0), 5, 3), rigs.ahead(Plane(), z=560.0)])
    bayer = Bayer(SHARES[colour], balanced=False, output="raw")
    frames = list(photograph(view, plan, Optics(bayer=bayer, seed=seed, noise=noise)))
    x, y = CROPS[mosaic]
    return view, plan, [f[y:, x:] for f in frames]


def errors_of(view, found, first):
    """Errors of points along their rays, in σ. The truth lies at the middle of each pixel."""
    rows, columns = found.reason.shape
    v, u = (at + 2 * np.arange(n) for at, n in zip(first[::-1], (rows, columns), strict=True))
    if all(float(at).is_integer() for at in first):
        true = view.points_mm[np.ix_(v.astype(int), u.astype(int))]
    else:  # between four pixels
        p = view.points_mm
        true = 0.25 * (p[:-1, :-1] + p[1:, :-1] + p[:-1, 1:] + p[1:, 1:])[::2, ::2]
        true = true[:rows, :columns]
    off = (found.xyz_mm - true)[..., 2] / found.sigma_mm
    return off[np.isfinite(off)]


@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("colour", COLOURS)
def test_the_pixels_of_one_colour_lie_within_their_sigma(tmp_path, colour, seed):
    view, plan, frames = mosaics(colour, seed=seed, rig=rigs.rig())
    np.save(tmp_path / "raw.npy", np.array(frames))
    stack = fw.files.read_stack(tmp_path / "raw.npy", plan, mosaic="rggb")
    assert stack.frames[0].shape == tuple(n // 2 for n in frames[0].shape)
    found = fw.measure(stack, rigs.rig()).points
    off = errors_of(view, found, first_px("rggb", colour[0]))
    assert off.size > 0.5 * found.reason.size
    assert 0.62 < np.mean(np.abs(off) < 1) < 0.76
    assert np.mean(np.abs(off) < 2) > 0.93
    # A rig for the middle of the cell is off by several σ.
    assert abs(np.median(off)) < 0.1


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_every_mosaic_has_its_places(tmp_path, mosaic):
    _, plan, frames = mosaics("blue", mosaic=mosaic)
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{k:02d}.png")
    fw.write(tmp_path / "plan.toml", plan)
    (tmp_path / "capture.toml").write_text(f'kind = "stack"\nmosaic = "{mosaic}"\n')
    stack = fw.files.read_stack(tmp_path)
    at = {"rggb": (1, 1), "grbg": (0, 1), "gbrg": (1, 0), "bggr": (0, 0)}[mosaic]
    rows, columns = (n // 2 for n in frames[0].shape)
    assert np.array_equal(stack.frames[3], frames[3][at[1] :: 2, at[0] :: 2][:rows, :columns])
    assert stack.region.first_px == at
    assert "channel b of a raw mosaic" in stack.notes[0]
    assert fw.measure(tmp_path, crop(mosaic, frames)).points.reason.size


def crop(mosaic, frames):
    """The rig for the frames that were cut."""
    x, y = CROPS[mosaic]
    part = Region(x, y, frames[0].shape[1], frames[0].shape[0])
    return fw.rig.for_frames(RIG, region=part)


def test_both_greens_are_one_pixel_that_saturates_with_either():
    raw = np.array([[10, 20, 11, 255], [30, 40, 31, 41]], np.uint8)
    assert plane_of(raw, "rggb", "g").tolist() == [[25.0, 255.0]]
    assert plane_of(raw, "rggb", "b").tolist() == [[40, 41]]
    assert plane_of(raw[:, :3], "grbg", "r").tolist() == [[20]]
    assert first_px("grbg", "r") == (1.0, 0.0)


def test_a_rig_for_every_second_pixel_sees_what_that_pixel_sees():
    rng = np.random.default_rng(5)
    points = rng.uniform((-60, -40, 450), (60, 40, 550), (50, 3))
    known = replace(RIG, blur=fw.rig.CameraBlur.everywhere(0.6))
    h, w = known.camera.shape
    before = project(known.camera, points)
    for first, blur in (((1.0, 0.0), 0.09), ((0.5, 0.5), 0.09 + 0.25 / 4)):
        found = rig_for_region(known, ColourPlane(0, 0, w, h, first))
        assert np.allclose(project(found.camera, points), (before - first) / 2)
        assert found.camera.shape == (h // 2, w // 2)
        assert np.isclose(found.blur.factors_px2[0], blur)


def test_a_rig_for_pixels_of_one_colour_keeps_them_in_its_file(tmp_path):
    h, w = RIG.camera.shape
    plane = ColourPlane(0, 0, w, h, (1.0, 1.0))
    found = rig_for_region(RIG, plane)
    fw.write(tmp_path / "rig.toml", found)
    back = fw.read(tmp_path / "rig.toml")
    assert back.region == plane
    assert rig_for_region(back, plane) is back
    with pytest.raises(fw.RigMismatch, match="from column 1, row 1 on, got .* column 0, row 0"):
        rig_for_region(back, replace(plane, first_px=(0.0, 0.0)))
    with pytest.raises(fw.RigMismatch, match="got frames of all pixels"):
        rig_for_region(back, Region(0, 0, w, h))


@pytest.mark.parametrize(
    ("mosaic", "channels", "words"),
    [
        ("rgbb", "blue", "mosaic: expected one of rggb"),
        ("rggb", None, "expected one channel beside it"),
        ("rggb", "rgb", "got rgb"),
        ("file", "blue", "expected a raw photograph that says its mosaic"),
    ],
)
def test_mosaics_that_are_none(tmp_path, mosaic, channels, words):
    _, plan, frames = mosaics("blue")
    np.save(tmp_path / "raw.npy", np.array(frames))
    plain = replace(plan, channel=None)
    with pytest.raises(fw.InputError, match=words):
        fw.files.read_stack(tmp_path / "raw.npy", plain, channels=channels, mosaic=mosaic)


def test_images_with_colours_are_no_raw_frames(tmp_path):
    _, plan, frames = mosaics("blue")
    for k, frame in enumerate(frames):
        Image.fromarray(np.stack((frame,) * 3, axis=-1)).save(tmp_path / f"{k:02d}.png")
    with pytest.raises(fw.InputError, match=r"raw counts, \(h, w\), got colours"):
        fw.files.read_stack(tmp_path, plan, mosaic="rggb")


def test_raw_photographs_say_their_mosaic():
    raw = np.arange(24, dtype=np.uint16).reshape(4, 6) * 100 + 500
    image = BayerImage(raw, np.array([[1, 2], [0, 3]]), [500] * 4, 500 + 65535)
    assert image.mosaic == "gbrg"
    plane, first = plane_of_image(image, "file", "b")
    assert first == (1.0, 0.0)
    assert plane.tolist() == [[100, 300, 500], [1300, 1500, 1700]]
    assert plane.dtype == np.uint16
    with pytest.raises(fw.InputError, match="expected gbrg, which the file says"):
        plane_of_image(image, "rggb", "b")


@pytest.mark.parametrize("colour", COLOURS)
def test_pictures_of_a_plan_are_in_its_colour(tmp_path, colour):
    plan = replace(fw.simulate.fringe_plan(RIG, both=False), channel=colour)
    pictures = list(fw.encode(plan))
    white = list(fw.encode(replace(plan, channel=None)))
    k = COLOURS.index(colour)
    assert np.array_equal(pictures[1][..., k], white[1])
    assert not np.delete(pictures[1], k, axis=2).any()
    fw.write(tmp_path / "plan.toml", plan)
    assert f'channel = "{colour}"' in (tmp_path / "plan.toml").read_text()
    assert fw.read(tmp_path / "plan.toml") == plan
    paths = fw.files.write_patterns(tmp_path / "pictures", plan)
    assert np.array_equal(np.asarray(Image.open(paths[1])), pictures[1])
    decoded = fw.decode(pictures, plan)
    assert np.allclose(decoded.x.coordinate_px, np.arange(plan.width_px), atol=0.02)


def test_the_plan_names_the_channel_that_is_decoded(tmp_path):
    """Colour images that are grey otherwise: light of the room in red and green changes."""
    view, plan, _ = mosaics("blue")
    frames = list(photograph(view, plan, Optics(seed=3)))
    rng = np.random.default_rng(4)
    for k, frame in enumerate(frames):
        other = np.full_like(frame, rng.integers(20, 200))
        Image.fromarray(np.stack((other, other // 2, frame), axis=-1)).save(
            tmp_path / f"{k:02d}.png"
        )
    fw.write(tmp_path / "plan.toml", plan)
    stack = fw.files.read_stack(tmp_path)
    assert np.array_equal(stack.frames[2], frames[2])
    assert "channel b of a colour image" in stack.notes[0]
    # Grey cameras see the light as it is; a channel that is named comes first.
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{k:02d}.png")
    assert np.array_equal(fw.files.read_stack(tmp_path).frames[2], frames[2])
    with pytest.raises(fw.FileProblem, match="expected a colour image for its channels g"):
        fw.files.read_stack(tmp_path, channels="green")


@pytest.mark.parametrize("word", ['channel = "blue"', 'channels = "blue"', 'channels = "b"'])
def test_captures_name_a_channel(tmp_path, word):
    view, plan, _ = mosaics("blue")
    frames = list(photograph(view, plan, Optics(seed=3)))
    for k, frame in enumerate(frames):
        colours = np.stack((frame // 3, frame // 2, frame), axis=-1)
        Image.fromarray(colours).save(tmp_path / f"{k:02d}.png")
    fw.write(tmp_path / "plan.toml", replace(plan, channel=None))
    (tmp_path / "capture.toml").write_text(f'kind = "stack"\n{word}\n')
    assert np.array_equal(fw.files.read_stack(tmp_path).frames[2], frames[2])


def test_both_words_for_a_channel_are_refused(tmp_path):
    (tmp_path / "capture.toml").write_text('kind = "stack"\nchannel = "blue"\nchannels = "g"\n')
    with pytest.raises(fw.FileProblem, match="expected channels or channel .* got both"):
        fw.files.read_stack(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"channel": "violet"}, "channel: expected one of red, green, blue"),
        ({"channel": "blue", "bits": 10}, "pictures of 8 bit in one colour, got 10 bit"),
    ],
)
def test_channels_that_a_plan_cannot_have(change, words):
    plan = fw.simulate.fringe_plan(RIG, both=False)
    with pytest.raises(fw.InputError, match=words):
        replace(plan, **change)


@pytest.mark.parametrize("colour", ["green", "blue"])
def test_a_capture_in_one_colour_by_a_colour_camera(tmp_path, colour):
    plan = replace(fw.simulate.fringe_plan(fw.devices.virtual_rig(), both=False), channel=colour)
    projector, camera = fw.devices.virtual_bench("sphere", clock=SimulatedClock())
    folder = fw.capture(projector, camera, plan, tmp_path / "shots")
    shot = np.asarray(Image.open(sorted(folder.glob("*.png"))[0])).astype(int)
    k = COLOURS.index(colour)
    assert shot[..., k].sum() > 3 * np.delete(shot, k, axis=2).sum(axis=(0, 1)).max()
    points = fw.measure(folder, fw.devices.virtual_rig()).points
    assert (points.reason == 0).sum() > 15000
    assert np.nanmedian(points.sigma_mm) < 0.03
    # The camera delivers grey frames again.
    assert camera.grab().pixels.ndim == 2


def test_a_projector_that_shows_no_colours_needs_light_of_that_colour():
    from fringeworks.scan.frames import check_plan, pictures_of

    plan = replace(fw.simulate.fringe_plan(RIG, both=False), channel="blue")
    size = (plan.width_px, plan.height_px)
    grey = SimpleNamespace(name="grey", size_px=size, bits=8, settings=None)
    with pytest.raises(fw.InputError, match="shows blue pictures, or one whose light is set"):
        check_plan(grey, plan)
    lit = SimpleNamespace(name="lit", size_px=size, bits=8, settings=SimpleNamespace(colour="blue"))
    check_plan(lit, plan)
    assert next(pictures_of(lit, plan, [0])).counts.ndim == 2


def test_a_camera_has_its_channel_in_its_words(tmp_path):
    with open_camera(f"folder:{tmp_path},channel=blue") as camera:
        picture = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
        Image.fromarray(picture).save(tmp_path / "a.png")
        assert np.array_equal(camera.grab(10.0).pixels, picture[..., 2])
    with pytest.raises(fw.DeviceProblem, match="expected channel= and one of luminance, red"):
        open_camera(f"folder:{tmp_path},channel=violet")


def test_the_commands(tmp_path):
    plan_file, shots = tmp_path / "plan.toml", tmp_path / "shots"
    assert run(["plan", "--projector-size", "216x135", "--frames", "12", "--channel", "blue",
                "--out", f"{plan_file}"]) == 0  # fmt: skip
    assert fw.read(plan_file).channel == "blue"
    shots.mkdir()
    view, plan, frames = mosaics("blue")
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(shots / f"{k:02d}.png")
    fw.write(shots / "plan.toml", plan)
    fw.write(tmp_path / "rig.toml", RIG)
    out = tmp_path / "part.npz"
    assert run(["measure", f"{shots}", "--mosaic", "rggb", "--rig", f"{tmp_path / 'rig.toml'}",
                "--out", f"{out}"]) == 0  # fmt: skip
    off = errors_of(view, fw.read(out), (1.0, 1.0))
    assert np.mean(np.abs(off) < 2) > 0.93
    assert run(["decode", f"{shots}", "--steps", "4", "--mosaic", "rggb"]) == 2


class RawCamera:
    """A camera of a test bench, that sees its frames behind a mosaic."""

    def __init__(self, camera):
        self._camera, self.mosaic = camera, "gbrg"
        self.name, self.sees_colours = "raw", False

    def deliver_colours(self, wanted):
        assert not wanted

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def grab(self, timeout_s=5.0):
        found = self._camera.grab(timeout_s)
        rows, columns = (np.arange(n) % 2 for n in found.pixels.shape)
        share = np.array([[0.3, 1.0], [0.1, 0.3]])[np.ix_(rows, columns)]
        return replace(found, pixels=np.rint(found.pixels * share).astype(np.uint8))


def test_raw_frames_of_a_camera_are_captured_and_measured(tmp_path):
    rig = fw.devices.virtual_rig()
    plan = replace(fw.simulate.fringe_plan(rig, both=False), channel="blue")
    projector, camera = fw.devices.virtual_bench("sphere", clock=SimulatedClock())
    white = replace(plan, channel=None)
    with pytest.raises(fw.InputError, match="one with a channel, .* delivers raw frames"):
        fw.capture(projector, RawCamera(camera), white, tmp_path / "white")
    folder = fw.capture(projector, RawCamera(camera), plan, tmp_path / "shots")
    assert 'mosaic = "gbrg"' in (folder / "capture.toml").read_text()
    stack = fw.files.read_stack(folder)
    assert stack.region.first_px == (1.0, 0.0)
    assert stack.region.shape == stack.frames[0].shape
    points = fw.measure(folder, rig).points
    assert (points.reason == 0).sum() > 3000
    with pytest.raises(fw.DeviceProblem, match="genicam or gentl for channel=raw"):
        open_camera("webcam:0,channel=raw")
