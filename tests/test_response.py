"""The response: exponent, phase tables and their files."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, Stack, analyse, encode, reconstruct
from fringeworks.cli.commands import run
from fringeworks.files import read_plan, write_plan
from fringeworks.files.images import read_frame
from fringeworks.files.response import read_response, write_response
from fringeworks.files.stack import write_stack
from fringeworks.pair import prepare
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from fringeworks.pipeline.stacks import measure_response as response_of
from fringeworks.signal.gamma import gamma_of_frames, harmonic_distortion
from fringeworks.signal.phase_table import phase_table
from fringeworks.signal.response import (
    apply_response,
    correct_phase,
    linearise,
    measure_response,
    phase_of_steps,
)
from fringeworks.signal.smooth_coordinate import smooth_coordinate
from tests.conftest import scene

pytestmark = pytest.mark.statistical

PERIOD = 60.0


def white_plane(gamma, steps=3, noise=0.5, seed=0, exponent=1.0):
    """N frames of a white plane with falling albedo, and the phase that was projected."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:200, :300]
    ideal = 2 * np.pi * (x + 0.1 * y) / PERIOD
    albedo = 1.0 - 0.2 * x / 300
    shifts = 2 * np.pi * np.arange(steps) / steps
    light = (0.5 + 0.5 * np.cos(ideal - shifts[:, None, None])) ** (exponent * gamma)
    return 12 + 200 * albedo * light + noise * rng.standard_normal(light.shape), ideal


def measured(gamma=2.2, **options):
    frames, ideal = white_plane(gamma, **options)
    return measure_response(
        frames,
        ideal,
        camera="left",
        projector="bench",
        pattern_exponent=options.get("exponent", 1.0),
    )


@pytest.mark.parametrize("gamma", [0.7, 1.6, 2.2])
@pytest.mark.parametrize("steps", [3, 4])
def test_exponent_is_found(gamma, steps):
    assert measured(gamma, steps=steps).gamma == pytest.approx(gamma, rel=0.02)


def test_exponent_behind_a_predistorted_pattern():
    assert measured(2.0, exponent=1 / 0.75).gamma == pytest.approx(2.0, rel=0.02)


def test_table_corrects_another_capture():
    response = measured(2.2)
    frames, ideal = white_plane(2.2, seed=5)
    phase, _ = phase_of_steps(frames)
    raw = np.angle(np.exp(1j * (phase - ideal)))
    residual = np.angle(np.exp(1j * (correct_phase(phase, response) - ideal)))
    assert raw.std() > 0.15
    assert residual.std() < 0.012
    assert response.residual_rad < 0.012


def test_steps_that_start_elsewhere_give_the_same_response():
    """The plan's first shift is an origin; it changes neither γ nor the table."""
    frames, ideal = white_plane(2.2)
    names = {"camera": "left", "projector": "bench"}
    known = measure_response(frames, ideal, **names)
    for start in (0.3, np.pi / 2, np.pi):
        found = measure_response(frames, ideal + start, **names)
        assert found.gamma == pytest.approx(known.gamma, abs=1e-3)
        assert found.residual_rad == pytest.approx(known.residual_rad, abs=1e-6)
        np.testing.assert_allclose(found.table_rad, known.table_rad, atol=1e-6)


@pytest.mark.parametrize("steps", [3, 4])
def test_phases_that_do_not_follow_the_projected_ones_are_refused(steps):
    frames, ideal = white_plane(2.2, steps=steps)
    names = {"camera": "left", "projector": "bench"}
    expected = r"by at most 0\.36 rad rms after the correction, got \d\.\d\d rad; "
    with pytest.raises(InputError, match=f"{expected}the steps run the other way"):
        measure_response(frames, -ideal, **names)
    unrelated = np.random.default_rng(0).uniform(-np.pi, np.pi, ideal.shape)
    for wrong in (2.0 * ideal, 0.5 * ideal, 1.1 * ideal, unrelated):
        with pytest.raises(InputError, match=f"{expected}likely the period, the order"):
            measure_response(frames, wrong, **names)


