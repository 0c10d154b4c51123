"""The set-up on virtual devices: every fault is named with its cause, and clean devices have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.devices.bench import virtual_bench
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.protocols import VideoMode
from fringeworks.files.setup import read_setup, write_setup
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.setup import SetupStopped, set_up
from fringeworks.types import CameraSettings, DeviceProblem, Finding
from tests.grids import quick
from tests.virtual_devices import Screen, bench

pytestmark = pytest.mark.statistical

ROWS, COLUMNS = 120, 192
# Five more are in test_setup_figures.py, which shows them too.
FAULTS = {
    "limited range and gamma": ({"range_limited": True, "gamma": 2.2}, {}, "range"),
    "resized by 1.05": ({"scale": 1.05}, {}, "scale"),
    "colour wheel": ({"duty": 0.6}, {"fps": 31.0, "reference_ms": 15.0}, "flicker"),
    "compression": ({}, {"jpeg": 75}, "compressed"),
    "lamp and rolling shutter": (
        {},
        {"flicker": 0.4, "shutter": "rolling", "readout_s": 0.02},
        "flicker",
    ),
}
CLEAN = {
    "plain": ({}, {}),
    "gamma": ({"gamma": 2.2, "black": 0.01}, {}),
    "late": ({"delay_s": 0.05, "jitter_refreshes": 1}, {"delay_s": 0.04, "jitter_frames": 1}),
    "rolling": ({"settling_s": 0.004}, {"shutter": "rolling", "fps": 60.0, "noise": 2.0}),
    "twelve bits": ({"gamma": 1.8}, {"bits": 12}),
}


SHORT = CameraSettings(exposure_ms=15.0)
"""No whole refresh period of 60 Hz."""


def measured(projector, camera, seed, settings=None, **scene):
    b = bench(
        {"width_px": COLUMNS, "height_px": ROWS} | projector,
        camera,
        scene=Screen(ROWS, COLUMNS, **scene),
        seed=seed,
    )
    return set_up(b.projector, b.camera, settings=settings)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named(name):
    projector, camera, kind = FAULTS[name]
    settings = SHORT if name == "colour wheel" else None
    found = measured(projector, camera, 1, settings, ambient=0.12)
    assert {f.kind for f in found.findings} == {kind}
    text = found.findings[0].text
    assert "likely" in text
    assert text.count(";") >= 2


def test_a_camera_that_averages_over_time_is_named():
    """Scans wait; the fast way, which cannot, has no delay."""
    found = measured({}, {"lag": 0.6}, 1)
    assert [f.kind for f in found.findings] == ["averaged", "delay"]
    assert found.findings[0].figures["kept_share"] == pytest.approx(0.6, abs=0.03)
    assert found.delay is None
    assert "60% of every frame" in found.findings[1].seen


@pytest.mark.parametrize("name", quick(list(CLEAN), "rolling", "twelve bits"))
def test_a_clean_bench_has_no_finding(name):
    projector, camera = CLEAN[name]
    found = measured(projector, camera, 2)
    assert found.findings == ()
    assert found.levels.gamma == pytest.approx(projector.get("gamma", 1.0), rel=0.05)
    top = 2 ** camera.get("bits", 8) - 1
    gain = 10 ** (found.settings.gain_db / 20)
    read = gain * camera.get("noise", 1.0) * top / 255
    assert found.noise.read_counts == pytest.approx(read, rel=0.15)
    model = np.sqrt(found.noise.variance(found.levels.brightness))
    np.testing.assert_allclose(found.levels.noise, model, rtol=0.15)
    assert found.proposal.plan.frames == 12
    assert found.delay is not None


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_hundred_clean_benches():
    for seed in range(100):
        projector, camera = CLEAN[list(CLEAN)[seed % len(CLEAN)]]
        assert measured(projector, camera, seed).findings == (), seed


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("scene", ["plane", "sphere", "bust", "board-0", "board-3", "board-7"])
def test_objects_are_no_faults(scene):
    for seed in range(3):
        found = set_up(*virtual_bench(scene, clock=SimulatedClock(), seed=seed))
        assert found.findings == (), seed


def test_the_exposure_is_chosen_and_stored(tmp_path):
    b = bench({"width_px": COLUMNS, "height_px": ROWS}, scene=Screen(ROWS, COLUMNS, white=0.1))
    found = set_up(b.projector, b.camera)
    assert found.exposing.chosen
    periods = found.settings.exposure_ms * 60e-3
    assert periods == pytest.approx(round(periods), abs=0.01)
    assert periods > 4
    assert 0.8 < found.levels.brightness.max() / 255 < 0.96
    told = (Finding("delay", "irregular", ("a cause",), "do it", severity="note"),)
    told += (Finding("flicker", "it flickers", axis="x", figures={"depth_share": 0.1}),)
    written = replace(found, findings=told)
    write_setup(tmp_path / "s.toml", written, projector="virtual", camera="virtual")
    stored = read_setup(tmp_path / "s.toml")
    assert stored.settings.exposure_ms == found.settings.exposure_ms
    assert stored.findings == told


def test_an_exposure_that_is_given_stays():
    given = CameraSettings(exposure_ms=33.333)
    found = measured({}, {}, 1, given, white=0.4)
    assert not found.exposing.chosen
    assert found.settings.exposure_ms == 33.333
    with pytest.raises(SetupStopped, match="100% of the lit pixels at it: use a shorter exposure"):
        measured({}, {}, 1, given, white=0.6)
    half = np.where(np.arange(COLUMNS // 2) < 20, 0.6, 0.4)
    found = measured({}, {}, 1, given, white=half)
    assert [f.kind for f in found.findings] == ["saturated"]


def test_what_stops_a_setup_is_explained():
    with pytest.raises(SetupStopped, match=r"automatic exposure is on") as stopped:
        measured({}, {"auto_exposure": True}, 1)
    tests = stopped.value.tests
    assert stopped.value.lines[0].startswith("error (exposure): an automatic exposure is on: ")
    assert [f.kind for f in tests.findings] == ["exposure"]
    assert tests.exposing.proof.verdict == "automatic"
    assert tests.levels is None
    with pytest.raises(DeviceProblem, match="point the camera at the projected picture"):
        measured({}, {}, 1, white=0.0)


@pytest.mark.parametrize(
    ("scene", "kinds"),
    [
        ({"white": 5e-4, "ambient": 5e-4}, ["dark"]),
        ({"white": 3e6}, ["saturated"]),
        ({"white": 0.1, "ambient": 0.9}, ["exposure"]),
    ],
    ids=["dark", "bright", "bright room"],
)
def test_light_that_no_exposure_suits_is_named(scene, kinds):
    with pytest.raises(SetupStopped) as stopped:
        measured({}, {}, 1, **scene)
    assert [f.kind for f in stopped.value.tests.findings] == kinds


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("white", [1.5, 20.0])
def test_a_bright_projector_is_exposed_for_less_than_a_refresh(white, seed):
    """Its light is steady, so that any exposure sees the same."""
    found = measured({}, {}, seed, white=white)
    assert found.settings.exposure_ms < 1e3 / 60
    assert 0.7 < found.levels.brightness.max() / 255 < 0.96
    assert [(f.kind, f.severity) for f in found.findings] == [("exposure", "note")]
    assert "less than a refresh period" in found.findings[0].seen


def test_a_bright_room_is_named_where_the_exposure_cannot_be_proved():
    """Double the exposure saturates, and half of it is no whole refresh period."""
    found = measured({}, {}, 1, white=0.3, ambient=0.6)
    assert [f.kind for f in found.findings] == ["room"]
    assert found.exposing.proof is None
    assert "saturated" in found.exposing.unproved


@pytest.mark.parametrize(
    ("projector", "camera"),
    [
        pytest.param({"gamma": 2.8, "black": 0.002}, {}, marks=pytest.mark.long),
        (
            {},
            {
                "fps": 15.0,
                "noise": 5.0,
                "shot_gain": 0.1,
                "shutter": "rolling",
                "readout_s": 0.03,
                "delay_s": 0.12,
                "jitter_frames": 1,
            },
        ),
    ],
    ids=["strong response", "noisy webcam"],
)
def test_weak_devices_are_no_faults(projector, camera):
    found = measured(projector, camera, 1)
    assert found.findings == ()
    assert found.levels.gamma == pytest.approx(projector.get("gamma", 1.0), rel=0.05)


def test_the_delay_is_right_with_a_small_object():
    """Rows of dark background show no picture; they were read as pictures of long ago."""
    y, x = np.mgrid[: ROWS // 2, : COLUMNS // 2]
    disc = np.hypot(x - COLUMNS / 4, y - ROWS / 4) < 18
    b = bench(
        {"width_px": COLUMNS, "height_px": ROWS}, scene=Screen(ROWS, COLUMNS, white=0.7 * disc)
    )
    delay = measure_delay(b.projector, b.camera)
    assert delay.appears_s.min() > 0
    assert delay.left_s.max() < 0.06


def test_a_bent_gamma_ramp_is_named():
    b = bench({"width_px": COLUMNS, "height_px": ROWS}, scene=Screen(ROWS, COLUMNS))
    b.projector.mode = VideoMode((COLUMNS, ROWS), 60.0, 1.0, (2 * COLUMNS, ROWS), straight=False)
    found = set_up(b.projector, b.camera)
    assert [f.kind for f in found.findings] == ["ramp"]
    assert f"{found.mode}" == "192 × 120 px, 60 Hz, scale 1, the screen offers up to 384 × 120 px"


def test_contrast_and_period_follow_the_optics():
    """A camera out of focus does not resolve fine stripes."""
    from scipy import ndimage

    class Soft(Screen):
        def projected(self, light):
            return ndimage.gaussian_filter(super().projected(light), 1.2)

    b = bench({"width_px": COLUMNS, "height_px": ROWS}, scene=Soft(ROWS, COLUMNS))
    found = set_up(b.projector, b.camera)
    assert found.findings == ()
    stripes = found.stripes[0]
    # The camera sees every second pixel, so its blur is 2.4 projector px.
    expected = np.exp(-2 * (np.pi * 2.4 / stripes.period_px) ** 2)
    inside = stripes.period_px >= 12
    np.testing.assert_allclose(
        stripes.contrast[inside], (expected / expected[-1])[inside], atol=0.04
    )
    assert 8 <= stripes.min_period_px <= 16
