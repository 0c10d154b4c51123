"""Decoding of stacks: right coordinates, honest errors, and refusal of wrong frames."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, Reason, decode, encode
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.signal import CameraNoise
from fringeworks.signal.noise import noise_of_residuals
from fringeworks.signal.response import Response
from fringeworks.stack import StreamingDecoder
from tests.grids import quick, thinned
from tests.oracles.phase_shift import decode_pixel
from tests.stacks import guarded, multi, take

HETERODYNE = (29, 32, 36)
X = np.arange(960.0)


def predicted(counts, steps, noise=2.0, modulation=100.0):
    """σ of the inverse-variance mean of all sets, quantisation included (theory §5)."""
    sigma = np.sqrt((noise**2 + 1 / 12) * 2 / steps) / modulation
    return sigma / np.sqrt(sum((2 * np.pi * v / 960) ** 2 for v in counts))


@pytest.mark.parametrize("steps", quick(range(3, 17), 3, 4, 5, 8, 16))
def test_error_is_that_of_theory(steps):
    plan = multi(HETERODYNE, steps, (960, 200))
    found = decode(take(plan, seed=steps), plan).x
    off = found.coordinate_px - X
    assert np.isnan(off).sum() <= 2
    assert np.sqrt(np.nanmean(off**2)) == pytest.approx(predicted(HETERODYNE, steps), rel=0.02)
    # No wrong orders, not even at the borders.
    assert np.nanmax(np.abs(off)) < 6.5 * predicted(HETERODYNE, steps)
    assert np.nanmedian(found.sigma_px) == pytest.approx(predicted(HETERODYNE, steps), rel=0.03)


@pytest.mark.parametrize(
    "counts", [(1, 8, 64), (64, 8, 1), (12, 13), (1, 20), (60, 61.5, 70), (1, 4, 16, 64)]
)
def test_orders_are_right_for_every_choice_of_periods(counts):
    plan = multi(counts, 5, (960, 150))
    found = decode(take(plan, seed=7), plan).x
    off = found.coordinate_px - X
    assert np.nanmax(np.abs(off)) < 6.5 * predicted(counts, 5)
    # Pixels are lost at the seam of the range, or at its ends where the phases do not repeat.
    assert found.failed_fraction < (0.03 if counts == (60, 61.5, 70) else 3e-3)
    reasons = {Reason.OK, Reason.ORDER_AMBIGUOUS, Reason.ISOLATED}
    assert set(np.unique(found.reason)) <= reasons


def test_against_the_oracle():
    plan = multi(HETERODYNE, [3, 4, 7], (960, 6))
    frames = take(plan, b=127.5, noise=1.0, seed=3)
    assert (frames == 255).any()
    found = decode(frames, plan, noise=CameraNoise(1.0), saturation=255).x
    rng = np.random.default_rng(0)
    for y, x in zip(rng.integers(0, 6, 60), rng.integers(0, 960, 60), strict=True):
        coordinate, sigma = decode_pixel(frames[:, y, x], plan, 1.0, 255.0)
        if np.isnan(coordinate):
            assert found.reason[y, x] == Reason.SATURATED
            continue
        assert found.coordinate_px[y, x] == pytest.approx(coordinate, abs=2e-3)
        assert found.sigma_px[y, x] == pytest.approx(sigma, rel=0.01)


def cover(off, sigma):
    ok = np.isfinite(off)
    return [float(np.mean(np.abs(off[ok]) < k * sigma[ok])) for k in (1, 2)]


@thinned(strength=1, steps=[3, 4, 8], noise=[0.5, 1.0, 2.0, 4.0, 8.0])
def test_stated_errors_cover_the_true_ones(noise, steps):
    plan = multi(HETERODYNE, steps, (960, 300))
    albedo = np.linspace(0.1, 1.0, 300)[:, None] * np.ones(960)
    frames = take(plan, noise=noise, albedo=albedo, a=135.0, b=105.0, seed=int(10 * noise))
    found = decode(frames, plan).x
    assert found.failed_fraction < (0.9 if noise == 8.0 else 0.6)
    one, two = cover(found.coordinate_px - X, found.sigma_px)
    assert one == pytest.approx(0.683, abs=0.01 if noise < 8 else 0.015)
    assert two == pytest.approx(0.954, abs=0.007 if noise < 8 else 0.01)
    # Wrong orders are NaN, not outliers.
    assert np.nanmax(np.abs(found.coordinate_px - X)) < 3.0


def test_shot_noise_is_found_and_counted():
    plan = multi(HETERODYNE, 3, (960, 300))
    albedo = np.linspace(0.3, 1.0, 300)[:, None] * np.ones(960)
    frames = take(plan, noise=1.0, gain=0.1, albedo=albedo, a=120.0, b=105.0, seed=2)
    found = decode(frames, plan)
    assert found.noise.gain == pytest.approx(0.1, rel=0.1)
    off = found.x.coordinate_px - X
    one, two = cover(off, found.x.sigma_px)
    assert (one, two) == pytest.approx((0.683, 0.954), abs=0.012)
    # With three steps the noise of the phase has three periods per turn: σ must follow it.
    turn = np.angle(np.exp(3j * 2 * np.pi * X * 36 / 960)) * np.ones((300, 1))
    for part in (np.abs(turn) < 1.0, np.abs(turn) > 2.1):
        one, _ = cover(np.where(part, off, np.nan), found.x.sigma_px)
        assert one == pytest.approx(0.683, abs=0.03)


def test_noise_of_residuals_ignores_outliers():
    rng = np.random.default_rng(0)
    brightness = rng.uniform(10, 200, 30_000)
    sigma = np.sqrt(1.5**2 + 0.05 * brightness)
    square = sigma**2 * rng.chisquare(3, brightness.size)
    square[::50] += 1e4
    found = noise_of_residuals(brightness, square, 3)
    assert found.read_counts == pytest.approx(1.5, rel=0.1)
    assert found.gain == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_every_type_and_layout_of_frames(kind):
    plan = multi(HETERODYNE, 4, (960, 50))
    frames = take(plan).astype(kind)
    kept = frames.copy()
    noise = CameraNoise(2.0)
    expected = decode(take(plan), plan, noise=noise).x.coordinate_px
    wide = np.repeat(frames, 2, axis=2)[:, :, ::2]
    for stack in (frames, list(frames), wide, np.asfortranarray(frames), frames[:, ::-1][:, ::-1]):
        found = decode(stack, plan, noise=noise).x.coordinate_px
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(frames, kept)


@pytest.mark.parametrize("shape", [(960, 2), (961, 37), (1030, 3)])
def test_widths_that_are_no_multiple_of_a_block(shape):
    plan = multi((1, 8), 4, shape)
    frames = take(plan)
    found = decode(frames, plan, noise=CameraNoise(2.0)).x
    assert np.nanmax(np.abs(found.coordinate_px - np.arange(shape[0]))) < 3.0


def streamed(frames, plan, **options):
    stream = StreamingDecoder(plan, **options)
    for frame in frames:
        stream.add(frame)
    return stream.result()


@pytest.mark.parametrize("kind", [np.uint8, np.float64])
def test_a_stream_gives_the_same_result(kind):
    size = (300, 70)
    blocks = multi((1, 8), 4, size).blocks + multi((1, 5), 3, size, "y").blocks
    gray = (GrayCode("x", 15.0, 300), PhaseSteps("x", 30.0, equal_steps(6)))
    for plan in (PatternPlan(*size, blocks), PatternPlan(*size, gray)):
        frames = take(plan, b=127.5, kind=kind)
        whole = decode(frames, plan, keep_phases=True)
        parts = streamed(frames, plan, keep_phases=True)
        assert whole.noise == parts.noise
        for axis, mine in whole.maps.items():
            for name in ("coordinate_px", "sigma_px", "modulation", "background", "reason"):
                np.testing.assert_array_equal(
                    getattr(parts.maps[axis], name), getattr(mine, name), err_msg=name
                )
            np.testing.assert_array_equal(parts.maps[axis].phase_rad, mine.phase_rad)


@pytest.mark.parametrize("saturation", [None, 240.0])
def test_a_stream_leaves_saturated_samples_out(saturation):
    plan = multi(HETERODYNE, 5, (960, 40))
    frames = take(plan, a=150.0, b=140.0, noise=1.0)
    whole = decode(frames, plan, saturation=saturation).x
    parts = streamed(frames, plan, saturation=saturation).x
    np.testing.assert_array_equal(parts.reason, whole.reason)
    # The stream subtracts saturated samples from its sums, which adds rounding errors.
    np.testing.assert_allclose(parts.coordinate_px, whole.coordinate_px, atol=5e-4)


def test_results_can_be_written_to_again():
    plan = multi((1, 8), 4, (300, 30))
    first = decode(take(plan, seed=1), plan)
    kept = first.x.coordinate_px
    expected = decode(take(plan, seed=2), plan).x.coordinate_px
    again = decode(take(plan, seed=2), plan, out=first)
    assert again.x.coordinate_px is kept
    np.testing.assert_array_equal(kept, expected)
    other = multi((1, 8), 4, (300, 30), "y")
    for frames, layout, options, words in (
        (take(plan), plan, {"keep_phases": True}, "keep_phases=False"),
        (take(other), other, {}, "expected a result along y, got one along x"),
        (take(plan)[:, :20], plan, {}, "expected coordinate_px as float32 \\(20, 300\\)"),
    ):
        with pytest.raises(InputError, match=words):
            decode(frames, layout, out=first, **options)


def test_patterns_that_fill_the_range_are_trusted():
    for steps in (3, 4, 8):
        plan = multi(HETERODYNE, steps, (960, 60))
        frames = take(plan, a=127.5, b=127.5)
        assert (frames == 255).any(axis=0).mean() > 0.2
        found = decode(frames, plan).x
        assert found.failed_fraction < 1e-4
        one, _ = cover(found.coordinate_px - X, found.sigma_px)
        assert one == pytest.approx(0.683, abs=0.02)


def test_a_stream_says_what_is_missing():
    plan = multi((1, 8), 4, (300, 20))
    frames = take(plan)
    stream = StreamingDecoder(plan)
    with pytest.raises(InputError, match="got 0; missing: x-phase-300px-0"):
        stream.result()
    for frame in frames[:7]:
        stream.add(frame)
    assert stream.missing == ["x-phase-37.5px-3"]
    with pytest.raises(InputError, match="expected the size of the first"):
        stream.add(frames[7][:-1])
    stream.add(frames[7])
    with pytest.raises(InputError, match="got one more"):
        stream.add(frames[7])


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("white_black", [False, True])
def test_gray_code_and_phase_agree_at_every_border(inverse, white_black):
    plan = guarded(16.0, 4, (960, 80), inverse=inverse, white_black=white_black)
    # The camera's pixels are shifted against the cells, so that no border lies between pixels.
    y, x = np.mgrid[:80, :960] * 1.0
    frames = take(plan, at=(y, x * 0.9937 + 0.31), seed=4)
    found = decode(frames, plan).x
    off = found.coordinate_px - (x * 0.9937 + 0.31)
    assert found.failed_fraction < 1e-3
    assert np.nanmax(np.abs(off)) < 1.0
    # A wrong bit next to its border does no harm; an undecided bit far from it makes a NaN.
    first = plan.gray_code("x")[0]
    frames[first, 10, 514:516] = 255 - frames[first, 10, 514:516]
    frames[first : first + 1 + inverse, 20, 100] = 127
    again = decode(frames, plan).x
    assert np.nanmax(np.abs(again.coordinate_px - (x * 0.9937 + 0.31))) < 1.0
    assert again.reason[20, 100] == Reason.ORDER_AMBIGUOUS


def test_gray_code_alone():
    plan = PatternPlan(960, 40, (GrayCode("x", 4.0, 960, True),))
    found = decode(take(plan), plan, noise=CameraNoise(2.0)).x
    assert np.nanmax(np.abs(found.coordinate_px - X)) <= 2.0
    assert np.nanmedian(found.sigma_px) == pytest.approx(4 / np.sqrt(12))
    bare = PatternPlan(960, 40, (GrayCode("x", 4.0, 960),))
    with pytest.raises(InputError, match="inverse bits, a white and a black frame, or fringes"):
        decode(take(bare), bare)


def test_reasons():
    plan = multi((1, 8, 64), 4, (960, 60))
    albedo = np.ones((60, 960))
    albedo[:10] = 0.0
    albedo[10:20] = 0.08
    albedo[20:30] = 0.03
    y, x = np.mgrid[:60, :960] * 1.0
    # Neighbours help on surfaces only.
    x[10:20] = np.random.default_rng(0).uniform(0.0, 959.0, (10, 960))
    frames = take(plan, albedo=albedo, a=120.0, b=115.0, at=(y, x))
    bright = frames.astype(int)
    bright[:, 40:50] = np.minimum(bright[:, 40:50] * 3, 255)
    frames = bright.astype(np.uint8)
    frames[:, 55] = 255
    reason = decode(frames, plan, noise=CameraNoise(2.0)).x.reason
    assert (reason[:10] == Reason.SHADOW).mean() > 0.98
    assert np.isin(reason[10:20], (Reason.ORDER_AMBIGUOUS, Reason.LOW_MODULATION)).all()
    assert (reason[10:20] == Reason.ORDER_AMBIGUOUS).mean() > 0.8
    # Modulation of 3.5 counts with noise of 1.4: too weak in some sets or in all.
    assert not (reason[20:30] == Reason.OK).any()
    assert (reason[30:40] == Reason.OK).all()
    assert (reason[40:50] == Reason.SATURATED).mean() > 0.3
    assert (reason[55] == Reason.SATURATED).all()
    found = decode(frames, plan, noise=CameraNoise(2.0), min_modulation=100.0).x
    assert (found.reason[10:20] == Reason.LOW_MODULATION).all()
    assert np.isnan(found.coordinate_px[found.reason != Reason.OK]).all()
    assert np.isnan(found.sigma_px[found.reason != Reason.OK]).all()


def test_saturated_samples_are_left_out():
    plan = multi(HETERODYNE, 5, (960, 60))
    frames = take(plan, a=150.0, b=140.0, noise=1.0)
    assert (frames == 255).any(axis=0).mean() > 0.2
    found = decode(frames, plan).x
    trusted = decode(frames, plan, saturation=1000.0, estimate_steps=False).x
    off, biased = found.coordinate_px - X, trusted.coordinate_px - X
    assert np.nanstd(biased) > 2 * np.nanstd(off)
    one, _ = cover(off, found.sigma_px)
    assert one == pytest.approx(0.683, abs=0.03)


def test_pixels_that_are_not_finite_are_masked():
    plan = multi((1, 8), 4, (300, 40))
    frames = take(plan, kind=np.float32)
    frames[3, 5, 7] = np.nan
    frames[1, 9, 9] = np.inf
    found = decode(frames, plan).x
    assert (found.reason[5, 7], found.reason[9, 9]) == (Reason.MASKED, Reason.MASKED)
    assert found.reason[5, 8] == Reason.OK


def test_perfect_frames():
    plan = multi((1, 8, 64), 4, (960, 4))
    exact = decode(take(plan, noise=0.0, kind=np.float64), plan).x
    assert np.abs(exact.coordinate_px - X).max() < 1e-3
    assert exact.failed_fraction == 0.0
    rounded = decode(np.stack(list(encode(plan))), plan).x
    assert np.abs(rounded.coordinate_px - X).max() < 0.05


def test_relative_coordinates():
    plan = PatternPlan(960, 30, (PhaseSteps("x", 24.0, equal_steps(5)),))
    frames = take(plan)
    with pytest.raises(InputError, match="repeat after 24 px, but the projector has 960 px"):
        decode(frames, plan)
    found = decode(frames, plan, absolute=False, keep_phases=True).x
    assert found.repeats_px == 24.0
    assert found.failed_fraction == 0.0
    off = (found.coordinate_px - X + 12.0) % 24.0 - 12.0
    assert np.abs(off).max() < 0.5
    turn = np.exp(1j * (found.phase_rad[0] - 2 * np.pi * X / 24.0))
    assert np.abs(np.angle(turn)).max() < 0.15


SWAPS = [
    (steps, a, b)
    for steps in (3, 4, 5)
    for a, b in ((0, 1), (1, 2), (0, steps), (steps, 2 * steps + 1))
]


@pytest.mark.parametrize(("steps", "a", "b"), quick(SWAPS, *SWAPS[::3], SWAPS[1]))
def test_swapped_frames_are_named(steps, a, b):
    plan = multi(HETERODYNE, steps, (960, 60))
    frames = take(plan)
    frames[[a, b]] = frames[[b, a]]
    with pytest.raises(InputError, match=f"{a} and {b} .*swapped"):
        decode(frames, plan)
    stream = StreamingDecoder(plan)
    for frame in frames:
        stream.add(frame)
    with pytest.raises(InputError, match="swapped"):
        stream.result()


def test_frames_of_another_plan_are_refused():
    plan, other = multi((29, 32, 36), 4), multi((29, 34, 41), 4)
    with pytest.raises(InputError, match="contradict each other all over the image"):
        decode(take(other), plan)
    # But for the scale of the coordinates, 29, 33 and 37 are 28.2, 32 and 36.
    with pytest.raises(
        InputError, match="33.1034 px along x have another period|likely the plan is another"
    ):
        decode(take(multi((29, 33, 37), 4)), plan)
    with pytest.raises(InputError, match=r"cells of 19 px, 16 px in the plan.* period_px = 27$"):
        right = guarded(16.0)
        wrong = PatternPlan(960, 60, (PhaseSteps("x", 27.0, equal_steps(4)), *right.blocks[1:]))
        decode(take(wrong), right)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f[:6], "plan has 8, got 6; missing: x-phase-37.5px-2, x-phase-37.5px-3"),
        (lambda f: [*f, f[0]], "plan has 8, got 9: 1 too many"),
        (lambda f: [*f[:7], f[7][:-1]], "x-phase-37.5px-3: expected the size of the first"),
        (
            lambda f: [*f[:7], f[7].astype(float)],
            "expected the type of the first, uint8, got float64",
        ),
        (lambda f: f.astype(np.int32), "expected uint8, uint16, float32, float64, got int32"),
        (lambda f: f[0], "expected shape \\(n, h, w\\), got \\(20, 300\\)"),
        (lambda f: f[:, :, :, None][:, :0], "expected shape"),
        (
            lambda f: np.where(np.arange(8)[:, None, None] == 5, np.uint8(9), f),
            "x-phase-37.5px-1: expected a pattern, got 9 everywhere",
        ),
    ],
)
def test_frames_that_do_not_fit_are_refused(change, words):
    plan = multi((1, 8), 4, (300, 20))
    with pytest.raises(InputError, match=words):
        decode(change(take(plan)), plan)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"saturation": 0.0}, "saturation: expected > 0"),
        ({"min_modulation": -1.0}, "min_modulation: expected >= 0"),
        ({"min_modulation": float("nan")}, "min_modulation: expected >= 0"),
    ],
)
def test_invalid_options_are_refused(options, words):
    plan = multi((1, 8), 4, (300, 20))
    with pytest.raises(InputError, match=words):
        decode(take(plan), plan, **options)
    with pytest.raises(InputError, match="noise: expected read_counts >= 0"):
        CameraNoise(-1.0)


@pytest.mark.parametrize("steps", [3, 4, 5, 8])
def test_real_steps_are_found(steps):
    rng = np.random.default_rng(steps)
    wrong = np.radians(6.0) * rng.standard_normal((2, steps))
    wrong -= wrong.mean(axis=1, keepdims=True)
    nominal = multi((1, 8), steps, (960, 100))
    real = PatternPlan(
        960,
        100,
        tuple(
            PhaseSteps("x", b.period_px, tuple(np.asarray(b.shifts_rad) + w))
            for b, w in zip(nominal.blocks, wrong, strict=True)
        ),
    )
    frames = take(real, noise=1.0)
    found = decode(frames, nominal, estimate_steps=True)
    shifts = np.radians(found.details["x"]["shifts_deg"])
    real_shifts = np.stack([b.shifts_rad for b in real.blocks])
    assert np.abs(shifts - real_shifts).max() < (0.01 if steps < 5 else 0.003)
    off = found.x.coordinate_px - X
    before = decode(frames, nominal, estimate_steps=False).x.coordinate_px - X
    assert np.nanstd(off) < 0.8 * np.nanstd(before)
    assert np.nanstd(off) < 1.1 * predicted((1, 8), steps, noise=1.0)
    one, _ = cover(off, found.x.sigma_px)
    assert one == pytest.approx(0.683, abs=0.04)
    assert any("off by up to" in note for note in found.notes)


@pytest.mark.parametrize("steps", [3, 4, 6])
def test_shifts_of_few_fringes_are_not_guessed(steps):
    plan = multi((1, 8), steps, (960, 60))
    # The scene shows 12 % of the coarse fringe.
    y, x = np.mgrid[:60, :480] * 1.0
    found = decode(take(plan, at=(y, 400.0 + x * 0.24), seed=steps), plan)
    nominal = np.degrees(equal_steps(steps))
    assert np.abs(np.array(found.details["x"]["shifts_deg"][0]) - nominal).max() < 0.5
    one, _ = cover(found.x.coordinate_px - (400.0 + x * 0.24), found.x.sigma_px)
    assert one == pytest.approx(0.683, abs=0.02)


def test_a_response_is_corrected():
    plan = multi((1, 8), 3, (960, 60))
    phase = (np.arange(256) + 0.5) * 2 * np.pi / 256 - np.pi
    frames = []
    for block in plan.blocks:
        for n in range(3):
            light = np.tile(block.values(X, n) ** 1.6, (60, 1))
            frames.append(np.rint(20 + 200 * light).astype(np.uint8))
    shifts = np.array(equal_steps(3))[:, None]
    bent = (0.5 + 0.5 * np.cos(phase - shifts)) ** 1.6
    seen = np.arctan2((bent * np.sin(shifts)).sum(axis=0), (bent * np.cos(shifts)).sum(axis=0))
    error = np.interp(phase, seen, np.angle(np.exp(1j * (seen - phase))), period=2 * np.pi)
    response = Response("a", "b", 1.6, 3, 1.0, error[None], (200.0,), 0.0)
    raw = decode(frames, plan, estimate_steps=False).x.coordinate_px - X
    right = decode(frames, plan, response=response).x.coordinate_px - X
    assert np.nanstd(raw) > 1.0
    assert np.nanstd(right) < 0.2
    with pytest.raises(InputError, match="made for 3 steps, the plan has 4"):
        four = multi((1, 8), 4, (960, 60))
        decode(take(four), four, response=response)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_single_line_of_pixels_decodes(axis):
    code, light = GrayCode(axis, 25.0, 300), (Uniform("white"), Uniform("black"))
    plan = PatternPlan(300, 300, (PhaseSteps(axis, 50.0, equal_steps(4)), code, *light))
    rows, columns = (1, 300) if axis == "x" else (300, 1)
    frames = [20 + picture[:rows, :columns] // 2 for picture in encode(plan)]
    found = getattr(decode(frames, plan), axis).coordinate_px
    assert np.nanmax(np.abs(found.ravel() - np.arange(300.0))) < 1.0
    assert np.mean(np.isfinite(found)) > 0.95
