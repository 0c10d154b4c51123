"""Scores of anyone's results on named scenes, and of folders of depth maps."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.io
from PIL import Image

import fringeworks as fw
from fringeworks.evaluate.scored_scenes import BenchmarkScene
from fringeworks.evaluate.scoring import columns_of_depths
from tests.commands import run


@pytest.fixture(scope="module")
def bust():
    return fw.evaluate.benchmark_scene("bust")


@pytest.fixture(scope="module")
def smooth():
    return fw.evaluate.benchmark_scene("pair-smooth")


def test_the_truth_scores_perfectly_in_every_quantity(bust, smooth):
    for scene in (bust, smooth):
        period = 2 * np.pi / scene.period_px
        base = "displacement" if scene.is_pair else "coordinate"
        for quantity, values in {**scene.truth, "phase": scene.truth[base] * period}.items():
            found = fw.evaluate.score(values, scene, quantity=quantity)
            assert found.measured == 1.0
            assert found.rms < 1e-9
            assert found.wrong_orders_ppm == 0.0
            assert found.within_1_sigma is None


def test_errors_are_those_that_were_added(bust):
    rng = np.random.default_rng(7)
    truth = bust.truth["coordinate"]
    values = truth + 0.3 + 0.2 * rng.standard_normal(truth.shape)
    found = fw.evaluate.score(
        values, bust, quantity="coordinate", sigma=np.full(truth.shape, np.hypot(0.3, 0.2))
    )
    assert found.mean == pytest.approx(0.3, abs=0.003)
    assert found.rms == pytest.approx(np.hypot(0.3, 0.2), abs=0.003)
    assert found.p95 == pytest.approx(0.3 + 1.645 * 0.2, abs=0.01)
    assert found.within_2_sigma == pytest.approx(1.0, abs=0.02)
    assert found.unfounded == pytest.approx(1.0, abs=1e-9)  # light or not, all have a value


@pytest.mark.parametrize("quantity", ["coordinate", "phase", "depth"])
def test_wrong_orders_are_counted_in_every_quantity(bust, quantity):
    where = np.flatnonzero(bust.measurable)[::1000]
    off = np.zeros(bust.measurable.shape)
    off.flat[where] = bust.period_px
    if quantity == "depth":
        # The depth at which the pixel's ray has the column of the next fringe, by the secant.
        z = bust.truth["depth"]
        step = 0.01
        rate = (columns_of_depths(z + step, bust.rig) - bust.truth["coordinate"]) / step
        values = z + off / rate
    else:
        values = bust.truth["coordinate"] + off
        values = values * (2 * np.pi / bust.period_px if quantity == "phase" else 1.0)
    found = fw.evaluate.score(values, bust, quantity=quantity)
    expected = 1e6 * len(where) / np.count_nonzero(bust.measurable)
    assert found.wrong_orders_ppm == pytest.approx(expected, rel=1e-6)
    assert found.rms_right_order < 1e-6 < found.rms


def test_wrong_orders_of_heights(smooth):
    moved = smooth.truth["displacement"] + smooth.period_px * (np.arange(500) % 100 == 0)
    heights = fw.pair.height_from_displacement(moved, smooth.capture.geometry)
    found = fw.evaluate.score(heights, smooth, quantity="height")
    assert found.wrong_orders_ppm == pytest.approx(1e4)
    # A height beyond the pupils has no displacement, and so none within half a period.
    assert fw.evaluate.score(heights * 0 + 1e6, smooth, quantity="height").wrong_orders_ppm == 1e6


def test_our_own_results_are_scored_with_their_sigma(bust, smooth):
    measured = fw.measure(bust.capture, bust.rig, axis="x")
    for result in (measured, measured.points, measured.decoded, measured.decoded.x):
        found = fw.evaluate.score(result, "bust")
        assert found.measured > 0.97
        assert found.wrong_orders_ppm < 20
        assert 0.6 < found.within_1_sigma < 0.8
    moved = measured.points.transformed(np.eye(4), frame="base")
    assert fw.evaluate.score(moved, bust).unit == "mm"
    made = fw.reconstruct(smooth.capture, "fourier")
    assert fw.evaluate.score(made, smooth).quantity == "height"
    assert fw.evaluate.score(made.displacement, smooth).quantity == "displacement"


def test_zero_and_nan_are_no_depth(bust):
    z = bust.truth["depth"].copy()
    z[::2] = 0.0
    z[1::4] = np.nan
    found = fw.evaluate.score(z, bust, quantity="depth")
    assert found.measured == pytest.approx(0.25, abs=0.01)
    assert found.rms == 0.0


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda s: fw.evaluate.score(s.truth["depth"], "bsut"), "scene: expected one of bust,"),
        (lambda s: fw.evaluate.score(s.truth["depth"], s), "quantity: expected one of coordinate"),
        (
            lambda s: fw.evaluate.score(s.truth["depth"], s, quantity="height"),
            "expected one of coordinate, depth, phase for bust, got 'height'",
        ),
        (
            lambda s: fw.evaluate.score(s.truth["depth"][1:], s, quantity="depth"),
            r"expected shape \(512, 640\), got \(511, 640\)",
        ),
        (
            lambda s: fw.evaluate.score(0 * s.truth["depth"], s, quantity="depth"),
            "expected values where bust has light, got none",
        ),
        (
            lambda s: fw.evaluate.score(np.zeros((2, 2, 2)), s, quantity="depth"),
            r"a map \(h, w\), got float64 \(2, 2, 2\)",
        ),
        (
            lambda s: fw.evaluate.score(s.rig, s, quantity="depth"),
            r"a map \(h, w\), got Rig",
        ),
    ],
)
def test_what_cannot_be_scored_is_refused(bust, call, said):
    with pytest.raises(fw.InputError, match=said):
        call(bust)


def test_scenes_are_the_same_again_and_keep_their_truth_apart():
    one = fw.evaluate.benchmark_scene("pair-painted")
    fw.evaluate.benchmark_scenes()
    from fringeworks.evaluate import scored_scenes as module

    module.benchmark_scene.cache_clear()
    two = fw.evaluate.benchmark_scene("pair-painted")
    assert np.array_equal(one.capture.object, two.capture.object)
    assert one.capture.truth_mm is None
    assert isinstance(two, BenchmarkScene)


def test_there_are_ten_scenes_that_say_what_they_test():
    known = fw.evaluate.benchmark_scenes()
    assert len(known) == 10
    assert all(text.endswith(".") for text in known.values())


# Folders of depth maps.


def depth_set(folder, maps, kind=".mat", name="depthMap"):
    (folder / "depth").mkdir(parents=True)
    for stem, values in maps.items():
        path = folder / "depth" / f"{stem}{kind}"
        if kind == ".mat":
            scipy.io.savemat(path, {name: values})
        elif kind == ".npy":
            np.save(path, values)
        else:
            Image.fromarray(values.astype(np.uint16)).save(path)
    return folder


@pytest.fixture
def truth():
    ball = np.zeros((40, 50))
    ball[10:30, 10:40] = 1800.0
    return {"banana_A0": ball, "mug_A60": 0.9 * ball}


@pytest.mark.parametrize(("kind", "name"), [(".mat", "depth"), (".npy", ""), (".png", "")])
def test_depth_maps_in_the_layout_of_fpp_ml_bench(tmp_path, truth, kind, name):
    depth_set(tmp_path / "test", truth)
    off = {stem: np.where(z > 0, z + 14.0, 0.0) for stem, z in truth.items()}
    depth_set(tmp_path / "mine", off, kind, name)
    rows = fw.evaluate.score_depths(tmp_path / "mine", tmp_path / "test")
    assert [row.scene for row in rows] == ["banana_A0", "mug_A60", "all"]
    assert rows[-1].mean_abs == rows[-1].rms == pytest.approx(14.0)
    assert rows[-1].measured == 1.0
    assert rows[-1].unfounded == 0.0
    assert np.isnan(rows[-1].wrong_orders_ppm)


def test_metres_and_a_background_that_has_values(tmp_path, truth):
    metres = {stem: z / 1000 for stem, z in truth.items()}
    depth_set(tmp_path / "test", metres)
    depth_set(tmp_path / "mine", {s: np.full(z.shape, 1.81) for s, z in metres.items()})
    rows = fw.evaluate.score_depths(tmp_path / "mine", tmp_path / "test", scale=1000.0)
    assert rows[0].mean == pytest.approx(10.0)
    assert rows[0].unfounded == 1.0


def test_depth_sets_that_do_not_fit(tmp_path, truth):
    depth_set(tmp_path / "test", truth)
    depth_set(tmp_path / "few", {"mug_A60": truth["mug_A60"]})
    with pytest.raises(fw.FileProblem, match="1 are missing, the first is banana_A0"):
        fw.evaluate.score_depths(tmp_path / "few", tmp_path / "test")
    with pytest.raises(fw.FileProblem, match="expected a folder of maps"):
        fw.evaluate.score_depths(tmp_path / "none", tmp_path / "test")
    depth_set(tmp_path / "small", {stem: z[1:] for stem, z in truth.items()})
    with pytest.raises(fw.InputError, match="expected shape"):
        fw.evaluate.score_depths(tmp_path / "small", tmp_path / "test")
    scipy.io.savemat(tmp_path / "few" / "depth" / "banana_A0.mat", {"z": truth["mug_A60"]})
    with pytest.raises(fw.FileProblem, match="expected a variable depth, got z"):
        fw.evaluate.score_depths(tmp_path / "few", tmp_path / "test")


# The command.


def test_the_command_writes_frames_and_scores_what_is_made_of_them(tmp_path):
    run("score", "--scene", "bust", "--out", tmp_path / "bust")
    assert not list((tmp_path / "bust").rglob("truth*"))
    place = tmp_path / "bust"
    run("measure", place / "frames", "--rig", place / "rig.toml", "--out", tmp_path / "mine.npz")
    done = run("score", tmp_path / "mine.npz", "--scene", "bust", "--json", tmp_path / "s.json")
    (row,) = json.loads((tmp_path / "s.json").read_text())["rows"]
    assert row["quantity"] == "depth"
    assert row["rms"] < 0.1
    assert "wrong orders, ppm" in done.stdout


def test_the_command_scores_maps_of_other_programs(tmp_path, bust):
    phase = bust.truth["coordinate"] * (2 * np.pi / bust.period_px)
    np.savez(tmp_path / "phase.npz", phase=phase, sigma=np.full(phase.shape, 0.1))
    np.save(tmp_path / "depth.npy", bust.truth["depth"] / 1000)
    run("score", tmp_path / "phase.npz", "--scene", "bust", "--json", tmp_path / "p.json")
    (row,) = json.loads((tmp_path / "p.json").read_text())["rows"]
    assert (row["unit"], row["within_1_sigma"]) == ("rad", 1.0)
    words = ("--scene", "bust", "--holds", "depth", "--scale", "1000", "--json")
    run("score", tmp_path / "depth.npy", *words, tmp_path / "d.json")
    assert json.loads((tmp_path / "d.json").read_text())["rows"][0]["rms"] < 1e-9


def test_the_command_lists_scenes_and_refuses_half_of_a_question(tmp_path, truth):
    assert "pair-painted" in run("score").stdout
    depth_set(tmp_path / "test", truth)
    assert "all" in run("score", tmp_path / "test", "--truth", tmp_path / "test").stdout
    for words, said in (
        (["--out", tmp_path / "x"], "--scene: expected one of"),
        (["--scene", "bust"], "expected a result to score, or --out"),
        ([tmp_path / "test"], "expected either --scene, or --truth"),
        (["--scene", "bsut", "--out", tmp_path / "x"], "got 'bsut'"),
    ):
        assert said in run("score", *words, code=2).stderr
