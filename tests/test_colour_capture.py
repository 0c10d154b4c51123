"""Captures of plans with colours: from the projector's picture to points, by every way."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.pixel_formats import full_scale, to_colours, to_grey
from fringeworks.devices.protocols import ColourCamera, ColourProjector, Grab
from fringeworks.devices.virtual_camera import CameraModel, VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture_in_memory
from fringeworks.scan.live import live
from fringeworks.simulate import bust, look, standard_rig
from fringeworks.stack import unmix
from tests.commands import run

RIG = fw.devices.virtual_rig()
SIZE = (RIG.projector.width_px, RIG.projector.height_px)


def sets(*periods):
    return tuple(PhaseSteps("x", p, equal_steps(3)) for p in periods)


PLAN = PatternPlan(*SIZE, sets(18.0, 94.0, 576.0), colours=True)
SMALL_RIG = standard_rig(scale=0.1)
SMALL = (SMALL_RIG.projector.width_px, SMALL_RIG.projector.height_px)
SMALL_PLAN = PatternPlan(*SMALL, sets(18.0, 94.0), colours=True)


def bench(scene="painted", seed=0):
    return fw.devices.virtual_bench(scene, clock=SimulatedClock(), seed=seed)


def small_bench(camera=None, projector=None, seed=0):
    """A projector and a camera of a few pixels before a bust."""
    shows = VirtualProjector(projector or ProjectorModel(*SMALL), clock=SimulatedClock(), seed=seed)
    scene = RigScene(look(SMALL_RIG, bust()))
    model = camera or CameraModel(fps=60.0, readout_s=0.004)
    return shows, VirtualCamera(scene, shows, model, seed=seed)


def assert_right(points, measured=0.9):
    """Points lie on the bust within their σ."""
    view = look(RIG, bust())
    ok = points.reason == 0
    assert ok.sum() > measured * view.lit.sum()
    ratio = np.linalg.norm(points.xyz_mm - view.points_mm, axis=-1)[ok] / points.sigma_mm[ok]
    assert 0.64 < np.mean(ratio < 1.0) < 0.78
    assert np.mean(ratio < 2.0) > 0.93
    assert np.mean(ratio < 5.0) > 0.998


@pytest.mark.parametrize(("scene", "seed"), [("painted", 11), ("painted", 12), ("bust", 11)])
def test_points_of_a_capture_in_colours_are_within_sigma(tmp_path, scene, seed):
    taken = fw.capture(*bench(scene, seed), PLAN, tmp_path / "shots")
    read = fw.measure(taken, RIG)
    assert_right(read.points)
    assert any("crosstalk of the colours" in finding.seen for finding in read.findings)


def test_crosstalk_that_is_left_is_no_measurement():
    """The channels of the virtual camera as they are contradict the plan; unmixed, they do not."""
    pictures = [frame for _, frame in fw.scan.take_frames(*bench(seed=13), PLAN)]
    frames = [p[..., d] for p in pictures[:3] for d in range(3)]
    with pytest.raises(fw.FramesContradictPlan):
        fw.decode(frames, PatternPlan(*SIZE, PLAN.blocks))
    truth = look(RIG, bust()).projector_px[..., 0]
    off = fw.decode(unmix(pictures, PLAN)).x.coordinate_px - truth
    assert np.nanmedian(np.abs(off)) < 0.2


def test_commands_take_and_measure(tmp_path):
    plan, rig = tmp_path / "plan.toml", tmp_path / "rig.toml"
    size = "x".join(str(n) for n in SIZE)
    run("plan", "--frames", "7", "--projector-size", size, "--colours", "--out", plan)
    fw.files.write_rig(rig, RIG)
    devices = ("--projector", "virtual", "--camera", "virtual:painted")
    run("capture", plan, *devices, "--out", tmp_path / "shots")
    names = sorted(path.name for path in (tmp_path / "shots").glob("*.png"))
    assert len(names) == 7
    assert np.asarray(Image.open(tmp_path / "shots" / names[0])).shape == (*RIG.camera.shape, 3)
    out = tmp_path / "points.npz"
    run("scan", plan, *devices, "--rig", rig, "--capture", tmp_path / "again", "--out", out)
    assert_right(fw.read(out))
    assert "crosstalk of the colours" in run("decode", tmp_path / "again").stdout


def test_memory_and_folder_hold_the_same(tmp_path):
    kept = capture_in_memory(*small_bench(seed=1), SMALL_PLAN)
    written = fw.capture(*small_bench(seed=1), SMALL_PLAN, tmp_path / "shots")
    read = fw.files.read_stack(written)
    assert fw.decode(kept).x == fw.decode(read).x
    assert (kept.camera, kept.region) == (read.camera, read.region)
    assert np.array_equal(kept.colour, read.colour)


@pytest.mark.parametrize("bits", [8, 12])
def test_averages_and_deep_frames(tmp_path, bits):
    model = CameraModel(fps=60.0, readout_s=0.004, bits=bits)
    taken = fw.capture(*small_bench(model), SMALL_PLAN, tmp_path / "one")
    several = fw.capture(*small_bench(model), SMALL_PLAN, tmp_path / "mean", average=4)
    one, mean = (fw.decode(folder).x for folder in (taken, several))
    assert np.nanmedian(mean.sigma_px) < 0.7 * np.nanmedian(one.sigma_px)


def test_an_interrupted_capture_goes_on(tmp_path):
    shows, camera = small_bench(seed=2)

    def stop(label):
        if "18px" in label:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fw.capture(shows, camera, SMALL_PLAN, tmp_path / "shots", progress=stop)
    assert camera.configure(fw.devices.CameraSettings()).pixel_format == "Mono8"
    assert camera.grab().pixels.ndim == 2
    taken = []
    fw.capture(shows, camera, SMALL_PLAN, tmp_path / "shots", resume=True, progress=taken.append)
    assert len(taken) < SMALL_PLAN.pictures + 1
    assert np.isfinite(fw.decode(tmp_path / "shots").x.coordinate_px).any()


def test_the_fast_way(tmp_path):
    shows, camera = small_bench(seed=3)
    delay = fw.scan.measure_delay(shows, camera)
    started = shows.clock.now_s()
    fw.capture(shows, camera, SMALL_PLAN, tmp_path / "fast", delay=delay)
    fast_s = shows.clock.now_s() - started
    slow = fw.decode(fw.capture(*small_bench(seed=3), SMALL_PLAN, tmp_path / "slow")).x
    found = fw.decode(tmp_path / "fast").x
    assert fast_s < 3.0
    off = (found.coordinate_px - slow.coordinate_px) / np.hypot(found.sigma_px, slow.sigma_px)
    assert np.mean(np.abs(off[np.isfinite(off)]) < 2.0) > 0.93


def test_no_frame_shows_two_pictures():
    """With a slow screen and a rolling shutter, agreement waits in all channels."""
    model = CameraModel(fps=60.0, readout_s=0.012, shutter="rolling")
    shows, camera = small_bench(model, ProjectorModel(*SMALL, delay_s=0.05, jitter_refreshes=2))
    for _ in fw.scan.take_frames(shows, camera, SMALL_PLAN):
        assert len(camera.pictures) == 1


def test_automatic_exposure_and_a_grey_format_of_a_setup():
    shows, camera = small_bench(seed=4)
    grey = fw.devices.CameraSettings(pixel_format="Mono8")
    stack = capture_in_memory(shows, camera, SMALL_PLAN, settings=grey, exposure="auto")
    assert 100.0 < np.nanpercentile(stack.colour.max(axis=-1), 99.0) < 256.0


class GreyCamera:
    """A camera without ``deliver_colours``."""

    def __init__(self, camera):
        self._camera = camera

    def __getattr__(self, name):
        if name == "deliver_colours":
            raise AttributeError(name)
        return getattr(self._camera, name)


def test_devices_without_colours_say_so(tmp_path):
    shows, camera = small_bench()
    assert isinstance(camera, ColourCamera)
    assert isinstance(shows, ColourProjector)
    with pytest.raises(fw.InputError, match="the camera virtual delivers grey frames, got colours"):
        fw.capture(shows, GreyCamera(camera), SMALL_PLAN, tmp_path / "a")
    assert not (tmp_path / "a").exists()

    class Grey(VirtualProjector):
        shows_colours = False

    grey = Grey(ProjectorModel(*SMALL), clock=SimulatedClock())
    with pytest.raises(fw.InputError, match="projector virtual shows no pictures in colour"):
        fw.capture(grey, camera, SMALL_PLAN, tmp_path / "a")
    two = [tmp_path / "a", tmp_path / "b"]
    for refused in (
        lambda: fw.scan.capture_hdr(grey, camera, SMALL_PLAN, tmp_path / "a", 2),
        lambda: fw.scan.capture_together(grey, [camera, camera], SMALL_PLAN, two),
        lambda: next(live(grey, camera, SMALL_PLAN, SMALL_RIG)),
    ):
        with pytest.raises(fw.InputError, match="projector virtual shows no pictures in colour"):
            refused()
    greys = [camera, GreyCamera(camera)]
    with pytest.raises(fw.DeviceProblem, match="virtual: expected a camera that sees colours"):
        fw.scan.capture_together(shows, greys, SMALL_PLAN, two)
    with pytest.raises(fw.InputError, match="the camera virtual delivers grey frames, got colours"):
        next(live(shows, GreyCamera(camera), SMALL_PLAN, SMALL_RIG))
    assert not any(path.exists() for path in two)
    with pytest.raises(fw.InputError, match="expected grey pictures here, got colours"):
        fw.devices.MemoryProjector(SMALL_PLAN)
    with pytest.raises(fw.InputError, match=r"expected frames of shape \(h, w\) or \(h, w, 3\)"):
        Grab(np.zeros((4, 4, 2), np.uint8), 0.0)
    with pytest.raises(fw.InputError, match="filters: expected three rows"):
        CameraModel(filters=((1.0, 0.2, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    with pytest.raises(fw.InputError, match="paint: expected shape"):
        RigScene(look(SMALL_RIG, bust()), paint=np.ones((4, 4, 3)))


@pytest.mark.parametrize("seed", [21, 22])
def test_live_points_in_colours_are_within_sigma(seed):
    shows, camera = bench(seed=seed)
    clouds = live(shows, camera, PLAN, RIG, judge_every=2)
    judged = []
    for _ in range(3):
        cloud = next(clouds)
        judged.append(cloud.judged)
        assert_right(cloud.points)
    clouds.close()
    assert judged == [True, False, True]
    assert camera.grab().pixels.ndim == 2


def test_the_decoder_takes_photographs():
    """As a capture on disk gives, and with the pixels that single photographs saturate."""
    pictures = [frame for _, frame in fw.scan.take_frames(*small_bench(seed=5), SMALL_PLAN)]
    decoder = fw.stack.Decoder(SMALL_PLAN, pictures[0].shape[:2])
    usual = fw.decode(unmix(pictures, SMALL_PLAN)).x
    again = decoder.decode(pictures).x
    np.testing.assert_allclose(again.coordinate_px, usual.coordinate_px, atol=1e-3)
    bright = [p.copy() for p in pictures]
    bright[1][40:60, 50:70] = 255
    reasons = decoder.decode(bright).x.reason[40:60, 50:70]
    assert not np.any(reasons == fw.Reason.OK)
    with pytest.raises(fw.FramesContradictPlan, match=r"the decoder is for uint8 .* 3\)"):
        decoder.decode([p[..., 0] for p in pictures])


def test_several_exposures_in_colours(tmp_path):
    """A bust that is brighter than the short exposure needs, and darker than the long one."""
    shows, camera = bench(seed=23)
    times = [fw.devices.CameraSettings(exposure_ms=t) for t in (8.0, 24.0)]
    taken = fw.scan.capture_hdr(shows, camera, PLAN, tmp_path / "hdr", times)
    fused = fw.measure(taken, RIG).points
    assert_right(fused)
    assert camera.grab().pixels.ndim == 2
    one = fw.measure(taken / "0", RIG).points
    assert np.sum(fused.reason == 0) >= np.sum(one.reason == 0)
    assert np.nanmedian(fused.sigma_mm) < np.nanmedian(one.sigma_mm)
    both = (fused.reason == 0) & (one.reason == 0)
    assert fused.colour.shape == (*RIG.camera.shape, 3)
    share = fused.colour[both].sum(axis=-1) / one.colour[both].sum(axis=-1)
    assert abs(np.median(share) - 1.0) < 0.02


def test_several_cameras_in_colours(tmp_path):
    shows, camera = bench(seed=24)
    both = [tmp_path / "left", tmp_path / "right"]
    taken = fw.scan.capture_together(shows, [camera, camera], PLAN, both)
    for folder in taken:
        assert_right(fw.measure(folder, RIG).points)


def test_the_virtual_camera_sees_the_colours_that_are_shown():
    filters = ((0.8, 0.2, 0.0), (0.1, 0.8, 0.1), (0.0, 0.3, 0.7))
    shows, camera = small_bench(CameraModel(noise=0.0, shot_gain=0.0, filters=filters))
    camera.deliver_colours(True)
    seen = []
    for colour in range(4):
        picture = np.zeros((*SMALL[::-1], 3), np.uint8)
        picture[..., :] = 255 if colour == 3 else 255 * np.eye(3, dtype=np.uint8)[colour]
        shows.show(picture)
        shows.clock.wait_until(shows.clock.now_s() + 0.2)
        camera.discard()
        seen.append(camera.grab().pixels.astype(float))
    lit = look(SMALL_RIG, bust()).lit & (seen[3].min(axis=-1) > 60)
    dark = seen[3][~look(SMALL_RIG, bust()).lit].mean() if not lit.all() else 0.0
    share = np.stack([s[lit].mean(axis=0) - dark for s in seen[:3]], axis=-1)
    assert np.allclose(share / (seen[3][lit].mean() - dark), filters, atol=0.05)


def test_folders_of_other_programs_deliver_colours(tmp_path):
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[..., 0], picture[..., 1], picture[..., 2] = 10, 20, 30
    with fw.devices.FolderCamera(tmp_path, settled_s=0.01) as camera:
        assert isinstance(camera, ColourCamera)
        camera.deliver_colours(True)
        Image.fromarray(picture).save(tmp_path / "a.png")
        assert np.array_equal(camera.grab().pixels, picture)
        Image.fromarray(picture[..., 0]).save(tmp_path / "b.png")
        with pytest.raises(fw.DeviceProblem, match="expected a colour image"):
            camera.grab(0.3)
        camera.deliver_colours(False)
        Image.fromarray(picture).save(tmp_path / "c.png")
        assert camera.grab().pixels.shape == (20, 30)


def test_webcams_deliver_colours(tmp_path):
    picture = np.zeros((20, 30, 3), np.uint8)
    picture[..., 0], picture[..., 1], picture[..., 2] = 10, 20, 30
    for k in range(4):
        Image.fromarray(picture).save(tmp_path / f"frame-{k:02d}.png")
    with fw.devices.WebcamCamera(str(tmp_path / "frame-%02d.png")) as camera:
        assert isinstance(camera, ColourCamera)
        camera.deliver_colours(True)
        assert camera.limits().pixel_formats == ("RGB8",)
        assert np.array_equal(camera.grab().pixels, picture)
        camera.deliver_colours(False)
        assert camera.grab().pixels.ndim == 2


def test_formats_of_industrial_cameras():
    raw = np.zeros((8, 8), np.uint8)
    raw[::2, ::2], raw[1::2, 1::2] = 200, 50
    raw[::2, 1::2] = raw[1::2, ::2] = 100
    found = to_colours(raw, "BayerRG8")
    assert np.array_equal(found[4, 4], [200, 100, 50])
    for k, name in enumerate(("red", "green", "blue")):
        assert np.array_equal(found[..., k], to_grey(raw, "BayerRG8", name))
    with pytest.raises(fw.DeviceProblem, match="such as BayerRG8, got Mono8"):
        to_colours(raw, "Mono8")
    assert full_scale("RGB12") == 4095
