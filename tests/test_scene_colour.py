"""The colour of a scene from noisy colour images: its error against the smallest possible one."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from PIL import Image

import fringeworks as fw
from fringeworks.files.scene_colour import SceneColour
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, equal_steps
from fringeworks.stack.even_light import texture_weights

WIDTH = 320
PLANS = {
    "three sets": tuple(PhaseSteps("x", p, equal_steps(4)) for p in (20.0, 80.0, 320.0)),
    "Gray code without inverse": (PhaseSteps("x", 20.0, equal_steps(4)), GrayCode("x", 20.0, 320)),
    "Gray code with inverse": (
        PhaseSteps("x", 20.0, equal_steps(3)),
        GrayCode("x", 20.0, 320, inverse=True),
    ),
}
NOISES = {
    "read": ((1.0, 0.0), (1.2, 0.0), (1.6, 0.0)),
    "shot": ((0.3, 0.3), (0.3, 0.3), (0.3, 0.3)),
    "both": ((1.0, 0.02), (1.2, 0.02), (1.6, 0.02)),
}


def images(plan, noise, seed, *, rows=60, exposure=70.0):
    """What a camera sees of three smooth paints, the light of each image, and the paints."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :WIDTH]
    waves = (np.sin(x / 31 + seed), np.cos(y / 19), np.sin((x + 2 * y) / 47))
    paint = exposure * (0.6 + 0.33 * np.stack(waves, axis=-1)) * (0.75, 0.9, 0.6)
    light = [
        0.04 + 2.0 * block.values(x + 0.5, k) for block in plan.blocks for k in range(block.frames)
    ]
    seen = []
    for p in light:
        clean = paint * p[..., None]
        sigma = [np.sqrt(read**2 + gain * clean[..., c]) for c, (read, gain) in enumerate(noise)]
        seen.append(clean + np.stack(sigma, axis=-1) * rng.standard_normal(clean.shape))
    return np.array(seen, np.float32), np.array(light), paint


def colour_of(seen, plan, order=None):
    found = SceneColour(texture_weights(plan), len(seen))
    for k in order or range(len(seen)):
        found.add(k, seen[k], coloured=True)
    return found.noise(), found.colour()


def least_error(light, paint, noise):
    """Standard deviation of a paint by the Cramér–Rao bound, where the light is known."""
    bound = np.empty(paint.shape)
    for c, (read, gain) in enumerate(noise):
        p = light
        variance = read**2 + gain * paint[..., c] * p
        bound[..., c] = np.sum(p * p / variance, axis=0) ** -0.5
    return bound


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("seed", [83, 84])
def test_the_error_is_near_the_smallest_possible_and_known(name, noise, seed):
    plan = PatternPlan(WIDTH, 200, PLANS[name])
    seen, light, paint = images(plan, NOISES[noise], seed)
    model, colour = colour_of(seen, plan)
    scale = np.median(colour / paint)
    off = colour / scale / paint - 1.0
    least = least_error(light, paint, NOISES[noise]) / paint
    shown = seen[list(texture_weights(plan))].mean(axis=0) / scale / paint - 1.0
    error, bound, mean = (np.sqrt(np.mean(v**2)) for v in (off, least, shown))
    # Without inverse, only the steps tell the brightness; all images tell the colour.
    assert error < (1.22 if "without" in name else 1.08) * bound
    assert error < 1.06 * mean
    assert abs(np.mean(off)) < 0.1 * error
    for c in range(3):
        sigma = np.sqrt(model[c].variance(colour[..., c]))
        ratio = np.abs(off[..., c]) * paint[..., c] * scale / sigma
        assert 0.62 < np.mean(ratio < 1) < 0.71
        assert 0.91 < np.mean(ratio < 2) < 0.97


def test_the_order_of_reading_does_not_count():
    plan = PatternPlan(WIDTH, 200, PLANS["Gray code with inverse"])
    seen, _, _ = images(plan, NOISES["both"], 85, rows=20)
    order = np.random.default_rng(1).permutation(len(seen)).tolist()
    assert np.array_equal(colour_of(seen, plan)[1], colour_of(seen, plan, order)[1])


def test_dark_and_saturated_pixels_are_grey():
    plan = PatternPlan(WIDTH, 200, PLANS["three sets"])
    seen, _, _ = images(plan, NOISES["both"], 86, rows=20)
    counts = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    counts[:, :5, :5], counts[:, 10:15, :5] = 0, 255
    _, colour = colour_of(counts, plan)
    assert np.all(colour[:5, :5] == 0)
    np.testing.assert_allclose(colour[10:15, :5], 255, rtol=1e-5)
    assert np.isfinite(colour).all()


def test_few_images_and_grey_ones_tell_no_noise():
    plan = PatternPlan(WIDTH, 200, (PhaseSteps("x", 20.0, equal_steps(3)),))
    seen, _, _ = images(plan, NOISES["both"], 87, rows=20)
    model, colour = colour_of(seen, plan)
    assert model is None
    assert colour.shape == seen.shape[1:]
    assert colour_of(seen[..., 0], plan) == (None, None)


