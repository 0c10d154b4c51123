"""Unwrapping: the kernel against its oracle, and equality modulo 2π."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from fringeworks import InputError, unwrap
from tests.oracles.unwrap import unwrap_reliability, wrap


@pytest.mark.parametrize("seed", range(4))
def test_kernel_agrees_with_its_oracle(seed):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:24, :30]
    truth = 0.9 * x + 0.03 * y**2 + 0.5 * rng.standard_normal(x.shape)
    mask = rng.random(x.shape) > 0.1
    phase = wrap(truth).astype(np.float32)
    phase_rad, region, *_ = unwrap(phase, mask, algorithm="reliability")
    expected = unwrap_reliability(phase.astype(float), mask)
    largest = region == 1
    difference = (phase_rad - expected)[largest] / (2 * np.pi)
    assert np.ptp(np.round(difference)) == 0
    np.testing.assert_allclose(difference, np.round(difference), atol=1e-5)
    assert np.isnan(phase_rad[~mask]).all()


def test_tiles_make_the_tree_of_the_whole_map():
    """With noise the result depends on the path; tiles of 64 px must not change the path."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:100, :90]
    truth = 0.5 * x + 0.004 * (y - 50.0) ** 2 + 0.7 * rng.standard_normal(x.shape)
    phase = wrap(truth).astype(np.float32)
    mask = rng.random(x.shape) > 0.02
    unwrapped = unwrap(phase, mask, algorithm="reliability")
    assert unwrapped.residues > 20
    expected = unwrap_reliability(phase, mask)
    difference = np.round((unwrapped.phase - expected)[unwrapped.region == 1] / (2 * np.pi))
    # Kernel and oracle round the sums of four squares differently, so ties may differ.
    assert np.mean(difference != np.median(difference)) < 0.002


@settings(max_examples=20, deadline=None)
@given(
    slope_x=st.floats(-2.0, 2.0),
    slope_y=st.floats(-2.0, 2.0),
    bend=st.floats(-0.01, 0.01),
    h=st.integers(2, 40),
    w=st.integers(2, 40),
)
def test_smooth_phase_is_exact(slope_x, slope_y, bend, h, w):
    y, x = np.mgrid[:h, :w].astype(float)
    truth = slope_x * x + slope_y * y + bend * (x - w / 2) ** 2
    phase_rad, region, *_ = unwrap(wrap(truth))
    assert (region == 1).all()
    offset = (phase_rad - truth) / (2 * np.pi)
    np.testing.assert_allclose(offset, np.round(offset.flat[0]), atol=1e-4)


def test_noise_causes_no_error_where_steps_stay_below_pi():
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:512, :512]
    truth = 0.5 * x + 40 * np.exp(-((x - 256) ** 2 + (y - 200) ** 2) / 20000)
    truth = truth + 0.3 * rng.standard_normal(x.shape)
    phase_rad = unwrap(wrap(truth)).phase
    offset = (phase_rad - truth) / (2 * np.pi)
    assert np.abs(offset - np.round(np.median(offset))).max() < 1e-3


def wrong_share(unwrapped, truth):
    """Share of pixels with a wrong order; the constant of each region is free."""
    wrong = 0
    for label in range(1, int(unwrapped.region.max()) + 1):
        inside = unwrapped.region == label
        order = np.round((unwrapped.phase - truth)[inside] / (2 * np.pi))
        wrong += int((order != np.median(order)).sum())
    return wrong / int((unwrapped.region > 0).sum())


def noisy_hill(n, noise, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:n, :n].astype(float)
    hill = np.exp(-((x - 0.5 * n) ** 2 + (y - 0.5 * n) ** 2) / (0.08 * n**2))
    return 0.3 * x + 0.1 * y + 0.1 * n * hill + noise * rng.standard_normal(x.shape)


@pytest.mark.parametrize("seed", range(3))
def test_guided_keeps_the_order_in_noise(seed):
    truth = noisy_hill(512, 0.8, seed)
    unwrapped = unwrap(wrap(truth))
    assert unwrapped.algorithm == "guided"
    assert 0.01 < unwrapped.residues / truth.size < 0.04
    # Noise beyond π (0.009 % of all pixels) cannot be distinguished from a whole period.
    assert wrong_share(unwrapped, truth) <= 2e-4
    plain = unwrap(wrap(truth), algorithm="reliability")
    assert wrong_share(plain, truth) > 0.01


def cliffs(n=256):
    """Steps of many periods across a masked curve, around a closed one, and along a spiral."""
    y, x = np.mgrid[:n, :n].astype(float)
    base = 0.3 * x + 0.1 * y
    curve = 0.45 * n + 0.1 * n * np.sin(6 * y / n)
    height = 37.3 * np.clip((y - 0.15 * n) / (0.7 * n), 0, 1)
    yield "curve", base + height * (x > curve), (np.abs(x - curve) >= 1.5) | (y < 0.15 * n)
    radius = np.hypot(x - 0.5 * n, y - 0.5 * n)
    yield "disc", base + 50 * (radius < 0.25 * n), np.abs(radius - 0.25 * n) >= 1.2
    angle = np.arctan2(y - 0.5 * n, x - 0.5 * n)
    arm = radius / (0.12 * n) - angle / (2 * np.pi)
    away = np.minimum(arm % 1, 1 - arm % 1) * 0.12 * n
    shear = 0.5 * base + 8.0 * (angle + 2 * np.pi * np.floor(arm))
    yield "spiral", shear, (away > 1.5) & (radius > 0.03 * n)


