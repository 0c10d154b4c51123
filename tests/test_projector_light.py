"""Black and white frames of a pair: ambient light and paint that the captures show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.signal.response import Response
from tests.commands import run
from tests.grids import thinned

pytestmark = pytest.mark.statistical

SHAPE = (220, 320)
PERIOD = 20.0


def scene(seed, *, ambient=True, noise=1.0):
    """A pair of a smooth body with hard paint under a lamp with a shadow edge, and its truth, px."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    truth = 9.0 * np.exp(-((x - 160) ** 2 + (y - 110) ** 2) / 4000.0)
    angle = rng.uniform(0, np.pi)
    paint = np.where(np.sin((x * np.cos(angle) + y * np.sin(angle)) / 9.0) > 0.2, 0.35, 1.0)
    paint = ndimage.gaussian_filter(paint, 0.7)
    vignetting = 1.0 - 0.3 * ((x - 160) ** 2 + (y - 110) ** 2) / 160**2 / 2
    lamp = np.where(ambient & (x + 0.3 * y > 200), 45.0, 15.0)

    def fringes(u):
        phase = 2 * np.pi * (x - u) / PERIOD
        return vignetting * (75 + 50 * np.cos(phase) + 9 * np.cos(2 * phase))

    def photograph(light):
        return np.clip(np.rint(light + noise * rng.standard_normal(SHAPE)), 0, 255).astype(np.uint8)

    pair = fw.Pair(
        reference=photograph(15 + fringes(0 * x)),
        object=photograph(8 + paint * (lamp + fringes(truth))),
        black=photograph(8 + paint * lamp),
        white=photograph(8 + paint * (lamp + 150 * vignetting)),
        axis="x",
    )
    return pair, truth, paint


def errors(pair, truth, method):
    found = fw.analyse(pair, method)
    inner = np.s_[20:-20, 40:-40]
    error = (found.displacement_px - truth)[inner]
    return error, found.sigma_px[inner], found


# Filters flatten the body itself: without paint and noise they have 0.04 to 0.1 px left.
MOST_PX = {"windowed": 0.03, "fourier": 0.06, "windowed_fourier": 0.1, "wavelet": 0.11}


@thinned(strength=1, method=list(MOST_PX), seed=[1, 2, 3])
def test_a_white_frame_takes_the_paint_away(method, seed):
    pair, truth, _ = scene(seed)
    plain = replace(pair, black=None, white=None)
    without, _, _ = errors(plain, truth, method)
    error, sigma, found = errors(pair, truth, method)
    assert np.isfinite(error).mean() > 0.99
    assert np.nanmean(np.abs(error)) < min(MOST_PX[method], 0.8 * np.nanmean(np.abs(without)))
    covered = [np.nanmean(np.abs(error) < k * sigma) for k in (1, 2)]
    assert covered[0] > 0.6, covered
    assert covered[1] > 0.9, covered
    assert found.albedo is not None


def test_albedo_and_modulation_are_those_of_the_paint():
    pair, truth, paint = scene(4)
    inner = np.s_[20:-20, 40:-40]
    for method in ("windowed", "fourier"):
        _, _, found = errors(pair, truth, method)
        ratio = (found.albedo / paint)[inner]
        assert np.std(ratio) / np.mean(ratio) < 0.1  # vignetting and noise are left
        dark = paint[inner] < 0.4
        assert np.nanmedian(found.modulation_ratio[inner][dark]) == pytest.approx(0.36, abs=0.05)


def test_sigma_is_larger_on_dark_paint():
    pair, _, paint = scene(5, noise=5.0)
    dark, bright = (ndimage.binary_erosion(p, iterations=3) for p in (paint < 0.4, paint > 0.95))
    for method in ("fourier", "wavelet"):
        found = fw.analyse(pair, method)
        ratio = np.nanmedian(found.sigma_px[dark]) / np.nanmedian(found.sigma_px[bright])
        assert ratio > 1.1, method


def test_a_black_frame_takes_the_edge_of_a_shadow_away():
    pair, truth, _ = scene(6)
    plain = replace(pair, black=None, white=None)
    black = replace(pair, white=None)
    for method in ("windowed", "fourier"):
        # Without it, some pixels are not determined.
        without, known = (
            np.mean(np.abs(errors(p, truth, method)[0]) < 0.1) for p in (plain, black)
        )
        assert known > without, method


