"""Findings of pairs: what was seen and what to do, and none on clean captures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import fringeworks as fw
from fringeworks import Pair, reconstruct, unwrap
from fringeworks.cli import (
    app,
    commands,  # noqa: F401, registers them
)
from fringeworks.files import read_surface
from fringeworks.pair import plain_reference
from fringeworks.pair.unwrap import MAX_CG_STEPS
from fringeworks.pipeline.pair_findings import pair_findings
from fringeworks.report import summarise
from fringeworks.simulate.scene import standard_scene
from tests.grids import quick

pytestmark = pytest.mark.statistical


def small_scene(**settings):
    chosen = {"size": 160, "height_mm": 50, "fringes": 8, "bits": 8, "noise": 1, **settings}
    return standard_scene("parabola", **chosen)


def kinds(result):
    return [finding.kind for finding in result.warnings]


def told(figures):
    """Kinds of the findings among figures that are more than notes."""
    return [f["kind"] for f in figures["findings"] if f["severity"] != "note"]


def the_finding(result, kind):
    """The only finding, which says what was seen and what to do, and is also among the notes."""
    assert kinds(result) == [kind]
    finding = result.warnings[0]
    assert finding.seen
    assert finding.advice
    assert finding.text in result.notes
    return finding


@pytest.mark.parametrize("seed", quick(range(20), *range(8)))
def test_clean_captures_have_no_findings(seed):
    rng = np.random.default_rng(seed)
    shape = ("parabola", "sphere", "cylinder", "cube")[seed % 4]
    pair = standard_scene(
        shape,
        size=160,
        height_mm=float(rng.uniform(10, 60)),
        fringes=float(rng.uniform(8, 16)),
        bits=8,
        noise=float(rng.uniform(0.5, 3)),
        gamma=float(rng.uniform(1, 2.2)),
        axis=("x", "y")[seed % 2],
        seed=seed,
    )
    for method in ("windowed", "fourier"):
        result = reconstruct(pair, method)
        assert result.warnings == ()
        assert result.converged
        assert result.surface.converged


def test_masked_pixels_are_not_lost():
    mask = np.zeros((160, 160), bool)
    mask[60:100, 60:100] = True
    result = reconstruct(replace(small_scene(), mask=mask), "fourier")
    assert result.warnings == ()


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 44.0, 46.0])
def test_tilted_fringes_are_not_turned(tilt_deg):
    """Noise may put fringes at 45° on either axis; that is no turned frame."""
    y, x = np.mgrid[:160, :160]
    t = np.cos(np.radians(tilt_deg)) * x + np.sin(np.radians(tilt_deg)) * y
    rng = np.random.default_rng(1)
    frames = [120 + 80 * np.cos(t / 2.5) + rng.standard_normal(t.shape) for _ in range(2)]
    assert reconstruct(Pair(*frames), "fourier").warnings == ()
    turned = reconstruct(Pair(frames[0], np.rot90(frames[1]).copy()), "fourier")
    assert "turned frame" in kinds(turned)


def test_a_turned_frame_is_reported():
    pair = small_scene()
    turned = Pair(pair.reference, np.rot90(pair.object).copy())
    result = reconstruct(turned, "fourier")
    finding = next(f for f in result.findings if f.kind == "turned frame")
    assert finding.figures["angle_deg"] == pytest.approx(90, abs=5)
    assert finding.advice


@pytest.mark.parametrize("method", ["windowed", "fourier"])
def test_swapped_frames_are_reported(method):
    pair = small_scene()
    swapped = Pair(pair.object, pair.reference, axis="x", geometry=pair.geometry)
    finding = the_finding(reconstruct(swapped, method), "swapped frames")
    assert finding.figures["share_behind"] > 0.95


@pytest.mark.parametrize("method", ["ifa", "sifa", "gsifa", "exact"])
def test_row_methods_on_noisy_frames_are_advised_against(method):
    finding = the_finding(reconstruct(small_scene(noise=3), method), "row method")
    assert "windowed" in finding.advice
    assert reconstruct(standard_scene("parabola", size=160, fringes=8), method).warnings == ()


def test_mostly_lost_pixels_are_reported():
    pair = small_scene()
    frame = pair.object.copy()
    frame[:, 60:] = np.random.default_rng(2).integers(118, 122, frame[:, 60:].shape)
    result = reconstruct(replace(pair, object=frame), "fourier")
    finding = next(f for f in result.findings if f.kind == "lost pixels")
    assert finding.figures["measured_share"] < 0.5
    assert "low modulation" in finding.seen


def test_a_background_that_does_not_settle_is_reported(monkeypatch):
    single = replace(small_scene(), reference=None)
    assert reconstruct(single, "fourier").converged
    monkeypatch.setattr(plain_reference, "MAX_FIT_STEPS", 1)
    result = reconstruct(single, "fourier")
    assert not result.converged
    assert not result.surface.converged
    assert "convergence" in kinds(result)


def test_least_squares_says_whether_it_converged():
    y, x = np.mgrid[:60, :60]
    rng = np.random.default_rng(0)
    phase = np.angle(np.exp(1j * (0.3 * x + 0.2 * y + rng.standard_normal(x.shape))))
    assert unwrap(phase, algorithm="least_squares").converged
    assert unwrap(phase, quality=rng.uniform(0.5, 1, x.shape), algorithm="least_squares").converged
    assert MAX_CG_STEPS == 300
    wild = 10.0 ** rng.uniform(-6, 0, x.shape)
    assert not unwrap(phase, quality=wild, algorithm="least_squares").converged
    for algorithm in ("auto", "reliability", "guided"):
        assert unwrap(phase, quality=wild, algorithm=algorithm).converged


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
def test_findings_travel_through_files(tmp_path, suffix):
    surface = reconstruct(small_scene(noise=3), "exact").surface
    unsteady = replace(surface, converged=False)
    for written in (surface, unsteady):
        path = tmp_path / f"height{suffix}"
        fw.files.write_surface(path, written)
        read = read_surface(path)
        assert read.converged is written.converged
        assert read.findings == written.findings != ()


@pytest.mark.parametrize("suffix", [".x3p", ".gsf"])
def test_formats_without_findings_leave_them_unknown(tmp_path, suffix):
    path = tmp_path / f"height{suffix}"
    fw.files.write_surface(path, reconstruct(small_scene(), "fourier").surface)
    assert read_surface(path).converged is None


def test_the_command_line_tells_and_writes_findings(tmp_path):
    capture, json_file = tmp_path / "capture", tmp_path / "result.json"
    fw.files.write_pair(capture, small_scene(noise=3))
    result = CliRunner().invoke(
        app.app, ["reconstruct", str(capture), "--method", "exact", "--json", str(json_file)]
    )
    assert result.exit_code == 0, result.output
    assert "single pixels" in " ".join(result.output.split())
    figures = json.loads(json_file.read_text())
    assert figures["converged"] is True
    assert told(figures) == ["row method"]
    assert told(summarise(reconstruct(small_scene(), "fourier"))) == []


def test_orders_torn_from_the_rows_above_and_below_are_told():
    pair = small_scene()
    found = fw.analyse(pair)
    assert "torn orders" not in [f.kind for f in pair_findings(pair, found)]
    torn = found.displacement_px.copy()
    torn[60:90, :80] += found.period_px
    seen = pair_findings(pair, replace(found, displacement_px=torn))
    finding = next(f for f in seen if f.kind == "torn orders")
    assert finding.figures["length_px"] == pytest.approx(160, rel=0.1)
