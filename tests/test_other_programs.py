"""Files, arrays and orders of frames as other programs write them."""

from __future__ import annotations

import codecs
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks.patterns.plan import (
    Block,
    GrayCode,
    PatternPlan,
    PhaseSteps,
    Uniform,
    equal_steps,
)
from tests.bumps import COLUMN, ROW, SIZE, seen
from tests.hostile_calls import calls

SETS = PatternPlan(*SIZE, tuple(PhaseSteps("x", p, equal_steps(4)) for p in (25.0, 400.0)))


def save(folder, frames, names=None, write=None, plan=SETS):
    folder.mkdir()
    for k, frame in enumerate(frames):
        path = folder / (names[k] if names else f"{k + 1}.png")
        if write is None:
            Image.fromarray(frame).save(path)
        else:
            write(path, frame)
    fw.files.write_plan(folder / "plan.toml", plan)
    return folder


def assert_right(folder):
    found = fw.decode(folder).x
    error = found.coordinate_px - COLUMN
    assert np.isfinite(error).mean() > 0.99
    assert np.nanstd(error) < 0.13
    return found


def zstandard(path, frame):
    Image.fromarray(frame).save(path, format="TIFF", compression="zstd")


def planes(path, frame):
    colour = np.stack([frame] * 3)
    tifffile.imwrite(path, colour, photometric="rgb", planarconfig="separate")


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".TIF", zstandard),
        (".tiff", planes),
        (".tif", lambda path, frame: tifffile.imwrite(path, frame.astype(np.uint32))),
        (".tif", lambda path, frame: tifffile.imwrite(path, (frame / 255.0).astype(np.float16))),
        (".tif", lambda path, frame: Image.fromarray(frame).save(path, format="PNG")),
        (".png", lambda path, frame: Image.fromarray(frame).save(path, format="TIFF")),
    ],
    ids=["zstd", "planes", "uint32", "float16", "png as tif", "tif as png"],
)
def test_images_of_other_programs(tmp_path, suffix, write):
    names = [f"Bild ü ({k}){suffix}" for k in range(8)]
    assert_right(save(tmp_path / "größe", seen(SETS), names, write))


def test_colours_of_print_are_refused(tmp_path):
    def cmyk(path, frame):
        Image.fromarray(frame).convert("CMYK").save(path)

    folder = save(tmp_path / "print", seen(SETS), [f"{k}.tif" for k in range(8)], cmyk)
    with pytest.raises(fw.FileProblem, match="colours of print"):
        fw.decode(folder)


@pytest.mark.parametrize(
    "encoded",
    [
        lambda text: text.encode("utf-16-le"),
        lambda text: text.encode("utf-16-be"),
        lambda text: codecs.BOM_UTF32_LE + text.encode("utf-32-le"),
    ],
    ids=["16 le", "16 be", "32 le"],
)
def test_encodings_without_a_mark_are_read(tmp_path, encoded):
    path = fw.files.write_plan(tmp_path / "plan.toml", SETS)
    path.write_bytes(encoded(path.read_text()))
    assert fw.files.read_plan(path) == SETS


def test_code_pages_are_refused(tmp_path):
    path = fw.files.write_plan(tmp_path / "plan.toml", SETS)
    path.write_bytes("# größe\n".encode("cp1252") + path.read_bytes())
    with pytest.raises(fw.FileProblem, match="save the file as UTF-8"):
        fw.files.read_plan(path)


@pytest.mark.parametrize("last", [255, 4095, 999])
def test_counters_that_wrap(tmp_path, last):
    numbers = [last - 2, last - 1, last, 0, 1, 2, 3, 4]
    found = fw.decode(save(tmp_path / "f", seen(SETS), [f"f{n:03d}.png" for n in numbers]))
    assert np.isfinite(found.x.coordinate_px).mean() > 0.99
    assert any("wrap" in f.seen for f in found.findings)


@pytest.mark.parametrize("camera", ["P101", "101", "DSC0_101"])
def test_digits_in_front_of_a_counter_do_not_wrap(tmp_path, camera):
    numbers = [9997, 9998, 9999, 1, 2, 3, 4, 5]
    found = fw.decode(save(tmp_path / "f", seen(SETS), [f"{camera}{n:04d}.png" for n in numbers]))
    assert np.isfinite(found.x.coordinate_px).mean() > 0.99
    assert any("wrap" in f.seen for f in found.findings)


def test_a_copy_among_the_images_is_named(tmp_path):
    folder = save(tmp_path / "f", seen(SETS))
    Image.fromarray(seen(SETS)[2]).save(folder / "9.png")
    with pytest.raises(fw.InputError, match=r"9\.png is a copy of 3\.png"):
        fw.decode(folder)
    Image.fromarray(seen(SETS, 1)[2]).save(folder / "9.png")
    with pytest.raises(fw.InputError, match="list the frames as frames"):
        fw.decode(folder)


