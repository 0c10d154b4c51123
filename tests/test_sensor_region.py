"""Rigs for frames of another part of the sensor, or with other pixels."""

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices import Region
from fringeworks.files.capture_writer import writing_capture
from fringeworks.rig.pinhole import project
from fringeworks.rig.sensor_region import for_frames
from fringeworks.simulate.bodies import Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import CameraSettings
from tests import rigs

BLUR = fw.rig.CameraBlur((0.5, 0.1, -0.05, 0.3, 0.2, 0.1), 500.0, (400.0, 600.0), 0.02)
PART = Region(200, 120, 256, 224)


def rig():
    camera = rigs.rig().camera
    return replace(
        rigs.rig(),
        covariance=np.diag(np.linspace(1e-4, 1e-2, 24)),
        residual_px=(0.1, 0.2),
        blur=BLUR,
        region=Region(64, 32, camera.width_px, camera.height_px),
    )


def points(count=50):
    rng = np.random.default_rng(0)
    return rng.uniform((-60, -40, 450), (60, 40, 550), (count, 3))


def test_a_crop_moves_pixels():
    found = for_frames(rig(), region=PART)
    before, after = project(rig().camera, points()), project(found.camera, points())
    assert np.allclose(after, before - (200, 120), atol=1e-9)
    assert found.region == Region(264, 152, 256, 224)
    assert np.array_equal(found.covariance, rig().covariance)
    for z in (430.0, 560.0):
        then, now = (
            b.variance_px2(r.camera.shape, p, np.full(len(p), z))
            for b, r, p in ((BLUR, rig(), before), (found.blur, found, after))
        )
        assert np.allclose(now, then)


@pytest.mark.parametrize("region", [None, PART])
def test_binned_pixels_have_the_mean_of_their_places(region):
    found = for_frames(rig(), region=region, binning=2)
    first = (0, 0) if region is None else (region.x_px, region.y_px)
    before = project(rig().camera, points()) - first
    assert np.allclose(project(found.camera, points()), (before - 0.5) / 2)
    sigma = np.sqrt(np.diag(found.covariance) / np.diag(rig().covariance))
    assert np.allclose(sigma, [0.5] * 4 + [1.0] * 20)
    assert found.residual_px == (0.05, 0.2)
    assert found.region is None


def test_resampled_frames_have_whole_sizes():
    found = for_frames(rig(), scale=0.3)
    w, h = rig().camera.width_px, rig().camera.height_px
    assert found.camera.shape == (round(0.3 * h), round(0.3 * w))
    corner = for_frames(rig(), scale=0.3).camera
    assert np.isclose(corner.focal_px[0] / rig().camera.focal_px[0], corner.width_px / w)


def test_blur_of_larger_pixels_is_that_of_their_area():
    """Binned white noise of a perfect lens: each pixel still collects over itself."""
    perfect = replace(rig(), blur=fw.rig.CameraBlur.everywhere(np.sqrt(1.0 / 12.0)))
    assert np.isclose(for_frames(perfect, binning=4).blur.factors_px2[0], 1.0 / 12.0)
    soft = replace(rig(), blur=fw.rig.CameraBlur.everywhere(1.0))
    expected = (1.0 - 1.0 / 12.0) / 4.0 + 1.0 / 12.0
    assert np.isclose(for_frames(soft, binning=2).blur.factors_px2[0], expected)
    assert np.isclose(for_frames(soft, scale=2.0).blur.factors_px2[0], 4.0)


def test_nothing_to_do_changes_nothing():
    known = rig()
    assert for_frames(known) is known


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"region": Region(600, 0, 400, 400)}, "expected one inside"),
        ({"binning": 0}, "expected binning >= 1"),
        ({"scale": -1.0}, "a scale > 0"),
        ({"binning": 2, "scale": 0.5}, "expected binning or a scale"),
        ({"binning": 100}, "expected frames of 16"),
    ],
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(fw.InputError, match=message):
        for_frames(rig(), **options)


def ball():
    plan = fw.simulate.fringe_plan(rigs.rig(), both=False)
    view = look(rigs.rig(), [rigs.ahead(Sphere(25.0), 5, 3)])
    return plan, list(photograph(view, plan, Optics(seed=1)))


def test_a_capture_of_a_part_is_measured_with_the_rig_of_all(tmp_path):
    """The part that a capture shows is in its file, and that of the rig in the rig's."""
    plan, frames = ball()
    all_of_it = fw.measure(fw.Stack(frames, plan), replace(rig(), blur=None)).points
    x, y = 200, 120
    cut = [f[y : y + 224, x : x + 256] for f in frames]
    settings = CameraSettings(region=Region(64 + x, 32 + y, 256, 224))
    with writing_capture(tmp_path / "part", plan, settings=settings) as writer:
        for k, frame in enumerate(cut):
            writer.add(k, frame)
    fw.write(tmp_path / "rig.toml", replace(rig(), blur=None))
    found = fw.measure(tmp_path / "part", tmp_path / "rig.toml").points
    same = all_of_it.xyz_mm[y : y + 224, x : x + 256]
    ok = (found.reason == 0) & np.isfinite(same[..., 2])
    assert ok.mean() > 0.3
    assert np.abs(found.xyz_mm - same)[ok].max() < 0.02
    elsewhere = replace(fw.read(tmp_path / "part"), region=Region(0, 0, 256, 224))
    with pytest.raises(fw.RigMismatch, match="columns 64 to .* got frames of columns 0 to 255"):
        fw.measure(elsewhere, rig())


def test_the_command(tmp_path, capsys):
    fw.write(tmp_path / "rig.toml", rig())
    out = tmp_path / "part.toml"
    assert run(["rig", "convert", f"{tmp_path / 'rig.toml'}", "--crop", "200,120,256,224",
                "--bin", "2", "--out", f"{out}"]) == 0  # fmt: skip
    expected = for_frames(rig(), region=PART, binning=2)
    assert fw.read(out).camera.shape == (112, 128)
    assert np.allclose(fw.read(out).camera.parameters, expected.camera.parameters)
    assert run(["rig", "convert", f"{out}", "--crop", "1,2,3", "--out", f"{out}2.toml"]) == 2
    assert "--crop: expected first column" in capsys.readouterr().err