@pytest.mark.parametrize("noise", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("case", list(cliffs()), ids=lambda case: case[0])
def test_masked_cliffs_and_shear(case, noise):
    _, truth, mask = case
    truth = truth + noise * np.random.default_rng(3).standard_normal(truth.shape)
    unwrapped = unwrap(wrap(truth), mask)
    plain = unwrap(wrap(truth), mask, algorithm="reliability")
    assert wrong_share(unwrapped, truth) <= wrong_share(plain, truth)
    if noise < 0.5:
        assert wrong_share(unwrapped, truth) == 0.0
    else:
        assert wrong_share(unwrapped, truth) < 5e-4


def terrain(n, steepness, seed):
    """Rough terrain; differences of neighbours have an s.d. of ``steepness`` rad."""
    rng = np.random.default_rng(seed)
    f = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.fftfreq(n)[None, :])
    f[0, 0] = 1.0
    z = np.fft.ifft2(np.fft.fft2(rng.standard_normal((n, n))) * f**-1.8).real
    return z * steepness / np.diff(z, axis=0).std()


def scenes(n=192):
    """Steep, masked and sheared terrain and cliffs."""
    y, x = np.mgrid[:n, :n].astype(float)
    everywhere = np.ones((n, n), bool)
    for steepness in (0.6, 1.0, 1.3):
        rough = terrain(n, steepness, int(10 * steepness))
        slope = np.maximum(*np.abs(np.gradient(rough)))
        yield f"terrain {steepness}", rough, everywhere
        yield f"terrain {steepness} masked", rough, ndimage.binary_opening(slope < 2.2)
    shear = np.where(x < n / 2, 0.1 * y, 0.6 * y) + 0.05 * x
    yield "shear", shear, np.abs(x - n / 2) >= 2
    peak = 80.0 * np.exp(-((x - 0.5 * n) ** 2 + (y - 0.5 * n) ** 2) / (0.045 * n**2))
    yield "peak", 1.5 * peak, everywhere
    radius = np.hypot(x - 0.5 * n, y - 0.5 * n)
    yield "cliff", 0.3 * x + 0.1 * y + 2.8 * (radius < 0.25 * n), everywhere


@pytest.mark.parametrize("noise", [0.0, 0.3, 0.6, 0.8, 1.0])
@pytest.mark.parametrize("case", list(scenes()), ids=lambda case: case[0])
def test_auto_is_never_worse_than_reliability(case, noise):
    _, truth, mask = case
    truth = truth + noise * np.random.default_rng(5).standard_normal(truth.shape)
    plain = unwrap(wrap(truth), mask, algorithm="reliability")
    found = unwrap(wrap(truth), mask)
    assert wrong_share(found, truth) <= wrong_share(plain, truth) + 1e-3


def test_steep_terrain_needs_no_guide():
    """A few residues on steep terrain are not noise."""
    truth = terrain(256, 1.3, 0)
    found = unwrap(wrap(truth))
    assert found.residues / truth.size > 0.01
    assert wrong_share(found, truth) < 0.05


def test_steep_terrain_with_noise_needs_a_narrow_guide():
    truth = terrain(256, 1.0, 1)
    truth += 0.7 * np.random.default_rng(0).standard_normal(truth.shape)
    assert wrong_share(unwrap(wrap(truth)), truth) < 0.02
    assert wrong_share(unwrap(wrap(truth), algorithm="reliability"), truth) > 0.05


def test_longs_peak(real_data):
    """Steep terrain of Ghiglia and Pritt; scikit-image leaves 3.5 % wrong orders."""
    if not (real_data / "unwrap_longs").is_dir():
        pytest.skip("no unwrap_longs among the real captures")
    stem, shape = real_data / "unwrap_longs" / "longs.152x458", (458, 152)
    phase, mask, correlation = (
        np.fromfile(f"{stem}.{kind}", np.uint8).reshape(shape) for kind in ("phase", "mask", "corr")
    )
    truth = np.fromfile(f"{stem}.surf", ">f4").reshape(shape)
    wrapped = phase * (2 * np.pi / 256)
    assert wrong_share(unwrap(wrapped, mask > 0), truth) < 0.04
    assert wrong_share(unwrap(wrapped, mask > 0, quality=correlation / 255), truth) < 0.032


