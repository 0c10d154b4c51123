"""The self-test keeps what the documentation promises, and says so where a promise is broken."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.selftest import cases, promises, run
from fringeworks.evaluate.selftest.cases import CaseResult
from fringeworks.evaluate.selftest.scenes import BODIES, DISTURBANCES, pair_rig, view_of
from fringeworks.pipeline import decoding
from fringeworks.stack import examine
from fringeworks.types import CameraNoise
from tests.commands import run as run_command

pytestmark = pytest.mark.statistical

PAGE = Path(__file__).parent.parent / "docs" / "promises.md"
GOOD = CaseResult(
    "stack", "sphere", "noise", "mm", 1.0, 0.0, 0.01, 0.01, 0.01, 0.01, 0.68, 0.95, 0.0
)


@pytest.fixture
def _one_scene(monkeypatch):
    """A quick self-test of one scene, for tests that need its end only."""
    monkeypatch.setattr(run, "QUICK", (("sphere", "noise"),))
    monkeypatch.setattr(run, "QUICK_METHODS", ("fourier",))


def broken(found):
    return {one.promise.name for one in found.broken}


@pytest.mark.usefixtures("_one_scene")
def test_it_passes_and_writes_what_it_found(tmp_path):
    done = run_command("selftest", "--quick", "--json", tmp_path / "selftest.json")
    assert "stack coverage 2 σ: kept: within 2 σ 0.9" in done.stdout
    assert "windowed coverage: not tested" in done.stdout
    written = json.loads((tmp_path / "selftest.json").read_text())
    assert written["passed"] is True
    assert written["provenance"]["options"] == {"quick": True, "seed": 0}
    assert [case["way"] for case in written["cases"]] == ["stack", "fourier"]
    assert all(0 < case["within_1_sigma"] < 1 for case in written["cases"])


def too_much_noise(monkeypatch):
    """The decoder takes the camera for noisier than it is."""
    right = examine.measure_noise

    def wrong(*given):
        noise, source = right(*given)
        return CameraNoise(1.4 * noise.read_counts, 2 * noise.gain), source

    monkeypatch.setattr(examine, "measure_noise", wrong)


def too_small_sigma(monkeypatch):
    """The decoder's σ is too small. Too small a noise does not suffice: it sees the residuals."""
    right = decoding.decode

    def wrong(*given, **options):
        found = right(*given, **options)
        return replace(found, x=replace(found.x, sigma_px=0.7 * found.x.sigma_px))

    monkeypatch.setattr(decoding, "decode", wrong)


@pytest.mark.usefixtures("_one_scene")
@pytest.mark.parametrize("fault", [too_much_noise, too_small_sigma])
def test_a_wrong_noise_model_breaks_named_promises(fault, monkeypatch):
    fault(monkeypatch)
    done = run_command("selftest", "--quick", code=1)
    for name in ("stack coverage 1 σ", "stack coverage 2 σ", "stack sigma"):
        assert f"fringeworks: {name}: NOT KEPT" in done.stderr
    assert "(stack, sphere, noise)" in done.stderr
    assert "stack bias" not in done.stderr


def test_a_wrong_rig_breaks_the_bias(monkeypatch):
    rig = cases.stack_rig()
    T = rig.T_projector_camera.copy()
    T[0, 3] *= 1.0002
    moved = replace(rig, T_projector_camera=T)
    monkeypatch.setattr(cases, "stack_rig", lambda: moved)
    found = cases.stack_case("sphere", "noise")
    assert promises.judge(named("stack bias"), [found]).kept is False
    assert promises.judge(named("stack orders"), [found]).kept is True


def test_a_wrong_sigma_of_pairs_breaks_their_promise(monkeypatch):
    right = cases.analyse

    def wrong(*given):
        found = right(*given)
        return replace(found, sigma_px=found.sigma_px / 3)

    monkeypatch.setattr(cases, "analyse", wrong)
    found = list(cases.pair_cases("sphere", "noise", ("fourier",)))
    assert promises.judge(named("filters coverage mean"), found).kept is False


def named(name):
    return next(one for one in promises.PROMISES if one.name == name)


def test_promises_are_judged_by_their_worst_case():
    one = fw.evaluate.Promise("bias", "Small.", "size of the bias", -np.inf, 0.1)
    poor = replace(GOOD, body="step", bias=-0.3)
    found = promises.judge(one, [GOOD, poor])
    assert (found.kept, found.value, found.case) == (False, 0.3, "stack, step, noise")
    assert found.sentence == (
        "bias: NOT KEPT: size of the bias 0.3 (stack, step, noise), promised at most 0.1"
    )
    assert promises.judge(one, [GOOD]).kept is True
    assert promises.judge(replace(one, bodies=("plane",)), [GOOD]).kept is None
    pooled = promises.judge(replace(one, pooled=True, high=0.2), [GOOD, poor])
    assert (pooled.kept, pooled.value) == (True, 0.15)


def test_frames_that_give_nothing_break_promises():
    empty = cases._nothing("stack", "sphere", "noise", "mm", "no fringes")
    found = promises.judge(named("stack coverage 1 σ"), [GOOD, empty])
    assert found.kept is False
    assert "no fringes" in found.sentence


def test_the_page_holds_the_promises_of_the_code():
    assert fw.evaluate.promise_table() in PAGE.read_text()
    names = [one.name for one in promises.PROMISES]
    assert len(set(names)) == len(names)
    for one in promises.PROMISES:
        assert one.quantity in promises.QUANTITIES
        assert set(one.disturbances) <= set(DISTURBANCES)
        assert set(one.bodies) <= set(BODIES)
        assert f"`{one.name}`" in PAGE.read_text()


def test_every_promise_concerns_a_case_of_the_full_test():
    every = [
        replace(GOOD, way=way, body=body, disturbance=disturbance)
        for way in ("stack", *promises.PAIR_METHODS)
        for body in BODIES
        for disturbance in DISTURBANCES
    ]
    for one in promises.PROMISES:
        assert any(one.concerns(case) for case in every), one.name


def test_the_rig_of_pairs_has_one_period_on_its_wall():
    wall = view_of("wall", "pair", False)
    steps = np.diff(wall.projector_px[..., 0], axis=1)
    assert np.ptp(steps) < 1e-9 * steps.mean()
    assert pair_rig().baseline_mm == pytest.approx(280)


def test_a_negative_seed_is_refused():
    with pytest.raises(fw.InputError, match="seed: expected at least 0, got -1"):
        fw.selftest(seed=-1)


@pytest.mark.parametrize("seed", [0, 31])
def test_the_quick_self_test_keeps_its_promises(seed):
    """What everybody runs after an installation."""
    found = fw.selftest(quick=True, seed=seed)
    assert not broken(found), [one.sentence for one in found.broken]
    assert sum(one.kept is True for one in found.judged) == 14


def test_weak_fringes_without_edges_hold_no_doubt_about_blur():
    """Slopes of a modulation that are noise are no edges at which blur could shift coordinates."""
    for seed in (61, 62):
        found = cases.stack_case("plane", "defocus", seed=seed)
        assert found.sigma == pytest.approx(found.bound, rel=0.02)
        assert found.within_1_sigma == pytest.approx(0.683, abs=0.01)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.timeout(900)
def test_all_promises_are_kept(seed):
    found = fw.selftest(seed=seed)
    assert not broken(found), [one.sentence for one in found.broken]
    assert all(one.kept for one in found.judged)
