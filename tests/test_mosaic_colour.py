"""The colour of a scene from raw frames behind a mosaic: edges of paint, fine fringes, noise."""

import numpy as np
import pytest
import scipy

from fringeworks.files.bayer_image import BayerImage
from fringeworks.files.scene_colour import SceneColour

SHAPE = (150, 180)
WHITE = 60_000
FULL = 65535 / WHITE
STEPS = 12
PATTERNS = {"rggb": [[0, 1], [3, 2]], "gbrg": [[1, 2], [0, 3]]}


def over_pixels(paint, *, over=6, blur_px=0.5):
    """What pixels collect of a paint, (h, w, 3): means over their area, through a lens."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    offsets = (np.arange(over) + 0.5) / over - 0.5
    mean = np.mean([paint(y + dy, x + dx) for dy in offsets for dx in offsets], axis=0)
    return scipy.ndimage.gaussian_filter(mean, (blur_px, blur_px, 0), mode="nearest")


def stripes(angle, start):
    """Hard stripes of two paints: red falls where blue rises."""
    one, other = np.array((0.8, 0.35, 0.3)), np.array((0.3, 0.5, 0.85))

    def paint(y, x):
        side = (x * np.cos(angle) + y * np.sin(angle) + start) // 17 % 2
        shade = 0.85 + 0.15 * np.cos(x / 60) * np.cos(y / 50)
        return np.where(side[..., None] > 0, one, other) * shade[..., None]

    return paint


def raw_frames(seen, pattern, *, period=8.0, noise=20.0, seed=0, light=0.6):
    """Raw frames of fringes of a period in camera pixels."""
    rng = np.random.default_rng(seed)
    number = np.tile(np.array(pattern), (SHAPE[0] // 2, SHAPE[1] // 2))
    own = np.take_along_axis(seen, np.array([0, 1, 2, 1])[number][..., None], axis=2)[..., 0]
    x = np.arange(SHAPE[1])
    for k in range(STEPS):
        fringe = 1.0 + 0.9 * np.cos(2 * np.pi * (x / period - k / STEPS))
        counts = light * WHITE * own * fringe + rng.normal(0.0, noise, SHAPE)
        raw = np.clip(np.rint(counts), 0, WHITE).astype(np.uint16)
        yield BayerImage(raw, np.array(pattern), [0] * 4, WHITE)


def colour_of(images):
    found = SceneColour(dict.fromkeys(range(STEPS), 1.0), STEPS)
    for k, image in enumerate(images):
        found.add(k, image, coloured=True)
    return found.noise(), found.colour()


def linear(seen, pattern):
    """Linear interpolation of what a mosaic shows."""
    raw = np.rint(next(raw_frames(seen, pattern, period=np.inf, noise=0.0)).whole())
    return raw / (0.6 * 1.9 * 65535)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize(("angle", "start"), [(0.0, 3.0), (0.7, 11.0), (1.9, 5.0)])
def test_edges_of_two_paints(pattern, angle, start):
    """At and beside hard edges, and everywhere: less than 2 % of white, rms in linear light."""
    seen = over_pixels(stripes(angle, start))
    _, colour = colour_of(raw_frames(seen, PATTERNS[pattern], seed=int(start)))
    off = (colour / (0.6 * 65535) - seen)[4:-4, 4:-4]
    change = np.ptp([seen, np.roll(seen, 2, 0), np.roll(seen, 2, 1)], axis=0).max(axis=2)
    edge = scipy.ndimage.maximum_filter(change, 3)[4:-4, 4:-4] > 0.1
    before = (linear(seen, PATTERNS[pattern]) - seen)[4:-4, 4:-4]
    at_edges, at_edges_before = (np.sqrt(np.mean(v[edge] ** 2)) for v in (off, before))
    assert edge.mean() > 0.1
    assert at_edges < 0.012
    assert at_edges < 0.4 * at_edges_before
    assert np.sqrt(np.mean(off**2)) < 0.01
    assert np.sqrt(np.mean((off / seen[4:-4, 4:-4]) ** 2)) < 0.02


@pytest.mark.parametrize("period", [6.0, 8.0, 11.0])
def test_fine_fringes_do_not_tint(period):
    """Interpolated one by one, fringes of 8 px tint the channels by 3 %."""
    paint = np.array((0.5, 0.6, 0.4))
    seen = np.broadcast_to(paint, (*SHAPE, 3))
    _, colour = colour_of(raw_frames(seen, PATTERNS["rggb"], period=period, noise=0.0))
    ratio = colour[4:-4, 4:-4] / (0.6 * 65535) / paint
    assert np.abs(ratio - 1.0).max() < 2e-3


@pytest.mark.parametrize("seed", [31, 32])
def test_the_noise_is_known(seed):
    """By the mosaic itself: edges of paint change it by little."""
    seen = over_pixels(stripes(0.4, seed))
    clean = colour_of(raw_frames(seen, PATTERNS["rggb"], noise=0.0))[1]
    noise, colour = colour_of(raw_frames(seen, PATTERNS["rggb"], noise=300.0, seed=seed))
    expected = 300.0 * FULL / np.sqrt(STEPS)
    for c in range(3):
        stated = float(np.sqrt(noise[c].variance(np.median(colour[..., c]))))
        assert 0.85 * expected < stated < 1.3 * expected
    # Between the filters, most pixels have less; those at edges, up to twice as much.
    off = np.abs(colour - clean)[4:-4, 4:-4]
    assert (np.median(off, axis=(0, 1)) < 0.6745 * 1.05 * expected).all()
    assert (np.sqrt(np.mean(off**2, axis=(0, 1))) < 1.5 * expected).all()


def test_saturated_samples_and_dark_pixels():
    paint = np.array((0.5, 0.9, 0.4))
    seen = np.broadcast_to(paint, (*SHAPE, 3)).copy()
    seen[:20, :20] = 0.0
    seen[-20:, -20:] = 9.0
    _, colour = colour_of(raw_frames(seen, PATTERNS["rggb"], period=20.0, noise=0.0))
    inner = colour[40:-40, 40:-40]
    # Green is cut off at the brightest frames; its ratio to red is that of the other ones.
    assert np.median(inner[..., 1] / inner[..., 0]) == pytest.approx(1.8, rel=0.03)
    assert np.all(colour[2:16, 2:16] == 0.0)
    assert np.isfinite(colour).all()
