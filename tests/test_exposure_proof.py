"""Light proves whether an exposure obeys: on virtual cameras, never wrong on a clean one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.scan.exposure_proof import exposure_obeys
from fringeworks.types import CameraSettings, DeviceProblem
from tests.virtual_devices import Screen, bench

pytestmark = pytest.mark.statistical


def proof(projector=None, camera=None, *, seed=0, **scene):
    b = bench(projector, camera, scene=Screen(**({"rows": 32, "columns": 48} | scene)), seed=seed)
    return exposure_obeys(b.projector, b.camera)


SIZE = {"width_px": 48, "height_px": 32}
FAULTS = {
    "ignored": {"obeys_exposure": False},
    "automatic": {"auto_exposure": True},
}


def random_bench(rng):
    """Models of a projector and a camera without a fault of exposure."""
    projector = SIZE | {
        "refresh_hz": float(rng.choice([50, 60, 120])),
        "delay_s": float(rng.uniform(0, 0.1)),
        "jitter_refreshes": int(rng.integers(0, 3)),
        "gamma": float(rng.uniform(0.8, 2.4)),
        "black": float(rng.uniform(0, 0.05)),
        # Liquid crystals settle; micromirrors send light in a part of the period.
        **[{}, {"settling_s": 0.005}, {"settling_s": 0.02}, {"duty": 0.7}][rng.integers(4)],
    }
    camera = {
        "fps": float(rng.choice([10, 15, 30, 60])),
        "shutter": str(rng.choice(["global", "rolling"])),
        "delay_s": float(rng.uniform(0, 0.2)),
        "jitter_frames": int(rng.integers(0, 3)),
        "reference_ms": float(rng.choice([8.0, 16.667, 33.3])),
        "noise": float(rng.uniform(0.3, 4)),
        "shot_gain": float(rng.uniform(0, 0.1)),
        "bits": int(rng.choice([8, 12])),
        "flicker": float(rng.choice([0, 0.3])),
        "flicker_hz": float(rng.choice([100, 120])),
        "loss": float(rng.choice([0, 0.05])),
        "torn": float(rng.choice([0, 0.05])),
    }
    scene = {"white": float(rng.uniform(0.1, 1.5)), "ambient": float(rng.uniform(0, 0.15))}
    return projector, camera, scene


@pytest.mark.parametrize(
    "decade", [k if k < 2 else pytest.param(k, marks=pytest.mark.long) for k in range(10)]
)
def test_never_wrong_on_a_clean_camera(decade):
    wrong = []
    for seed in range(10 * decade, 10 * decade + 10):
        projector, camera, scene = random_bench(np.random.default_rng(seed))
        found = proof(projector, camera, seed=seed, **scene)
        if not found.obeyed or abs(found.ratio - 2) > 0.1:
            wrong.append((seed, str(found), projector, camera, scene))
    assert not wrong


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("decade", range(2))
def test_faults_are_named(fault, decade):
    named = []
    for seed in range(10 * decade, 10 * decade + 10):
        projector, camera, scene = random_bench(np.random.default_rng(seed))
        # A camera that ignores its exposure must see white below full scale at its own.
        scene["white"] = min(scene["white"], 0.8)
        named.append((proof(projector, camera | FAULTS[fault], seed=seed, **scene).verdict, seed))
    assert {verdict for verdict, _ in named} == {fault}, named


class Changed:
    """A camera with something changed about it."""

    def __init__(self, camera, **changes):
        self._camera = camera
        vars(self).update(changes)

    def __getattr__(self, name):
        return getattr(self._camera, name)


def small(camera=None, **scene):
    return bench(SIZE, camera, scene=Screen(**({"rows": 32, "columns": 48} | scene)))


def test_figures_and_the_exposure_afterwards():
    b = small()
    b.camera.configure(CameraSettings(exposure_ms=70.0))
    found = exposure_obeys(b.projector, b.camera)
    assert found.obeyed
    assert found.asked_ms == found.read_back_ms
    # Whole refresh periods; 70 ms saturates.
    assert found.asked_ms[0] * 60e-3 == pytest.approx(1.0)
    assert found.ratio == pytest.approx(2.0, abs=0.02)
    assert found.drift == 0
    assert found.used_share == 1
    assert str(found).startswith("the exposure obeys (16.7 and 33.3 ms: expected a ratio of 2.00")
    assert b.camera.configure(CameraSettings()).exposure_ms == 70.0


def test_a_bright_projector_is_dimmed_at_one_refresh_period():
    found = exposure_obeys(*(lambda b: (b.projector, b.camera))(small(white=1.4)))
    assert found.obeyed
    assert found.asked_ms[0] * 60e-3 == pytest.approx(1.0)


def test_a_grey_is_chosen_before_six_series_are_filmed():
    b = small({"fps": 60.0}, white=0.8)
    start_s = b.clock.now_s()
    assert exposure_obeys(b.projector, b.camera).obeyed
    # Six series of 1.8 s, and one that shows that white is beyond full scale at two periods.
    assert b.clock.now_s() - start_s < 14.0


def test_a_curved_response_has_another_ratio():
    b = small(white=0.4)

    def grab(timeout_s=5.0):
        taken = b.camera.grab(timeout_s)
        curved = np.rint(255 * (taken.pixels / 255.0) ** (1 / 2.2)).astype(np.uint8)
        return replace(taken, pixels=curved)

    found = exposure_obeys(b.projector, Changed(b.camera, grab=grab))
    assert found.verdict == "another ratio"
    assert found.ratio < 1.6
    assert "its response is curved" in str(found)


def test_a_camera_that_tells_nothing_and_one_that_rounds():
    b = small()

    def silent(settings):
        b.camera.configure(settings)
        return CameraSettings()

    found = exposure_obeys(b.projector, Changed(b.camera, configure=silent))
    assert found.obeyed
    assert found.read_back_ms == (None, None)

    def rounds(settings):
        if settings.exposure_ms is None:
            return b.camera.configure(settings)
        return b.camera.configure(
            replace(settings, exposure_ms=2.5 * settings.exposure_ms // 10 * 10)
        )

    b = small(white=0.2)
    found = exposure_obeys(b.projector, Changed(b.camera, configure=rounds))
    assert found.obeyed
    assert found.expected_ratio == pytest.approx(found.read_back_ms[1] / found.read_back_ms[0])

    def keeps(settings):
        b.camera.configure(replace(settings, exposure_ms=None))
        return CameraSettings(16.667, 0.0, None, "Mono8", False)

    found = exposure_obeys(b.projector, Changed(b.camera, configure=keeps))
    assert found.verdict == "ignored"
    assert found.read_back_ms == (16.667, 16.667)
    assert "set it with the camera's own program" in str(found)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({"white": 0.0}, "expected white to be 4 counts brighter than black, got"),
        ({"ambient": 3.0}, "100 % of the lit pixels saturated: close the aperture"),
    ],
)
def test_scenes_that_prove_nothing(scene, said):
    b = small(**scene)
    with pytest.raises(DeviceProblem, match=said):
        exposure_obeys(b.projector, b.camera)
    assert b.camera.configure(CameraSettings()).exposure_ms == 16.667


def test_exposures_out_of_the_limits():
    b = small()
    short = replace(b.camera.limits(), exposure_ms=(0.01, 5.0))
    with pytest.raises(DeviceProblem, match="got limits of 0.01 to 5 ms"):
        exposure_obeys(b.projector, Changed(b.camera, limits=lambda: short))


def test_frames_that_never_complete():
    b = small({"torn": 0.999})
    with pytest.raises(DeviceProblem, match="expected complete frames, got 21 incomplete ones"):
        exposure_obeys(b.projector, b.camera)
