"""Watching a rig by its scans: knocks are found, clean scans make no alarm, what is blind is said.

Coordinates are made here from rays, bodies and phasors, and photographs by ``tests/ray_caster.py``;
the package's own simulator takes no part.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy

import fringeworks as fw
from fringeworks.rig.drift_learning import WITHIN
from fringeworks.rig.drift_watch import WINDOWS
from fringeworks.rig.pinhole import pose, project, rays, rotation
from fringeworks.rig.scan_evidence import drift_units
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.types import CoordinateMap, Decoded, Reason
from tests.commands import run
from tests.ray_caster import Ball, Photographs, Sheet

pytestmark = pytest.mark.statistical

SCALE = 0.25
PERIOD_PX = 12.0


@cache
def truth():
    return standard_rig(scale=SCALE)


@cache
def pixel_rays():
    h, w = truth().camera.shape
    u, v = np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float))
    return rays(truth().camera, np.stack((u, v), axis=-1))


@cache
def calibrated(seed=0):
    """A rig that is off from the truth by errors that its covariance states."""
    rng = np.random.default_rng([77, seed])
    f = truth().camera.focal_px[0]
    sigma = np.array(
        [f, f, f, f, 9, 90, 2, 2, 0.0, f, f, f, f, 9, 90, 2, 2, 0, 1, 1, 1, 60, 60, 60]
    )
    sigma = sigma * 2e-4
    error = sigma * rng.standard_normal(24)
    return replace(changed(truth(), error), covariance=np.diag(sigma**2))


def changed(rig, step):
    """The rig after a change of its parameters, without the package's own function for it."""

    def device(one, part):
        p = one.parameters + part
        return replace(
            one, focal_px=tuple(p[:2]), principal_px=tuple(p[2:4]), distortion=tuple(p[4:])
        )

    T = rig.T_projector_camera
    moved = pose(rotation(step[18:21]) @ T[:3, :3], T[:3, 3] + step[21:24])
    return fw.Rig(device(rig.camera, step[:9]), device(rig.projector, step[9:18]), moved)


def knock(**parts):
    step = np.zeros(24)
    places = {f"rotation_{axis}": (18 + k, np.radians(1.0)) for k, axis in enumerate("xyz")}
    places |= {f"translation_{axis}": (21 + k, 1.0) for k, axis in enumerate("xyz")}
    for name, size in parts.items():
        place, unit = places[name]
        step[place] = unit * size
    return step


def scan(seed, step=None, *, noise_px=0.03, blur_px=0.0):
    """Coordinates of a tilted plate with a ball before it, elsewhere in each scan."""
    rng = np.random.default_rng([31, seed])
    rig = truth() if step is None else changed(truth(), step)
    ray = pixel_rays()
    normal = rotation(rng.normal(0, 0.2, 3))[:, 2]
    depth = normal[2] * rng.uniform(480, 560) / (ray @ normal)
    facing = np.abs(np.broadcast_to(normal[2], depth.shape))
    centre, radius = rng.uniform([-50, -40, 430], [50, 40, 470]), rng.uniform(15, 40)
    size = np.sum(ray * ray, axis=-1)
    along = ray @ centre
    root = along**2 - size * (centre @ centre - radius**2)
    hit = root > 0
    nearer = (along - np.sqrt(np.maximum(root, 0.0))) / size
    depth = np.where(hit, nearer, depth)
    points = depth[..., None] * ray
    facing = np.where(hit, (centre - points)[..., 2] / radius, facing)
    at = project(
        rig.projector, points @ rig.T_projector_camera[:3, :3].T + rig.T_projector_camera[:3, 3]
    )
    light = 60.0 * np.maximum(facing, 0.05)
    edge = scipy.ndimage.binary_dilation(hit ^ scipy.ndimage.binary_erosion(hit), iterations=2)
    maps = []
    for k, axis in enumerate("xy"):
        q = at[..., k]
        phasor = light * np.exp(2j * np.pi / PERIOD_PX * q)
        if blur_px:
            parts = [scipy.ndimage.gaussian_filter(p, blur_px) for p in (phasor.real, phasor.imag)]
            phasor = parts[0] + 1j * parts[1]
        shift = np.angle(phasor * np.exp(-2j * np.pi / PERIOD_PX * q)) * PERIOD_PX / (2 * np.pi)
        sigma = noise_px * 60.0 / light
        q = q + shift + sigma * rng.standard_normal(q.shape)
        reason = np.where(edge, Reason.LOW_MODULATION, Reason.OK).astype(np.uint8)
        q = np.where(edge, np.nan, q).astype(np.float32)
        sigma = np.where(edge, np.nan, sigma).astype(np.float32)
        b = np.abs(phasor).astype(np.float32)
        maps.append(CoordinateMap(q, sigma, b, b, reason, axis, (PERIOD_PX,)))
    return Decoded(maps[0], maps[1], fw.signal.CameraNoise(1.0, 0.0))


