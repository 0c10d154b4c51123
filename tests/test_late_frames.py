"""Frames that come late in fast scans: dated, thrown away or refused, never taken for another."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import PatternPlan, encode
from fringeworks.devices.protocols import Grab
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from fringeworks.scan.dating import moments_s
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.frames import take_frames
from fringeworks.scan.references import PROOF_LEVELS, proof_trace, trace_of
from fringeworks.types import DeviceProblem
from tests.light_devices import COLUMNS, ROWS, devices

pytestmark = pytest.mark.statistical

PLAN = PatternPlan(
    COLUMNS, ROWS, (PhaseSteps("x", 16.0, equal_steps(3)), GrayCode("x", 8.0, COLUMNS))
)
LATE = {
    "rolling": {"line_s": 1.2e-4, "starts_late": (12, 0.06)},
    "by a clock": {"starts_late": (12, 0.06), "dated": "device"},
    "by a counter": {"starts_late": (12, 0.06), "dated": "counter"},
    "by arrival": {"starts_late": (25, 0.1)},
    "slow": {"starts_late": (40, 0.03), "fps": 30.0},
    "now and then": {"late": (0.05, 0.025)},
    "lost and doubled": {"lost": 0.05, "doubled": 0.05, "late": (0.02, 0.03)},
}


def worst(camera, frames, plan=PLAN):
    """Largest count by which a frame differs from the light of its picture, over its noise."""
    found = 0.0
    for number, picture in enumerate(encode(plan)):
        light = camera.white * picture[camera.seen] / 255.0 + camera.ambient
        expected = 255.0 * light * camera.settings.exposure_ms / camera.reference_ms
        noise = np.sqrt(camera.noise**2 + camera.shot * expected + 1 / 12)
        # Means over rows: a trace of another picture stands out of the noise of single pixels.
        off = ((frames[number] - expected) / noise).reshape(12, -1, camera.shape[1]).mean(axis=1)
        found = max(found, float(np.abs(off).max()) * np.sqrt(camera.shape[0] / 12))
    return found


@pytest.mark.parametrize("name", LATE)
def test_no_late_frame_is_taken_for_another(name):
    projector, camera = devices({}, LATE[name], seed=11)
    delay = measure_delay(projector, camera)
    frames = dict(take_frames(projector, camera, PLAN, delay=delay))
    # 13 824 means of normal values stay below 5.5.
    assert worst(camera, frames) < 5.5


@pytest.mark.parametrize("line_s", [0.0, 1.2e-4])
def test_a_delay_that_has_changed_is_refused_with_rows(line_s):
    projector, camera = devices({}, {"line_s": line_s}, seed=3)
    delay = measure_delay(projector, camera)
    camera.latency_s += 0.025
    with pytest.raises(DeviceProblem, match=r"light of the picture before in rows \d+ to \d+ of"):
        list(take_frames(projector, camera, PLAN, delay=delay))


def grabs(arrived, own=None, numbers=None, pixels=None):
    rng = np.random.default_rng(1)
    return [
        Grab(
            rng.integers(0, 99, (4, 4)).astype(np.uint8) if pixels is None else pixels[k],
            s,
            None if own is None else own[k],
            None if numbers is None else numbers[k],
        )
        for k, s in enumerate(arrived)
    ]


def test_frames_are_dated_by_the_clock_the_counter_or_later_frames():
    due = 5.0 + np.arange(12) / 60
    arrived = due.copy()
    arrived[2:6] = due[5] + 0.001 * np.arange(4)
    for known in ({"own": due - 3.0}, {"numbers": list(range(7, 19))}, {}):
        dated = moments_s(grabs(arrived, **known))
        # The last of the bunch is late by 3 ms, and all by as much.
        np.testing.assert_allclose(dated, due, atol=4e-3, err_msg=str(known))
        assert (dated <= arrived).all()


def test_a_clock_in_another_unit_is_not_used():
    due = 5.0 + np.arange(12) / 60
    np.testing.assert_allclose(moments_s(grabs(due, own=1000.0 * due)), due)
    np.testing.assert_allclose(moments_s(grabs(due, own=np.ones(12))), due)
    np.testing.assert_allclose(moments_s(grabs(due[:2])), due[:2])


def test_a_copy_is_as_old_as_its_original():
    due = 5.0 + np.arange(12) / 60
    rng = np.random.default_rng(2)
    frames = rng.integers(0, 99, (12, 4, 4)).astype(np.uint8)
    arrived, shown = np.insert(due, 6, due[5] + 2e-3), np.insert(frames, 6, frames[5], axis=0)
    np.testing.assert_allclose(
        moments_s(grabs(arrived, pixels=shown)), np.insert(due, 6, due[5]), atol=1e-9
    )


def test_triggered_frames_keep_their_arrival():
    arrived = np.array([0.0, 0.03, 0.1, 0.11, 0.3])
    np.testing.assert_array_equal(moments_s(grabs(arrived), triggered=True), arrived)


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_a_trace_is_found_in_its_rows_whatever_the_gain(share):
    rng = np.random.default_rng(4)
    x = np.arange(200.0)
    fringe = 90 + 60 * np.cos(x / 9) + np.zeros((160, 1))
    other = 90 + 60 * np.cos(x / 31) + np.zeros((160, 1))
    frame = 1.07 * fringe
    frame[80:120] = 1.07 * ((1 - share) * fringe + share * other)[80:120]
    noisy = [np.clip(f + 2 * rng.standard_normal(f.shape), 0, 255) for f in (frame, fringe, other)]
    found = trace_of(*noisy)
    if not share:
        assert found is None
        return
    assert found.share == pytest.approx(1.07 * share, abs=0.01)
    assert 80 <= found.rows[0] < found.rows[1] <= 120
    assert f"rows {found.rows[0]} to {found.rows[1] - 1} of 160" in str(found)


def test_a_dark_frame_holds_no_trace():
    dark = np.zeros((40, 50))
    assert trace_of(dark, dark, dark) is None


@pytest.mark.parametrize("late", [0.0, 0.3, 1.0, 2.0])
def test_known_pictures_prove_that_nothing_is_late(late):
    rng = np.random.default_rng(5)
    levels = np.array([0.4, 0.4, *PROOF_LEVELS])
    at = np.arange(2, len(levels)) - late
    low, part = np.floor(at).astype(int), at % 1.0
    seen = (1 - part) * levels[low] + part * levels[np.minimum(low + 1, len(levels) - 1)]
    frames = [200 * v + 10 + rng.standard_normal((64, 80)) for v in seen]
    assert (proof_trace(frames) is None) == (late == 0.0)


@pytest.mark.parametrize("room", [5.0, 10.0, 20.0, 50.0])
@pytest.mark.parametrize("level", [0.0, 1.0])
def test_room_light_is_no_trace(room, level):
    """Where the room lights white and black alike, a share and a gain differ by noise only."""
    rng = np.random.default_rng(31 + int(room))
    v, u = np.mgrid[:120, :160]
    albedo = 0.8 + 0.15 * np.sin(u / 11) * np.cos(v / 14)

    def frame(share):
        seen = albedo * (room + 150.0 * share)
        return np.rint(seen + np.sqrt(1.2 + 0.025 * seen) * rng.standard_normal(seen.shape))

    other = frame(1.0 - level)
    assert trace_of(frame(level), frame(level), other) is None
    mixed = trace_of(frame(0.85 * level + 0.15 * (1.0 - level)), frame(level), other)
    assert mixed is not None
    assert mixed.share == pytest.approx(0.15, abs=0.02)


def test_jitter_does_not_date_frames_before_they_were_exposed():
    """The period of 64 frames with a jitter of 15 ms is known to 5 %, too little 32 frames ahead."""
    early = []
    for seed in range(40, 60):
        rng = np.random.default_rng(seed)
        due = 5.0 + np.arange(80) / 51
        pixels = np.zeros((80, 2, 2), np.uint8)
        pixels[1::2] = 1
        dated = moments_s(grabs(due + 0.015 * rng.random(80), pixels=pixels))
        early.append((due - dated).max())
    assert max(early) < 3e-3


def test_rows_in_the_dark_show_no_trace():
    """A body in a few rows: where nothing is lit, noise is common to both sides of the fit."""
    rng = np.random.default_rng(8)
    lit = np.zeros((300, 400))
    lit[100:180, 120:260] = 1.0

    def frame(level):
        return 5.0 + 120.0 * level * lit + rng.normal(0.0, 1.0, lit.shape)

    assert trace_of(frame(1.0), frame(1.0), frame(0.2), gain=False) is None
    mixed = trace_of(frame(0.7), frame(1.0), frame(0.0), gain=False)
    assert mixed is not None
    assert mixed.share == pytest.approx(0.3, abs=0.03)
