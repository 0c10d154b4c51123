"""Timing of scans on virtual devices: no frame of the wrong picture, whatever the delay."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest

from fringeworks import encode
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.fast import FastTaker
from fringeworks.scan.frame_noise import noise_between
from fringeworks.scan.frames import take_frames
from fringeworks.simulate.standard import bust, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import CameraSettings, DeviceProblem
from tests.grids import quick, thinned
from tests.virtual_devices import Screen, bench, plan

pytestmark = pytest.mark.statistical

DEVICES = [
    (
        {"delay_s": delay / 2, "jitter_refreshes": jitter},
        {
            "fps": fps,
            "shutter": shutter,
            "delay_s": delay / 2,
            "jitter_frames": jitter,
            "readout_s": 0.014,
        },
    )
    for delay, jitter, fps, shutter in itertools.product(
        (0.0, 0.03, 0.2), (0, 2), (30, 60), ("global", "rolling")
    )
]


def wrong_by_agreement(seed, devices, frames):
    b = bench(*devices, seed=seed)
    taker = Agreement(b.projector, b.camera)
    taker.start()
    pictures = itertools.islice(itertools.cycle(list(encode(plan()))), frames)
    return sum(not b.shows_only(taker.take(picture), picture) for picture in pictures)


def wrong_in_fast_mode(seed, devices, frames, triggered=False):
    projector, camera = devices
    if triggered:
        camera = camera | {"jitter_frames": 0}
    b = bench(projector, camera, seed=seed)
    delay = measure_delay(b.projector, b.camera, triggered=triggered, seed=seed)
    taker = FastTaker(b.projector, b.camera, delay)
    pictures = list(itertools.islice(itertools.cycle(list(encode(plan()))), frames))
    grabs = taker.take(pictures)
    return sum(not b.shows_only(g, p) for g, p in zip(grabs, pictures, strict=True))


def test_agreement_takes_no_wrong_frame():
    assert sum(wrong_by_agreement(k, devices, 24) for k, devices in enumerate(DEVICES)) == 0


@pytest.mark.parametrize("triggered", [False, True])
def test_fast_mode_takes_no_wrong_frame(triggered):
    assert (
        sum(wrong_in_fast_mode(k, devices, 24, triggered) for k, devices in enumerate(DEVICES[::5]))
        == 0
    )


@functools.cache
def bust_scene():
    return RigScene(look(standard_rig(scale=0.2), bust()))


PROCESSED = [
    {"jpeg": 95},
    {"jpeg": 85},
    {"jpeg": 60, "noise": 0.4},
    {"smoothing_px": 0.8},
    {"smoothing_px": 1.5, "noise": 2.0},
    {"jpeg": 85, "smoothing_px": 0.8},
    {"lag": 0.3},
    {"lag": 0.6, "jpeg": 85},
    {"lag": 0.8},
]
"""What cameras do to frames before they send them."""


@pytest.mark.parametrize("camera", quick(PROCESSED, *PROCESSED[2::3]), ids=str)
def test_frames_of_cameras_that_process_them_are_taken(camera):
    """Compressed frames differ most beside edges; a flat picture does not show how much."""
    scene = bust_scene()
    rows, columns = 240, 384
    shown = list(encode(plan(width=columns, height=rows)))
    for k, late in enumerate(({}, {"fps": 60, "shutter": "rolling", "jitter_frames": 2})):
        b = bench({"width_px": columns, "height_px": rows}, camera | late, scene=scene, seed=k)
        taker = Agreement(b.projector, b.camera)
        assert all(b.shows_only(taker.take(picture), picture) for picture in shown)
        assert taker.noise.kept == pytest.approx(camera.get("lag", 0.0), abs=0.06)


@pytest.mark.parametrize("lag", [0.2, 0.5, 0.8])
def test_no_trace_of_the_picture_before_stays(lag):
    """The part of a frame that belongs to the picture before it, relative to the noise."""
    b = bench({}, {"lag": lag}, seed=5)
    taker = Agreement(b.projector, b.camera)
    shown = list(encode(plan()))
    clean = [Screen().projected(picture / 255.0) for picture in shown]
    traces = []
    for k, picture in enumerate(shown):
        frame = taker.take(picture).pixels.astype(float)
        if k == 0:
            continue
        difference = 255.0 * (clean[k - 1] - clean[k])
        error = frame - 255.0 * (clean[k] + 0.03)
        share = np.sum(error * difference) / np.sum(difference**2)
        traces.append(share * np.std(difference))
    noise = np.sqrt(taker.noise.usual.variance(np.array(128.0)))
    assert np.abs(np.mean(traces)) < 0.4 * noise


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_ten_thousand_frames():
    assert sum(wrong_by_agreement(k, devices, 420) for k, devices in enumerate(DEVICES)) == 0
    assert (
        sum(
            wrong_in_fast_mode(k, devices, 210, triggered)
            for triggered in (False, True)
            for k, devices in enumerate(DEVICES)
        )
        == 0
    )


def test_time_of_a_scan():
    devices = {"delay_s": 1 / 60}, {"fps": 60, "delay_s": 1 / 60}
    pictures = list(encode(plan()))
    b = bench(*devices)
    taker = Agreement(b.projector, b.camera)
    start = b.clock.now_s()
    taker.start()
    for picture in pictures:
        taker.take(picture)
    assert b.clock.now_s() - start <= 1.5
    b = bench(*devices)
    delay = measure_delay(b.projector, b.camera, triggered=True)
    start = b.clock.now_s()
    FastTaker(b.projector, b.camera, delay).take(pictures)
    assert b.clock.now_s() - start <= 0.6


@thinned(strength=1, delay_s=[0.0, 0.05, 0.2], shutter=["global", "rolling"])
def test_measured_delay_is_right_within_a_frame(delay_s, shutter):
    """A picture begins to appear after the delays, and is complete one exposure and one readout later."""
    b = bench(
        {"delay_s": delay_s}, {"fps": 59.0, "delay_s": 0.02, "readout_s": 0.01, "shutter": shutter}
    )
    delay = measure_delay(b.projector, b.camera)
    exposure_s, frame_s = 16.667e-3, 1 / 59
    begins_s = delay_s + 0.02 + (0.01 if shutter == "global" else 0.0)
    assert abs(delay.appears_s.min() - begins_s) <= frame_s
    assert abs(delay.left_s.max() - (delay_s + 0.03 + exposure_s)) <= frame_s


def test_a_camera_that_repeats_frames_is_waited_for():
    b = bench({}, {"frozen": 0.4, "torn": 0.2, "loss": 0.1}, seed=3)
    taker = Agreement(b.projector, b.camera)
    pictures = list(encode(plan()))
    grabs = [taker.take(picture) for picture in pictures]
    clean = bench(seed=3)
    expected = [Agreement(clean.projector, clean.camera).take(p) for p in pictures]
    for grab, reference in zip(grabs, expected, strict=True):
        assert grab.complete
        assert np.abs(grab.pixels.astype(float) - reference.pixels).mean() < 4


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ({"flicker": 0.2, "fps": 37.0, "reference_ms": 3.0}, "flickers|steady"),
        ({"frozen": 0.999}, "white to be brighter|expected a change"),
        ({"torn": 0.99}, "incomplete"),
        ({"loss": 0.999}, "no frame arrived"),
    ],
)
def test_what_cannot_be_taken_is_said(camera, said):
    from tests.virtual_devices import Screen

    b = bench({}, camera, scene=Screen(ambient=0.2), seed=1)
    taker = Agreement(b.projector, b.camera)
    with pytest.raises(DeviceProblem, match=said):
        for picture in encode(plan()):
            taker.take(picture)


def test_a_covered_projector_is_said():
    from tests.virtual_devices import Screen

    b = bench(scene=Screen(white=0.0))
    with pytest.raises(DeviceProblem, match="white to be brighter than black"):
        Agreement(b.projector, b.camera).start()


def test_noise_is_measured():
    rng = np.random.default_rng(0)
    light = np.linspace(5, 220, 64 * 80).reshape(64, 80)

    def frame():
        return np.rint(light + np.sqrt(1.5**2 + 0.05 * light) * rng.standard_normal(light.shape))

    found = [noise_between([(frame(), frame()), (frame(), frame())]) for _ in range(20)]
    read = np.mean([n.read_counts**2 for n in found])
    assert read == pytest.approx(1.5**2 + 1 / 12, rel=0.15)
    assert np.mean([n.gain for n in found]) == pytest.approx(0.05, rel=0.1)


def test_noise_is_measured_where_black_is_clipped():
    """Most samples of a dark scene are 0, and a highlight is at the limit."""
    rng = np.random.default_rng(1)
    light = np.geomspace(0.5, 300, 64 * 80).reshape(64, 80)

    def frame(share):
        shown = light * share
        noisy = shown + np.sqrt(1.5**2 + 0.05 * shown) * rng.standard_normal(light.shape)
        return np.clip(np.rint(noisy), 0, 255)

    found = [
        noise_between([(frame(0.01), frame(0.01)), (frame(1.0), frame(1.0))]) for _ in range(20)
    ]
    assert np.mean([n.read_counts**2 for n in found]) == pytest.approx(1.5**2 + 1 / 12, rel=0.2)
    assert np.mean([n.gain for n in found]) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("read", [0.7, 1.5, 4.0])
def test_noise_is_measured_where_every_sample_is_clipped_or_dark(read):
    """A dark background at count 0, and an object that saturates: no group is free of clipping."""
    rng = np.random.default_rng(2)
    light = np.zeros((64, 80))
    light[20:40, 20:50] = 400.0

    def frame(share):
        noisy = light * share + read * rng.standard_normal(light.shape)
        return np.clip(np.rint(noisy), 0, 255)

    found = [noise_between([(frame(0), frame(0)), (frame(1), frame(1))]) for _ in range(20)]
    measured = np.sqrt(np.mean([n.read_counts**2 for n in found]))
    # Noise of less than a count is overestimated, because rounding hides how it is spread.
    assert 0.9 * read < measured < 1.6 * read


@pytest.mark.parametrize("exposure_ms", [40.0, 80.0])
def test_noise_is_measured_where_white_saturates(exposure_ms):
    """Shot noise is seen between black and saturation only, so a grey is shown as well."""
    b = bench(scene=Screen(white=0.9))
    b.camera.configure(CameraSettings(exposure_ms=exposure_ms))
    agreement = Agreement(b.projector, b.camera)
    _, white = agreement.start()
    assert np.all(white.pixels == 255)
    assert agreement.noise.usual.variance(np.array(128.0)) == pytest.approx(
        1.083 + 128 * 0.02, rel=0.1
    )
    picture = next(iter(encode(plan())))
    assert b.shows_only(agreement.take(picture), picture)


@pytest.mark.parametrize("delay_s", np.arange(0.18, 0.19, 0.001))
def test_equal_frames_of_a_camera_without_noise_are_no_repeated_ones(delay_s):
    """White's first steady frame may show a trace of black, and then differs from the others."""
    camera = {"noise": 0.0, "shot_gain": 0.0, "readout_s": 0.0}
    b = bench({"delay_s": delay_s}, camera, scene=Screen(white=0.05))
    b.camera.configure(CameraSettings(exposure_ms=200.0))
    picture = next(iter(encode(plan())))
    assert b.shows_only(Agreement(b.projector, b.camera).take(picture), picture)


