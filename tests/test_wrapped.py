"""Phase steps without a plan: wrapped phase, its error, its files and its command."""

import numpy as np
import pytest
import typer

import fringeworks as fw
from fringeworks import InputError, Reason
from fringeworks.cli import commands
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from fringeworks.stack import wrapped_phase
from tests.oracles.phase_shift import fit
from tests.stacks import take

SHAPE = (80, 300)


def scene(shifts, *, noise=2.0, seed=0):
    """Frames of a smooth phase of several turns, and that phase."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * 1.0
    phase = 0.21 * x + 0.002 * (y - 40.0) ** 2
    rng = np.random.default_rng(seed)
    frames = [120.0 + 80.0 * np.cos(phase - d) + noise * rng.standard_normal(SHAPE) for d in shifts]
    return np.clip(np.rint(frames), 0, 255).astype(np.uint8), phase


def wrapped(v):
    return np.angle(np.exp(1j * v))


@pytest.mark.parametrize("steps", [3, 4, 5])
def test_the_phase_and_its_error_are_right(steps):
    frames, phase = scene(equal_steps(steps))
    found = wrapped_phase(frames, equal_steps(steps))
    assert found.failed_fraction == 0.0
    off = wrapped(found.phase_rad - phase) / found.sigma_rad
    assert np.mean(np.abs(off) < 1.0) == pytest.approx(0.683, abs=0.03)
    assert np.nanmedian(found.modulation) == pytest.approx(80.0, abs=1.0)
    assert np.nanmedian(found.background) == pytest.approx(120.0, abs=1.0)
    assert np.abs(found.phase_rad).max() <= np.pi + 1e-5


def test_unequal_shifts_against_the_oracle():
    shifts = np.radians([0.0, 80.0, 190.0, 275.0])
    frames, _ = scene(shifts)
    found = wrapped_phase(frames, shifts, noise=fw.signal.CameraNoise(2.0))
    for y, x in [(3, 5), (40, 120), (77, 250)]:
        expected, modulation, unit = fit(frames[:, y, x].astype(float), shifts, 255.0)
        assert wrapped(found.phase_rad[y, x] - expected) == pytest.approx(0.0, abs=1e-4)
        assert found.modulation[y, x] == pytest.approx(modulation, rel=1e-4)
        assert found.sigma_rad[y, x] == pytest.approx(2.0 * np.sqrt(unit), rel=0.01)


def test_pixels_that_cannot_be_measured_have_a_reason():
    frames, _ = scene(equal_steps(4))
    frames = frames.astype(np.float32)
    frames[:, :10] = 30.0 + np.random.default_rng(1).normal(0.0, 2.0, (4, 10, SHAPE[1]))
    frames[2, 50, 60] = np.nan
    found = wrapped_phase(frames, equal_steps(4), noise=fw.signal.CameraNoise(2.0))
    assert (found.reason[:10] == Reason.SHADOW).mean() > 0.98
    assert found.reason[50, 60] == Reason.MASKED
    assert np.array_equal(np.isnan(found.phase_rad), found.reason != Reason.OK)
    with pytest.raises(InputError, match="got none: .* low_modulation"):
        wrapped_phase(frames, equal_steps(4), min_modulation=90.0)


def test_frames_that_do_not_fit_are_refused():
    frames, _ = scene(equal_steps(4))
    with pytest.raises(InputError, match="missing: of 270°"):
        wrapped_phase(frames[:3], equal_steps(4))
    with pytest.raises(InputError, match="3 to 64, got 2"):
        wrapped_phase(frames[:2], [0.0, 1.0])


def written(folder, frames):
    folder.mkdir()
    for k, frame in enumerate(frames):
        fw.files.write_frame(folder / f"{k}.png", frame)
    return folder


def test_the_command_needs_no_plan(tmp_path, capsys):
    frames, phase = scene(equal_steps(4))
    shots = written(tmp_path / "shots", frames)
    out = tmp_path / "phase.npz"
    options = ["--steps", "0,90,180,270", "--unwrap", "--out", str(out)]
    assert commands.run(["decode", str(shots), *options]) == 0
    assert "median σ" in capsys.readouterr().out
    found = fw.files.read_phase(out)
    assert found.provenance is not None
    assert np.nanmax(np.abs(wrapped(found.phase_rad - phase))) < 0.2
    unwrapped = np.load(out)["unwrapped_rad"]
    off = unwrapped - phase
    assert np.ptp(off) < 0.3
    again = fw.stack.wrapped_phase(shots, equal_steps(4))
    assert np.array_equal(again.phase_rad, found.phase_rad, equal_nan=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--steps", "4", "--relative"], "--steps"),
        (["--steps", "0,x"], "--steps"),
        (["--unwrap"], "--unwrap"),
    ],
)
def test_options_that_contradict_are_refused(tmp_path, capsys, options, words):
    shots = written(tmp_path / "shots", scene(equal_steps(4))[0])
    assert commands.run(["decode", str(shots), *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("command", ["decode", "measure", "calibrate", "response"])
def test_every_command_that_decodes_has_the_options_of_decoding(command):
    group = typer.main.get_command(commands.face.app)
    known = {name for parameter in group.commands[command].params for name in parameter.opts}
    names = {"--camera-name", "--projector-name"}
    options = {"--noise", "--gain", "--saturation", "--min-modulation", *names}
    if command != "response":
        options |= {"--estimate-steps", "--response"}
    assert options <= known


def test_the_lens_is_measured_without_a_plan(real_data):
    folder = real_data / "lens_4step"
    frames = [fw.files.read_frame(folder / f"lens_crop_{a:03d}.jpg")[0] for a in (0, 90, 180, 270)]
    found = wrapped_phase(frames, equal_steps(4), estimate_steps=False)
    c, s = (np.asarray(a, float) - b for a, b in ((frames[0], frames[2]), (frames[1], frames[3])))
    ok = found.reason == Reason.OK
    assert ok[np.hypot(c, s) > 20.0].mean() > 0.99
    assert np.abs(wrapped(found.phase_rad - np.arctan2(s, c)))[ok].max() < 1e-3


def test_the_response_of_a_stack_takes_the_options_of_decoding():
    blocks = (PhaseSteps("x", 32.0, equal_steps(4)), GrayCode("x", 4.0, 960))
    plan = fw.PatternPlan(
        960, 80, (*blocks, fw.patterns.Uniform("white"), fw.patterns.Uniform("black"))
    )
    y, x = np.mgrid[:80, :900] * 1.0
    frames = take(plan, a=120.0, b=100.0, noise=1.0, at=(y, 10.0 + x + 0.1 * y))
    stack = fw.Stack(frames, plan, camera="a", projector="b")
    assert fw.signal.measure_response(stack).gamma == pytest.approx(1.0, abs=0.05)
    # Without the samples above the limit no pixel has a bright phase; with the limits of
    # modulation and noise no pixel is left.
    for options in (
        {"saturation": 150.0},
        {"min_modulation": 150.0},
        {"noise": fw.signal.CameraNoise(60.0)},
    ):
        with pytest.raises(InputError):
            fw.signal.measure_response(stack, **options)


@pytest.mark.parametrize("steps", [3, 4, 5, 7])
def test_shifts_in_degrees_are_refused_and_several_turns_are_not(steps):
    frames, _ = scene(equal_steps(steps))
    with pytest.raises(InputError, match="look like degrees"):
        wrapped_phase(frames, np.round(np.degrees(equal_steps(steps)), 3))
    turns = [5.0 * shift for shift in equal_steps(7)]
    found = wrapped_phase(scene(turns)[0], turns)
    assert found.failed_fraction == 0.0
