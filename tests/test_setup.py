"""The set-up on virtual devices: every fault is named with its cause, and clean devices have none."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks.scan.setup import set_up
from fringeworks.types import DeviceProblem
from tests.virtual_devices import Screen, bench

ROWS, COLUMNS = 120, 192
FAULTS = {
    "limited range": ({"range_limited": True}, {}, "range"),
    "limited range and gamma": ({"range_limited": True, "gamma": 2.2}, {}, "range"),
    "resized by 0.9": ({"scale": 0.9}, {}, "scale"),
    "resized by 1.05": ({"scale": 1.05}, {}, "scale"),
    "colour wheel": ({"duty": 0.6}, {"fps": 31.0, "reference_ms": 15.0}, "flicker"),
    "mirrored": ({"mirrored": True}, {}, "mirrored"),
    "lamp on mains": ({}, {"flicker": 0.4}, "flicker"),
    "exposure ignored": ({}, {"obeys_exposure": False}, "exposure"),
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


def measured(projector, camera, seed, **scene):
    b = bench(
        {"width_px": COLUMNS, "height_px": ROWS} | projector,
        camera,
        scene=Screen(ROWS, COLUMNS, **scene),
        seed=seed,
    )
    return set_up(b.projector, b.camera)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named(name):
    projector, camera, kind = FAULTS[name]
    found = measured(projector, camera, 1, ambient=0.12)
    assert {f.kind for f in found.findings} == {kind}
    text = found.findings[0].text
    assert "likely" in text
    assert text.count(";") >= 2


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_bench_has_no_finding(name):
    projector, camera = CLEAN[name]
    found = measured(projector, camera, 2)
    assert found.findings == ()
    assert found.levels.gamma == pytest.approx(projector.get("gamma", 1.0), rel=0.05)
    top = 2 ** camera.get("bits", 8) - 1
    assert found.noise.read_counts == pytest.approx(camera.get("noise", 1.0) * top / 255, rel=0.15)
    assert found.proposal.plan.frames == 12
    assert found.delay is not None


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_hundred_clean_benches():
    for seed in range(100):
        projector, camera = CLEAN[list(CLEAN)[seed % len(CLEAN)]]
        assert measured(projector, camera, seed).findings == (), seed


def test_what_stops_a_setup_is_explained():
    with pytest.raises(DeviceProblem, match=r"automatic exposure is on"):
        measured({}, {"auto_exposure": True}, 1)
    with pytest.raises(DeviceProblem, match="point the camera at the projected picture"):
        measured({}, {}, 1, white=0.0)


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
