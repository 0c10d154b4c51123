"""Scenes of high contrast: several exposures, captured, decoded each by itself, and fused."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from fringeworks import FileProblem, FramesContradictPlan, InputError, PatternPlan, Stack, decode
from fringeworks.devices.bench import virtual_bench
from fringeworks.devices.clock import SimulatedClock
from fringeworks.files import read_stack
from fringeworks.files.capture import read_capture
from fringeworks.files.exposures import is_exposures, read_exposures, series_to_resume
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.patterns.encode import encode
from fringeworks.pipeline.stacks import decode_stack, measure
from fringeworks.scan.capture import capture
from fringeworks.scan.exposure import auto_exposure, exposure_series
from fringeworks.scan.hdr import capture_hdr
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import truth_distance
from fringeworks.types import CameraSettings, DeviceProblem, Reason
from tests.grids import quick, thinned
from tests.hdr_scene import RIG, glossy_view, hdr_bench, hdr_plan
from tests.virtual_devices import Interrupting, Screen, bench, plan

pytestmark = pytest.mark.statistical

TWO = (CameraSettings(exposure_ms=1e3 / 60), CameraSettings(exposure_ms=2e3 / 60))


def valid_and_covered(decoded, view):
    """Share of the lit pixels that are measured, and of these within one σ of the truth."""
    ok = (decoded.x.reason == Reason.OK) & view.lit
    error = np.abs(decoded.x.coordinate_px - view.projector_px[..., 0])
    return ok.sum() / view.lit.sum(), np.mean((error <= decoded.x.sigma_px)[ok])


def hdr_scan(folder, seed):
    """The view, the decoded single exposure of ``auto_exposure``, and a scan of three."""
    view = glossy_view(seed)
    b = hdr_bench(view, seed=seed)
    settings = auto_exposure(b.projector, b.camera)
    one = capture(b.projector, b.camera, hdr_plan(), folder / "one", settings=settings)
    series = exposure_series(b.projector, b.camera, 3)
    three = capture_hdr(b.projector, b.camera, hdr_plan(), folder / "three", series)
    return view, decode_stack(one), three


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_three_exposures_hold_what_one_cannot(tmp_path, seed):
    """Albedo of 0.02 to 1 and a highlight that is four times as bright as white paint."""
    view, one, folder = hdr_scan(tmp_path, seed)
    assert valid_and_covered(one, view)[0] < 0.7
    measured = measure(folder, RIG)
    valid, within = valid_and_covered(measured.decoded, view)
    assert valid >= 0.97
    assert within == pytest.approx(0.683, abs=0.035)
    distance = truth_distance(view.points_mm, measured.points.xyz_mm)
    assert np.nanmedian(np.abs(distance)) < 0.1


@pytest.mark.long
def test_coverage_over_many_scenes(tmp_path):
    found = []
    for seed in range(10, 22):
        view, _, folder = hdr_scan(tmp_path / str(seed), seed)
        found.append(valid_and_covered(decode_stack(folder), view))
    valid, within = np.mean(found, axis=0)
    assert valid >= 0.97
    assert within == pytest.approx(0.683, abs=0.02)


@pytest.mark.parametrize("after", [30, 80])
def test_an_interrupted_scan_is_resumed(tmp_path, after):
    b = bench({}, {"delay_s": 0.02}, scene=Screen(white=0.3), seed=3)
    folder = tmp_path / "c"
    camera = Interrupting(b.camera, after, DeviceProblem("camera: gone"))
    with pytest.raises(DeviceProblem, match="gone"):
        capture_hdr(b.projector, camera, plan(), folder, TWO)
    taken = {p: p.read_bytes() for p in folder.glob("*/*.png")}
    assert 0 < len(taken) < 2 * plan().frames
    assert is_exposures(folder)
    with pytest.raises(FileProblem, match="interrupted"):
        decode_stack(folder)
    with pytest.raises(InputError, match="the settings of the captures that are there"):
        capture_hdr(b.projector, b.camera, plan(), folder, TWO[::-1], resume=True)
    with pytest.raises(InputError, match="the plan of the capture that is there"):
        capture_hdr(b.projector, b.camera, plan(2), folder, TWO, resume=True)
    steps = []
    capture_hdr(b.projector, b.camera, plan(), folder, TWO, resume=True, progress=steps.append)
    assert len(steps) == 2 * plan().frames - len(taken)
    assert steps[-1].startswith("exposure 2 of 2: ")
    assert all(path.read_bytes() == content for path, content in taken.items())
    dark, bright = (np.mean(stack.frames) for stack in read_exposures(folder))
    assert bright / dark == pytest.approx(2.0, abs=0.1)
    # A complete scan has nothing to resume, and stays as it is, with its settings as well.
    before = {p: p.read_bytes() for p in folder.glob("**/[!.]*.*")}
    for settings in (TWO, 2):
        capture_hdr(b.projector, no_frames(b.camera), plan(), folder, settings, resume=True)
        assert {p: p.read_bytes() for p in folder.glob("**/[!.]*.*")} == before
    # A new scan would lose frames that nobody can take again.
    with pytest.raises(FileProblem, match="a finished capture, whose frames would be lost"):
        capture_hdr(b.projector, no_frames(b.camera), plan(2), folder, TWO[:1])
    assert {p: p.read_bytes() for p in folder.glob("**/[!.]*.*")} == before
    capture_hdr(b.projector, b.camera, plan(2), folder, TWO[:1], force=True)
    assert [stack.plan for stack in read_exposures(folder)] == [plan(2)]
    assert not (folder / "1").exists()


def no_frames(camera):
    """A camera that can be configured and gives no frames."""
    return Interrupting(camera, 0, AssertionError("no frame is needed"))


@pytest.fixture(scope="module")
def exposures(tmp_path_factory):
    """A folder with two exposures of an even scene."""
    b = bench(scene=Screen(white=0.3))
    return capture_hdr(b.projector, b.camera, plan(), tmp_path_factory.mktemp("e") / "c", TWO)


def test_exposures_are_decoded_from_folders_and_stacks(exposures):
    found = decode_stack(exposures)
    again = decode_stack(read_exposures(exposures))
    assert found.x == again.x
    single = [decode_stack(stack) for stack in read_exposures(exposures)]
    best = np.minimum(*(np.nan_to_num(d.x.sigma_px, nan=np.inf) for d in single))
    ok = found.x.reason == Reason.OK
    assert np.mean(ok) > 0.95
    assert np.all(found.x.sigma_px[ok] <= best[ok] * 1.0001)
    assert len(found.provenance.inputs) == 2 * (plan().frames + 2)


def test_what_does_not_fit_is_refused(exposures, tmp_path):
    for read in (read_stack, read_capture):
        with pytest.raises(FileProblem, match="got several exposures of a scene"):
            read(exposures)
    b = bench()
    with pytest.raises(InputError, match="settings: expected 1 to"):
        capture_hdr(b.projector, b.camera, plan(), tmp_path / "a", ())
    with pytest.raises(InputError, match="delays: expected 2"):
        capture_hdr(b.projector, b.camera, plan(), tmp_path / "a", TWO, delays=())
    with pytest.raises(InputError, match="at least one, got none"):
        decode_stack([])
    stacks = read_exposures(exposures)
    with pytest.raises(InputError, match="out: expected None"):
        decode_stack(stacks, out=decode_stack(stacks[0]))
    other = capture(b.projector, b.camera, plan(2), tmp_path / "other")
    with pytest.raises(InputError, match="exposure 2: expected the plan of the first"):
        decode_stack([stacks[0], read_stack(other)])
    mixed = tmp_path / "mixed"
    shutil.copytree(exposures, mixed)
    shutil.rmtree(mixed / "1")
    shutil.copytree(other, mixed / "1")
    with pytest.raises(FileProblem, match="expected the plan and the frame size of the other"):
        read_exposures(mixed)
    shutil.rmtree(mixed / "1")
    with pytest.raises(FileProblem, match="1"):
        read_exposures(mixed)


def test_an_exposure_that_shows_nothing_is_left_out(exposures):
    stacks = read_exposures(exposures)
    rng = np.random.default_rng(0)
    dark = [np.rint(3 + rng.standard_normal(f.shape)).astype(np.uint8) for f in stacks[0].frames]
    black = type(stacks[0])(dark, stacks[0].plan, 255.0, "virtual", "virtual")
    found = decode_stack([black, stacks[1]])
    assert found.x == decode_stack(stacks[1]).x
    assert "exposure 1 of 2 is not used" in found.findings[0].text
    with pytest.raises(InputError):
        decode_stack([black, black])


@pytest.mark.parametrize("exposure", [8.0, 20.0])
def test_a_long_exposure_of_a_series_is_decoded(exposure):
    """Most of the bright pixels are saturated, and contradict no order of the frames."""
    optics = Optics(exposure=exposure, noise=1.0, gain=0.02)
    frames = list(photograph(glossy_view(0), hdr_plan(), optics))
    found = decode(frames, hdr_plan(), saturation=255.0)
    assert 0.3 < np.mean(found.x.reason == Reason.OK) < 0.7
    frames[1], frames[2] = frames[2], frames[1]
    with pytest.raises(FramesContradictPlan):
        decode(frames, hdr_plan(), saturation=255.0)


@pytest.mark.parametrize("scene", quick(["sphere", "plane"], "sphere"))
def test_the_rim_of_an_object_does_not_decide(tmp_path, scene):
    """A ball before black turns away from the light at its rim; a plane saturates as a whole."""
    projector, camera = virtual_bench(scene, clock=SimulatedClock())
    columns, rows = projector.size_px
    shown = PatternPlan(
        columns, rows, tuple(PhaseSteps("x", columns / n, equal_steps(4)) for n in (27, 5.2, 1))
    )
    one = capture(projector, camera, shown, tmp_path / "one", exposure="auto")
    series = exposure_series(projector, camera, 3)
    assert series[-1].exposure_ms <= 8 * series[0].exposure_ms
    many = capture_hdr(projector, camera, shown, tmp_path / "many", series)
    single, found = (np.mean(decode_stack(f).x.reason == Reason.OK) for f in (one, many))
    assert found >= 0.99 * single


def half_white(shown, exposures, *, limit=255.0, kind=np.uint8, knee=1.0, gamma=1.0):
    """Frames of a scene of white paint (0.9) and of black paint (0.06), at several exposures; the
    projector columns, and where even noise does not reach what the sensor cuts off or bends."""
    rng = np.random.default_rng(7)
    v, u = np.mgrid[:96, :160]
    column = 12.0 + 2.0 * u + 9.0 * np.sin(u / 60 + v / 40)
    albedo = np.where(u < 80, 0.9, 0.06) * (1.0 + 0.03 * rng.standard_normal(u.shape))
    unit, bend, fine = limit / 255.0, knee * limit, np.arange(4.0 * shown.width_px) / 4.0 - 0.375
    stacks, clear = [], []
    for exposure in exposures:
        frames, low = [], np.ones(u.shape, bool)
        for block in shown.blocks:
            for k in range(block.frames):
                sent = gaussian_filter1d(block.values(fine, k) ** gamma, 2.4, mode="nearest")
                sent = np.interp(column, fine, sent)
                light = 0.55 * limit * exposure * albedo * (0.03 + 0.97 * sent)
                sigma = np.sqrt((0.7 * unit) ** 2 + 0.02 * unit * light)
                low &= light + 4.0 * sigma < bend
                light = light + sigma * rng.standard_normal(u.shape)
                if knee < 1.0:
                    over = np.maximum(light - bend, 0.0) / (limit - bend)
                    light = np.where(over > 0, limit - (limit - bend) * np.exp(-over), light)
                    light += 0.3 * unit * rng.standard_normal(u.shape)
                light = np.clip(light, 0.0, limit)
                frames.append((np.rint(light) if kind != np.float32 else light).astype(kind))
        stacks.append(Stack(frames, shown))
        clear.append(low)
    return stacks, column, clear


def errors_of(found, column):
    """Pixels that are measured, and the shares of them beyond half a period and beyond 5 σ."""
    ok = found.x.reason == Reason.OK
    error = np.abs(found.x.coordinate_px - column)[ok]
    return (
        ok,
        np.mean(error > 0.5 * min(found.x.periods_px)),
        np.mean(error > 5 * found.x.sigma_px[ok]),
    )


def steps_of(period, steps):
    return PhaseSteps("x", period, equal_steps(steps))


HALF_PLANS = {
    "4+gray": (Uniform("white"), Uniform("black"), GrayCode("x", 8, 352), steps_of(16, 4)),
    "3+gray": (Uniform("white"), Uniform("black"), GrayCode("x", 8, 352), steps_of(16, 3)),
    "hierarchy": tuple(steps_of(352 / n, 4) for n in (1, 5.2, 20)),
    "heterodyne": tuple(steps_of(p, 3) for p in (14, 16.3, 17.1)),
}
SENSORS = {
    "8 bit": {},
    "250 of 255": {"limit": 250.0},
    "12 bit in 16": {"limit": 4095.0, "kind": np.uint16},
    "float": {"limit": 1.0, "kind": np.float32},
    "knee": {"limit": 4095.0, "kind": np.uint16, "knee": 0.88},
}


@thinned(strength=1, thorough=2, name=list(HALF_PLANS), sensor=list(SENSORS))
def test_an_exposure_that_saturates_the_white_half_measures_the_dark_one(name, sensor):
    """Saturated pixels blame neither order nor steps, whatever the sensor's limit is."""
    shown = PatternPlan(352, 64, HALF_PLANS[name])
    stacks, column, clear = half_white(shown, (1.0, 4.0, 16.0), **SENSORS[sensor])
    found = decode_stack(stacks[2])
    ok, wrong, beyond = errors_of(found, column)
    assert ok[clear[2]].mean() > 0.98
    assert max(wrong, beyond) <= 100e-6
    first = next(f for f in found.findings if f.rank)
    assert first.kind == "saturated"
    assert "shorten the exposure" in first.advice
    assert first.figures["share"] == pytest.approx(0.5, abs=0.1)
    ok, wrong, beyond = errors_of(decode_stack(stacks), column)
    assert ok[np.logical_or.reduce(clear)].mean() > 0.98
    assert max(wrong, beyond) <= 100e-6


