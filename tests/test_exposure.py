"""Auto exposure and series of exposures on virtual devices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.brightness import measure_brightness
from fringeworks.scan.exposure import auto_exposure, exposure_series
from fringeworks.types import CameraSettings, DeviceProblem
from tests.virtual_devices import Screen, bench

pytestmark = pytest.mark.statistical

PERIOD_MS = 1e3 / 60


class Textured(Screen):
    """A screen of which every pixel has its own brightness."""

    def __init__(self, white, ambient=0.0):
        super().__init__(ambient=ambient)
        self.white = np.resize(white, self.shape)


def white_of(b):
    """Shares of full scale under white, at the present settings."""
    _, white = Agreement(b.projector, b.camera).start()
    return white.pixels / 255.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("white", [0.004, 0.02, 0.13, 0.4, 0.85])
def test_white_just_fits(seed, white):
    b = bench({"delay_s": 0.02}, scene=Screen(white=white, ambient=0.02), seed=seed)
    settings = auto_exposure(b.projector, b.camera)
    assert settings == b.camera.configure(CameraSettings())
    periods = settings.exposure_ms / PERIOD_MS
    assert periods == pytest.approx(round(periods), abs=2e-3)
    seen = white_of(b)
    if white >= 0.02:
        assert np.quantile(seen, 0.99) == pytest.approx(0.9, abs=0.05)
    assert np.mean(seen >= 1.0) <= 0.02
    # Time comes before gain.
    assert settings.gain_db < 1 or settings.exposure_ms * 2 > 0.87 * min(0.9 / white, 15) * 16
    assert settings.exposure_ms <= 251


def test_highlights_do_not_decide():
    white = np.full((48, 64), 0.1)
    white[0, :20] = 3.0
    b = bench(scene=Textured(white), seed=4)
    auto_exposure(b.projector, b.camera)
    assert np.median(white_of(b)) > 0.75
    auto_exposure(b.projector, b.camera, saturated=0.5, longest_ms=60)


def test_cameras_that_round_or_have_no_gain(monkeypatch):
    b = bench(scene=Screen(white=0.05, ambient=0.0))
    real, limits = b.camera.configure, b.camera.limits

    def rounding(settings):
        exposure = settings.exposure_ms
        if exposure is not None:
            settings = replace(settings, exposure_ms=round(exposure, 1))
        assert settings.gain_db is None
        return replace(real(settings), gain_db=None)

    monkeypatch.setattr(b.camera, "configure", rounding)
    monkeypatch.setattr(b.camera, "limits", lambda: replace(limits(), gain_db=None))
    settings = auto_exposure(b.projector, b.camera)
    assert settings.gain_db is None
    assert settings.exposure_ms == pytest.approx(250, abs=0.1)
    monkeypatch.setattr(
        b.camera, "configure", lambda s: real(replace(s, exposure_ms=10.0, gain_db=0.0))
    )
    with pytest.raises(DeviceProblem, match=r"an exposure of 16.667 ms, got 10.000 ms"):
        auto_exposure(b.projector, b.camera)


def test_a_camera_that_tells_nothing(monkeypatch):
    b = bench(scene=Screen(white=0.05, ambient=0.0))
    real = b.camera.configure

    def silent(settings):
        real(settings)
        return CameraSettings(triggered=False)

    monkeypatch.setattr(b.camera, "configure", silent)
    auto_exposure(b.projector, b.camera)
    assert np.quantile(white_of(b), 0.99) == pytest.approx(0.9, abs=0.05)


@pytest.mark.parametrize(
    ("scene", "camera", "said"),
    [
        (Screen(white=1e-4, ambient=0.0), {}, "white to be brighter than black"),
        (Screen(white=3e-4, ambient=0.0), {}, "too dark; open the aperture|to be brighter"),
        (Screen(white=8.0, ambient=0.0), {}, "too bright; close the aperture"),
        (Screen(white=8.0, ambient=2.0), {}, "got all pixels: too bright"),
        (Screen(white=0.05), {"obeys_exposure": False}, "does not obey"),
        (Screen(white=0.05), {"auto_exposure": True}, "does not obey|steady"),
    ],
)
def test_what_cannot_be_exposed_is_said(scene, camera, said):
    b = bench(camera=camera, scene=scene, seed=2)
    with pytest.raises(DeviceProblem, match=said):
        auto_exposure(b.projector, b.camera)


def test_light_that_flickers_is_said_after_two_trials_of_one_exposure(monkeypatch):
    b = bench(scene=Screen(white=0.5))
    tried = []

    def measured(projector, camera, settings):
        tried.append(settings.exposure_ms)
        if settings.exposure_ms < 30.0:
            raise DeviceProblem("expected white to be brighter than black and steady")
        return measure_brightness(projector, camera, settings)

    monkeypatch.setattr("fringeworks.scan.exposure.measure_brightness", measured)
    with pytest.raises(DeviceProblem, match="brighter than black and steady"):
        auto_exposure(b.projector, b.camera)
    assert tried == pytest.approx([PERIOD_MS, 4 * PERIOD_MS, PERIOD_MS])


def test_shorter_exposures_only_when_told():
    b = bench(scene=Screen(white=8.0, ambient=0.0))
    settings = auto_exposure(b.projector, b.camera, whole_periods=False)
    assert settings.exposure_ms == pytest.approx(0.9 / 8 * 16.667, rel=0.06)
    with pytest.raises(InputError, match="at least 16.7 ms"):
        auto_exposure(b.projector, b.camera, longest_ms=10.0)
    with pytest.raises(InputError, match="saturated"):
        auto_exposure(b.projector, b.camera, saturated=1.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_series_exposes_every_pixel(seed):
    rng = np.random.default_rng(seed)
    white = 10.0 ** rng.uniform(np.log10(0.006), np.log10(0.8), (48, 64))
    b = bench(scene=Textured(white), seed=seed)
    series = exposure_series(b.projector, b.camera, 3)
    assert len(series) == 3
    amounts = [s.exposure_ms * 10 ** (s.gain_db / 20) / 16.667 for s in series]
    assert amounts == sorted(amounts)
    best = np.max([np.where(white * a < 0.97, white * a, 0) for a in amounts], axis=0)
    step = (0.8 / 0.006) ** (1 / 3)
    assert np.quantile(best, 0.02) > 0.6 * 0.9 / step
    for settings in series:
        assert settings.exposure_ms / PERIOD_MS == pytest.approx(
            round(settings.exposure_ms / PERIOD_MS), abs=2e-3
        )


def test_an_even_scene_needs_one_exposure():
    b = bench(scene=Screen(white=0.85, ambient=0.0))
    assert len(exposure_series(b.projector, b.camera, 3)) == 1
    with pytest.raises(InputError, match="count"):
        exposure_series(b.projector, b.camera, 0)
    assert len(exposure_series(b.projector, b.camera, 1)) == 1


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Screen(white=8.0, ambient=0.0), "too bright"),
        (Screen(white=1e-4, ambient=0.0), "too dark; open the aperture"),
    ],
)
def test_a_series_says_what_is_wrong(scene, said):
    b = bench(scene=scene)
    assert isinstance(b.camera, VirtualCamera)
    with pytest.raises(DeviceProblem, match=said):
        exposure_series(b.projector, b.camera, 3)


class Rounding:
    """A camera whose gain has steps of 1 dB."""

    def __init__(self, camera, rounded):
        self._camera, self._rounded = camera, rounded

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def configure(self, settings):
        if settings.gain_db is not None:
            settings = replace(settings, gain_db=float(self._rounded(settings.gain_db)))
        return self._camera.configure(settings)


@pytest.mark.parametrize("rounded", [np.floor, np.rint, np.ceil])
@pytest.mark.parametrize("white", [0.35, 0.5, 0.55, 0.6, 0.65, 0.7, 0.8])
def test_gains_in_whole_decibels_settle(rounded, white):
    b = bench(scene=Screen(white=white, ambient=0.02), seed=1)
    settings = auto_exposure(b.projector, Rounding(b.camera, rounded))
    assert settings == b.camera.configure(CameraSettings())
    assert settings.gain_db == round(settings.gain_db)
    # A step of 1 dB is 12 % of the brightness.
    assert 0.75 <= np.quantile(white_of(b), 0.99) < 1.0
