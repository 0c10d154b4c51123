"""Calibration of the two-frame path from planes at known heights."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest

from fringeworks import InputError, reconstruct
from fringeworks.evaluate import errors
from fringeworks.files import read_pair, read_surface, write_surface
from fringeworks.files.images import write_frame
from fringeworks.files.reference_plane import (
    read_reference_plane,
    write_reference_plane,
)
from fringeworks.pair import ReferencePlaneGeometry, displacement_from_height
from fringeworks.rig.calibration.planes import (
    calibrate_pixels,
    calibrate_reference_plane,
    height_by_pixel,
)
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.types import DisplacementMap
from tests.commands import run

HEIGHTS = (10.0, 20.0, 35.0, 50.0)


def planes(geometry, noise=0.02, seed=0, shape=(80, 100)):
    rng = np.random.default_rng(seed)
    return [
        displacement_from_height(np.full(shape, h), geometry) + noise * rng.standard_normal(shape)
        for h in HEIGHTS
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_distance_and_baseline_are_recovered(sign):
    truth = ReferencePlaneGeometry(800.0, 300.0, 0.4, sign)
    found = calibrate_reference_plane(planes(truth), HEIGHTS, pitch_mm_per_px=0.4)
    assert found.geometry.distance_mm == pytest.approx(800.0, rel=2e-3)
    assert found.geometry.baseline_mm == pytest.approx(300.0, rel=2e-3)
    assert found.geometry.sign == sign
    assert max(found.residual_mm) < 0.05


def test_outliers_do_not_affect_the_geometry():
    truth = ReferencePlaneGeometry(800.0, 300.0, 0.4)
    maps = planes(truth)
    for m in maps:
        m[:8] += 30.0
        m[40, 40] = np.nan
    found = calibrate_reference_plane(maps, HEIGHTS, pitch_mm_per_px=0.4)
    assert found.geometry.distance_mm == pytest.approx(800.0, rel=5e-3)


def test_every_pixel_has_its_own_law():
    x = np.linspace(-1, 1, 100)[None, :] * np.ones((80, 1))
    distance, baseline = 800.0 + 30.0 * x, 750.0 - 40.0 * x
    maps = [baseline * h / (distance - h) for h in HEIGHTS]
    maps[1][5, 5] = np.nan
    maps[2][5, 5] = np.nan
    found = calibrate_pixels(maps, HEIGHTS)
    assert np.isnan(found.slope[5, 5])
    ok = np.isfinite(found.slope)
    np.testing.assert_allclose(found.slope[ok], (distance / baseline)[ok], rtol=1e-6)
    np.testing.assert_allclose(found.bend[ok], 1.0 / baseline[ok], rtol=1e-6)
    u = baseline * 27.0 / (distance - 27.0)
    phase = DisplacementMap(
        u, np.full(u.shape, 0.1), u, np.zeros(u.shape, np.uint8), 20.0, "x", "test"
    )
    surface = height_by_pixel(phase, found)
    np.testing.assert_allclose(surface.values[ok], 27.0, rtol=1e-6)
    slope = (distance - 27.0) ** 2 / (baseline * distance)
    np.testing.assert_allclose(surface.sigma[ok], 0.1 * slope[ok], rtol=1e-6)
    assert np.isnan(surface.values[5, 5])


def test_files_are_read_back(tmp_path):
    truth = ReferencePlaneGeometry(800.0, 300.0, 0.4, -1)
    assert read_reference_plane(write_reference_plane(tmp_path / "g.toml", truth)) == truth
    found = calibrate_pixels(planes(truth), HEIGHTS)
    back = read_reference_plane(write_reference_plane(tmp_path / "p.npz", found))
    np.testing.assert_array_equal(back.slope, found.slope)
    assert back.heights_mm == (10.0, 50.0)
    (tmp_path / "bad.npz").write_bytes(b"PK")
    (tmp_path / "bad.toml").write_text("kind = 'rig'")
    for name in ("bad.npz", "bad.toml", "no.toml"):
        with pytest.raises(InputError, match=name):
            read_reference_plane(tmp_path / name)
    with pytest.raises(InputError, match=".npz"):
        write_reference_plane(tmp_path / "p.txt", found)


@pytest.mark.parametrize("pitch", [None, 0.4])
def test_heights_do_not_make_up_a_pitch(tmp_path, pitch):
    truth = ReferencePlaneGeometry(800.0, 300.0, 0.4)
    law = calibrate_pixels(planes(truth), HEIGHTS, pitch_mm_per_px=pitch)
    law = read_reference_plane(write_reference_plane(tmp_path / "p.npz", law))
    u = displacement_from_height(np.full((80, 100), 20.0), truth)
    reason = np.zeros(u.shape, np.uint8)
    surface = height_by_pixel(DisplacementMap(u, 0 * u + 0.1, u, reason, 20.0, "x", "test"), law)
    assert surface.pitch == pitch
    for name in ("s.tif", "s.npz"):
        write_surface(tmp_path / name, surface)
        assert read_surface(tmp_path / name).pitch == pitch
    for name in ("s.ply", "s.x3p", "s.gsf"):
        if pitch is None:
            with pytest.raises(InputError, match="expected heights with a known pitch"):
                write_surface(tmp_path / name, surface)
            assert not (tmp_path / name).exists()
        else:
            write_surface(tmp_path / name, surface)
    if pitch is not None:
        with zipfile.ZipFile(tmp_path / "s.x3p") as archive:
            assert b"Date" not in archive.read("main.xml")  # unknown here, so not today's
    assert np.isfinite(errors(surface, np.full(u.shape, 20.0)).mean_abs_error_mm)


@pytest.mark.parametrize(
    ("maps", "heights", "message"),
    [
        (1, (10.0,), "2 different ones"),
        (2, (10.0, 10.0), "2 different ones"),
        (2, (0.0, 10.0), "other than 0"),
        (2, (10.0,), "a height for each"),
        ("empty", (10.0, 20.0), "100 measured pixels"),
        ("mixed", (10.0, 20.0), "one shape"),
        ("falling", (10.0, 20.0, 30.0), "no geometry explains"),
    ],
)
def test_planes_that_do_not_determine_the_geometry_are_refused(maps, heights, message):
    every = planes(ReferencePlaneGeometry(800.0, 300.0, 0.4))
    given = every[:maps] if isinstance(maps, int) else every[:2]
    if maps == "empty":
        given = [np.full((80, 100), np.nan), every[1]]
    if maps == "mixed":
        given = [every[0], every[1][:40]]
    if maps == "falling":
        given = [np.full((80, 100), u) for u in (40.0, 20.0, 60.0)]
    with pytest.raises(InputError, match=message):
        calibrate_reference_plane(given, heights, pitch_mm_per_px=0.4)


def test_from_photographs_on_the_command_line(tmp_path):
    truth = ReferencePlaneGeometry(800.0, 300.0, 0.5)
    settings = PairSettings(fringes=12, noise=1.0, bits=8, seed=1)
    for height in (0.0, 4.0, 8.0, 12.0):
        pair = capture_pair(np.full((200, 240), height), truth, settings)
        write_frame(tmp_path / f"{height:g}.png", pair.object)
    given = [f"--plane={h:g}={tmp_path}/{h:g}.png" for h in (4.0, 8.0, 12.0)]
    out = tmp_path / "g.toml"
    done = run(
        *("calibrate-plane", "--reference", tmp_path / "0.png", *given, "--out", out),
        *("--pitch-mm-per-px", "0.5", "--json", "-"),
    )
    content = json.loads(done.stdout)
    # Such low planes determine the ratio l/d₀ well, but not l and d₀ separately.
    assert content["distance_mm"] / content["baseline_mm"] == pytest.approx(800 / 300, rel=0.03)
    pixels = tmp_path / "p.npz"
    run("calibrate-plane", "--reference", tmp_path / "0.png", *given, "--out", pixels)
    for geometry in (out, pixels):
        done = run(
            *("reconstruct", "--reference", tmp_path / "0.png", "--object", tmp_path / "8.png"),
            *("--geometry", geometry, "--json", "-"),
        )
        assert json.loads(done.stdout)["median"] == pytest.approx(8.0, abs=0.1)
        assert json.loads(done.stdout)["unit"] == "mm"
    bad = run(
        "calibrate-plane",
        "--reference",
        tmp_path / "0.png",
        "--plane=ten",
        "--out",
        out,
        "--pitch-mm-per-px",
        "1",
        code=2,
    )
    assert "mm=image" in bad.stderr
    pair = read_pair(tmp_path / "0.png", tmp_path / "8.png")
    found = reconstruct(pair, geometry=read_reference_plane(pixels))
    assert found.surface.unit == "mm"
