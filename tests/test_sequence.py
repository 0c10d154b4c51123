"""Scenes that move: motion is found and taken out, and areas are followed along time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate.vibrations import Displacement
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.exposure import photograph_moving
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.motion_search import distance_of

pytestmark = pytest.mark.statistical

SCALE = 0.25
RIG = standard_rig(scale=SCALE)
WIDTH, HEIGHT = RIG.projector.width_px, RIG.projector.height_px
MM_PER_PX = 500.0 / (3150.0 * SCALE)
PX_PER_MM = 4100.0 * SCALE * 280.0 / 500.0**2
MIDDLE = np.array([0.0, 0.0, 500.0])


def steps(period: float, count: int, axis: str = "x") -> PhaseSteps:
    return PhaseSteps(axis, period, equal_steps(count))


THREE = PatternPlan(WIDTH, HEIGHT, (steps(480.0, 3), steps(80.0, 3), steps(16.0, 3)))
FOUR = PatternPlan(WIDTH, HEIGHT, (steps(480.0, 4), steps(80.0, 4), steps(16.0, 4)))
GRAY = PatternPlan(
    WIDTH,
    HEIGHT,
    (
        GrayCode("x", 8.0, WIDTH, offset_px=-4.0),
        steps(16.0, 4),
        Uniform("white"),
        Uniform("black"),
    ),
)


def paint(x, y):
    tones = np.random.default_rng(3).uniform(0.25, 0.9, (64, 64))
    return tones[np.floor(y / 8).astype(int) % 64, np.floor(x / 8).astype(int) % 64]


def still(_):
    return bust()


def receding(t):
    return bust(pose(np.eye(3), MIDDLE + np.array([0, 0, 0.5 * t / PX_PER_MM])))


def turning(t):
    return bust(pose(rotation(np.array([0, 0.5 * t * MM_PER_PX / 40.0, 0])), MIDDLE))


def sliding(t):
    tilted = rotation(np.array([0.2, 0.3, 0]))
    return [Body(Plane(), pose(tilted, MIDDLE + np.array([0.5 * t * MM_PER_PX, 0, 0])), paint)]


def passing(t):
    wall = Body(Plane(), pose(np.eye(3), np.array([0, 0, 560.0])), 0.35)
    return [
        Body(Sphere(40.0), pose(np.eye(3), MIDDLE + np.array([0.5 * t * MM_PER_PX, 0, 0])), paint),
        wall,
    ]


def shaking(t):
    away = 4.8 * np.sin(2 * np.pi * t / 60) / PX_PER_MM
    return bust(pose(np.eye(3), MIDDLE + np.array([0, 0, away])))


@lru_cache(maxsize=4)
def taken(scene, plan, count, noise=0.5):
    """Frames of a scene, and its true projector columns in each."""
    views = [look(RIG, scene(t)) for t in range(1 if scene is still else count)]
    views = views * count if scene is still else views
    optics = Optics(noise=noise, exposure=0.9, seed=5)
    frames = tuple(photograph_moving(views, plan, optics))
    return frames, [np.where(v.lit, v.projector_px[..., 0], np.nan) for v in views]


def errors(coordinate, time, truth):
    """Errors at a time; where another surface is there half a frame later, nobody knows."""
    before, after = truth[int(np.floor(time))], truth[int(np.ceil(time))]
    known = np.abs(before - after) < 3.0
    return np.where(known, coordinate - 0.5 * (before + after), np.nan)


STILL_PX = 0.02
"""Pixels that change by less from frame to frame are as good by either way."""


def rms(values) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def compared(scene, plan, cycle):
    """Rms errors of both ways on moving pixels that both measure, and what each measures."""
    n = plan.frames
    frames, truth = taken(scene, plan, 3 * n)
    moments = {m.first_frame: m for m in fw.stack.decode_sequence(frames, plan, every=n)}
    moment = moments[cycle * n]
    moved = errors(moment.decoded.x.coordinate_px, moment.time_frames, truth)
    plain = fw.decode(frames[cycle * n : (cycle + 1) * n], plan).x.coordinate_px
    plain = errors(plain, moment.time_frames, truth)
    change = truth[int(np.floor(moment.time_frames)) + 1] - truth[int(np.floor(moment.time_frames))]
    both = np.isfinite(moved) & np.isfinite(plain) & (np.abs(change) > STILL_PX)
    sigma = np.where(np.isfinite(moved), moment.decoded.x.sigma_px, np.nan)
    shares = np.isfinite(moved).mean(), np.isfinite(plain).mean()
    return rms(moved[both]), rms(plain[both]), shares, moved / sigma


def test_motion_is_taken_out():
    moved, plain, shares, normal = compared(turning, THREE, 1)
    assert moved < plain / 3.0
    assert shares[0] > 0.98 * shares[1]
    within = np.nanmean(np.abs(normal[np.isfinite(normal)]) < 1.0)
    assert 0.55 < within < 0.9


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "plan"), [(turning, FOUR), (sliding, THREE), (sliding, FOUR), (passing, THREE)]
)
@pytest.mark.parametrize("cycle", [0, 1, 2])
def test_motion_of_many_kinds_is_taken_out(scene, plan, cycle):
    moved, plain, shares, normal = compared(scene, plan, cycle)
    assert moved < plain / 3.0
    assert shares[0] > 0.97 * shares[1]
    within = np.abs(normal[np.isfinite(normal)])
    assert 0.55 < np.mean(within < 1.0) < 0.92
    assert np.mean(within < 2.0) > 0.88


@pytest.mark.long
def test_what_plain_decoding_refuses_is_measured():
    frames, truth = taken(receding, FOUR, 36)
    with pytest.raises(fw.InputError, match="order_ambiguous"):
        fw.decode(frames[12:24], FOUR)
    moment = list(fw.stack.decode_sequence(frames, FOUR, every=12))[1]
    found = errors(moment.decoded.x.coordinate_px, moment.time_frames, truth)
    lit = np.isfinite(errors(0.0, moment.time_frames, truth))
    assert np.isfinite(found).sum() > 0.98 * lit.sum()
    assert np.nanmedian(np.abs(found)) < 0.04
    true = (truth[int(moment.time_frames) + 3] - truth[int(moment.time_frames) - 2]) / 5.0
    assert np.nanmedian(np.abs(moment.motion.velocity_px["x"] - true)) < 0.01


@pytest.mark.long
def test_gray_code_of_a_scene_that_moves():
    frames, truth = taken(receding, GRAY, 36)
    for moment in fw.stack.decode_sequence(frames, GRAY, every=5):
        found = errors(moment.decoded.x.coordinate_px, moment.time_frames, truth)
        lit = np.isfinite(errors(0.0, moment.time_frames, truth))
        assert np.isfinite(found).sum() > 0.95 * lit.sum()
        assert np.nanmedian(np.abs(found)) < 0.04
        assert np.nanmean(np.abs(found) > 5.0) < 2e-3


@pytest.mark.long
def test_vibration_is_followed():
    frames, truth = taken(shaking, THREE, 72)
    moments = list(fw.stack.decode_sequence(frames, THREE, every=2))
    off = [errors(m.decoded.x.coordinate_px, m.time_frames, truth) for m in moments]
    middle = [np.nanmedian(np.abs(e)) for e in off[5:-5]]
    assert np.median(middle) < 0.05
    sigma = [m.decoded.x.sigma_px for m in moments]
    normal = np.concatenate([(e / s)[np.isfinite(e)] for e, s in zip(off, sigma, strict=True)])
    assert np.mean(np.abs(normal) < 1.0) > 0.6


def test_still_scenes_are_unharmed():
    frames, truth = taken(still, FOUR, 36, noise=1.0)
    plain = fw.decode(frames[12:24], FOUR).x
    for moment in fw.stack.decode_sequence(frames, FOUR, every=6):
        found = moment.decoded.x
        assert (
            np.isfinite(found.coordinate_px).sum() > 0.995 * np.isfinite(plain.coordinate_px).sum()
        )
        both = np.isfinite(found.coordinate_px) & np.isfinite(plain.coordinate_px)
        mine, theirs = ((m.coordinate_px - truth[0])[both] for m in (found, plain))
        assert rms(mine) < 1.03 * rms(theirs)
        assert np.median(found.sigma_px[both]) < 1.03 * np.median(plain.sigma_px[both])
        assert moment.motion.flow_px is None
        assert np.nanmedian(np.abs(moment.motion.velocity_px["x"])) < 0.01


def kinds_on_steps(shown, move_px):
    """Kinds of the findings on the finest steps, once other cycles are known: of patterns that are
    really shown, and of a surface that moves along the projector by a function of the time in frames."""
    rng = np.random.default_rng(8)
    v, u = np.mgrid[:90, :130].astype(float)
    place = 120.0 + 1.4 * u + 0.2 * v + 5.0 * np.sin(u / 21.0) * np.cos(v / 26.0)
    patterns = [(block, k) for block in shown.blocks for k in range(block.frames)]
    frames = []
    for t in range(4 * shown.frames):
        block, k = patterns[t % shown.frames]
        counts = 12.0 + 150.0 * block.values(place + move_px(t), k)
        frames.append(np.rint(counts + rng.standard_normal(counts.shape)).astype(np.uint8))
    moments = fw.stack.decode_sequence(frames, FOUR, every=4)
    late = [m.decoded.findings for m in moments if m.first_frame >= FOUR.frames]
    return {one.kind for findings in late for one in findings if "steps of 16 px" in one.seen}


def test_steps_that_differ_between_cycles_come_from_motion():
    assert kinds_on_steps(FOUR, lambda t: 0.6 * np.sin(0.9 * t + 0.7)) == {"motion"}


def test_steps_that_are_wrong_in_every_cycle_are_the_projectors():
    def wrong(block):
        shifts = tuple(d + e for d, e in zip(block.shifts_rad, (0, 0.03, -0.03, 0), strict=True))
        return PhaseSteps("x", block.period_px, shifts)

    shown = PatternPlan(WIDTH, HEIGHT, tuple(map(wrong, FOUR.blocks)))
    assert kinds_on_steps(shown, lambda _: 0.0) == {"steps"}


def test_moments_come_as_soon_as_their_motion_is_known():
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    decoder = fw.stack.SequenceDecoder(FOUR)
    come = {}
    for k, frame in enumerate(frames):
        for moment in decoder.add(frame):
            come[moment.first_frame] = k
    come |= {moment.first_frame: len(frames) for moment in decoder.finish()}
    assert sorted(come) == list(range(25))
    # A moment comes at most a cycle and a half after its last frame.
    assert max(k - (first + 11) for first, k in come.items() if k < 36) <= 24


def test_a_lost_frame_is_told():
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    rolled = [*frames, *frames[:7], *frames[8:], *frames]
    with pytest.raises(fw.InputError, match=r"frames \d+ to \d+: "):
        list(fw.stack.decode_sequence(rolled, FOUR, every=12))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f[:20], r"expected 2 cycles of 12 frames or more, got 20 frames"),
        (lambda f: [*f[:5], f[5][:9]], r"frame 5 \(x-phase-80px-1\): expected the size"),
        (lambda f: [f[0], np.zeros_like(f[0])], r"frame 1 \(x-phase-480px-1\): expected a pattern"),
    ],
)
def test_bad_frames_are_named(change, message):
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    with pytest.raises(fw.InputError, match=message):
        list(fw.stack.decode_sequence(change(list(frames)), FOUR))


def test_bad_options_are_refused():
    with pytest.raises(
        fw.InputError, match="every: expected a whole number of 1 or more frames, got 0"
    ):
        fw.stack.SequenceDecoder(FOUR, every=0)
    gray = PatternPlan(64, 40, (GrayCode("x", 2.0, 64), Uniform("white"), Uniform("black")))
    with pytest.raises(fw.InputError, match="expected fringes along x, got Gray code only"):
        fw.stack.SequenceDecoder(gray)


def test_distance_of_is_that_on_which_the_sets_agree():
    true = np.array([[-21.0, -3.0, 0.0, 9.0, 25.0]])
    periods = (480.0, 80.0, 16.0)
    turns = [(true / p + 0.5) % 1.0 - 0.5 for p in periods]
    distance, misfit = distance_of(turns, periods)
    np.testing.assert_allclose(distance, true, atol=1e-4)
    assert misfit.max() < 0.01


def vibrating(amplitude, frequency, *, rate=100.0, n=400, drift=0.0, noise=0.001, seed=0):
    time = np.arange(n) / rate
    values = amplitude * np.sin(2 * np.pi * frequency * time + 0.3) + drift * time
    values = values + np.random.default_rng(seed).normal(0, noise, n)
    return Displacement(time, values, np.full(n, noise))


def test_spectrum_finds_vibrations_and_drift():
    found = fw.evaluate.vibration(vibrating(0.02, 7.3, drift=0.05))
    frequency, amplitude = found.peaks[0]
    assert abs(frequency - 7.3) < 0.02
    assert abs(amplitude - 0.02) < 0.0008
    assert len(found.peaks) == 1
    assert abs(found.drift_mm_per_s - 0.05) < 3.0 * found.drift_sigma


@pytest.mark.parametrize(
    ("count", "shared"),
    [(300, 12), *(pytest.param(c, n, marks=pytest.mark.long) for c in (64, 1000) for n in (1, 12))],
)
def test_noise_alone_is_no_vibration(count, shared):
    """Moments that share frames have noise that is not white."""
    spurious = 0
    for seed in range(300):
        moved = vibrating(0.0, 1.0, n=count + shared - 1, seed=seed)
        mean = np.convolve(moved.distance_mm, np.ones(shared) / shared, "valid")
        time = moved.time_s[:count]
        found = fw.evaluate.vibration(Displacement(time, mean, np.ones(count), float(shared)))
        spurious += bool(found.peaks)
    assert spurious <= 6


def test_drift_is_as_certain_as_stated():
    """A vibration leans, and moments share frames: the drift scatters as it says."""
    off = []
    for seed in range(200):
        moved = vibrating(0.01, 1.7, n=411, seed=seed)
        mean = np.convolve(moved.distance_mm, np.ones(12) / 12, "valid")
        found = fw.evaluate.vibration(Displacement(moved.time_s[:400], mean, np.ones(400), 12.0))
        off.append(found.drift_mm_per_s / found.drift_sigma)
    assert 0.75 < np.std(off) < 1.35
    assert np.abs(np.mean(off)) < 0.3


def test_gaps_are_bridged_and_too_many_refused():
    moved = vibrating(0.02, 7.3)
    gaps = moved.distance_mm.copy()
    gaps[50:60] = np.nan
    assert fw.evaluate.vibration(Displacement(moved.time_s, gaps, moved.sigma_mm)).peaks
    gaps[60:300] = np.nan
    with pytest.raises(fw.InputError, match="half of them measured or more, got 150 of 400"):
        fw.evaluate.vibration(Displacement(moved.time_s, gaps, moved.sigma_mm))


AREAS = {
    "chin": fw.evaluate.Area(box=(165, 133, 180, 150)),
    "wall": fw.evaluate.Area(box=(240, 60, 270, 100)),
}


def recipe(**changes) -> fw.Recipe:
    return fw.Recipe(**({"rig": RIG, "plan": FOUR, "areas": AREAS} | changes))


def test_a_sequence_is_written_as_it_comes(tmp_path):
    zarr = pytest.importorskip("zarr")
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    out = tmp_path / "head.zarr"
    seen = []

    def watched(done, whole):
        group = zarr.open_group(out, mode="r")
        seen.append((done, whole, group.attrs["moments"], group.attrs["complete"]))

    found = fw.batch.run_sequence(frames, recipe(), out, rate_hz=50.0, every=6, progress=watched)
    assert seen == [(k, None, k, False) for k in range(1, 6)]
    group = zarr.open_group(out, mode="r")
    assert group.attrs["complete"]
    assert group["xyz_mm"].shape == (5, *RIG.camera.shape, 3)
    assert group["xyz_mm"].shards == (1, 256, 512, 3)
    np.testing.assert_allclose(group["time"][:], (6.0 + 6 * np.arange(5)) / 50.0)
    moments = list(fw.stack.measure_sequence(frames, RIG, FOUR, every=6))
    np.testing.assert_array_equal(group["xyz_mm"][3], moments[3].points.xyz_mm)
    np.testing.assert_array_equal(group["reason"][3], moments[3].points.reason)
    for moved in found.displacements.values():
        normal = moved.distance_mm[1:] / (2**0.5 * moved.sigma_mm[1:])
        assert np.abs(normal).max() < 5.0
    rows = found.table.read_text().splitlines()
    assert rows[0] == "time s,chin mm,chin σ mm,wall mm,wall σ mm"
    assert len(rows) == 6


def test_what_was_measured_stays_when_frames_end_in_an_error(tmp_path):
    zarr = pytest.importorskip("zarr")
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    out = tmp_path / "head.zarr"
    broken = [*frames, *frames[:6], frames[6][:9]]
    with pytest.raises(fw.InputError, match="frame 42 "):
        fw.batch.run_sequence(broken, recipe(), out, every=3)
    group = zarr.open_group(out, mode="r")
    assert not group.attrs["complete"]
    assert group.attrs["moments"] == len(out.with_suffix(".csv").read_text().splitlines()) - 1 > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rig": None}, "expected a rig for a sequence, got none"),
        ({"plan": None}, "expected a plan for a sequence, got none"),
        ({"options": {"sigma": 3}}, "expected options of sequences, .* got sigma"),
    ],
)
def test_recipes_that_do_not_suit_are_refused(tmp_path, changes, message):
    with pytest.raises(fw.InputError, match=message):
        fw.batch.run_sequence([], recipe(**changes), tmp_path / "a.zarr")
    with pytest.raises(fw.InputError, match="expected a name that ends with"):
        fw.batch.run_sequence([], recipe(), tmp_path / "a")
    with pytest.raises(fw.InputError, match="expected > 0 frames per second, got -1"):
        fw.batch.run_sequence([], recipe(), tmp_path / "a.zarr", rate_hz=-1)
    assert not list(tmp_path.iterdir())


def test_sequences_are_read_from_folders_stacks_and_arrays(tmp_path):
    import tifffile

    frames = np.random.default_rng(0).integers(0, 255, (12, 20, 30), np.uint8)
    folder = tmp_path / "images"
    folder.mkdir()
    for k, frame in enumerate(frames):
        fw.files.write_frame(folder / f"frame-{k}.png", frame)
    np.save(tmp_path / "frames.npy", frames)
    tifffile.imwrite(tmp_path / "frames.tif", frames)
    sources = [folder, tmp_path / "frames.npy", tmp_path / "frames.tif"]
    for source in sources:
        found = fw.files.read_sequence(source)
        assert len(found) == 12
        np.testing.assert_array_equal(np.stack(list(found)), frames)
    with pytest.raises(fw.FileProblem, match=r"expected counts \(frame, row, column\)"):
        np.save(tmp_path / "one.npy", frames[0])
        fw.files.read_sequence(tmp_path / "one.npy")
    with pytest.raises(fw.FileProblem, match="expected images, got none"):
        (tmp_path / "empty").mkdir()
        fw.files.read_sequence(tmp_path / "empty")


def test_command_and_report(tmp_path):
    frames, _ = taken(still, FOUR, 36, noise=1.0)
    pytest.importorskip("zarr")
    np.save(tmp_path / "frames.npy", np.stack([*frames, *frames[:12]]))
    fw.files.write_rig(tmp_path / "rig.toml", RIG)
    written = recipe(rig=tmp_path / "rig.toml")
    fw.files.write_recipe(tmp_path / "recipe.toml", written)
    out = tmp_path / "head.zarr"
    command = ["sequence", tmp_path / "frames.npy", "--recipe", tmp_path / "recipe.toml"]
    command += ["--out", out, "--fps", 50, "--every", 2, "--report", tmp_path / "head.html"]
    assert run([str(part) for part in command]) == 0
    assert "Displacement of the area" in (tmp_path / "head.html").read_text()
    assert (tmp_path / "head.csv").is_file()