def test_a_black_level_is_a_number():
    pair, _, _ = scene(7, ambient=False)
    level = fw.pair.prepare(replace(pair, black=8.0, white=None)).object
    np.testing.assert_allclose(level, pair.object - 8.0)


def test_what_does_not_fit_is_refused():
    pair, _, _ = scene(8)
    with pytest.raises(fw.InputError, match=r"black frame: expected shape \(220, 320\)"):
        fw.analyse(replace(pair, black=pair.black[:-1]))
    with pytest.raises(fw.InputError, match="white frame: expected shape"):
        fw.analyse(replace(pair, white=pair.white[:, 1:]))
    with pytest.raises(fw.InputError, match="black: expected less light than in the object frame"):
        fw.analyse(replace(pair, black=255.0))
    with pytest.raises(fw.InputError, match="black: expected finite counts, got none"):
        fw.analyse(replace(pair, black=np.nan))
    with pytest.raises(fw.InputError, match="below the sensor's limit"):
        fw.analyse(replace(pair, white=np.full(SHAPE, 255, np.uint8)))


def test_captures_keep_black_and_white(tmp_path):
    pair, _, _ = scene(9)
    folder = tmp_path / "capture"
    fw.files.write_pair(folder, pair)
    again = fw.files.read_capture(folder)
    np.testing.assert_array_equal(again.black, pair.black)
    np.testing.assert_array_equal(again.white, pair.white)
    fw.files.write_pair(folder, replace(pair, black=8.0))
    assert fw.files.read_capture(folder).black == 8.0
    np.savez(tmp_path / "pair.npz", reference=pair.reference, object=pair.object, white=pair.white)
    assert fw.files.read_capture(tmp_path / "pair.npz").white is not None


def test_the_command_takes_black_and_white(tmp_path):
    pair, truth, _ = scene(10)
    for name in ("reference", "object", "black", "white"):
        fw.files.write_frame(tmp_path / f"{name}.png", getattr(pair, name))
    frames = [word for n in ("reference", "object") for word in (f"--{n}", tmp_path / f"{n}.png")]
    means = []
    for more in ([], ["--black", tmp_path / "black.png", "--white", tmp_path / "white.png"]):
        out = tmp_path / "u.npz"
        run("reconstruct", *frames, *more, "--out", out)
        with np.load(out) as found:
            values = found["values"]
        means.append(np.nanmean(np.abs(values - truth)[20:-20, 40:-40]))
    assert means[1] < 0.5 * means[0]


def test_figure_and_page_show_the_albedo():
    pair, _, _ = scene(11)
    result = fw.reconstruct(pair)
    titles = [axes.get_title() for axes in result.plot().axes]
    assert "albedo, object over reference" in titles
    packed = fw.report.pack_surface(result)
    layer = next(one for one in packed.header["layers"] if one["name"] == "albedo")
    assert layer["unit"] == ""
    assert not any(one["name"] == "walls" for one in packed.header["layers"])


def test_a_response_is_of_the_light_without_paint():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    paint = np.where(np.hypot(x - 150, y - 100) < 60, 0.4, 1.0)
    light = 150.0 * (0.5 + 0.4 * np.cos(2 * np.pi * x / PERIOD)) ** 2.2
    plain = fw.Pair(light, light, axis="x", camera="c", projector="p")
    painted = replace(
        plain, object=10 + paint * (20 + light), black=10 + paint * 20, white=10 + paint * 170
    )
    response = Response("c", "p", 2.2, 4, 1.0, np.zeros((1, 8)), (1.0,), 0.0)
    one, other = (fw.pair.prepare(p, response=response).object for p in (plain, painted))
    # A root of almost 0 multiplies rounding.
    np.testing.assert_allclose(other / one, np.full(SHAPE, np.mean(other / one)), rtol=1e-5)


def test_a_white_frame_without_light_is_refused():
    pair, _, _ = scene(12)
    white = np.zeros(SHAPE, np.uint8)
    white[:20] = 200
    with pytest.raises(fw.InputError, match="white frame: expected light, got a median of 0"):
        fw.analyse(replace(pair, black=None, white=white))