@pytest.mark.parametrize(("gamma", "end"), [(5.0, 4.0), (0.3, 0.4)])
@pytest.mark.parametrize("exponent", [1.0, 0.8])
def test_an_exponent_at_the_end_of_the_range_is_refused(gamma, end, exponent):
    with pytest.raises(InputError, match=f"at the end of this range, {end}; likely the camera's"):
        measured(gamma / exponent, exponent=exponent)


def test_a_refused_response_is_not_written(tmp_path, capsys):
    plan = PatternPlan(
        256, 8, (GrayCode("x", 4.0, 256, inverse=True), PhaseSteps("x", 64.0, equal_steps(4)))
    )
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:160, :240]
    at = 0.9 * column + 0.13 * row
    shots = [np.interp(at, np.arange(256), frame[0].astype(float)) for frame in encode(plan)]
    shots = [np.rint(20 + 0.6 * f + rng.normal(0, 0.7, f.shape)).astype(np.uint8) for f in shots]
    shots[-4:] = shots[:-5:-1]  # the steps run backwards
    write_stack(tmp_path / "plane", shots, plan)
    words = ["response", str(tmp_path / "plane"), "--camera-name", "left"]
    words += ["--projector-name", "bench", "--out", str(tmp_path / "response.toml")]
    assert run(words) == 2
    assert "the steps run the other way" in capsys.readouterr().err
    assert not (tmp_path / "response.toml").exists()


def test_a_gray_code_that_only_fringes_could_be_compared_with_is_refused_with_what_to_add():
    plan = PatternPlan(256, 8, (GrayCode("x", 4.0, 256), PhaseSteps("x", 64.0, equal_steps(4))))
    stack = Stack(list(encode(plan)), plan)
    with pytest.raises(InputError, match="expected inverse bits of the Gray code along x, or a w"):
        response_of(stack, camera="left", projector="bench")


def test_predistorted_pictures_make_light_that_is_a_cosine(tmp_path):
    plan = PatternPlan(
        400, 8, tuple(PhaseSteps("x", p, equal_steps(3)) for p in (400.0, 40.0)), bits=16
    )
    write_plan(tmp_path / "plan.toml", plan)
    write_response(tmp_path / "response.toml", measured(2.2))
    words = ["patterns", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "shots")]
    assert run([*words, "--response", str(tmp_path / "response.toml")]) == 0
    assert read_plan(tmp_path / "shots/plan.toml").gamma == pytest.approx(2.2, rel=1e-3)
    for picture in sorted((tmp_path / "shots").glob("*.png"))[3:]:
        level = read_frame(picture)[0] / 65535.0
        assert harmonic_distortion(level**2.2, 40.0) < 1e-4
        assert harmonic_distortion(level, 40.0) > 0.05


def test_linearisation_makes_a_cosine():
    response = measured(2.2)
    values = np.tile(0.5 + 0.5 * np.cos(2 * np.pi * np.arange(400) / 40), (8, 1))
    seen = 10 + 150 * values**2.2
    assert harmonic_distortion(seen, 40.0) > 0.05
    assert harmonic_distortion(linearise(seen, response), 40.0) < 1e-3


def test_applied_to_a_capture():
    response = measured(2.2)
    options = {"size": 240, "fringes": 6, "height_mm": 30.0}
    bent = dataclasses.replace(
        scene("parabola", gamma=2.2, **options), camera="left", projector="bench"
    )
    straight = apply_response(bent, response)
    assert harmonic_distortion(straight.reference, 40.0) < 1e-3
    assert any("γ = 2.2" in note for note in straight.notes)
    assert np.isfinite(analyse(straight, "fourier").displacement_px).mean() > 0.99
    for changes, words in (
        ({"camera": "right"}, "made for camera 'left', the capture is of 'right'"),
        ({"projector": "other"}, "made for projector 'bench'"),
        ({"camera": None}, "does not name its camera"),
    ):
        with pytest.raises(InputError, match=words):
            apply_response(dataclasses.replace(bent, **changes), response)