def test_what_lies_above_or_inside_a_capture_is_named(tmp_path):
    (tmp_path / "day").mkdir()
    folder = save(tmp_path / "day" / "pose0", seen(SETS))
    for given, words in (
        (tmp_path, "it holds captures: day/pose0"),
        (folder / "plan.toml", "give its folder"),
        (folder / "3.png", "give its folder"),
    ):
        with pytest.raises(fw.FileProblem, match=words):
            fw.decode(given)


def test_arrays_and_videos_in_place_of_images(tmp_path):
    folder = save(tmp_path / "a", seen(SETS), [f"{k}.npy" for k in range(8)], np.save)
    with pytest.raises(fw.FileProblem, match=r"got 8 \.npy files; give one file that holds all"):
        fw.decode(folder)
    (tmp_path / "v").mkdir()
    fw.files.write_plan(tmp_path / "v" / "plan.toml", SETS)
    for k in range(2):
        (tmp_path / "v" / f"{k}.mp4").write_bytes(b"none")
    with pytest.raises(fw.FileProblem, match=r"got 2 \.mp4 files; a capture is one video"):
        fw.decode(tmp_path / "v")


def masked(array):
    mask = np.zeros(array.shape, bool)
    mask.flat[array.size // 3] = True
    return np.ma.array(array, mask=mask)


MASKS_USED = {("unwrap", "phase_rad")}
LISTS = {("wavelet_ridge", "frequencies"), ("crop_cloud", "box_mm"), ("gauge_study", "parts")}
"""Arguments that are lists rather than measured maps."""
POSES = {("turntable_axis", "poses")}
"""Matrices; a mask has no meaning in them."""


@pytest.mark.parametrize("call", [c for c in calls() if not c.slow], ids=lambda call: call.name)
def test_masks_count_in_every_public_function(call):
    for key, value in call.arguments.items():
        real = isinstance(value, np.ndarray) and value.size > 3 and value.dtype.kind in "uif"
        if not real or (call.name, key) in MASKS_USED | LISTS | POSES:
            continue
        with pytest.raises(fw.InputError):
            call.function(**{**call.arguments, key: masked(value)})


CODES = PatternPlan(*SIZE, tuple(GrayCode(a, 4.0, n) for a, n in zip("xy", SIZE, strict=True)))
PAIRS = PatternPlan(
    *SIZE,
    (
        *(GrayCode(a, 2.0, n, True) for a, n in zip("xy", SIZE, strict=True)),
        Uniform("white"),
        Uniform("black"),
    ),
)
BOTH: tuple[Block, ...] = tuple(
    block
    for axis, n in zip("xy", SIZE, strict=True)
    for block in (PhaseSteps(axis, 25.0, equal_steps(4)), GrayCode(axis, 25.0, n))  # type: ignore[arg-type]
)
MIXED = PatternPlan(*SIZE, BOTH)


def parts(plan):
    """The frames of every block."""
    frames, out = seen(plan), []
    for block in plan.blocks:
        out.append(frames[: block.frames])
        frames = frames[block.frames :]
    return out


def codes_last_bit_first(x, y):
    return x[::-1] + y[::-1]


def codes_last_first_inverted(x, y):
    return [200 - f for f in codes_last_bit_first(x, y)]


def bits_in_turn(x, y):
    return [f for pair in zip(x, y, strict=True) for f in pair]


def pairs_last_bit_first(x, y, white, black):
    turned = [c[k + j] for c in (x, y) for k in range(len(c) - 2, -1, -2) for j in (0, 1)]
    return turned + white + black


def inverses_after_all(x, y, white, black):
    return x[::2] + x[1::2] + y[::2] + y[1::2] + white + black


def inverse_first(x, y, white, black):
    return [c[k ^ 1] for c in (x, y) for k in range(len(c))] + white + black


def fringes_first(fx, gx, fy, gy):
    return fx + fy + gx + gy


def codes_first(fx, gx, fy, gy):
    return gx + fx + gy + fy


ORDERS = [
    (CODES, codes_last_bit_first, "least significant bit", "least_first = true in plan.toml"),
    (CODES, codes_last_first_inverted, "are inverted, light for dark", "inverted = true"),
    (CODES, bits_in_turn, "bits of both axes in turn", "bits_in_turn = true in plan.toml"),
    (PAIRS, pairs_last_bit_first, "least significant bit", "least_first = true in plan.toml"),
    (PAIRS, inverses_after_all, "come after all bits", "inverses_last = true in plan.toml"),
    (PAIRS, inverse_first, "are inverted, light for dark", "inverted = true"),
    (MIXED, fringes_first, "fringes along x, fringes along y, Gray code along x", "sequence of"),
    (MIXED, codes_first, "Gray code along x, fringes along x, Gray code along y", "sequence of"),
]


@pytest.mark.parametrize(
    ("plan", "order", "words", "advice"), ORDERS, ids=[str(k) for k in range(len(ORDERS))]
)
def test_orders_of_other_programs_are_named(plan, order, words, advice):
    with pytest.raises(fw.FramesContradictPlan) as error:
        fw.decode(order(*parts(plan)), plan)
    said = str(error.value)
    assert words in said, said
    assert advice in said, said
    assert "swapped" not in said, said


def with_words(plan, in_turn=False, **words):
    blocks = [replace(b, **words) if isinstance(b, GrayCode) else b for b in plan.blocks]
    return replace(plan, blocks=tuple(blocks), bits_in_turn=in_turn)


SAID = [
    (CODES, codes_last_bit_first, {"least_first": True}),
    (CODES, codes_last_first_inverted, {"least_first": True, "inverted": True}),
    (CODES, bits_in_turn, {"in_turn": True}),
    (PAIRS, pairs_last_bit_first, {"least_first": True}),
    (PAIRS, inverses_after_all, {"inverses_last": True}),
    (PAIRS, inverse_first, {"inverted": True}),
]


@pytest.mark.parametrize(("plan", "order", "words"), SAID, ids=[str(k) for k in range(len(SAID))])
def test_plans_say_the_orders_of_other_programs(tmp_path, plan, order, words):
    said = with_words(plan, **words)
    folder = save(tmp_path / "shots", order(*parts(plan)), plan=said)
    found = fw.decode(folder)
    for map_, truth, cell in zip((found.x, found.y), (COLUMN, ROW), (4.0, 4.0), strict=True):
        error = map_.coordinate_px - truth
        assert np.isfinite(error).mean() > 0.99
        assert np.nanmax(np.abs(error)) < cell
    assert fw.files.read_plan(folder / "plan.toml") == said
    if "inverted" not in words:
        light = fw.stack.texture(order(*parts(plan)), said)
        np.testing.assert_allclose(light, fw.stack.texture(seen(plan), plan), atol=1e-3)


@pytest.mark.parametrize(
    ("plan", "words", "advice"),
    [
        (CODES, {"least_first": True}, "most significant bit.* write least_first = false"),
        (PAIRS, {"inverses_last": True}, "this plan says inverses_last = true"),
        (CODES, {"in_turn": True}, "this plan says bits_in_turn = true"),
    ],
)
def test_words_that_the_frames_contradict_are_named(plan, words, advice):
    with pytest.raises(fw.InputError, match=advice):
        fw.decode(seen(plan), with_words(plan, **words))


@pytest.mark.parametrize("both", [(False, False), (True, False), (True, True)])
def test_pictures_come_in_the_order_of_the_plan(tmp_path, both):
    """Labels, pictures, streams and calibrations of orders that are combined."""
    inverse, last = both
    codes = [
        GrayCode(a, 4.0, n, inverse, least_first=True, inverses_last=last)
        for a, n in zip("xy", SIZE, strict=True)
    ]
    light = () if inverse else (Uniform("white"), Uniform("black"))
    plan = PatternPlan(*SIZE, (*codes, *light), bits_in_turn=True)
    plain = with_words(plan, least_first=False, inverses_last=False)
    assert sorted(plan.labels()) == sorted(plain.labels())
    assert plan.labels()[:2] in (["x-gray-6", "y-gray-6"], ["x-gray-6", "x-gray-6-inverse"])
    drawn = dict(zip(plain.labels(), fw.encode(plain), strict=True))
    for label, picture in zip(plan.labels(), fw.encode(plan), strict=True):
        np.testing.assert_array_equal(picture, drawn[label])
    by_label = dict(zip(plain.labels(), seen(plain), strict=True))
    frames = [by_label[label] for label in plan.labels()]
    stream = fw.stack.StreamingDecoder(plan)
    for frame in frames:
        stream.add(frame)
    usual = fw.decode(seen(plain), plain)
    for found in (stream.result(), fw.stack.Decoder(plan, frames[0].shape).decode(frames)):
        np.testing.assert_allclose(found.x.coordinate_px, usual.x.coordinate_px, atol=1e-3)
        np.testing.assert_allclose(found.y.sigma_px, usual.y.sigma_px, rtol=0.02)
    assert len(fw.files.write_patterns(tmp_path / "p", plan)) == plan.frames


def test_moving_scenes_take_the_most_significant_bit_first():
    plan = with_words(MIXED, least_first=True)
    with pytest.raises(fw.InputError, match="expected a plan without least_first"):
        fw.stack.SequenceDecoder(plan)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: GrayCode("x", 4.0, 400, inverses_last=True), "got a code without them"),
        (lambda: replace(CODES, blocks=CODES.blocks[:1], bits_in_turn=True), "one along y"),
        (lambda: replace(MIXED, bits_in_turn=True), "one right after the other"),
    ],
)
def test_orders_that_make_no_sense_are_refused(make, words):
    with pytest.raises(fw.InputError, match=words):
        make()


def test_a_frame_that_is_a_copy_of_an_earlier_one_is_named():
    frames = seen(SETS)
    frames[5] = frames[1]
    with pytest.raises(
        fw.FramesContradictPlan, match="x-phase-400px-1 has the counts of frame x-p"
    ):
        fw.decode(frames, SETS)
