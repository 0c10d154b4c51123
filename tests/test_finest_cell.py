"""The finest Gray-code cell that a camera resolves: proposed, and measured by the set-up."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import fringeworks as fw
from fringeworks.files.setup import read_setup, write_setup
from fringeworks.patterns import GrayCode
from fringeworks.patterns.gray_code import finest_cell
from fringeworks.scan.setup import set_up
from tests.commands import run
from tests.virtual_devices import Screen, bench

WIDTH, SUPERSAMPLED, ROWS = 1024, 8, 40
DARK, BRIGHT, NOISE = 40.0, 160.0, 1.5
CAMERAS = [(scale, blur) for scale in (0.4, 1.0, 2.5) for blur in (0.3, 0.7, 1.0, 1.5)]


def photographs(plan, scale, blur, *, seed=0, noise=NOISE, bright=BRIGHT):
    """Frames of a camera of ``scale`` projector px per pixel, and the true coordinates."""
    rng = np.random.default_rng(seed)
    columns = int(900 / scale)
    fine = np.arange(columns * SUPERSAMPLED) / SUPERSAMPLED * scale
    at = 5.0 + fine + rng.uniform(0.0, scale, (ROWS, 1)) + 10.0 * np.sin(fine / 150.0)
    pixels = np.clip(np.floor(at), 0, WIDTH - 1).astype(int)
    frames = []
    for picture in fw.encode(plan):
        light = scipy.ndimage.gaussian_filter1d(
            picture[0][pixels] / 255.0, blur * SUPERSAMPLED, axis=1
        )
        light = scipy.ndimage.uniform_filter1d(light, SUPERSAMPLED, axis=1)
        counts = DARK + (bright - DARK) * light[:, SUPERSAMPLED // 2 :: SUPERSAMPLED]
        counts = counts + rng.normal(0.0, noise, counts.shape)
        frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return np.stack(frames), at[:, SUPERSAMPLED // 2 :: SUPERSAMPLED] - 0.5


def proposed(scale, blur, **options):
    options = {"noise": NOISE, "modulation": 0.5 * (BRIGHT - DARK)} | options
    return fw.propose(WIDTH, ROWS, 14, camera_pixel_px=scale, blur_px=blur, **options)


def alone(scale, blur, **options):
    (found,) = (p for p in proposed(scale, blur, **options) if p.kind == "gray-alone")
    return found


def unresolved(decoded):
    return [finding for finding in decoded.findings if finding.kind == "resolution"]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("scale", "blur"), CAMERAS)
def test_the_proposed_code_is_resolved_and_no_coarser_than_needed(scale, blur, seed):
    found = alone(scale, blur)
    cell = found.plan.blocks[0].step_px
    frames, truth = photographs(found.plan, scale, blur, seed=seed)
    decoded = fw.decode(frames, found.plan)
    assert not unresolved(decoded)
    error = decoded.x.coordinate_px - truth
    ok = np.isfinite(error)
    assert ok.mean() > 0.99
    # The prediction is that of the cells; blurred borders tell more.
    assert np.sqrt(np.mean(error[ok] ** 2)) < 1.1 * found.sigma_px
    if cell > 1:
        # A cell of less than half the width is not resolved: at most one level is lost.
        finer = cell / 2.2 if cell / 2.2 >= 1.0 else 1.0
        plan = fw.PatternPlan(WIDTH, ROWS, (GrayCode("x", finer, WIDTH), *found.plan.blocks[1:]))
        frames, _ = photographs(plan, scale, blur, seed=seed)
        assert unresolved(fw.decode(frames, plan))
        assert finest_cell(scale, blur, NOISE / 60.0) == cell


def test_fringes_have_cells_that_the_camera_resolves():
    for blur in (0.5, 3.0):
        for proposal in proposed(2.5, blur, min_period_px=4.0):
            for block in proposal.plan.blocks:
                if isinstance(block, GrayCode):
                    assert block.step_px >= finest_cell(2.5, blur, NOISE / 60.0)


def test_noise_makes_cells_coarser_until_none_is_resolved():
    cells = [finest_cell(1.0, 1.5, ratio) for ratio in (0.01, 0.1, 0.15, 0.19)]
    assert cells == sorted(cells)
    assert cells[-1] > cells[0]
    assert finest_cell(1.0, 1.5, 0.25) is None
    kinds = {p.kind for p in proposed(1.0, 1.5, noise=12.0, modulation=60.0)}
    assert "gray-alone" not in kinds


def test_both_axes_and_few_frames():
    found = fw.propose(640, 480, 12, axes=("x", "y"), camera_pixel_px=0.5, blur_px=0.5)
    (plan,) = (p.plan for p in found if p.kind == "gray-alone")
    assert plan.frames <= 12
    assert [b.step_px for b in plan.blocks if isinstance(b, GrayCode)] == [20.0, 15.0]
    kinds = {p.kind for p in fw.propose(640, 480, 12, camera_pixel_px=0.5, max_period_px=40.0)}
    assert not kinds & {"gray", "gray-alone"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"camera_pixel_px": 0.0}, "camera_pixel_px: expected > 0"),
        ({"camera_pixel_px": float("nan")}, "camera_pixel_px: expected > 0"),
        ({"camera_pixel_px": 1.0, "blur_px": -1.0}, "blur_px: expected 0 camera px or more"),
        ({"blur_px": 1.0}, "blur_px: expected together with camera_pixel_px"),
    ],
)
def test_nonsense_is_refused(options, words):
    with pytest.raises(fw.InputError, match=words):
        fw.propose(640, 480, 12, **options)


class Soft(Screen):
    """A screen whose light the camera sees blurred, through pixels of ``span`` projector px."""

    def __init__(self, rows, columns, span, blur):
        super().__init__(rows, columns)
        self._span, self._blur = span, blur
        self._lit = np.zeros(self.shape, bool)

    def projected(self, light):
        fine = 5
        rows, columns = self.shape
        places = []
        for count in (rows, columns):
            at = (np.arange(count * fine) + 0.5) / fine * self._span
            places.append(np.floor(4.0 + at).astype(int))
        inside = [np.clip(p, 0, n - 1) for p, n in zip(places, light.shape, strict=True)]
        dense = light[np.ix_(*inside)]
        dense = scipy.ndimage.gaussian_filter(dense, self._blur * fine)
        return 0.6 * dense.reshape(rows, fine, columns, fine).mean(axis=(1, 3))


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("span", "blur"),
    [
        *(
            pytest.param(s, b, marks=pytest.mark.long)
            for s, b in ((0.5, 1.5), (1.0, 0.4), (2.0, 0.8))
        ),
        (1.0, 1.2),
    ],
)
def test_the_setup_measures_pixel_and_blur(tmp_path, span, blur):
    rows, columns = 96, 128
    b = bench(
        {"width_px": int(columns * span) + 8, "height_px": int(rows * span) + 8},
        scene=Soft(rows, columns, span, blur),
    )
    found = set_up(b.projector, b.camera)
    for stripes in found.stripes:
        assert stripes.camera_pixel_px == pytest.approx(span, rel=0.03)
        assert stripes.blur_px == pytest.approx(blur, rel=0.1, abs=0.1)
    assert found.finest_cell_px in (
        finest_cell(span, blur * 0.9, 0.03),
        finest_cell(span, blur, 0.03),
        finest_cell(span, blur * 1.1, 0.03),
    )
    assert fw.report.summarise(found)["finest_cell_px"] == found.finest_cell_px
    write_setup(tmp_path / "setup.toml", found, projector="virtual", camera="virtual")
    stored = read_setup(tmp_path / "setup.toml")
    words = ("--setup", tmp_path / "setup.toml", "--frames", "14", "--kind", "gray-alone")
    run("plan", *words, "--out", tmp_path / "plan.toml")
    code = fw.files.read_plan(tmp_path / "plan.toml").blocks[0]
    assert stored.blur_px in {s.blur_px for s in found.stripes}
    assert code.step_px == found.finest_cell_px


def test_the_command_proposes_it(tmp_path):
    size = ("--projector-size", "1024x40", "--frames", "14", "--noise", "1.5", "--modulation", "60")
    words = ("--camera-pixel", "2.5", "--blur-px", "1.0", "--kind", "gray-alone")
    run("plan", *size, *words, "--out", tmp_path / "plan.toml")
    assert fw.files.read_plan(tmp_path / "plan.toml") == alone(2.5, 1.0).plan
    done = run("plan", *size[:4], "--blur-px", "1.0", code=2)
    assert "blur_px: expected together with camera_pixel_px" in done.stderr