def test_an_exposure_that_cannot_be_judged_is_left_out_with_its_cause():
    shown = PatternPlan(352, 64, HALF_PLANS["4+gray"])
    (dark, bright), *_ = half_white(shown, (1.0, 400.0))
    with pytest.raises(InputError, match=r"^saturated: ") as raised:
        decode_stack(bright)
    assert "shorten the exposure" in str(raised.value)
    frames = list(dark.frames)
    frames[-1], frames[-3] = frames[-3], frames[-1]
    swapped = Stack(frames, shown)
    found = decode_stack([swapped, dark, bright])
    assert found.x == decode_stack(dark).x
    texts = [f.text for f in found.findings if f.kind == "exposures"]
    assert texts[0].startswith("exposure 1 of 3 is not used: frames: ")
    assert "swapped" in texts[0]
    assert texts[1].startswith("exposure 3 of 3 is not used: saturated: ")
    with pytest.raises(FramesContradictPlan, match="swapped"):
        decode_stack([swapped, bright])


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("name", HALF_PLANS)
def test_patterns_that_are_not_cut_off_have_no_saturation(name, noise, kind):
    """White is the same everywhere, and its counts are the largest of all."""
    shown = PatternPlan(352, 64, HALF_PLANS[name])
    rng = np.random.default_rng(0)
    frames = [20.0 + 180.0 / 255.0 * frame for frame in encode(shown)]
    frames = [frame + noise * rng.standard_normal(frame.shape) for frame in frames]
    frames = [(np.rint(f) if kind == np.uint16 else f).astype(kind) for f in frames]
    found = decode(frames, shown)
    assert not [f for f in found.findings if f.kind == "saturated"]
    assert np.mean(found.x.reason == Reason.OK) > 0.95


