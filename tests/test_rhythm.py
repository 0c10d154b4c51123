"""The light in time: pulses, wheels and black frames are seen, and safe exposures are found."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import PatternPlan
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.frames import take_frames
from fringeworks.scan.rhythm import Ripple, is_whole, measure_ripple, safe_period
from fringeworks.scan.setup import SetupStopped, set_up
from fringeworks.types import CameraSettings, DeviceProblem
from tests.light_devices import COLUMNS, PHASES, ROWS, bit_planes, devices, dithered, strobed

pytestmark = pytest.mark.statistical

WHEEL = ((0.3, 0.5), (0.3, 1.0), (0.25, 0.35), (0.15, 1.6))
PLAN = PatternPlan(COLUMNS, ROWS, (PhaseSteps("x", 192.0, equal_steps(4)),))
STEADY = {
    "LED": ({}, {}),
    "LED, short": ({}, {"exposure_ms": 3.1, "white": 3.0}),
    "liquid crystal": ({"crystal_s": 0.006, "raster": True, "overdrive": 0.3}, {}),
    "wheel of 120 Hz": (
        {"table": bit_planes(WHEEL, 2, 0.06)},
        {"exposure_ms": 8.333, "white": 1.4},
    ),
    "bit planes, whole": ({"table": bit_planes()}, {"fps": 53.0}),
    "rolling": ({"table": strobed()}, {"line_s": 1.5e-4, "fps": 40.0}),
    "drift": ({"warm_up": 0.3}, {"gain_drift": 0.02, "fps": 30.0}),
    "lamp on mains": ({}, {"mains": 0.4, "ambient": 0.1, "fps": 31.0}),
}
PULSED = {
    "bit planes": ({"table": bit_planes()}, {"exposure_ms": 2.0, "white": 5.0}, None),
    "bit planes of 10 ms": (
        {"table": bit_planes()},
        {"exposure_ms": 10.0, "white": 1.1, "fps": 57.0},
        1e3 / 60,
    ),
    "black frames": ({"table": strobed()}, {"exposure_ms": 4.0, "white": 0.9}, 1e3 / 60),
    "black frames, rolling": (
        {"table": strobed()},
        {"exposure_ms": 4.0, "white": 0.9, "line_s": 5e-5},
        1e3 / 60,
    ),
    "backlight of 240 Hz": (
        {"table": strobed(0.5, 0.1, 4)},
        {"exposure_ms": 3.0, "white": 0.9, "fps": 58.0},
        1e3 / 240,
    ),
    "wheel of 240 Hz": (
        {"table": bit_planes(WHEEL, 4, 0.06)},
        {"exposure_ms": 5.0, "white": 0.9},
        1e3 / 240,
    ),
}


@pytest.mark.parametrize("name", STEADY)
def test_steady_light_is_steady(name):
    for seed in range(3):
        ripple = measure_ripple(*devices(*STEADY[name], seed=seed), seed=seed)
        assert ripple.steady, (seed, ripple)
        assert np.isfinite(ripple.depth)


@pytest.mark.parametrize("name", PULSED)
def test_pulses_are_seen_and_safe_exposures_found(name):
    projector, camera, period_ms = PULSED[name]
    shows, films = devices(projector, camera, seed=2)
    before = films.settings
    ripple = measure_ripple(shows, films)
    assert not ripple.steady
    assert ripple.depth > 0.02
    found, tried = safe_period(shows, films, ripple)
    # Pulses of 2 ms are so bright that whole periods are at the camera's limit.
    assert found == (None if period_ms is None else pytest.approx(period_ms, rel=1e-3))
    assert films.settings == before
    assert tried[0] == ripple


@pytest.mark.parametrize("name", PULSED)
@pytest.mark.parametrize("take", ["scan", "delay"])
def test_a_scan_that_sees_parts_of_pulses_is_refused_with_the_cause(name, take):
    projector, camera, _ = PULSED[name]
    shows, films = devices(projector, camera, seed=3)
    with pytest.raises(DeviceProblem, match=r"in pulses.*whole refresh periods \(16\.67 ms"):
        if take == "scan":
            next(take_frames(shows, films, PLAN))
        else:
            measure_delay(shows, films)


def test_nothing_is_said_of_light_that_cannot_be_judged():
    for white in (0.0, 400.0):
        shows, films = devices({}, {"white": white, "exposure_ms": 5.0})
        ripple = measure_ripple(shows, films)
        assert np.isnan(ripple.depth)
        assert not ripple.steady


def test_dithering_over_four_refreshes_needs_as_many():
    shows, films = devices({"table": dithered()}, {"noise": 0.3, "white": 0.2}, seed=4)
    ripple = measure_ripple(shows, films)
    assert ripple.depth < 0.02
    if not ripple.steady:
        assert safe_period(shows, films, ripple)[0] in (
            pytest.approx(1e3 / 30),
            pytest.approx(1e3 / 15),
        )


def test_the_present_exposure_is_not_measured_again():
    shows, films = devices({}, {"exposure_ms": 16.667, "white": 0.4})
    present = Ripple(16.667, depth=0.05, grey=1.0, white=0.05, significance=50.0)
    period_ms, tried = safe_period(shows, films, present)
    assert period_ms == pytest.approx(1e3 / 30)
    assert [r.exposure_ms for r in tried] == pytest.approx([16.667, 1e3 / 30])


def test_whole_periods():
    assert is_whole(16.667, 1e3 / 60)
    assert is_whole(50.0, 1e3 / 60)
    assert not is_whole(15.0, 1e3 / 60)
    assert not is_whole(0.05, 1e3 / 60)


@pytest.mark.parametrize("name", ["bit planes", "black frames", "wheel of 240 Hz"])
def test_a_set_up_names_pulses_and_no_other_cause(name):
    projector, camera, period_ms = PULSED[name]
    shows, films = devices(projector, camera, seed=5)
    given = CameraSettings(exposure_ms=films.exposure_ms)
    start_s = shows.clock.now_s()
    stopped = None
    try:
        found = set_up(shows, films, settings=given).findings
    except SetupStopped as error:
        stopped, found = str(error), error.findings
    assert stopped is None or stopped.startswith("flicker: the light under")
    assert shows.clock.now_s() - start_s < 90.0
    assert found[0].kind == "flicker"
    assert not {f.kind for f in found} & {"scale", "range"}
    if period_ms is not None:
        assert f"{period_ms:.4g} ms or multiples" in found[0].advice


def test_a_set_up_chooses_a_safe_exposure():
    """A projector that shows each picture bright and dark in turn, for glasses with shutters."""
    light = (np.arange(256) / 255.0)[:, None] * np.repeat([1.02, 0.98], PHASES // 2)[None]
    shows, films = devices({"table": (light, 2)}, {"white": 0.42, "ambient": 0.01}, seed=6)
    found = set_up(shows, films)
    assert is_whole(found.settings.exposure_ms, 1e3 / 30)
    assert [(f.kind, f.severity) for f in found.findings] == [("flicker", "note")]
    assert "was chosen" in found.findings[0].seen
    assert found.delay is not None
