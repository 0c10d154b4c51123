"""The cause that is named first is the true one: periods, steps of all sets, dark and dim frames, bands
of rows, an axis without margin, and sharp lines."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps

WIDTH, HEIGHT, SHAPE, FINE = 640, 400, (96, 260), 3
LIGHT = (Uniform("white"), Uniform("black"))


def steps(period, count, axis="x", turn=0.0, sign=1, line=None):
    return PhaseSteps(axis, period, equal_steps(count, start_rad=turn, sign=sign), line)


def plan_of(*blocks):
    return PatternPlan(WIDTH, HEIGHT, blocks)


def surface(seed):
    """Projector columns and rows of a tilted wall with a cap and a box, FINE samples per pixel."""
    rng = np.random.default_rng(seed)
    v, u = (np.mgrid[: SHAPE[0] * FINE, : SHAPE[1] * FINE] + 0.5) / FINE - 0.5
    u, v = u - SHAPE[1] / 2, v - SHAPE[0] / 2
    depth = rng.uniform(-0.15, 0.15) * u + rng.uniform(-0.2, 0.2) * v
    cap = 1.0 - ((u - rng.uniform(-60, 60)) / 55.0) ** 2 - (v / 40.0) ** 2
    depth = depth + 26.0 * np.sqrt(np.clip(cap, 0.0, None))
    depth = depth + 22.0 * ((np.abs(u - rng.uniform(-90, 90)) < 22) & (np.abs(v) < 25))
    x = WIDTH / 2 + 2.1 * u + rng.choice([-0.6, 0.6]) * depth
    y = HEIGHT / 2 + 2.1 * v + 0.03 * u
    return x, y


def photographed(plan, seed, *, noise=1.2, peak=180.0, exposure=None, blur=0.7, shake=0.0):
    """Frames of the surface; ``exposure`` is a frame and its factor, ``blur`` and ``shake`` are
    standard deviations in camera px."""
    rng = np.random.default_rng(seed + 1000)
    x, y = surface(seed)
    albedo = 0.65 + 0.25 * np.sign(np.sin(x / 61.0)) * (np.sin(y / 37.0) > 0)
    frames = []
    for block in plan.blocks:
        axis = getattr(block, "axis", "x")
        at, length = (x, WIDTH) if axis == "x" else (y, HEIGHT)
        pixels = np.arange(float(length))
        for k in range(block.frames):
            light = np.interp(at, pixels, block.values(pixels, k), left=0.0, right=0.0)
            counts = 2.0 + albedo * (8.0 + peak * light)
            if exposure is not None and exposure[0] == len(frames):
                counts = exposure[1] * counts
            if shake:
                counts = ndimage.shift(counts, shake * FINE * rng.standard_normal(2), order=1)
            seen = ndimage.gaussian_filter(counts, blur * FINE)
            seen = seen.reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
            seen = seen + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return frames


def told_of(frames, plan):
    """The refusal, or the kinds of the findings."""
    try:
        return ", ".join(one.kind for one in fw.decode(frames, plan).findings if one.rank)
    except fw.InputError as error:
        return str(error)


def refusal(frames, plan):
    with pytest.raises(fw.FramesContradictPlan) as told:
        fw.decode(frames, plan)
    return str(told.value)


GRAY = {
    "full": (*LIGHT, GrayCode("x", 20.0, WIDTH), steps(20.0, 4)),
    "half": (GrayCode("x", 10.0, WIDTH, inverse=True), steps(20.0, 3)),
    "bare": (steps(20.0, 4), GrayCode("x", 20.0, WIDTH)),
}
SETS = {
    "beats": (steps(40.0, 4), steps(36.0, 4), steps(33.0, 4)),
    "nested": (steps(640.0, 3), steps(128.0, 3), steps(25.6, 3)),
}


@pytest.mark.parametrize(
    ("name", "factor"), [("full", 1.024), ("half", 1.024), ("half", 0.98), ("bare", 1.0125)]
)
def test_a_rounded_period_beside_a_gray_code_is_named(name, factor):
    """The stack was decoded without a finding, 8 px rms off, at a σ of 0.45 px."""
    plan = plan_of(*GRAY[name])
    period = 20.0 * factor
    blocks = [steps(period, b.frames) if isinstance(b, PhaseSteps) else b for b in plan.blocks]
    said = refusal(photographed(plan, 71), plan_of(*blocks))
    assert said.startswith("frames: the fringes of"), said
    found = float(said.split("than the plan says (")[1].split(" px")[0])
    assert abs(found / 20.0 - 1.0) < 2e-3, said


@pytest.mark.parametrize("of_set", [0, 1, 2])
def test_a_rounded_period_of_one_of_three_sets_is_named(of_set):
    """It was taken for another start of its steps, or for a scene that moved."""
    shown = plan_of(*SETS["beats"])
    blocks = list(shown.blocks)
    blocks[of_set] = steps(blocks[of_set].period_px * 1.02, 4)
    said = refusal(photographed(shown, 72 + of_set), plan_of(*blocks))
    assert said.startswith(f"frames: the fringes of {blocks[of_set].period_px:.6g} px"), said
    found = float(said.split("than the plan says (")[1].split(" px")[0])
    assert abs(found / shown.blocks[of_set].period_px - 1.0) < 3e-3


@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2])
def test_all_sets_that_start_elsewhere_are_named(turn):
    said = refusal(
        photographed(plan_of(*SETS["beats"]), 75),
        plan_of(*(steps(b.period_px, b.frames, turn=turn) for b in SETS["beats"])),
    )
    assert said.startswith("frames: all sets along x have another sign or start"), said


@pytest.mark.parametrize("name", ["full", "bare"])
def test_a_dark_bit_is_named(name):
    """Of a code without inverses, 44 % of the pixels were wrong by 96 px, without a finding."""
    plan = plan_of(*GRAY[name])
    frames, labels = photographed(plan, 76), plan.labels()
    for k in (labels.index("x-gray-1"), labels.index("x-gray-2")):
        wrong = list(frames)
        wrong[k] = (frames[k] // 40).astype(np.uint8)
        assert f"frame {labels[k]}: it shows no pattern" in refusal(wrong, plan)


@pytest.mark.parametrize("seed", [77, 78])
def test_an_exposure_that_misleads_is_named(seed):
    """19 % of the pixels were wrong by a period, without a finding."""
    plan = plan_of(*GRAY["full"])
    bit = plan.labels().index("x-gray-3")
    dark = fw.decode(photographed(plan, seed, exposure=(bit, 0.65)), plan)
    (said,) = (one.text for one in dark.findings if one.kind == "exposure")
    assert "frame x-gray-3 has another exposure than the others along x (0.6" in said
    right = fw.decode(photographed(plan, seed), plan).x.coordinate_px
    off = np.abs(dark.x.coordinate_px - right)
    assert np.mean(off[np.isfinite(off)] > 5.0) < 1e-3
    fine = fw.decode(photographed(plan, seed, exposure=(bit, 0.95)), plan)
    assert not [one for one in fine.findings if one.kind == "exposure"]


@pytest.mark.parametrize("name", ["full", "half", "beats", "nested"])
def test_rows_that_see_the_next_picture_are_named(name):
    """They decoded in places to wrong fringe orders, without a finding."""
    plan = plan_of(*(GRAY | SETS)[name])
    frames = photographed(plan, 79)
    later = [*frames[1:], frames[0]]
    mixed = [np.vstack([a[:40], b[40:58], a[58:]]) for a, b in zip(frames, later, strict=True)]
    said = refusal(mixed, plan)
    assert "a band of rows" in said
    assert "shows the pattern after that of its frame" in said
    share = float(said.split("from ")[1].split(" %")[0])
    assert abs(share - 100.0 * 40 / SHAPE[0]) < 4.0


def test_an_axis_without_margin_leaves_the_other_measured():
    heights = (HEIGHT / 50, HEIGHT / 53, HEIGHT / 54)
    code = GrayCode("x", 10.0, WIDTH, inverse=True)
    plan = plan_of(code, steps(20.0, 8), *(steps(p, 3, "y") for p in heights))
    decoded = fw.decode(photographed(plan, 80, noise=5.0, peak=70.0), plan)
    (finding,) = [one for one in decoded.findings if one.kind == "axis left out"]
    assert finding.axis == "y"
    assert "expected pixels that can be measured" in finding.seen
    assert not np.isfinite(decoded.y.coordinate_px).any()
    assert decoded.y.reason.all()
    columns = surface(80)[0].reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
    measured = np.isfinite(decoded.x.coordinate_px)
    off = np.abs(decoded.x.coordinate_px - columns)[measured] / decoded.x.sigma_px[measured]
    assert np.mean(measured) > 0.9
    assert np.mean(off < 2.0) > 0.9


def test_all_axes_without_margin_are_refused():
    plan = plan_of(*(steps(p, 3) for p in (WIDTH / 60, WIDTH / 63, WIDTH / 64)))
    with pytest.raises(fw.InputError, match="expected pixels that can be measured"):
        fw.decode(photographed(plan, 81, noise=5.0, peak=50.0), plan)


@pytest.mark.parametrize("seed", [82, 83])
@pytest.mark.parametrize("line", [8.0, 5.0])
def test_sharp_lines_have_no_direction_of_their_own(seed, line):
    """The phase of a line as sharp as its steps stands still over pixels, where noise turns it."""
    plan = plan_of(GrayCode("x", 16.0, WIDTH, inverse=True), steps(32.0, 4, line=line))
    decoded = fw.decode(photographed(plan, seed), plan)
    assert np.mean(np.isfinite(decoded.x.coordinate_px)) > 0.5


@pytest.mark.parametrize("name", list(GRAY | SETS))
@pytest.mark.parametrize("seed", [84, 85])
def test_right_frames_are_kept(name, seed):
    plan = plan_of(*(GRAY | SETS)[name])
    decoded = fw.decode(photographed(plan, seed), plan)
    assert not [one for one in decoded.findings if one.kind in ("exposure", "axis left out")]
    columns = surface(seed)[0].reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
    off = np.abs(decoded.x.coordinate_px - columns)
    assert np.nanmean(off > 8.0) < 2e-3


@pytest.mark.parametrize("name", ["full", "beats", "nested"])
def test_another_number_of_steps_is_named(name):
    """It was taken for frames that were lost, or for steps of another start."""
    shown = plan_of(*(GRAY | SETS)[name])
    number, block = next((k, b) for k, b in enumerate(shown.blocks) if isinstance(b, PhaseSteps))
    told = list(shown.blocks)
    told[number] = steps(block.period_px, block.frames + 1)
    told = plan_of(*told)
    frames = (photographed(shown, 91) + photographed(shown, 91))[: told.frames]
    said = refusal(frames, told)
    assert f"has {block.frames} steps, {block.frames + 1} in the plan" in said, said
    assert said.startswith("frames: the set from "), said


def test_a_bit_that_the_plan_lacks_is_named():
    shown = plan_of(*LIGHT, GrayCode("x", 10.0, WIDTH), steps(20.0, 4))
    told = plan_of(*LIGHT, GrayCode("x", 20.0, WIDTH), steps(20.0, 4))
    said = refusal(photographed(shown, 92)[: told.frames], told)
    assert said.startswith("frames: the Gray code along x has 6 bits, 5 in the plan"), said


@pytest.mark.parametrize("name", ["full", "nested"])
def test_columns_that_the_plan_calls_rows_are_named(name):
    """Coordinates were given along the wrong axis, or the frames were called unrelated."""
    shown = plan_of(*(GRAY | SETS)[name])
    told = []
    for b in shown.blocks:
        if isinstance(b, GrayCode):
            b = GrayCode("y", b.step_px, HEIGHT, b.inverse)
        told.append(PhaseSteps("y", b.period_px, b.shifts_rad) if isinstance(b, PhaseSteps) else b)
    said = refusal(photographed(shown, 93), plan_of(*told))
    assert "the patterns along x and y are exchanged in the plan" in said, said


@pytest.mark.parametrize("name", ["full", "half", "nested"])
def test_fringes_that_blur_hides_are_named(name):
    """The frames were taken for a stack that begins early."""
    plan = plan_of(*(GRAY | SETS)[name])
    said = told_of(photographed(plan, 94, blur=7.0), plan)
    assert "they are blurred" in said or said.startswith("blur"), said


def test_vibration_is_not_called_swapped():
    plan = plan_of(GrayCode("x", 10.0, WIDTH, inverse=True), steps(20.0, 8))
    for seed in (95, 96, 97):
        said = told_of(photographed(plan, seed, shake=1.0), plan)
        causes = ("moved from frame to frame", "motion", "steps", "flicker", "fringes beside")
        assert any(cause in said for cause in causes), said
        assert "are swapped, judging" not in said or "Nearest is" in said, said


@pytest.mark.parametrize("count", [3, 4])
def test_light_of_the_room_that_rises_is_no_wrong_step(count):
    """It turns the apparent steps of a set by up to as much as it changes their light."""
    plan = plan_of(*(steps(WIDTH / n, count) for n in (1, 5, 25)))
    frames = photographed(plan, 5)
    risen = [
        np.clip(f + np.rint(16.0 * k / len(frames)), 0, 255).astype(np.uint8)
        for k, f in enumerate(frames)
    ]
    assert told_of(risen, plan).split(", ")[0] == "flicker"


@pytest.mark.parametrize("count", [4, 5])
def test_a_wrong_step_is_no_change_of_the_light(count):
    plan = plan_of(*(steps(WIDTH / n, count) for n in (1, 5, 25)))
    blocks = []
    for block in plan.blocks:
        turned = np.array(block.shifts_rad)
        turned[1] += np.radians(3.0)
        blocks.append(PhaseSteps("x", block.period_px, tuple(turned)))
    assert told_of(photographed(plan_of(*blocks), 5), plan).split(", ")[0] == "steps"


SHAKEN = {
    "nested": (steps(16.0, 6), steps(80.0, 6), steps(640.0, 6)),
    "code": (*LIGHT, GrayCode("x", 20.0, WIDTH), steps(20.0, 6)),
}


@pytest.mark.parametrize("name", SHAKEN)
@pytest.mark.parametrize("seed", [91, 92])
def test_vibration_is_told_from_wrong_steps(name, seed):
    """Both turn the phases of frames; only vibration moves the paint. It was called wrong steps,
    and up to two thirds of the pixels were beyond 5 σ."""
    plan = plan_of(*SHAKEN[name])
    shaken = fw.decode(photographed(plan, seed, shake=0.3), plan)
    kinds = [one.kind for one in shaken.findings if one.rank]
    assert kinds[0] == "motion", kinds
    x = surface(seed)[0].reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
    ratio = np.abs(shaken.x.coordinate_px - x) / shaken.x.sigma_px
    ratio = ratio[np.isfinite(ratio)]
    assert ratio.size > 0.8 * x.size
    assert np.mean(ratio <= 2.0) > 0.9
    rng = np.random.default_rng(seed)
    wrong = [
        PhaseSteps("x", b.period_px, b.shifts_rad + np.radians(4.0) * rng.standard_normal(6))
        if isinstance(b, PhaseSteps)
        else b
        for b in plan.blocks
    ]
    seen = fw.decode(photographed(plan_of(*wrong), seed), plan)
    told = [(one.kind, one.causes[0]) for one in seen.findings if one.rank]
    assert told[0] == ("steps", "wrong steps of the projector"), told


def test_light_that_drifts_turns_no_steps():
    """The frames of a set show more and more light of the room: that is not called wrong steps."""
    plan = plan_of(*SHAKEN["nested"])
    frames = [
        np.clip(frame.astype(int) + k, 0, 255).astype(np.uint8)
        for k, frame in enumerate(photographed(plan, 93))
    ]
    told = [one.kind for one in fw.decode(frames, plan).findings if one.rank]
    assert told[:1] == ["flicker"], told


def test_a_repeated_frame_of_lines_is_named():
    """Lines of which a frame repeats the one before fit a set of other steps."""
    plan = plan_of(GrayCode("x", 12.0, WIDTH, inverse=True), steps(12.0, 6, line=2.0))
    frames = photographed(plan, 94)
    again = photographed(plan, 94, noise=1.3)
    first = plan.frames - 6
    frames[first + 2] = again[first + 1]
    label = plan.labels()[first + 2]
    assert refusal(frames, plan).startswith(f"frame {label}: it repeats frame")


@pytest.mark.parametrize("seed", [95, 96])
def test_vibration_of_a_gray_code_alone_is_told(seed):
    """Borders of cells lie where the scene was in their frame: up to 3 % of the pixels were beyond
    5 σ, without a word. At rest, and in light that drifts, nothing is said of motion."""
    plan = plan_of(*LIGHT, GrayCode("x", 4.0, WIDTH, inverse=True))
    shaken = fw.decode(photographed(plan, seed, shake=0.3), plan)
    assert [one.kind for one in shaken.findings if one.rank] == ["motion"]
    x = surface(seed)[0].reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
    ratio = np.abs(shaken.x.coordinate_px - x) / shaken.x.sigma_px
    ratio = ratio[np.isfinite(ratio)]
    assert ratio.size > 0.8 * x.size
    assert np.mean(ratio <= 2.0) > 0.93
    still = photographed(plan, seed)
    drifting = [np.clip(f.astype(int) + k, 0, 255).astype(np.uint8) for k, f in enumerate(still)]
    for frames in (still, drifting):
        told = [one.kind for one in fw.decode(frames, plan).findings if one.rank]
        assert "motion" not in told
