"""Captures of other programs: what their plans can say, against pictures drawn by their formulas."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy
from PIL import Image

import fringeworks as fw
from fringeworks.files import read_plan, write_plan
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.patterns.encode import thrown
from fringeworks.simulate import bust, fringe_plan, look, photograph, standard_rig
from tests.commands import run

WIDTH, ROWS = 640, 120
COLUMNS = np.arange(WIDTH)
GRAY = 'kind = "gray", axis = "x", step_px = 16, inverse = true'


def plan_of(tmp_path, *entries, head="", width=WIDTH):
    """A plan that is written by hand, and survives being written again."""
    sequence = "\n".join(f"    {{{entry}}}," for entry in entries)
    path = tmp_path / "plan.toml"
    path.write_text(
        f'kind = "plan"\nprojector = [{width}, {ROWS}]\n{head}\nsequence = [\n{sequence}\n]\n'
    )
    plan = read_plan(path)
    again = read_plan(write_plan(tmp_path / "again.toml", plan))
    for one, other in zip(fw.encode(plan), fw.encode(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.labels() == plan.labels()
    return plan


def seen(pictures, *, scale=0.8, blur=0.7, noise=1.5, seed=0, mirror=False):
    """Frames of a tilted plane of lines of light, (n, WIDTH) from 0 to 1; and the coordinate that
    each pixel sees, in the projector's own pixels."""
    rng = np.random.default_rng(seed)
    rows = np.arange(100)[:, None]
    at = np.arange(20.0, WIDTH - 20.0, scale)[None] + 0.15 * (rows - 50.0)
    fine = 10
    frames = []
    for line in pictures:
        light = np.repeat(np.asarray(line, float)[:: -1 if mirror else 1], fine)
        light = scipy.ndimage.gaussian_filter1d(light, blur * scale * fine, mode="nearest")
        light = scipy.ndimage.uniform_filter1d(light, 2 * int(scale * fine / 2) + 1, mode="nearest")
        place = (np.arange(light.size) + 0.5) / fine - 0.5
        counts = 30.0 + 180.0 * np.interp(at, place, light)
        frames.append(np.clip(np.rint(counts + rng.normal(0.0, noise, at.shape)), 0, 255))
    return np.stack(frames).astype(np.uint8), at


def bits_of(cells, count):
    """Gray code of cells, (count, WIDTH), the most significant bit first."""
    words = cells ^ (cells >> 1)
    return np.stack([(words >> (count - 1 - k)) & 1 for k in range(count)])


def with_inverse(bits):
    return np.stack([pattern for bit in bits for pattern in (bit, 1 - bit)])


def cosines(formula, steps=4, period=32.0):
    phase = 2.0 * np.pi * COLUMNS / period
    return np.stack([0.5 + 0.5 * formula(phase, n, steps) for n in range(steps)])


def check(frames, plan, truth, *, measured=0.98, rms=0.12, options=None):
    """Decode, and compare with the truth: where, how exact, and how honest."""
    found = fw.decode(frames, plan, **(options or {}))
    error = found.x.coordinate_px - truth
    ok = np.isfinite(error)
    assert ok.mean() > measured
    assert np.sqrt(np.mean(error[ok] ** 2)) < rms
    assert abs(np.mean(error[ok])) < 0.1 * rms
    assert np.mean(np.abs(error[ok]) < 2.0 * found.x.sigma_px[ok]) > 0.9
    assert not [f for f in found.findings if f.severity == "error"]
    return found


STEPS = {
    "steps = 4": lambda phase, n, steps: np.cos(phase - 2 * np.pi * n / steps),
    "steps = 4, sign = -1": lambda phase, n, steps: np.cos(phase + 2 * np.pi * n / steps),
    "steps = 4, sign = -1, start_deg = 90": lambda phase, n, steps: np.sin(
        phase + 2 * np.pi * n / steps
    ),
    "steps = 4, start_deg = 90": lambda phase, n, steps: np.sin(phase - 2 * np.pi * n / steps),
    "steps = 4, sign = -1, start_deg = 180": lambda phase, n, steps: (
        -np.cos(phase + 2 * np.pi * n / steps)
    ),
    "steps = 4, sign = -1, start_deg = -90": lambda phase, n, steps: np.cos(
        phase - 2 * np.pi * (steps - 1 - n) / steps
    ),
    "steps = 4, start_deg = -11.25": lambda phase, n, steps: np.cos(
        phase + 2 * np.pi / 32 - 2 * np.pi * n / steps
    ),
    "shifts_deg = [120, 0, -120]": lambda phase, n, steps: np.cos(
        phase + 2 * np.pi * (n - 1) / steps
    ),
}


