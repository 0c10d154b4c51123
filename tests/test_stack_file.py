"""Stacks and coordinates on disk, and the commands for them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile

from fringeworks import InputError, PatternPlan, Reason, decode
from fringeworks.files import (
    read_coordinates,
    read_stack,
    write_coordinates,
    write_patterns,
    write_plan,
)
from fringeworks.files.images import write_frame
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from tests.commands import run
from tests.stacks import guarded, multi, take

pytestmark = pytest.mark.statistical

PLAN = multi((1, 8), 4, (300, 40))


@pytest.fixture
def folder(tmp_path):
    """A folder of images whose names sort by their numbers only."""
    write_plan(tmp_path / "plan.toml", PLAN)
    for k, frame in enumerate(take(PLAN)):
        write_frame(tmp_path / f"shot{k + 7}.png", frame)
    return tmp_path


def test_folder_with_a_plan(folder):
    stack = read_stack(folder)
    np.testing.assert_array_equal(np.stack(stack.frames), take(PLAN))
    assert stack.plan.frames == 8
    (folder / "shot9.png").unlink()
    with pytest.raises(
        InputError, match=r"plan has 8 frames, got 7 images; missing: x-phase-300px-2 \(shot9.png\)"
    ):
        read_stack(folder)


def test_folder_with_a_capture_file(folder):
    names = [f"shot{k}.png" for k in range(7, 15)]
    text = f"""