def evidence(seed, step=None, rig=None, **how):
    found = scan(seed, step, **how)
    return fw.rig.epipolar_evidence(found, rig or calibrated(), name=f"scan {seed}")


@cache
def clean_scan(seed):
    return scan(seed, blur_px=0.4 + 0.05 * (seed % 7))


@cache
def clean_one(seed):
    return fw.rig.epipolar_evidence(clean_scan(seed), calibrated(), name=f"scan {seed}")


def clean(first, last):
    return [clean_one(k) for k in range(first, last)]


def verdicts(found, count):
    return [one.verdict for one in found.scans[-count:]]


@pytest.mark.parametrize(
    "step",
    [
        knock(rotation_x=0.05),
        knock(rotation_y=0.05),
        knock(rotation_z=-0.05),
        knock(translation_y=0.1),
        knock(rotation_x=0.03, rotation_z=0.04),
    ],
)
def test_knocks_are_found_within_three_scans(step):
    knocked = [evidence(200 + k, step, blur_px=0.6) for k in range(WITHIN)]
    found = fw.rig.judge_scans(calibrated(), [*clean(0, 23), *knocked])
    assert verdicts(found, 6)[:3] == ["holds"] * 3
    assert found.verdict == "has moved"
    (told,) = [one for one in found.findings if one.kind == "rig moved"]
    assert told.severity == "error"


def test_the_change_is_measured():
    step = knock(rotation_x=0.05, rotation_z=0.08)
    knocked = [evidence(300 + k, step) for k in range(4)]
    found = fw.rig.judge_scans(calibrated(), [*clean(0, 20), *knocked])
    expected = found.modes.T @ np.array([1.0, 0.0, 1.6, 0, 0, 0, 0])
    for one in found.scans[-4:]:
        off = one.modes - expected
        assert off @ np.linalg.solve(one.covariance, off) < 30.0  # χ² of 7: once in 10⁴


def test_a_shift_along_the_baseline_is_blind_and_said_to_be():
    along = truth().T_projector_camera[:3, 3] / truth().baseline_mm
    step = np.zeros(24)
    step[21:] = 2.0 * along
    knocked = [evidence(k, step, blur_px=0.5) for k in range(400, 405)]
    found = fw.rig.judge_scans(calibrated(), [*clean(0, 20), *knocked])
    assert set(verdicts(found, 5)) == {"holds"}
    assert found.noticeable["translation along the baseline, mm"] > 10.0
    assert found.noticeable["rotation x, degrees"] < 0.05
    assert any("along the baseline is never seen" in one.seen for one in found.findings)


def test_one_scan_that_differs_is_no_drift():
    moved = evidence(500, knock(rotation_x=0.2))
    scans = [*clean(0, 23), moved, *(evidence(k, blur_px=0.5) for k in range(600, 603))]
    assert fw.rig.judge_scans(calibrated(), scans[:24]).verdict == "suspect"
    found = fw.rig.judge_scans(calibrated(), scans)
    assert verdicts(found, 4) == ["suspect", "holds", "holds", "holds"]