def test_a_series_before_a_bright_projector_goes_below_a_refresh_period(tmp_path):
    """White is 2.4 times as bright as the sensor's limit at a whole refresh period."""
    b = bench(scene=Screen(white=2.4, ambient=0.01))
    series = capture_hdr(b.projector, b.camera, plan(), tmp_path / "many", 2)
    used = series_to_resume(series)
    period_ms = 1e3 * b.projector.refresh_s
    assert used[0].exposure_ms < period_ms
    # Multiples of a half, a third or a quarter of a period.
    parts = [12.0 * one.exposure_ms / period_ms for one in used]
    np.testing.assert_allclose(parts, np.rint(parts), atol=0.01)
    assert np.mean(decode_stack(series).x.reason == Reason.OK) > 0.95


def test_one_saturated_exposure_is_named_and_left_out(tmp_path):
    """Frames of saturated pixels only are equal, and are no frame that was delivered again."""
    b = bench(scene=Screen(white=0.8, ambient=0.03))
    columns, rows = b.projector.size_px
    shown = PatternPlan(columns, rows, (*plan().blocks, Uniform("white"), Uniform("black")))
    exposures = [CameraSettings(exposure_ms=k * 1e3 / 60) for k in (1, 14)]
    folder = capture_hdr(b.projector, b.camera, shown, tmp_path / "many", exposures)
    found = decode_stack(folder)
    assert np.mean(found.x.reason == Reason.OK) > 0.95
    (unused,) = [f for f in found.findings if f.kind == "exposures" and f.rank]
    assert "exposure 2 of 2 is not used: saturated" in unused.seen