@pytest.mark.parametrize("words", list(STEPS))
def test_steps_of_other_programs(tmp_path, words):
    """Sign and start of the steps, in the words of the plan."""
    plan = plan_of(tmp_path, f'kind = "phase", axis = "x", period_px = 32, {words}', GRAY)
    fringes = cosines(STEPS[words], steps=3 if "shifts" in words else 4)
    check(*_with(seen, [*fringes, *with_inverse(bits_of(COLUMNS // 16, 6))], plan))
    if "steps" in words:
        written = (tmp_path / "again.toml").read_text()
        assert ("sign = -1" in written) == ("sign" in words)


def _with(take, pictures, plan, **options):
    frames, truth = take(pictures, **options)
    return frames, plan, truth


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("steps = 4, sign = 0", "sign of the steps: expected 1 or -1, got 0"),
        ("steps = 4, start_deg = inf", "start_deg: Input should be a finite number"),
        ("shifts_deg = [0, 90, 180], sign = -1", "expected together with steps"),
        ("shifts_deg = [0, 90, 180], start_deg = 5", "expected together with steps"),
    ],
)
def test_nonsense_about_steps_is_refused(tmp_path, entry, words):
    with pytest.raises(fw.InputError, match=words):
        plan_of(tmp_path, f'kind = "phase", axis = "x", period_px = 32, {entry}')


LIGHT = {
    "inverse": (", inverse = true", (), lambda bits: with_inverse(bits)),
    "white": ("", ('kind = "white"', 'kind = "black"'), lambda bits: [*bits, 1 + 0 * bits[0], 0 * bits[0]]),
    "fringes": ("", (), lambda bits: bits),
}  # fmt: skip
PHASE = 'kind = "phase", axis = "x", period_px = 32, steps = 4'


@pytest.mark.parametrize("light", list(LIGHT))
@pytest.mark.parametrize("inverted", ["true", "[0]", "[5]", "[0, 2, 3]"])
def test_inverted_bits(tmp_path, inverted, light):
    """A Gray code whose bits are light for dark, all of them or some."""
    words, entries, pictures = LIGHT[light]
    code = f'kind = "gray", axis = "x", step_px = 16{words}, inverted = {inverted}'
    plan = plan_of(tmp_path, PHASE, code, *entries)
    bits = bits_of(COLUMNS // 16, 6)
    for k in range(6):
        if inverted == "true" or str(k) in inverted:
            bits[k] = 1 - bits[k]
    fringes = cosines(STEPS["steps = 4"])
    check(*_with(seen, [*fringes, *pictures(bits)], plan))


@pytest.mark.parametrize("light", ["inverse", "white"])
@pytest.mark.parametrize("inverted", ["true", "[1, 7]"])
def test_inverted_bits_without_fringes(tmp_path, inverted, light):
    """Also the place within a blurred border, which the brightness of a bit tells."""
    words, entries, pictures = LIGHT[light]
    code = f'kind = "gray", axis = "x", step_px = 2{words}, inverted = {inverted}'
    plan = plan_of(tmp_path, code, *entries)
    bits = bits_of(COLUMNS // 2, 9)
    plain = plan_of(tmp_path, code.split(", inverted")[0], *entries)
    flipped = bits.copy()
    for k in range(9):
        if inverted == "true" or str(k) in inverted:
            flipped[k] = 1 - bits[k]
    if inverted != "true":
        plan = plan_of(tmp_path, code.replace("[1, 7]", "[1, 7]"), *entries)
    one = check(*_with(seen, pictures(flipped), plan, scale=0.4), rms=0.6)
    other = check(*_with(seen, pictures(bits), plain, scale=0.4), rms=0.6)
    assert np.nanmean(one.x.sigma_px) == pytest.approx(np.nanmean(other.x.sigma_px), rel=0.02)


def test_inverted_digits(tmp_path):
    code = 'kind = "gray", axis = "x", step_px = 16, levels = 4, inverted = [1]'
    plan = plan_of(tmp_path, PHASE, code, 'kind = "white"', 'kind = "black"')
    pictures = np.stack([picture[0] / 255.0 for picture in fw.encode(plan)])
    cell, digits = COLUMNS // 16, []
    for place in (16, 4, 1):
        before, digit = np.divmod(cell // place, 4)
        digits.append(np.where(before % 2, 3 - digit, digit) / 3)
    digits[1] = 1.0 - digits[1]
    np.testing.assert_allclose(pictures[4:7], digits, atol=0.01)
    check(*_with(seen, pictures, plan))


def test_inverted_code_that_the_plan_does_not_say_is_named_with_what_says_it(tmp_path):
    entries = (PHASE, 'kind = "gray", axis = "x", step_px = 16', 'kind = "white"', 'kind = "black"')
    plan = plan_of(tmp_path, *entries)
    bits = 1 - bits_of(COLUMNS // 16, 6)
    frames, _ = seen([*cosines(STEPS["steps = 4"]), *LIGHT["white"][2](bits)])
    with pytest.raises(fw.FramesContradictPlan, match="light for dark.*inverted = true"):
        fw.decode(frames, plan)


@pytest.mark.parametrize("inverted", ["[6]", "[-1]", "[1.5]", '"all"'])
def test_nonsense_about_inverted_bits_is_refused(tmp_path, inverted):
    with pytest.raises(fw.InputError, match="inverted"):
        plan_of(tmp_path, PHASE, f"{GRAY}, inverted = {inverted}")


@pytest.mark.parametrize("light", list(LIGHT))
@pytest.mark.parametrize(("step", "offset"), [(16, 0), (15, 0), (16, -8), (24, -12)])
def test_mirrored_columns(tmp_path, light, step, offset):
    """A projector that shows columns from right to left: coordinates are its own pixels."""
    words, entries, pictures = LIGHT[light]
    code = f'kind = "gray", axis = "x", step_px = {step}, offset_px = {offset}{words}'
    head = 'mirrored = ["x"]'
    plan = plan_of(tmp_path, PHASE, code, *entries, head=head)
    count = plan.blocks[1].bits
    bits = bits_of((COLUMNS - offset) // step, count)
    sent = [*cosines(STEPS["steps = 4"]), *pictures(bits)]
    for picture, line in zip(fw.encode(plan), sent, strict=True):
        np.testing.assert_allclose(picture[0] / 255.0, line, atol=0.003)
    check(*_with(seen, sent, plan, mirror=True))


@pytest.mark.parametrize("step", [2, 3])
def test_mirrored_columns_without_fringes(tmp_path, step):
    code = f'kind = "gray", axis = "x", step_px = {step}, inverse = true, inverted = [1]'
    plan = plan_of(tmp_path, code, head='mirrored = ["x"]')
    bits = bits_of(COLUMNS // step, plan.blocks[0].bits)
    bits[1] = 1 - bits[1]
    check(*_with(seen, with_inverse(bits), plan, mirror=True, scale=0.5), rms=0.35 * step)


@pytest.mark.parametrize("mirrored", [("x",), ("y",), ("x", "y")])
@pytest.mark.parametrize("levels", [2, 3, 4])
def test_mirrored_blocks_are_the_pictures_from_the_other_end(mirrored, levels):
    blocks = (
        PhaseSteps("x", 21.0, equal_steps(3)),
        PhaseSteps("y", 9.0, tuple(np.radians([10.0, 100.0, 220.0, 300.0]))),
        GrayCode("x", 5.0, 97, False, -3.0, levels),
        GrayCode("y", 3.2, 40, False, 0.0, levels, True),
        Uniform("white"),
    )
    plan = fw.PatternPlan(97, 40, blocks, mirrored=mirrored)
    there = np.stack(list(thrown(plan)))
    own = np.stack(list(fw.encode(plan.used[0])))
    # A cosine at a half of the counts may be rounded up or down.
    assert np.abs(there.astype(int) - own).max() <= 1
    assert np.mean(there != own) < 0.03
    assert (np.stack(list(fw.encode(plan))) != there).any()


def test_a_rig_is_calibrated_and_measures_with_a_mirrored_projector():
    rig = standard_rig(scale=0.2)
    plan = fringe_plan(rig)
    view = look(rig, bust())
    mirrored = dataclasses.replace(plan, mirrored=("x", "y"))
    one = fw.measure(fw.Stack(tuple(photograph(view, plan)), plan), rig).points
    other = fw.measure(fw.Stack(tuple(photograph(view, mirrored)), mirrored), rig).points
    both = np.isfinite(one.xyz_mm).all(axis=-1) & np.isfinite(other.xyz_mm).all(axis=-1)
    assert both.mean() > 0.95 * np.isfinite(one.xyz_mm).all(axis=-1).mean()
    off = np.linalg.norm(one.xyz_mm - other.xyz_mm, axis=-1)[both]
    assert np.median(off) < 0.1
    with pytest.raises(fw.RigMismatch, match="from behind: .* which a plan says by mirrored"):
        fw.measure(fw.Stack(tuple(photograph(view, mirrored)), plan), rig, axis="x")


@pytest.mark.parametrize("mirrored", ['"x"', '["z"]', "true"])
def test_nonsense_about_mirrors_is_refused(tmp_path, mirrored):
    with pytest.raises(fw.InputError, match="mirrored"):
        plan_of(tmp_path, PHASE, GRAY, head=f"mirrored = {mirrored}")


@pytest.mark.parametrize("light", ["inverse", "white"])
@pytest.mark.parametrize("fringes", [True, False])
def test_unused_finest_bits(tmp_path, light, fringes):
    """Bits that were projected and show nonsense: their frames are left out."""
    words, entries, pictures = LIGHT[light]
    code = f'kind = "gray", axis = "x", step_px = 2, unused = 3{words}'
    plan = plan_of(tmp_path, *([PHASE] if fringes else []), code, *entries)
    rng = np.random.default_rng(1)
    bits = bits_of(COLUMNS // 2, 9).astype(float)
    bits[6:] = rng.uniform(0.0, 3.0, bits[6:].shape)
    sent = [*(cosines(STEPS["steps = 4"]) if fringes else []), *pictures(bits)]
    frames, truth = seen(sent)
    frames[-4 if light == "white" else -2] = 7  # a constant frame of the unused bits
    found = check(frames, plan, truth, rms=0.12 if fringes else 5.5)
    assert not [f for f in found.findings if f.kind == "resolution"]
    stream = fw.stack.StreamingDecoder(plan)
    for frame in frames:
        stream.add(frame)
    assert stream.result() == found
    decoder = fw.stack.Decoder(plan, frames[0].shape)
    np.testing.assert_array_equal(decoder.decode(frames).x.coordinate_px, found.x.coordinate_px)


def test_frames_that_are_not_decoded(tmp_path):
    """Flashes and pauses between the patterns are said to be unused, wherever they are."""
    pause = 'kind = "unused"'
    plan = plan_of(tmp_path, pause, PHASE, pause, GRAY, pause, pause)
    assert plan.labels()[0] == "unused"
    pictures = [*cosines(STEPS["steps = 4"]), *with_inverse(bits_of(COLUMNS // 16, 6))]
    flash = 1.0 + 0 * COLUMNS
    sent = [0 * COLUMNS, *pictures[:4], 1.3 * flash, *pictures[4:], pictures[3], pictures[-1]]
    frames, truth = seen(sent)
    frames[0] = 0
    check(frames, plan, truth)
    with pytest.raises(fw.FramesContradictPlan, match="the plan has 20, got 16"):
        fw.decode(frames[:16], plan)
    with pytest.raises(fw.FramesContradictPlan, match="swapped"):
        fw.decode(frames[[0, 1, 3, 2, *range(4, 20)]], plan)


@pytest.mark.parametrize("unused", ["-1", "6", "1.5", "true"])
def test_nonsense_about_unused_bits_is_refused(tmp_path, unused):
    with pytest.raises(fw.InputError, match="unused"):
        plan_of(tmp_path, PHASE, f"{GRAY}, unused = {unused}")
    with pytest.raises(fw.InputError, match="expected fringes or Gray code"):
        plan_of(tmp_path, 'kind = "unused"')


def _write_colours(folder, frames, plan_text, others):
    """Colour images whose channels are given in ``others`` and, in turn, by the frames."""
    folder.mkdir(exist_ok=True)
    (folder / "plan.toml").write_text(plan_text)
    for k, image in enumerate(others(frames)):
        Image.fromarray(np.ascontiguousarray(image)).save(folder / f"{k:02d}.png")


@pytest.mark.parametrize("channel", ["r", "g", "b"])
def test_one_channel_of_colour_images(tmp_path, channel):
    """The other channels show something else, such as the light of the room."""
    plan = plan_of(tmp_path, PHASE, GRAY)
    frames, truth = seen([*cosines(STEPS["steps = 4"]), *with_inverse(bits_of(COLUMNS // 16, 6))])
    rng = np.random.default_rng(0)

    def coloured(frames):
        for frame in frames:
            image = rng.integers(0, 255, (*frame.shape, 3), dtype=np.uint8)
            image[..., "rgb".index(channel)] = frame
            yield image

    folder = tmp_path / "shots"
    _write_colours(folder, frames, (tmp_path / "plan.toml").read_text(), coloured)
    stack = fw.files.read_stack(folder, channels=channel)
    np.testing.assert_array_equal(np.stack(stack.frames), frames)
    check(frames, plan, truth)
    (folder / "capture.toml").write_text(f'kind = "stack"\nchannels = "{channel}"\n')
    assert fw.decode(folder).x == fw.decode(stack).x
    np.save(tmp_path / "all.npy", np.stack([np.stack([f] * 3, axis=-1) for f in frames]))
    single = fw.files.read_stack(tmp_path / "all.npy", channels=channel)
    np.testing.assert_array_equal(np.stack(single.frames), frames)


def test_three_steps_in_the_channels_of_one_image(tmp_path):
    entry = 'kind = "phase", axis = "x", period_px = 32, steps = 3'
    plan_of(tmp_path, entry, 'kind = "gray", axis = "x", step_px = 16, inverse = true')
    fringes = cosines(STEPS["steps = 4"], steps=3)
    frames, truth = seen([*fringes, *with_inverse(bits_of(COLUMNS // 16, 6))])
    folder = tmp_path / "shots"
    _write_colours(
        folder,
        frames,
        (tmp_path / "plan.toml").read_text(),
        lambda frames: [np.stack(frames[k : k + 3], axis=-1) for k in range(0, 15, 3)],
    )
    stack = fw.files.read_stack(folder, channels="rgb")
    check(np.stack(stack.frames), stack.plan, truth, rms=0.15)
    with pytest.raises(fw.FramesContradictPlan, match="15 frames, got 5 images with 2 channels"):
        fw.files.read_stack(folder, channels="bg")


def test_nonsense_about_channels_is_refused(tmp_path):
    plan_of(tmp_path, PHASE)
    folder = tmp_path / "shots"
    folder.mkdir()
    (folder / "plan.toml").write_text((tmp_path / "plan.toml").read_text())
    for k in range(4):
        Image.fromarray(np.zeros((8, 8), np.uint8)).save(folder / f"{k}.png")
    for channels in ("x", "gg", "rgba", "violet"):
        with pytest.raises(fw.InputError, match="channels: expected some of r, g and b"):
            fw.files.read_stack(folder, channels=channels)
    with pytest.raises(
        fw.InputError, match="expected a colour image for its channels g, got a grey"
    ):
        fw.files.read_stack(folder, channels="g")
    np.save(tmp_path / "grey.npy", np.zeros((4, 8, 8), np.uint8))
    with pytest.raises(fw.InputError, match=r"shape \(n, h, w, 3\)"):
        fw.files.read_stack(tmp_path / "grey.npy", channels="g")
    done = run("decode", folder, "--steps", "4", "--channels", "g", code=2)
    assert "--channels: with --steps" in done.stderr


def lines(steps, width, shown=1.0):
    """A line that moves by its width from frame to frame."""
    return np.stack([shown * ((COLUMNS // width) % steps == k) for k in range(steps)])


def line_plan(tmp_path, steps, width, cell=0.5, light="inverse"):
    period = steps * width
    start = 180.0 * (width - 1) / period
    line = f'kind = "phase", axis = "x", period_px = {period}, line_px = {width}'
    words, entries, pictures = LIGHT[light]
    code = f'kind = "gray", axis = "x", step_px = {cell * period}{words}'
    plan = plan_of(tmp_path, f"{line}, steps = {steps}, start_deg = {start}", code, *entries)
    bits = bits_of((COLUMNS // (cell * period)).astype(int), plan.blocks[1].bits)
    sent = [*lines(steps, width), *pictures(bits)]
    for picture, light_sent in zip(fw.encode(plan), sent, strict=True):
        np.testing.assert_allclose(picture[0] / 255.0, light_sent, atol=0.003)
    return plan, sent


@pytest.mark.parametrize(
    ("steps", "width", "scale", "light"),
    [
        (4, 1, 0.5, "inverse"),
        (4, 2, 2.0, "inverse"),
        (4, 2, 0.8, "white"),
        (6, 1, 0.8, "inverse"),
        (6, 1, 1.0, "white"),
        (6, 2, 0.5, "inverse"),
        (6, 2, 2.0, "white"),
        (8, 1, 1.0, "inverse"),
        (8, 2, 0.8, "inverse"),
    ],
)
def test_lines_that_are_shifted(tmp_path, steps, width, scale, light):
    """Line shifting: σ holds for sharp and for blurred lines, and blurred ones are exact."""
    plan, sent = line_plan(tmp_path, steps, width, light=light)
    for blur in (0.3, 0.7, 1.2):
        frames, truth = seen(sent, scale=scale, blur=blur, seed=steps)
        found = fw.decode(frames, plan)
        error = found.x.coordinate_px - truth
        ok, wide = np.isfinite(error), blur * scale / width
        sigma = found.x.sigma_px[ok]
        assert ok.mean() > (0.98 if wide > 0.4 or steps < 8 else 0.85)
        assert abs(np.mean(error[ok])) < 0.01 * width
        assert np.mean(np.abs(error[ok]) < 2.0 * sigma) > 0.88
        assert np.mean(np.abs(error[ok]) > 5.0 * sigma) < 1e-4
        rms = np.sqrt(np.mean(error[ok] ** 2))
        # A sharp line tells no more than which of the steps lights a pixel.
        assert rms < (0.07 * scale if wide > 1.0 else 0.3) * width
        assert not {f.kind for f in found.findings} & {"response", "steps", "motion", "flicker"}


def test_mirrored_lines(tmp_path):
    plan, sent = line_plan(tmp_path, 6, 2)
    mirrored = dataclasses.replace(plan, mirrored=("x",))
    check(*_with(seen, sent, mirrored, mirror=True, blur=1.2))


def test_lines_that_saturate_are_not_measured(tmp_path):
    plan, sent = line_plan(tmp_path, 6, 1)
    frames, truth = seen([1.25 * np.asarray(p) if k < 6 else p for k, p in enumerate(sent)])
    frames[:6, :, 200:400] = np.clip(frames[:6, :, 200:400] * 2.5, 0, 255).astype(np.uint8)
    found = fw.decode(frames, plan).x
    saturated = (frames[:6] == 255).any(axis=0)
    assert saturated.mean() > 0.05
    assert np.isnan(found.coordinate_px[saturated]).all()
    assert (found.reason[saturated] == fw.Reason.SATURATED).mean() > 0.9
    error = found.coordinate_px - truth
    off = (np.abs(error) / found.sigma_px)[~saturated]
    assert np.mean(off < 2.0) > 0.93


def test_nonsense_about_lines_is_refused(tmp_path):
    line = 'kind = "phase", axis = "x", period_px = 6, steps'
    for entry, words in (
        (f"{line} = 6, line_px = 0", "line_px: expected above 0 px and below the period of 6 px"),
        (f"{line} = 6, line_px = 6", "line_px: expected above 0 px and below the period of 6 px"),
        (f"{line} = 3, line_px = 2", "line_px: expected 4 to 8 equal steps"),
        (f"{line} = 12, line_px = 2", "line_px: expected 4 to 8 equal steps"),
        (f"{line[:-5]}shifts_deg = [0, 80, 180, 270], line_px = 2", "4 to 8 equal steps"),
        (f"{line[:-5]}shifts_deg = [0, 90, 180, 0], line_px = 2", "4 to 8 equal steps"),
    ):
        with pytest.raises(fw.InputError, match=words):
            plan_of(tmp_path, entry)
    plan = plan_of(tmp_path, f"{line} = 6, line_px = 1", GRAY.replace("16, inverse = true", "3"))
    frames, _ = seen([*lines(6, 1), *bits_of(COLUMNS // 3, 8)])
    with pytest.raises(fw.InputError, match="expected inverse bits, or a white and a black frame"):
        fw.decode(frames, plan)
    with pytest.raises(fw.InputError, match="phase steps with a cosine"):
        fw.stack.separate_light(frames, plan)
