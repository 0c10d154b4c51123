"""Gray codes without fringes: every pixel decodes the bits that it resolves, with the σ of that."""

import numpy as np
import pytest
import scipy

import fringeworks as fw
from fringeworks.patterns import GrayCode, Uniform

BITS, WIDTH, SUPERSAMPLED, ROWS = 10, 1024, 8, 40
CAMERAS = {  # projector px per camera px, blur in camera px, noise in counts
    "fine": (0.4, 0.7, 2.0),
    "blurred": (1.0, 1.5, 1.0),
    "coarse": (2.5, 0.3, 1.0),
    "coarse and blurred": (3.0, 1.5, 2.0),
}
DARK, BRIGHT = 40.0, 160.0


def photographs(scale, blur, noise, *, inverse, uneven=0.0, seed=0):
    """Frames of a camera of ``scale`` projector px per pixel, their plan, and the true coordinates."""
    rng = np.random.default_rng(seed)
    columns = int(900 / scale)
    fine = np.arange(columns * SUPERSAMPLED) / SUPERSAMPLED * scale
    at = 5.0 + fine + rng.uniform(0.0, scale, (ROWS, 1)) + 10.0 * np.sin(fine / 150.0)
    cells = np.clip(np.floor(at), 0, WIDTH - 1).astype(int)
    words = cells ^ (cells >> 1)

    def seen(pattern):
        light = scipy.ndimage.gaussian_filter1d(pattern * 1.0, blur * SUPERSAMPLED, axis=1)
        light = scipy.ndimage.uniform_filter1d(light, SUPERSAMPLED, axis=1)
        counts = DARK + (BRIGHT - DARK) * light[:, SUPERSAMPLED // 2 :: SUPERSAMPLED]
        counts = counts * (1.0 + uneven * rng.uniform(-1.0, 1.0))
        return np.clip(np.rint(counts + rng.normal(0.0, noise, counts.shape)), 0, 255)

    bits = [(words >> (BITS - 1 - k)) & 1 for k in range(BITS)]
    if inverse:
        frames = [seen(pattern) for bit in bits for pattern in (bit, 1 - bit)]
        blocks = (GrayCode("x", 1.0, WIDTH, True),)
    else:
        frames = [seen(pattern) for pattern in (*bits, np.ones_like(bits[0]), 0 * bits[0])]
        blocks = (GrayCode("x", 1.0, WIDTH), Uniform("white"), Uniform("black"))
    truth = at[:, SUPERSAMPLED // 2 :: SUPERSAMPLED] - 0.5
    plan = fw.PatternPlan(WIDTH, ROWS, blocks)
    return np.stack(frames).astype(np.uint8), plan, truth


@pytest.mark.parametrize("inverse", [True, False])
@pytest.mark.parametrize("camera", list(CAMERAS))
def test_every_pixel_decodes_what_it_resolves(camera, inverse):
    scale, blur, noise = CAMERAS[camera]
    frames, plan, truth = photographs(scale, blur, noise, inverse=inverse, uneven=0.05)
    found = fw.decode(frames, plan)
    ok = np.isfinite(found.x.coordinate_px)
    assert ok.mean() > 0.98
    error, sigma = np.abs(found.x.coordinate_px - truth)[ok], found.x.sigma_px[ok]
    assert np.mean(error < 2.0 * sigma) > 0.98
    assert np.mean(error > 5.0 * sigma) <= 1e-4
    # σ is not loose either: that of the cells that are resolved, or of a border's blur.
    assert sigma.mean() < 4.0 * np.sqrt(np.mean(error**2))
    named = [finding for finding in found.findings if finding.kind == "resolution"]
    assert bool(named) == (camera != "fine")


def test_unresolved_bits_are_named_once():
    frames, plan, _ = photographs(*CAMERAS["coarse and blurred"], inverse=True)
    (found,) = (f for f in fw.decode(frames, plan).findings if f.kind == "resolution")
    assert found.figures["unresolved_bits"] == 3
    assert found.figures["resolved_px"] == 8.0
    assert found.frames[0] == "x-gray-7"
    assert len(found.frames) == 6


def test_borders_tell_more_than_cells():
    """Within the blur of a border, the brightness of its bit tells the place."""
    frames, plan, truth = photographs(0.4, 1.0, 1.0, inverse=True)
    found = fw.decode(frames, plan)
    at_border = found.x.sigma_px < 0.9 / np.sqrt(12.0)
    assert at_border.mean() > 0.2
    error = np.abs(found.x.coordinate_px - truth)
    assert np.sqrt(np.mean(error[at_border] ** 2)) < 0.16
    assert np.mean(error[at_border] < 2.0 * found.x.sigma_px[at_border]) > 0.95


def test_light_of_other_surfaces_is_not_measured():
    """A dark place that only the coarse bits reach, by light of the surfaces around it."""
    frames, plan, _ = photographs(1.0, 0.5, 1.0, inverse=False)
    dark = slice(100, 200)
    around = scipy.ndimage.gaussian_filter1d(frames.astype(float), 30.0, axis=2)
    frames[:, :, dark] = np.rint(0.5 * around[:, :, dark])
    found = fw.decode(frames, plan).x
    ok = np.isfinite(found.coordinate_px)
    assert ok[:, dark].mean() < 0.2
    assert ok[:, 220:].mean() > 0.98
