"""Other instances of mistakes that people make: each with the answer that it must have."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.simulate.optics import Optics

STEPS = equal_steps(3)


def bust_seen(plan_of, *, scale=0.2, **optics):
    """A rig, what its camera sees of the bust, the plan of its projector, and the frames."""
    rig = fw.simulate.standard_rig(scale=scale)
    plan = plan_of(rig.projector.width_px, rig.projector.height_px)
    view = fw.simulate.look(rig, fw.simulate.bust())
    return rig, view, plan, list(fw.simulate.photograph(view, plan, Optics(**optics)))


@pytest.mark.parametrize(
    ("given", "unit"), [((0.45, 0.56), "m"), ((17.0, 23.0), "inch"), ((44.0, 58.0), "cm")]
)
def test_a_depth_range_in_another_unit_is_named(given, unit):
    rig, _, plan, frames = bust_seen(
        lambda w, h: PatternPlan(w, h, tuple(PhaseSteps("x", p, STEPS) for p in (w / 16.0, w))),
        noise=1.0,
        seed=5,
    )
    points = fw.measure(fw.Stack(frames, plan), rig, depth_mm=given).points
    (said,) = (f for f in points.findings if f.severity == "error")
    assert said.kind == "depth range"
    assert any(unit in cause for cause in said.causes), said.causes
    assert not (points.reason == 0).any()


@pytest.mark.parametrize("names", [("left arm", "right arm"), ("2024-01", "2024-02", "2024-03")])
def test_the_folder_of_captures_names_those_that_it_holds(tmp_path, names):
    plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, STEPS),))
    for name in names:
        fw.files.write_stack(tmp_path / "all" / name, list(fw.encode(plan)), plan)
    with pytest.raises(fw.FileProblem, match=f"holds captures: {', '.join(names)}; give one"):
        fw.read(tmp_path / "all")
    assert fw.read(tmp_path / "all" / names[-1]).plan == plan
    # One pose of several that lie beside a plan of their own is read.
    shutil.move(tmp_path / "all" / names[0], tmp_path / "alone")
    assert fw.read(tmp_path / "alone").plan == plan


@pytest.mark.parametrize(("axis", "kind"), [("y", np.uint16), ("x", np.uint8)])
def test_one_photograph_twice_is_said_along_either_axis(tmp_path, axis, kind):
    y, x = np.mgrid[:90, :120].astype(float)
    frame = 120 + 80 * np.cos(2 * np.pi * (x if axis == "x" else y) / 15 + 0.004 * x * y / 9)
    frame = (frame * (1 if kind == np.uint8 else 257)).astype(kind)
    for name in ("a.png", "b.png"):
        Image.fromarray(frame).save(tmp_path / name)
    pair = fw.Pair(*(fw.files.read_frame(tmp_path / n)[0] for n in ("a.png", "b.png")))
    (said,) = (f for f in fw.reconstruct(pair).surface.findings if f.kind == "same frame")
    assert said.severity == "warning"
    noisy = np.random.default_rng(1).normal(0, 1, frame.shape)
    pair = fw.Pair(frame.astype(float), frame + noisy)
    assert not any(f.kind == "same frame" for f in fw.reconstruct(pair).surface.findings)


def binned(array, side):
    """Means over squares of pixels, as larger pixels see it."""
    h, w = (size // side for size in array.shape[:2])
    return array[: h * side, : w * side].reshape(h, side, w, side).mean(axis=(1, 3))


@pytest.mark.parametrize(("side", "inverse"), [(4, True), (5, False)])
def test_codes_finer_than_the_camera_are_named_as_that(side, inverse):
    """Pixels that see several cells: the coarser ones decode, with their σ."""
    light = () if inverse else (Uniform("white"), Uniform("black"))
    _, view, plan, frames = bust_seen(
        lambda w, h: PatternPlan(w, h, (*light, GrayCode("x", 1.0, w, inverse=inverse))),
        scale=0.3,
        noise=0.7,
        seed=6,
    )
    lit = binned(view.lit.astype(float), side) == 1.0
    true = binned(view.projector_px[..., 0], side)
    frames = [np.rint(binned(f.astype(float), side)).astype(np.uint8) for f in frames]
    found = fw.decode(frames, plan)
    (said,) = (f for f in found.findings if f.kind == "resolution")
    assert "does not resolve" in said.seen
    ok = (found.x.reason == 0) & lit
    assert ok.sum() > 0.75 * lit.sum()
    off = np.abs(found.x.coordinate_px - true)[ok]
    assert np.mean(off < 2.0 * found.x.sigma_px[ok]) > 0.9


@pytest.mark.parametrize(("seed", "fine"), [(7, 16), (8, 20)])
def test_a_fine_set_and_one_period_measure_most_of_what_is_lit(seed, fine):
    _, view, plan, frames = bust_seen(
        lambda w, h: PatternPlan(
            w, h, (PhaseSteps("x", w / fine, STEPS), PhaseSteps("x", w, STEPS))
        ),
        noise=3.0,
        seed=seed,
    )
    found = fw.decode(frames, plan).x
    ok = (found.reason == 0) & view.lit
    assert ok.sum() > 0.8 * view.lit.sum()
    off = np.abs(found.coordinate_px - view.projector_px[..., 0])[ok]
    assert np.mean(off > plan.blocks[0].period_px / 2) < 2e-3


def wrong_rigs(rig):
    """Rigs that do not belong to a capture of this one."""
    camera, projector = rig.camera, rig.projector
    w = camera.width_px
    yield "another lens", replace(rig, camera=replace(camera, focal_px=(1.4 * w, 1.4 * w)))
    mirrored = (w - 1 - camera.principal_px[0] + 0.3 * w, camera.principal_px[1])
    yield "another part of the sensor", replace(rig, camera=replace(camera, principal_px=mirrored))
    T = rig.T_projector_camera.copy()
    T[1, 3] += 60.0
    yield "a projector elsewhere", replace(rig, T_projector_camera=T)
    failed = replace(projector, distortion=(27.0, -2300.0, 8.0, 10.0, 0.0))
    yield "a failed distortion", replace(rig, projector=failed)


@pytest.mark.parametrize("number", range(4))
def test_rigs_of_other_captures_are_refused_or_their_misfit_is_in_sigma(number):
    whole = fw.simulate.fringe_plan(fw.simulate.standard_rig(scale=0.2))
    rig, _, plan, frames = bust_seen(lambda _w, _h: whole, noise=1.0, seed=9)
    name, wrong = list(wrong_rigs(replace(rig, covariance=None)))[number]
    try:
        points = fw.measure(fw.Stack(frames, plan), wrong).points
    except fw.RigMismatch:
        return
    assert any("epipolar" in f.seen for f in points.findings if f.rank), name