def test_a_bad_scan_among_the_first_ones_is_left_out():
    bad = fw.rig.epipolar_evidence(scan(520, knock(rotation_x=0.1)), calibrated(), name="bumped")
    scans = [*clean(0, 10), bad, *clean(10, 19)]
    knocked = [evidence(200 + k, knock(rotation_z=0.05), blur_px=0.6) for k in range(3)]
    found = fw.rig.judge_scans(calibrated(), [*scans, *knocked])
    assert found.verdict == "has moved"
    (told,) = [one for one in found.findings if "first scans" in one.seen]
    assert "bumped" in told.seen
    good = fw.rig.judge_scans(calibrated(), clean(0, 22))
    assert not any("first scans" in one.seen for one in good.findings)
    assert max(found.noticeable["rotation x, degrees"], 0.0) < 0.03


def test_blur_is_no_drift():
    """Scans that are blurred more than those that the rig was learnt from."""
    blurred = [evidence(k, blur_px=1.2) for k in range(700, 704)]
    found = fw.rig.judge_scans(calibrated(), [*clean(0, 20), *blurred])
    assert set(verdicts(found, 4)) == {"holds"}


def test_a_rig_without_a_covariance_is_learnt_as_well():
    plain = replace(calibrated(), covariance=None)
    knocked = [evidence(800 + k, knock(rotation_x=0.05), plain) for k in range(3)]
    usual = [fw.rig.epipolar_evidence(clean_scan(k), plain) for k in range(22)]
    found = fw.rig.judge_scans(plain, [*usual, *knocked])
    assert verdicts(found, 5)[:2] == ["holds"] * 2
    assert found.verdict == "has moved"


def drawn(rng, count, scatter, step=None, first=10**9):
    """Evidence as scans would give it, from the information of some of them."""
    rig, seen = calibrated(), clean(0, 20)
    usual = np.sqrt(np.diag(rig.covariance)) * rng.standard_normal(24)
    units = drift_units(rig)
    found = []
    for k in range(count):
        one = seen[rng.integers(len(seen))]
        size = np.sqrt(np.diag(one.information))
        values, vectors = np.linalg.eigh(one.information / np.outer(size, size))
        root = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        change = usual + units @ (scatter * rng.standard_normal(7))
        if k >= first:
            change = change + step
        score = one.information @ change + root @ rng.standard_normal(24)
        found.append(replace(one, score=score, name=str(k)))
    return found


SCATTERS = {
    "none": np.zeros(7),
    "one mode": np.array([0.3, 0, 0, 0, 0, 0, 0]),
    "all modes": np.full(7, 0.05),
}


@pytest.mark.parametrize("scatter", SCATTERS)
@pytest.mark.parametrize("runs", [3, pytest.param(25, marks=pytest.mark.long)])
def test_false_alarms_are_below_the_stated_rate(scatter, runs):
    alarms = scans = 0
    for seed in range(runs):
        rng = np.random.default_rng([901, seed])
        found = fw.rig.judge_scans(calibrated(), drawn(rng, 220, SCATTERS[scatter]))
        alarms += verdicts(found, 200).count("has moved")
        scans += 200
    # A Poisson count with the stated mean exceeds this once in 10³ tests.
    assert alarms <= scipy.stats.poisson.isf(1e-3, 1e-3 * scans)


def test_small_drifts_are_found_by_many_scans():
    rng = np.random.default_rng(902)
    step = knock(rotation_x=0.01)
    found = fw.rig.judge_scans(calibrated(), drawn(rng, 45, SCATTERS["all modes"], step, 25))
    assert found.verdict == "has moved"
    assert found.scans[-1].since in WINDOWS


def test_watching_needs_both_axes_and_enough_pixels():
    both = scan(0)
    with pytest.raises(fw.InputError, match="both axes"):
        fw.rig.epipolar_evidence(replace(both, y=None), calibrated())
    with pytest.raises(fw.RigMismatch, match="frames of"):
        fw.rig.epipolar_evidence(both, standard_rig(scale=0.1))
    hidden = np.where(np.arange(320) < 300, np.nan, both.x.coordinate_px)
    few = replace(both, x=replace(both.x, coordinate_px=hidden.astype(np.float32)))
    hidden = np.where(np.arange(256)[:, None] < 250, np.nan, both.y.coordinate_px)
    few = replace(few, y=replace(both.y, coordinate_px=hidden.astype(np.float32)))
    with pytest.raises(fw.RigMismatch, match="smooth cells"):
        fw.rig.epipolar_evidence(few, calibrated())
    with pytest.raises(fw.InputError, match="baseline"):
        fw.rig.judge_scans(calibrated(), [], baseline=3)
    with pytest.raises(fw.InputError, match="false_alarms"):
        fw.rig.judge_scans(calibrated(), [], false_alarms=0.0)
    assert fw.rig.judge_scans(calibrated(), []).verdict == "learning"


