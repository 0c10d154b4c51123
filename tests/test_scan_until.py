"""Scans that take frames until tolerances are decided: the steps, their risk, and whole scans."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.scan_step import LOOKS, guard_factor, information
from fringeworks.rig.pinhole import pose, project
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.types import CameraNoise
from tests.commands import run
from tests.ray_caster import Ball, Photographs, Sheet

pytestmark = pytest.mark.statistical

Open: type[fw.evaluate.OpenCheck] = fw.evaluate.OpenCheck
WIDE = Open("width", gap=0.05, noise=0.03, common=0.001)
STATE = fw.evaluate.ScanState((WIDE,), (1.0,), CameraNoise(1.0, 0.02), 80.0, 1.0)


def step(*checks, **known) -> fw.evaluate.ScanStep:
    return fw.evaluate.next_step(replace(STATE, open_checks=checks, **known))


def test_the_first_capture_comes_without_a_reason_and_the_end_with_one():
    assert step(WIDE, factors=()).kind == "first"
    assert "decided" in step().why
    assert step(WIDE, looks=LOOKS).kind == "stop"
    assert "allowed are taken" in step(WIDE, factors=(1.0,) * 8).why


@pytest.mark.parametrize("gap", [0.04, 0.05, 0.06])
def test_as_many_captures_as_the_gap_needs(gap):
    found = step(replace(WIDE, gap=gap))
    assert (found.kind, found.factor) == ("repeat", 1.0)
    sigma = np.hypot(WIDE.noise / np.sqrt(1 + found.captures), WIDE.common)
    assert guard_factor(0.05) * sigma < gap
    fewer = np.hypot(WIDE.noise / np.sqrt(found.captures), WIDE.common)
    assert guard_factor(0.05) * fewer > 0.75 * gap


def test_a_step_does_not_rest_on_one_uncertain_value():
    assert step(replace(WIDE, gap=0.001), most_captures=64).captures == 3


def test_what_no_frames_decide_stops_with_the_reason():
    found = step(replace(WIDE, gap=0.001, noise=0.001, common=0.03))
    assert found.kind == "stop"
    assert "calibration" in found.why
    # One that is hopeless does not keep another from its frames.
    both = step(replace(WIDE, gap=0.001, noise=0.001, common=0.03), WIDE)
    assert both.kind == "repeat"


def test_exposures_follow_what_the_pixels_lack():
    blind = replace(WIDE, gap=float("nan"), noise=0.0, common=0.0)
    free = {"exposures": (0.05, 20.0)}
    assert step(replace(blind, saturated=0.3), **free).kind == "shorter"
    assert step(replace(blind, dark=0.3), **free).kind == "longer"
    assert step(replace(blind, dark=0.3)).kind == "stop"
    assert step(replace(blind, dark=0.01), **free).kind == "stop"
    # A share of measured pixels has no noise that frames average.
    share = replace(WIDE, gap=0.1, noise=0.0, common=0.0)
    assert step(share).kind == "stop"
    assert step(replace(share, dark=0.3), **free).kind == "longer"


def test_a_longer_exposure_is_taken_where_it_is_quicker():
    quick = {"exposures": (0.1, 10.0), "headroom": 5.0}
    found = step(replace(WIDE, gap=0.03), overhead=4.0, **quick)
    assert found.kind == "longer"
    assert found.factor < 5.0
    assert information(STATE, 4.0) > 4.0
    assert information(replace(STATE, noise=CameraNoise(0.0, 0.02)), 4.0) == pytest.approx(4.0)


def play(rng, gap_sigmas, common=0.2, most=8):
    """A scan whose values are drawn: verdict and captures. Its part lies beyond the upper limit 0."""
    noise = 1.0
    shift = common * rng.standard_normal()
    values, factors, looks = [], [], 0
    wanted = 1
    while True:
        values += list(gap_sigmas + shift + noise * rng.standard_normal(wanted))
        factors += [1.0] * wanted
        looks += 1
        value, own = np.mean(values), noise / np.sqrt(len(values))
        sigma = np.hypot(own, common)
        if abs(value) > guard_factor(0.05) * sigma:
            return ("pass" if value < 0 else "fail"), len(values)
        check = Open("value", abs(value), own, common)
        state = replace(STATE, open_checks=(check,), factors=tuple(factors), looks=looks)
        found = fw.evaluate.next_step(replace(state, most_captures=most))
        if found.kind == "stop":
            return "undecided", len(values)
        wanted = found.captures


def test_looking_several_times_does_not_raise_the_risk():
    rng = np.random.default_rng(5)
    wrong = sum(play(rng, 1e-9)[0] == "pass" for _ in range(4000))
    # 5 % of 4000, with four standard deviations of the count.
    assert wrong < 200 + 4 * np.sqrt(200 * 0.95)


def test_clear_parts_take_few_captures_and_close_ones_many():
    rng = np.random.default_rng(6)
    clear = [play(rng, 6.0) for _ in range(200)]
    close = [play(rng, 1.2) for _ in range(200)]
    assert np.mean([count for _, count in clear]) < 1.3
    assert np.mean([verdict == "fail" for verdict, _ in clear]) > 0.99
    assert np.mean([count for _, count in close]) > 3.0


@cache
def rig():
    known = fw.rig.CameraBlur.everywhere(float(np.sqrt(0.25 + (1 - 1 / 4) / 12)))
    return replace(standard_rig(scale=0.15), blur=known)


def ball(seed):
    """A ball before a wall: its diameter, its photographs and its area."""
    rng = np.random.default_rng([7, seed])
    radius = rng.uniform(18, 28)
    centre = np.array([rng.uniform(-25, -5), rng.uniform(-15, 15), rng.uniform(480, 500)])
    wall = Sheet(pose(np.eye(3), np.array([0.0, 0.0, 545.0])), 0.6)
    photographs = Photographs(rig(), [Ball(tuple(centre), radius), wall], over=2)
    turn = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    rim = np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=-1)
    outline = project(rig().camera, centre + 0.7 * radius * rim)
    return 2 * radius, photographs, fw.evaluate.Area(polygon=tuple(map(tuple, outline.tolist())))


def recipe(area, low, high):
    tolerance = fw.evaluate.PartTolerance("diameter", "sphere_diameter", ("ball",), low, high)
    return fw.Recipe(rig=rig(), areas={"ball": area}, tolerances=(tolerance,))


def test_scans_end_when_a_diameter_is_decided():
    plan = fringe_plan(rig(), both=False)
    size, photographs, area = ball(3)
    taken = []

    def take(factor):
        assert factor == 1.0
        taken.append(len(taken))
        return photographs.stack(plan, blur_px=0.5, noise=4.0, seed=len(taken))

    found: fw.evaluate.ScanUntil = fw.evaluate.scan_until(take, recipe(area, size - 1, size + 1))
    assert (found.inspection.verdict, found.captures) == ("pass", 1)
    assert found.frames == plan.frames
    (first,) = found.inspection.checks
    # Nearer than the guard band of one capture, seen again with the same noise.
    taken.clear()
    told = []
    near = recipe(area, size - 1, first.value + 1.6 * first.sigma)
    found = fw.evaluate.scan_until(take, near, progress=told.append)
    assert 2 <= found.captures <= 8
    assert found.inspection.checks[0].sigma < 0.8 * first.sigma
    assert [one.kind for one in told] == [one.kind for one in found.steps]
    assert told[1].kind == "repeat"
    found = fw.evaluate.scan_until(take, recipe(area, size - 1, size + 1e-4), most_captures=2)
    assert found.inspection.verdict == "undecided"
    assert found.findings[0].kind == "undecided"


def test_recipes_without_tolerances_are_refused():
    with pytest.raises(fw.InputError, match="tolerances"):
        fw.evaluate.scan_until(lambda _: None, fw.Recipe(rig=rig()))
    with pytest.raises(fw.InputError, match="most_captures"):
        area = fw.evaluate.Area(polygon=((0, 0), (9, 0), (9, 9)))
        fw.evaluate.scan_until(lambda _: None, recipe(area, 0, 1), most_captures=0)


def test_the_command_scans_until_a_recipe_is_decided(tmp_path):
    virtual = fw.devices.virtual_rig()
    fw.files.write_rig(tmp_path / "rig.toml", virtual)
    fw.files.write_plan(tmp_path / "plan.toml", fringe_plan(virtual, both=False))
    text = (
        'kind = "recipe"\nrig = "rig.toml"\n[areas.part]\npolygon = [[150, 120], [230, 120], [230, 190], [150, 190]]\n'
        '[[tolerances]]\nname = "flat"\nquantity = "flatness"\nareas = ["part"]\nmax = 5.0\n'
    )
    (tmp_path / "recipe.toml").write_text(text, encoding="utf-8")
    devices = ("--projector", "virtual:plane", "--camera", "virtual:plane")
    done = run(
        "scan", tmp_path / "plan.toml", *devices, "--rig", tmp_path / "rig.toml", "--until",
        tmp_path / "recipe.toml", "--capture", tmp_path / "part", "--out", tmp_path / "part.ply",
    )  # fmt: skip
    said = done.stdout + done.stderr
    assert "all tolerances are decided" in said
    assert "1 captures, 12 frames" in said
    assert len(fw.files.read_exposures(tmp_path / "part")) == 1
    assert (tmp_path / "part.ply").exists()