kind = "stack"
frames = {json.dumps(names)}
saturation = 250
[devices]
camera = "left"
projector = "bench"
"""
    (folder / "capture.toml").write_text(text)
    stack = read_stack(folder)
    assert (stack.saturation, stack.camera, stack.projector) == (250, "left", "bench")
    for change, words in (
        (("shot7.png", "shot1.png"), "shot1.png: expected an image file"),
        (("saturation", "saturated"), "unknown key saturated"),
        (('"stack"', '"pair"'), "got a pair"),
        (('"stack"', '"film"'), "kind"),
    ):
        (folder / "capture.toml").write_text(text.replace(*change))
        with pytest.raises(InputError, match=words):
            read_stack(folder)


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".npz"])
def test_stacks_in_one_file(tmp_path, suffix):
    frames = take(PLAN)
    path = tmp_path / f"stack{suffix}"
    if suffix == ".tif":
        tifffile.imwrite(path, frames)
    elif suffix == ".npy":
        np.save(path, frames)
    else:
        np.savez(path, frames=frames)
    with pytest.raises(InputError, match="expected a plan, or a file plan.toml beside it"):
        read_stack(path)
    plan = write_plan(tmp_path / "other.toml", PLAN)
    stack = read_stack(path, plan)
    np.testing.assert_array_equal(np.stack(stack.frames), frames)
    if suffix != ".npz":
        assert not stack.frames[0].flags.owndata  # still on disk
    expected = decode(frames, PLAN).x.coordinate_px
    np.testing.assert_array_equal(decode(stack.frames, stack.plan).x.coordinate_px, expected)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="expected"):
        read_stack(path, plan)


def test_coordinates_keep_everything(tmp_path):
    found = decode(take(PLAN), PLAN, keep_phases=True)
    again = read_coordinates(write_coordinates(tmp_path / "x.npz", found))
    for name in ("coordinate_px", "sigma_px", "modulation", "background", "reason", "phase_rad"):
        np.testing.assert_array_equal(getattr(again.x, name), getattr(found.x, name))
    assert again.x.periods_px == found.x.periods_px
    assert again.noise == found.noise
    assert again.notes == found.notes
    assert (again.y, again.x.repeats_px) == (None, None)
    with pytest.raises(InputError, match="expected one of .npz, .csv"):
        write_coordinates(tmp_path / "x.tif", found)
    (tmp_path / "bad.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match="expected coordinates"):
        read_coordinates(tmp_path / "bad.npz")


def test_commands_from_plan_to_coordinates(tmp_path):
    plan = tmp_path / "plan.toml"
    shown = run(
        *("plan", "--projector-size", "320x48", "--frames", 9, "--min-period", 20, "--out", plan),
        *("--json", tmp_path / "plans.json"),
    ).stdout
    assert "hierarchical" in shown
    best = json.loads((tmp_path / "plans.json").read_text())["proposals"][0]
    shown = run("patterns", plan, "--out", tmp_path / "shots").stdout
    assert f"wrote {best['frames']} patterns" in shown
    out, picture = tmp_path / "x.npz", tmp_path / "x.png"
    shown = run(
        *("decode", tmp_path / "shots", "--out", out, "--json", tmp_path / "m.json"),
        *("--figure", picture, "--noise", 0.5),
    ).stdout
    assert "median σ" in shown
    found = read_coordinates(out).x
    assert np.nanmax(np.abs(found.coordinate_px - np.arange(320))) < 0.2
    figures = json.loads((tmp_path / "m.json").read_text())
    assert figures["axes"]["x"]["reasons"] == {"ok": 320 * 48}
    assert picture.stat().st_size > 10_000
    run("patterns", plan, "--out", tmp_path / "tiff", "--format", "tiff")
    again = run("decode", tmp_path / "tiff" / "patterns.tif", "--json", "-").stdout
    assert json.loads(again)["axes"]["x"]["failed_fraction"] == 0.0


def test_commands_say_what_is_wrong(folder):
    out = folder / "x.npz"
    for arguments, words in (
        (("plan", "--projector-size", "1920", "--frames", 12), "as 1920x1080"),
        (("plan", "--projector-size", "1920x1080", "--frames", 2), "3 or more"),
        (("plan", "--projector-size", "300x40", "--frames", 9, "--kind", "x"), "--kind: expected"),
        (("patterns", folder / "none.toml", "--out", folder), "no such file"),
        (("decode", folder / "nothing"), "nothing there"),
        (("decode", folder, "--gain", 0.1), "--gain: expected together with --noise"),
        (("decode", folder, "--out", folder / "x.tif"), "expected one of .npz, .csv"),
        (("decode", folder, "--out", folder / "no" / "x.npz"), "expected a writable folder"),
    ):
        assert words in run(*arguments, code=2).stderr
    (folder / "plan.toml").write_text((folder / "plan.toml").read_text().replace("300.0", "75.0"))
    refused = run("decode", folder, "--out", out, code=2).stderr
    assert "repeat after 75 px, but the projector has 300 px" in refused
    assert not out.exists()
    drawn = run("patterns", folder / "plan.toml", "--out", folder / "p").stdout
    assert "warning (whole periods): coordinates along x repeat after 75 px" in drawn
    code = GrayCode("x", 100.0, 300)
    wide = PatternPlan(300, 40, (PhaseSteps("x", 75.0, equal_steps(4)), code))
    with pytest.raises(InputError, match="expected 100 px or more for Gray-code cells"):
        write_patterns(folder / "q", wide)


def test_response_is_measured_from_a_stack_and_taken_out(tmp_path):
    plan = guarded(20.0, 3, (640, 240))
    x = 0.977 * np.arange(640.0)
    shots = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = np.tile(block.values(x + 0.0, k) ** 1.8, (240, 1))
            seen = 12 + 200 * light + np.random.default_rng(k).standard_normal(light.shape)
            shots.append(np.rint(seen).astype(np.uint8))
    np.save(tmp_path / "plane.npy", np.stack(shots))
    write_plan(tmp_path / "plan.toml", plan)
    devices = ("--camera-name", "left", "--projector-name", "bench")
    out = tmp_path / "response.toml"
    assert (
        "camera: expected its name"
        in run("response", tmp_path / "plane.npy", "--out", out, code=2).stderr
    )
    shown = run("response", tmp_path / "plane.npy", "--out", out, *devices).stdout
    assert "γ = 1.8" in shown or "γ = 1.79" in shown
    errors = []
    for options in (("--planned-steps",), ("--response", out, *devices)):
        run("decode", tmp_path / "plane.npy", "--out", tmp_path / "x.npz", *options)
        found = read_coordinates(tmp_path / "x.npz").x
        assert (found.reason == Reason.OK).mean() > 0.98
        errors.append(float(np.nanstd(found.coordinate_px - x)))
    assert errors[1] < 0.25 * errors[0]
    wrong = ("--response", out, "--camera-name", "right", "--projector-name", "bench")
    refused = run("decode", tmp_path / "plane.npy", *wrong, code=2).stderr
    assert "the capture is of 'right'" in refused