@pytest.mark.parametrize("seed", [88, 89])
def test_saturated_samples_do_not_change_the_colour(tmp_path, seed):
    rig = fw.simulate.standard_rig(scale=0.15)
    plan = fw.simulate.fringe_plan(rig, both=False)
    view = fw.simulate.look(rig, fw.simulate.bust())
    y, x = np.mgrid[: view.albedo.shape[0], : view.albedo.shape[1]]
    paint = 0.6 + 0.35 * np.stack((np.sin(x / 19 + seed), np.cos(y / 17), np.sin((x + y) / 23)), -1)
    channels = []
    for c, exposure in enumerate((2.4, 2.8, 2.2)):
        painted = replace(view, albedo=view.albedo * paint[..., c])
        optics = fw.simulate.Optics(seed=seed + c, exposure=exposure, noise=1.0, ambient=0.0)
        channels.append(list(fw.simulate.photograph(painted, plan, optics)))
    frames = [np.stack(one, axis=-1) for one in zip(*channels, strict=True)]
    fw.files.write_plan(tmp_path / "plan.toml", plan)
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{k:02d}.png", compress_level=1)
    points = fw.measure(tmp_path, rig).points
    ok = (points.reason == 0) & scipy.ndimage.binary_erosion(view.lit, iterations=3)
    full = (np.stack(frames) == 255).any(axis=(0, 3))
    ratio = points.colour / np.where(ok, view.shading * view.albedo, 1.0)[..., None] / paint
    scale = np.median(ratio[ok & ~full], axis=0)
    off = ratio[ok & full] / scale - 1.0
    assert len(off) > 300
    assert np.abs(np.median(off, axis=0)).max() < 0.003
    (found,) = (f for f in points.findings if f.kind == "colour")
    spread = np.median(np.abs(ratio[ok & ~full] / scale - 1.0), axis=0) / 0.6745
    stated = [found.figures[f"{c} / %"] / 100 for c in ("red", "green", "blue")]
    np.testing.assert_allclose(stated, spread, rtol=0.2)


def stripes(y, x, seed):
    """Hard stripes of two paints, and a smooth change of both, (..., 3)."""
    one, other = np.array((0.85, 0.35, 0.3)), np.array((0.35, 0.5, 0.85))
    side = (x * np.cos(0.3 + seed) + y * np.sin(0.3 + seed) + seed) // 17 % 2
    waves = np.stack((np.sin(x / 29), np.cos(y / 23), np.sin((x + y) / 31)), axis=-1)
    return np.where(side[..., None] > 0, one, other) * (0.85 + 0.15 * waves)


def over_pixels(paint, shape, seed, *, over=8):
    """Means of a paint over whole pixels, (h, w, 3)."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    offsets = (np.arange(over) + 0.5) / over - 0.5
    return np.mean([paint(y + dy, x + dx, seed) for dy in offsets for dx in offsets], axis=0)


@pytest.mark.parametrize("blur_px", [0.5, 1.0])
@pytest.mark.parametrize("seed", [92, 93])
def test_edges_of_paint_have_the_error_of_the_noise(tmp_path, seed, blur_px):
    """A pixel shows the paint that it and its lens collect: against that, edges cost nothing."""
    rig = fw.simulate.standard_rig(scale=0.15)
    plan = fw.simulate.fringe_plan(rig, both=False)
    view = fw.simulate.look(rig, fw.simulate.bust())
    paint = over_pixels(stripes, view.albedo.shape, seed)
    channels = []
    for c, exposure in enumerate((0.95, 0.9, 1.0)):
        painted = replace(view, albedo=view.albedo * paint[..., c])
        optics = fw.simulate.Optics(
            seed=3 * seed + c, exposure=exposure, noise=0.7, ambient=0.0, blur_px=blur_px
        )
        channels.append(list(fw.simulate.photograph(painted, plan, optics)))
    fw.files.write_plan(tmp_path / "plan.toml", plan)
    for k, frame in enumerate(np.stack(one, axis=-1) for one in zip(*channels, strict=True)):
        Image.fromarray(frame).save(tmp_path / f"{k:02d}.png", compress_level=1)
    points = fw.measure(tmp_path, rig).points
    lens = (blur_px, blur_px, 0)
    even = (view.shading * view.albedo)[..., None]
    white = scipy.ndimage.gaussian_filter(even, lens, mode="nearest")
    seen = scipy.ndimage.gaussian_filter(even * paint, lens, mode="nearest")
    ok = (points.reason == 0) & scipy.ndimage.binary_erosion(view.lit, iterations=3)
    change = [
        scipy.ndimage.maximum_filter(c, 3) - scipy.ndimage.minimum_filter(c, 3)
        for c in np.moveaxis(paint, -1, 0)
    ]
    edge = np.max(change, axis=0) > 0.15
    albedo = points.colour[ok] / white[ok]
    true, near = seen[ok] / white[ok], edge[ok]
    assert near.sum() > 1000
    albedo /= np.median(albedo[~near] / true[~near], axis=0)
    off = albedo - true
    at_edges, elsewhere = (np.sqrt(np.mean(off[m] ** 2)) for m in (near, ~near))
    assert at_edges < 1.15 * elsewhere
    assert at_edges < 0.012  # of white, in linear light
    relative = np.sqrt(np.mean((off / true) ** 2))
    assert relative < 0.02