@pytest.mark.parametrize("seed", range(2, 6))
def test_quality_helps(seed):
    """Noise that differs from place to place, and a quality that says so."""
    rng = np.random.default_rng(seed)
    clean = noisy_hill(192, 0.0)
    quality = np.where(terrain(192, 1.0, seed) > 0, 1.0, 0.25)
    truth = clean + 0.3 / quality * rng.standard_normal(clean.shape)
    orders = {}
    for name, weight in (("none", None), ("given", quality)):
        found = unwrap(wrap(truth), quality=weight, algorithm="reliability")
        order = np.round((found.phase - truth)[quality == 1.0] / (2 * np.pi))
        orders[name] = np.mean(order != np.median(order))
    assert orders["given"] < 0.5 * orders["none"]
    assert orders["given"] < 0.01


@pytest.mark.parametrize("algorithm", ["auto", "reliability", "guided", "least_squares"])
def test_transposed_arrays_are_taken(algorithm):
    truth = noisy_hill(96, 0.8)[:, :70]
    phase, mask = wrap(truth), truth < 20.0
    quality = 0.5 + np.random.default_rng(0).random(truth.shape)
    expected = unwrap(phase, mask, quality=quality, algorithm=algorithm)
    by_columns = (np.asfortranarray(a) for a in (phase, mask, quality))
    phase_f, mask_f, quality_f = by_columns
    found = unwrap(phase_f, mask_f, quality=quality_f, algorithm=algorithm)
    np.testing.assert_array_equal(found.phase, expected.phase)
    turned = unwrap(phase.T, mask.T, quality=quality.T, algorithm=algorithm)
    assert turned.phase.shape == (70, 96)


def test_least_squares():
    truth = noisy_hill(128, 0.2)
    mask = np.ones(truth.shape, bool)
    mask[40:60, 50:90] = False
    mask[:, 100] = False
    unwrapped = unwrap(wrap(truth), mask, algorithm="least_squares")
    assert unwrapped.region.max() == 2
    assert wrong_share(unwrapped, truth) == 0.0
    assert np.isnan(unwrapped.phase[~mask]).all()
    whole = unwrap(wrap(truth), algorithm="least_squares")
    assert wrong_share(whole, truth) == 0.0


@pytest.mark.parametrize("algorithm", ["reliability", "guided", "least_squares"])
def test_pixels_of_low_quality_do_not_disturb_the_others(algorithm):
    """A band of random phase with a low quality does not change the other pixels."""
    rng = np.random.default_rng(1)
    truth = noisy_hill(128, 0.05)
    phase = wrap(truth)
    bad = np.zeros(truth.shape, bool)
    bad[60:64, 20:128] = True
    phase[bad] = rng.uniform(-np.pi, np.pi, bad.sum())
    quality = np.where(bad, 1e-3, 1.0)
    unwrapped = unwrap(phase, quality=quality, algorithm=algorithm)
    order = np.round((unwrapped.phase - truth)[~bad] / (2 * np.pi))
    assert np.mean(order != np.median(order)) == 0.0
    quality[0, 0] = np.nan
    assert unwrapped.region[0, 0] == 1
    assert unwrap(phase, quality=quality, algorithm=algorithm).region[0, 0] == 0


@pytest.mark.parametrize("shape", [(1, 50), (50, 1), (1, 1), (2, 3)])
@pytest.mark.parametrize("algorithm", ["reliability", "guided", "least_squares"])
def test_narrow_maps(shape, algorithm):
    truth = 0.6 * np.arange(np.prod(shape), dtype=float).reshape(shape)
    unwrapped = unwrap(wrap(truth), algorithm=algorithm)
    assert unwrapped.phase.shape == shape
    assert np.ptp(np.round((unwrapped.phase - truth) / (2 * np.pi))) == 0


def test_separate_regions_are_numbered_by_size():
    phase = np.zeros((20, 40), np.float32)
    mask = np.ones(phase.shape, bool)
    mask[:, 10] = False
    region = unwrap(phase, mask).region
    assert (region[:, 11:] == 1).all()
    assert (region[:, :10] == 2).all()
    assert (region[:, 10] == 0).all()


def test_bad_input():
    with pytest.raises(InputError, match="phase: expected shape"):
        unwrap(np.zeros(5))
    with pytest.raises(InputError, match="mask: expected shape"):
        unwrap(np.zeros((5, 5)), np.ones((4, 5), bool))
    with pytest.raises(InputError, match="at least one valid pixel"):
        unwrap(np.full((5, 5), np.nan))
    with pytest.raises(InputError, match="at least one valid pixel"):
        unwrap(np.zeros((5, 5)), np.zeros((5, 5), bool))
    with pytest.raises(InputError, match="quality: expected shape"):
        unwrap(np.zeros((5, 5)), quality=np.ones((4, 5)))
    with pytest.raises(InputError, match="at most 1e.06 rad"):
        unwrap(np.full((5, 5), 1e9))
    with pytest.raises(InputError, match="real numbers, got complex"):
        unwrap(np.ones((5, 5), complex))
    with pytest.raises(InputError, match="algorithm: expected one of"):
        unwrap(np.zeros((5, 5)), algorithm="magic")
    wrapped = np.zeros((5, 5))
    wrapped[2, 2] = np.inf
    assert np.isnan(unwrap(wrapped).phase[2, 2])
    wrapped[2, 2] = 0.0
    unwrap(wrapped, np.ones((5, 5), bool))
    assert not wrapped.any()