def test_incomplete_frames_are_waited_for():
    """Seven of eight frames lack a packet."""
    b = bench(camera={"torn": 0.875, "fps": 50.0})
    agreement = Agreement(b.projector, b.camera)
    for picture in encode(plan()):
        assert b.shows_only(agreement.take(picture), picture)


def altered(b, change):
    """Let the camera of a bench deliver ``change(pixels, number of the frame)``."""

    def grab(timeout_s=5.0, real=b.camera.grab):
        grabbed = real(timeout_s)
        return replace(grabbed, pixels=change(grabbed.pixels, grabbed.number))

    b.camera.grab = grab
    return b


@pytest.mark.parametrize("phase", range(7))
def test_every_seventh_frame_repeats_the_one_before(phase):
    """A repeated frame among those of black and white must not count as a camera without noise."""
    last = []

    def repeat(pixels, number):
        pixels = last[-1] if last and number % 7 == phase else pixels
        last[:] = [pixels]
        return pixels

    b = altered(bench(), repeat)
    agreement = Agreement(b.projector, b.camera)
    for picture in encode(plan()):
        agreement.take(picture)
    assert agreement.noise.usual.variance(np.array(128.0)) == pytest.approx(
        1.083 + 128 * 0.02, rel=0.15
    )


def test_light_that_changes_within_a_refresh_is_not_a_wrong_screen():
    b = bench({"refresh_hz": 120.0, "duty": 0.3}, {"reference_ms": 5.0, "fps": 50.0})
    with pytest.raises(DeviceProblem, match=r"whole refresh periods .*8\.333 ms") as problem:
        Agreement(b.projector, b.camera).start()
    assert "right screen" not in str(problem.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pixels: pixels[:40, :60], "got 60 × 40 px of 8 bit"),
        (lambda pixels: pixels.astype(np.uint16), "got 64 × 48 px of 16 bit"),
    ],
)
@pytest.mark.parametrize("average", [1, 4])
def test_frames_of_another_size_or_depth(change, said, average):
    b = bench()
    altered(b, lambda pixels, number: change(pixels) if number > 40 and number % 2 else pixels)
    with pytest.raises(DeviceProblem, match=said):
        list(take_frames(b.projector, b.camera, plan(), average=average))