def test_saturated_pixels_stay_saturated_when_frames_are_linearised():
    bent = scene("parabola", size=128, fringes=8, bits=8, gamma=1.8, noise=1, seed=2)
    glare = bent.object.copy()
    glare[40:60, 30:70] = 255
    names = {"camera": "left", "projector": "bench"}
    pair = dataclasses.replace(bent, object=glare, **names)
    response = measured(1.8)
    found = reconstruct(pair, "fourier", response=response)
    block = found.surface.reason[42:58, 32:68]
    same = reconstruct(dataclasses.replace(bent, object=glare), "fourier").surface.reason
    assert (block == same[42:58, 32:68]).all()
    prepared = prepare(pair, response=response)
    assert prepared.saturated[42:58, 32:68].all()
    assert not prepared.object_ok[42:58, 32:68].any()
    assert np.isnan(apply_response(pair, response).object[42:58, 32:68]).all()
    assert any("γ = 1.8" in note for note in found.notes)


def test_file_keeps_everything(tmp_path):
    response = measured(1.8)
    path = write_response(tmp_path / "response.toml", response)
    again = read_response(path)
    np.testing.assert_allclose(again.table_rad, response.table_rad, atol=1e-7)
    assert again.brightness == pytest.approx(response.brightness, abs=1e-3)
    kept = {"table_rad": response.table_rad, "brightness": response.brightness}
    assert dataclasses.replace(again, **kept) == response
    text = path.read_text()
    for change, words in (
        (text.replace("gamma", "gamut"), "unknown key gamut|missing key gamma"),
        (text.replace('kind = "response"', 'kind = "rig"'), "kind"),
        (text.replace("steps = 3", "steps = 2"), "steps"),
        (text.replace("gamma = ", "gamma = nan #"), "gamma"),
        ("gamma = [", "expected TOML"),
    ):
        path.write_text(change)
        with pytest.raises(InputError, match=words):
            read_response(path)
    with pytest.raises(InputError, match="no such file"):
        read_response(tmp_path / "nowhere.toml")


def test_steps_of_any_kind():
    y, x = np.mgrid[:40, :60]
    ideal = 0.2 * x + 0.1 * y
    shifts = [0.0, 1.0, 2.5, 4.4]
    frames = np.stack([50 + 30 * np.cos(ideal - s) for s in shifts])
    phase, modulation = phase_of_steps(frames, shifts)
    np.testing.assert_allclose(np.exp(1j * phase), np.exp(1j * ideal), atol=1e-9)
    np.testing.assert_allclose(modulation, 30.0)


def test_coordinate_loses_its_steps_and_outliers():
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:150, :200]
    truth = 300 + 1.7 * x + 0.05 * y + 1e-3 * (x - 90.0) ** 2
    coded = 2 * np.floor(truth / 2) + 1.0
    coded[rng.random(coded.shape) < 0.01] = 900.0
    found = smooth_coordinate(coded, np.ones(coded.shape, bool))
    inner = (slice(15, -15), slice(15, -15))
    assert np.nanmax(np.abs(found - truth)[inner]) < 0.15
    assert np.isnan(found[coded == 900.0]).all()


def test_bad_input():
    frames, ideal = white_plane(2.0)
    names = {"camera": "a", "projector": "b"}
    with pytest.raises(InputError, match="n ≥ 3"):
        measure_response(frames[:2], ideal, **names)
    with pytest.raises(InputError, match="shifts: expected 3"):
        measure_response(frames, ideal, shifts_rad=[0.0, 1.0], **names)
    with pytest.raises(InputError, match="that differ"):
        phase_of_steps(frames, [1.0, 1.0, 1.0])
    with pytest.raises(InputError, match="ideal phase: expected shape"):
        measure_response(frames, ideal[1:], **names)
    with pytest.raises(InputError, match="camera: expected a name"):
        measure_response(frames, ideal, camera=" ", projector="b")
    with pytest.raises(InputError, match="pattern_exponent"):
        measure_response(frames, ideal, pattern_exponent=0.0, **names)
    with pytest.raises(InputError, match="whole fringe"):
        phase_table(np.zeros((50, 50)), np.zeros((50, 50)))
    with pytest.raises(InputError, match="1000 valid pixels"):
        smooth_coordinate(ideal, np.zeros(ideal.shape, bool))
    with pytest.raises(InputError, match="finite values"):
        linearise(np.full((3, 3), np.nan), measured())
    with pytest.raises(InputError, match="known pixels"):
        gamma_of_frames(frames, np.full(ideal.shape, np.nan))
