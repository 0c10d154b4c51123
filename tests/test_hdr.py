"""Scenes of high contrast: several exposures, captured, decoded each by itself, and fused."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from fringeworks import FileProblem, FramesContradictPlan, InputError, PatternPlan, decode
from fringeworks.devices.bench import virtual_bench
from fringeworks.devices.clock import SimulatedClock
from fringeworks.files import read_stack
from fringeworks.files.capture import read_capture
from fringeworks.files.exposures import is_exposures, read_exposures
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.pipeline.stacks import decode_stack, measure
from fringeworks.scan.capture import capture
from fringeworks.scan.exposure import auto_exposure, exposure_series
from fringeworks.scan.hdr import capture_hdr
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import truth_distance
from fringeworks.types import CameraSettings, DeviceProblem, Reason
from tests.grids import quick
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
    # A new scan replaces the whole folder, as it does for a single capture.
    capture_hdr(b.projector, b.camera, plan(2), folder, TWO[:1])
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