def test_logs_go_on_day_by_day(tmp_path):
    log = tmp_path / "watch.jsonl"
    scans = [replace(one, sha256=f"{k:064x}") for k, one in enumerate(clean(0, 20))]
    fw.files.append_watch_log(log, "rig", scans[:8])
    known = fw.files.append_watch_log(log, "rig", scans[6:])
    assert [one.sha256 for one in known.evidence] == [one.sha256 for one in scans]
    read: fw.files.WatchLog = fw.files.read_watch_log(log)
    for one, other in zip(read.evidence, scans, strict=True):
        np.testing.assert_array_equal(one.information, other.information)
        np.testing.assert_array_equal(one.score, other.score)
    before = log.read_text("utf-8")
    with pytest.raises(fw.FileProblem, match="another rig"):
        fw.files.append_watch_log(log, "other", scans[:1])
    assert log.read_text("utf-8") == before
    for text in ("", "{}", "[1]", '{"kind": "fringeworks watch log", "version": 9}', before[:900]):
        log.write_text(text, encoding="utf-8")
        with pytest.raises(fw.FileProblem):
            fw.files.read_watch_log(log)


def bodies(seed):
    """Parts that differ from scan to scan."""
    rng = np.random.default_rng([61, seed])
    place = np.array([0, 0, rng.uniform(490, 560)])
    found = [Sheet(pose(rotation(rng.normal(0, 0.2, 3)), place), rng.uniform(0.3, 0.9))]
    if rng.random() < 0.5:
        centre = tuple(rng.uniform([-50, -40, 440], [50, 40, 480]))
        found.append(Ball(centre, rng.uniform(15, 35), rng.uniform(0.3, 0.9)))
    return found


def photographed(seed, step=None):
    rng = np.random.default_rng([62, seed])
    rig = truth() if step is None else changed(truth(), step)
    photographs = Photographs(rig, bodies(seed), over=2)
    noise = rng.uniform(0.5, 2.5)
    return photographs.stack(fringe_plan(rig), blur_px=rng.uniform(0.3, 1), noise=noise, seed=seed)


@pytest.mark.long
def test_photographs_of_a_second_simulator_are_watched(tmp_path):
    log = tmp_path / "watch.jsonl"
    usual = ((f"scan {k}", photographed(k)) for k in range(16))
    found = fw.rig.watch_rig(calibrated(), usual, log=log, baseline=12)
    assert verdicts(found, 4) == ["holds"] * 4
    knocked = ((f"scan {k}", photographed(k, knock(rotation_x=0.05))) for k in range(50, 53))
    found = fw.rig.watch_rig(calibrated(), knocked, log=log, baseline=12)
    assert len(found.scans) == 19
    assert found.verdict == "has moved"


def test_the_command_learns_and_goes_on(tmp_path):
    small = standard_rig(scale=0.1)
    fw.files.write_rig(tmp_path / "rig.toml", small)
    for k, name in enumerate("ab"):
        plan = fringe_plan(small, both=name == "a")
        stack = Photographs(small, bodies(3 + k), over=2).stack(plan, blur_px=0.5)
        fw.files.write_stack(tmp_path / "day" / name, list(stack.frames), plan)
    log, out = tmp_path / "w.jsonl", tmp_path / "w.json"
    words = ("rig", "watch", tmp_path / "day", "--rig", tmp_path / "rig.toml", "--watched", log)
    for _ in range(2):  # scans that are known are not added again
        done = run(*words, "--json", out, code=4)
        assert "the rig is learnt from 20 scans, of which 1 are there" in done.stdout + done.stderr
        assert "b: it says nothing about the rig" in done.stdout + done.stderr
        assert json.loads(out.read_text("utf-8"))["verdict"] == "learning"
    assert len(fw.files.read_watch_log(log).evidence) == 1
