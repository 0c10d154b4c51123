"""Plans, their pictures and their files."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import tifffile

from fringeworks import InputError, PatternPlan, encode
from fringeworks.files import read_plan, write_patterns, write_plan
from fringeworks.files.images import read_frame
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

PLAN = PatternPlan(
    40,
    24,
    (
        PhaseSteps("x", 20.0, equal_steps(4)),
        PhaseSteps("y", 12.0, tuple(np.radians([120.0, 0.0, -120.0]))),
        GrayCode("x", 5.0, 40),
        GrayCode("y", 1.0, 24, True),
        Uniform("white"),
        Uniform("black"),
    ),
)


def test_pictures():
    pictures = list(encode(PLAN))
    assert len(pictures) == PLAN.frames == len(PLAN.labels()) == 4 + 3 + 3 + 10 + 2
    assert {p.dtype for p in pictures} == {np.dtype(np.uint8)}
    assert {p.shape for p in pictures} == {(24, 40)}
    x = np.arange(40)
    for n in range(4):
        expected = 255 * (0.5 + 0.5 * np.cos(2 * np.pi * x / 20 - 2 * np.pi * n / 4))
        assert np.abs(pictures[n][3] - expected).max() <= 0.5 + 1e-9
    # Neighbouring cells differ in one bit, and no two cells have the same bits.
    gray = np.stack([p[0] > 127 for p in pictures[7:10]])[:, ::5]
    assert (np.abs(np.diff(gray.astype(int), axis=1)).sum(axis=0) == 1).all()
    assert np.unique(gray, axis=1).shape[1] == 8
    assert (pictures[10] == 255 - pictures[11]).all()
    assert pictures[-2].min() == 255
    assert pictures[-1].max() == 0


@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize("bits", [8, 10])
def test_pictures_are_those_that_round_every_pixel(bits, gamma):
    plan = dataclasses.replace(PLAN, bits=bits, gamma=gamma)
    pictures = encode(plan)
    for block in plan.blocks:
        down = not isinstance(block, Uniform) and block.axis == "y"
        y, x = np.indices((24, 40)).astype(float)
        for n in range(block.frames):
            light = np.round(block.values(y if down else x, n) ** (1.0 / gamma), 11)
            counts = np.minimum(np.floor((2**bits - 1) * light + 0.5), 2**bits - 1)
            picture = next(pictures)
            np.testing.assert_array_equal(picture, counts)
            assert picture.flags.c_contiguous
            assert picture.flags.writeable


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("period", [4.0, 20.0, 4096 / 1023])
def test_halves_round_up(bits, period):
    """Where the cosine is zero, the value is half-way between two counts on every machine."""
    plan = PatternPlan(4096, 2, (PhaseSteps("x", period, equal_steps(4)),), bits=bits)
    # Columns in which 4 x / p is a whole number; the cosine then is zero in every second frame.
    quarters = 4 * np.arange(4096) / period
    whole = np.abs(quarters - np.rint(quarters)) < 1e-6
    for n, picture in enumerate(encode(plan)):
        zero = whole & ((np.rint(quarters) - n) % 2 == 1)
        assert zero.any()
        assert (picture[0, zero] == 2 ** (bits - 1)).all()


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_depth_and_response(bits):
    plan = dataclasses.replace(PLAN, bits=bits, gamma=2.2)
    picture = next(iter(encode(plan)))
    assert picture.dtype == (np.uint8 if bits == 8 else np.uint16)
    top = 2**bits - 1
    light = (picture[0] / top) ** 2.2
    ideal = 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(40) / 20)
    assert np.abs(light - ideal).max() < 2.0 / top


def test_dither_keeps_the_mean():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 64.0, equal_steps(3)),), gamma=1.7)
    dithered = dataclasses.replace(plan, dither=True)
    exact = 255 * plan.blocks[0].values(np.arange(64.0), 0) ** (1 / 1.7)
    plain, spread = (next(iter(encode(p))).astype(float) for p in (plan, dithered))
    # Eight thresholds err by a sixteenth at most, rounding by up to a half.
    assert np.abs(spread.mean(axis=0) - exact).max() <= 1 / 16 + 1e-9
    assert np.abs(plain.mean(axis=0) - exact).max() > 0.4


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PhaseSteps("x", 20, (0.0, 2 * np.pi, 4 * np.pi)), "differ modulo 360°"),
        (lambda: PhaseSteps("x", 20, (0.0, np.pi, 2 * np.pi, 3 * np.pi)), "differ modulo 360°"),
        (lambda: PhaseSteps("x", 20, (0.0, 1.0)), "expected 3 to 64, got 2"),
        (lambda: PhaseSteps("x", 1.5, equal_steps(3)), "expected 2 px or more"),
        (lambda: PhaseSteps("x", 24.0, 4), r"expected a sequence, as equal_steps\(4\) returns"),
        (lambda: PhaseSteps("z", 20, equal_steps(3)), "expected x or y"),
        (lambda: equal_steps(2), "expected 3 to 64, got 2"),
        (lambda: GrayCode("x", 0.5, 40), "cells of 1 px or more"),
        (lambda: GrayCode("x", 40, 40), "less than the projector's 40 px"),
        (lambda: Uniform("grey"), "white or black"),
        (lambda: PatternPlan(40, 24, (Uniform("white"),)), "fringes or Gray code"),
        (
            lambda: PatternPlan(40, 24, (GrayCode("y", 5.0, 40),)),
            "length of 24 px along y, like the projector, got 40",
        ),
        (lambda: PatternPlan(40, 24, PLAN.blocks, bits=9), "bits"),
        (lambda: PatternPlan(40, 24, PLAN.blocks, gamma=0.0), "gamma"),
        (lambda: PatternPlan(1, 24, PLAN.blocks), "2 × 2"),
        (lambda: PatternPlan(40, 24, (GrayCode("x", 5.0, 40),) * 2), "one Gray code along x"),
    ],
)
def test_invalid_plans_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_plan_file_keeps_everything(tmp_path):
    plan = dataclasses.replace(PLAN, bits=12, gamma=1.8, dither=True)
    again = read_plan(write_plan(tmp_path / "plan.toml", plan))
    assert again.bits == 12
    assert (again.gamma, again.dither, again.width_px) == (1.8, True, 40)
    for mine, theirs in zip(plan.blocks, again.blocks, strict=True):
        if isinstance(mine, PhaseSteps):
            assert theirs.axis == mine.axis
            assert theirs.period_px == pytest.approx(mine.period_px)
            assert theirs.shifts_rad == pytest.approx(mine.shifts_rad)
        else:
            assert theirs == mine


WRITTEN = """
kind = "plan"
projector = [1920, 1080]
sequence = [
    {kind = "phase", axis = "x", fringes = 64, steps = 4},
    {kind = "gray", axis = "x", step_px = 15},
]
"""


def test_plan_written_by_hand(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(WRITTEN)
    plan = read_plan(path)
    assert plan.blocks[0].period_px == 30.0
    assert plan.gray_code("x")[1].bits == 7
    for change, words in (
        (("fringes = 64", "fringes = 64, period_px = 30"), "entry 1.*either period_px or fringes"),
        (("fringes = 64, ", ""), "entry 1.*either period_px or fringes"),
        (("steps = 4", "steps = 4, shifts_deg = [0, 90, 180]"), "either steps or shifts_deg"),
        (("steps = 4", "steps = 2"), "entry 1.*expected 3 to 64, got 2"),
        (("fringes = 64", "fringes = 0"), "fringes: expected > 0"),
        (('axis = "x", step', 'axis = "z", step'), "axis"),
        (("step_px = 15", "step = 15"), "unknown key"),
        (("[1920, 1080]", "[1920]"), "projector"),
        (('kind = "plan"', 'kind = "pair"'), "kind"),
        (("= [1920", "= = [1920"), "expected TOML"),
    ):
        path.write_text(WRITTEN.replace(*change))
        with pytest.raises(InputError, match=words):
            read_plan(path)
    with pytest.raises(InputError, match="no such file"):
        read_plan(tmp_path / "none.toml")


@pytest.mark.parametrize("stack", [False, True])
def test_pictures_on_disk(tmp_path, stack):
    plan = dataclasses.replace(PLAN, bits=10)
    written = write_patterns(tmp_path / "out", plan, stack=stack)
    assert read_plan(tmp_path / "out" / "plan.toml").frames == plan.frames
    expected = np.stack(list(encode(plan)))
    if stack:
        assert len(written) == 1
        np.testing.assert_array_equal(tifffile.imread(written[0]), expected)
    else:
        assert [p.name for p in written] == sorted(p.name for p in written)
        np.testing.assert_array_equal(np.stack([read_frame(p)[0] for p in written]), expected)
