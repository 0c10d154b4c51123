"""Types of frames: every type, byte order and stride; colour, depth and compression of the files."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.grids import thinned
from tests.stacks import guarded, multi, take

PLAN = multi((1, 8), 4, (300, 40))
GRAY = guarded(steps=3, size=(320, 24))
KINDS = ("uint8", "uint16", "float32", "float64")


def columns_first(frames):
    return np.asfortranarray(frames)


def turned(frames):
    return frames[:, ::-1, ::-1].copy()[:, ::-1, ::-1]


def every_second(frames):
    n, h, w = frames.shape
    wide = np.zeros((n, 2 * h, 3 * w), frames.dtype)
    wide[:, ::2, ::3] = frames
    return wide[:, ::2, ::3]


def unaligned(frames):
    place = np.zeros(frames.nbytes + 1, np.uint8)[1:].view(frames.dtype).reshape(frames.shape)
    place[...] = frames
    return place


def plain(frames):
    return frames


LAYOUTS = (plain, columns_first, turned, every_second, unaligned)


def streamed(frames, plan):
    decoder = fw.stack.StreamingDecoder(plan)
    for frame in frames:
        decoder.add(frame)
    return decoder.result()


@cache
def native(plan, kind):
    """Frames as numpy makes them, and what is found of them."""
    frames = take(plan, kind=kind)
    frames.setflags(write=False)
    return frames, fw.decode(frames, plan), fw.stack.texture(frames, plan)


@thinned(plan={"phases": PLAN, "gray": GRAY}, kind=KINDS, order="<>", layout=LAYOUTS)
def test_stacks_of_every_type_order_and_stride(plan, kind, order, layout):
    plainly, expected, texture = native(plan, kind)
    frames = layout(plainly.astype(np.dtype(kind).newbyteorder(order)))
    before = frames.copy()
    assert fw.decode(frames, plan) == expected
    assert streamed(frames, plan) == expected
    np.testing.assert_array_equal(fw.stack.texture(frames, plan), texture)
    np.testing.assert_array_equal(fw.decode(fw.Stack(frames, plan)).x.sigma_px, expected.x.sigma_px)
    np.testing.assert_array_equal(frames, before)


def test_byte_orders_may_be_mixed():
    frames = list(take(PLAN, kind=np.uint16))
    frames[3] = frames[3].astype(">u2")
    assert fw.decode(frames, PLAN) == fw.decode(take(PLAN, kind=np.uint16), PLAN)
    frames[0] = frames[0].astype(">u2")
    assert streamed(frames, PLAN) == fw.decode(frames, PLAN)


PAIR_FUNCTIONS = {
    "analyse": lambda pair: fw.analyse(pair, "fourier").displacement_px,
    "reconstruct": lambda pair: fw.reconstruct(pair, "gsifa").surface.values,
    "denoise": lambda pair: fw.denoise(pair.object),
    "decompose_frame": lambda pair: fw.signal.decompose_frame(pair.object).imfs,
    "unwrap": lambda pair: fw.unwrap(pair.object).phase,
}


@cache
def native_pair(name, kind):
    """A scene, its frames as numpy makes them, and what a function finds of them."""
    scene = standard_scene("parabola", size=64, fringes=6, bits=8, noise=1, seed=1)
    both = np.stack((scene.reference, scene.object)).astype(kind)
    both.setflags(write=False)
    expected = PAIR_FUNCTIONS[name](replace(scene, reference=both[0], object=both[1]))
    return scene, both, expected


@thinned(name=list(PAIR_FUNCTIONS), kind=KINDS, layout=LAYOUTS)
def test_pairs_of_every_type_order_and_stride(name, kind, layout):
    scene, both, expected = native_pair(name, kind)
    swapped = layout(both.astype(np.dtype(kind).newbyteorder(">")))
    function = PAIR_FUNCTIONS[name]
    # A pair that is not copied on the way: the frames are passed as they lie in memory.
    pair = replace(scene)
    object.__setattr__(pair, "reference", swapped[0])
    object.__setattr__(pair, "object", swapped[1])
    np.testing.assert_array_equal(function(pair), expected)


@pytest.mark.parametrize("kind", [bool, np.int32, np.float16, np.complex64])
def test_other_types_get_one_clear_error(kind):
    frames = take(PLAN).astype(kind)
    words = "frame x-phase-300px-0: expected uint8, uint16, float32, float64, got"
    for call in (fw.decode, streamed, fw.stack.texture):
        with pytest.raises(fw.InputError, match=words):
            call(frames, PLAN)


def test_a_board_is_found_in_every_byte_order():
    rng = np.random.default_rng(0)
    squares = np.kron(np.indices((8, 9)).sum(axis=0) % 2, np.ones((30, 30))) * 150 + 50
    image = np.pad(squares, 40, constant_values=200) + rng.normal(0, 1, (320, 350))
    board = fw.rig.parse_board("chessboard:8x7:10")
    expected = fw.rig.find_board(np.rint(image).astype(np.uint8), board).pixels
    for kind in (">u2", ">f4", ">f8"):
        found = fw.rig.find_board(np.asfortranarray(np.rint(image).astype(kind)), board)
        np.testing.assert_allclose(found.pixels, expected, atol=1e-3)


@pytest.mark.parametrize("plan", [PLAN, GRAY], ids=["phases", "gray"])
def test_a_stream_keeps_no_frame(plan):
    decoder = fw.stack.StreamingDecoder(plan)
    alive = []
    for picture in take(plan):
        frame = picture.copy()
        alive.append(weakref.ref(frame))
        decoder.add(frame)
        del frame
    assert not any(reference() is not None for reference in alive)


def test_a_stream_does_not_follow_changes_of_a_frame():
    frames = take(GRAY)
    decoder = fw.stack.StreamingDecoder(GRAY)
    buffer = np.empty_like(frames[0])
    for frame in frames:
        buffer[...] = frame
        decoder.add(buffer)
    assert decoder.result() == fw.decode(frames, GRAY)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("suffix", ["tif", "npy", "folder"])
def test_files_of_both_byte_orders(tmp_path, suffix, order):
    native = take(PLAN, kind=np.uint16)
    frames = native.astype(f"{order}u2")
    fw.files.write_plan(tmp_path / "plan.toml", PLAN)
    path = tmp_path / f"stack.{suffix}"
    if suffix == "npy":
        np.save(path, frames)
    elif suffix == "tif":
        tifffile.imwrite(path, frames, byteorder=order, photometric="minisblack")
    else:
        path = tmp_path
        for k, frame in enumerate(frames):
            tifffile.imwrite(tmp_path / f"shot{k}.tif", frame, byteorder=order)
    stack = fw.files.read_stack(path)
    assert fw.decode(stack.frames, PLAN) == fw.decode(native, PLAN)
    assert (stack.count_step, stack.lossy) == (1.0, False)


@pytest.mark.parametrize("kind", [">u2", ">f4", "<u2"])
def test_written_frames_are_the_same_in_every_byte_order(tmp_path, kind):
    frames = take(PLAN, kind=np.uint16).astype(kind)
    folder = fw.files.write_stack(tmp_path / "stack", frames, PLAN)
    names = {path.suffix for path in folder.glob("*-x-phase-*")}
    assert names == ({".png"} if kind.endswith("u2") else {".tif"})
    np.testing.assert_array_equal(np.stack(fw.files.read_stack(folder).frames), frames)


# The memory of an earlier result.


@pytest.fixture(scope="module")
def measured():
    rig = standard_rig(scale=0.2)
    plan = fringe_plan(rig)
    decoded = fw.decode(list(photograph(look(rig, bust()), plan, Optics())), plan)
    return rig, decoded, fw.triangulate(decoded, rig)


SPOILT = {
    "columns first": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "double precision": lambda a: a.astype(np.float64),
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder(">")),
}


@pytest.mark.parametrize("field", ["xyz_mm", "sigma_mm", "noise_mm"])
@pytest.mark.parametrize("how", SPOILT)
def test_points_are_written_right_or_not_at_all(measured, how, field):
    rig, decoded, points = measured
    spoilt = SPOILT[how](np.asarray(getattr(points, field)))
    out = replace(points)
    object.__setattr__(out, field, spoilt)
    with pytest.raises(fw.InputError, match="out: expected"):
        fw.triangulate(decoded, rig, out=out)
    again = fw.triangulate(decoded, rig, out=fw.triangulate(decoded, rig))
    assert replace(again, provenance=None) == replace(points, provenance=None)


@pytest.mark.parametrize("how", SPOILT)
def test_coordinates_are_written_right_or_not_at_all(how):
    frames = take(PLAN)
    decoded = fw.decode(frames, PLAN)
    x = replace(decoded.x)
    object.__setattr__(x, "sigma_px", SPOILT[how](np.asarray(x.sigma_px)))
    with pytest.raises(fw.InputError, match="out: expected sigma_px"):
        fw.decode(frames, PLAN, out=replace(decoded, x=x))


def test_memory_that_is_shared_or_read_only_is_refused(measured, tmp_path):
    rig, decoded, points = measured
    out = replace(points)
    object.__setattr__(out, "noise_mm", out.sigma_mm)
    with pytest.raises(fw.InputError, match="out: expected sigma and noise in memory of their own"):
        fw.triangulate(decoded, rig, out=out)
    np.save(tmp_path / "sigma.npy", points.sigma_mm)
    object.__setattr__(out, "noise_mm", np.load(tmp_path / "sigma.npy", mmap_mode="r"))
    with pytest.raises(fw.InputError, match="out: expected memory that can be written to"):
        fw.triangulate(decoded, rig, out=out)


# Colour, depth and compression.


def save(folder, frames, suffix="png", colours=None, **options):
    """Write frames as images; ``colours`` scales red, green and blue."""
    fw.files.write_plan(folder / "plan.toml", GRAY)
    for k, frame in enumerate(frames):
        if colours is not None:
            frame = np.rint(frame[..., None] * np.asarray(colours)).astype(np.uint8)
        Image.fromarray(frame).save(folder / f"shot{k:02d}.{suffix}", **options)
    return folder


def test_a_stack_with_colour_is_converted_as_one(tmp_path):
    """The black frame has equal channels; it is luminance like the others."""
    frames = take(GRAY, noise=0.0, a=100.0)
    frames[-1] = 0
    stack = fw.files.read_stack(save(tmp_path, frames, colours=(1.0, 0.9, 0.7)))
    assert {frame.dtype for frame in stack.frames} == {np.dtype(np.float32)}
    assert stack.count_step == 1.0
    assert len(stack.notes) == 2
    assert stack.notes[1] == f"the same holds for {GRAY.frames - 1} other frames"
    Image.fromarray(frames[-1]).save(tmp_path / f"shot{GRAY.frames - 1:02d}.png")  # a grey file
    assert {frame.dtype.name for frame in fw.files.read_stack(tmp_path).frames} == {"float32"}


@pytest.mark.parametrize("colours", [(1.0, 0.9, 0.7), (1.0, 1.0, 1.0)])
def test_saturated_colour_is_left_out(tmp_path, colours):
    """Red is clipped while the luminance is still below the limit."""
    plan = multi((1, 5, 20), 6, (640, 30))
    fw.files.write_plan(tmp_path / "plan.toml", plan)
    rng = np.random.default_rng(0)
    for k, frame in enumerate(take(plan, noise=0.0, a=150.0, b=140.0, kind=np.float32)):
        seen = frame[..., None] * colours + rng.normal(0, 1.5, (*frame.shape, 3))
        picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        Image.fromarray(picture).save(tmp_path / f"{k:02d}.png")
    stack = fw.files.read_stack(tmp_path)
    assert stack.saturation == 255.0
    found = fw.decode(stack).x
    off = np.abs(found.coordinate_px - np.arange(640)) / found.sigma_px
    measured = found.reason == fw.Reason.OK
    assert measured.mean() > 0.95
    assert (off[measured] < 1).mean() > 0.6


def test_neutral_stacks_keep_their_counts(tmp_path):
    frames = take(GRAY)
    stack = fw.files.read_stack(save(tmp_path, frames, colours=(1.0, 1.0, 1.0)))
    np.testing.assert_array_equal(np.stack(stack.frames), frames)


def test_another_depth_is_told_with_the_file(tmp_path):
    save(tmp_path, take(GRAY), colours=(1.0, 0.9, 0.7))
    Image.fromarray(take(GRAY, kind=np.uint16)[3]).save(tmp_path / "shot03.png")
    with pytest.raises(
        fw.FramesContradictPlan,
        match=r"shot03.png: expected counts of the type in shot00.png, uint8, got uint16",
    ):
        fw.files.read_stack(tmp_path)


def test_colour_keeps_the_noise_of_rounding(tmp_path):
    """Without noise of the camera, that of rounding to 8 bits is left."""
    frames = take(GRAY, noise=0.0, a=100.0, b=80.0)
    found = fw.decode(save(tmp_path, frames, colours=(1.0, 0.9, 0.7)))
    assert found.noise.read_counts >= 0.99 * 12**-0.5


@pytest.mark.parametrize(
    ("kind", "step", "floor"),
    [
        (np.uint8, None, 1.0),
        (np.float32, None, 1.0),  # whole counts
        (np.float32, 0.25, 0.25),
        (np.float64, 4.0, 4.0),
    ],
)
def test_the_step_of_the_counts_is_the_smallest_noise(kind, step, floor):
    frames = np.rint(take(PLAN, noise=0.0, kind=np.float64)).astype(kind)
    known = fw.signal.CameraNoise(1e-3)
    found = fw.decode(frames, PLAN, noise=known, count_step=step)
    # The rounding of frames without noise repeats with the fringes, which raises it a little.
    assert floor / 12**0.5 * 0.999 < found.noise.read_counts < 2.0 * floor / 12**0.5
    decoder = fw.stack.StreamingDecoder(PLAN, noise=known, count_step=step)
    for frame in frames:
        decoder.add(frame)
    assert decoder.result() == found


def test_floats_between_whole_counts_have_no_step():
    frames = take(PLAN, noise=0.0, kind=np.float32)
    assert fw.decode(frames, PLAN, noise=fw.signal.CameraNoise(0.05)).noise.read_counts == 0.05


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_steps_that_are_none_are_refused(step):
    for call in (
        lambda: fw.decode(take(PLAN), PLAN, count_step=step),
        lambda: fw.stack.StreamingDecoder(PLAN, count_step=step),
    ):
        with pytest.raises(fw.InputError, match="count_step: expected > 0 counts"):
            call()


def test_lossy_files_are_known(tmp_path):
    frames = take(GRAY)
    assert not fw.files.read_stack(save(tmp_path, frames)).lossy
    for path in tmp_path.glob("*.png"):
        path.unlink()
    stack = fw.files.read_stack(save(tmp_path, frames, "jpg", quality=80))
    assert stack.lossy
    assert stack.count_step == 1.0


def test_a_pair_with_colour_is_converted_as_one(tmp_path):
    scene = standard_scene("parabola", size=64, fringes=6, bits=8, noise=1, seed=1)
    reference = np.asarray(scene.reference, np.uint8)
    Image.fromarray(np.stack([reference] * 3, axis=-1)).save(tmp_path / "reference.png")
    Image.fromarray(
        np.rint(np.asarray(scene.object)[..., None] * [1.0, 0.9, 0.7]).astype(np.uint8)
    ).save(tmp_path / "object.png")
    pair = fw.files.read_pair(tmp_path / "reference.png", tmp_path / "object.png")
    assert pair.reference.dtype == pair.object.dtype == np.float32
    np.testing.assert_array_equal(pair.reference, reference)
