"""Faults that real devices have but the usual lists leave out."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from tests.fault_stage import BLACK, EXPOSURE, NOISE, Shot, Stage, at_edges, expose


def _rows(stage: Stage) -> np.ndarray:
    """Row numbers of the camera, (h, 1)."""
    return np.arange(stage.seen.x.shape[0])[:, None]


def rolling_bands(stage: Stage, rng: np.random.Generator) -> Shot:
    """A rolling shutter under a pulsing lamp: bands of 2 %, at a new place in every frame."""
    start = rng.uniform(0, 2 * np.pi, (len(stage.direct), 1, 1))
    bands = 1.0 + 0.02 * np.sin(2 * np.pi * _rows(stage) / 170.0 + start)
    return stage.shot(expose(bands * stage.direct + stage.ambient, rng))


def pwm_lines(stage: Stage, rng: np.random.Generator) -> Shot:
    """A projector's pulsed light under a rolling shutter: single rows brighter or darker by 4 %."""
    lines = 1.0 + 0.04 * rng.standard_normal((len(stage.direct), stage.seen.x.shape[0], 1))
    return stage.shot(expose(lines * stage.direct + stage.ambient, rng))


def auto_exposure(stage: Stage, rng: np.random.Generator) -> Shot:
    """Automatic exposure: counts follow the mean of the frame before, up to 20 %."""
    light = stage.direct + stage.ambient
    means = light.mean(axis=(1, 2))
    before = np.concatenate([means[:1], means[:-1]])
    gains = np.clip(means.mean() / before, 0.8, 1.2)[:, None, None]
    return stage.shot(expose(gains * light, rng))


def bad_pixels(stage: Stage, rng: np.random.Generator) -> Shot:
    """A sensor with 0.1 % dead and 0.1 % hot pixels, and 0.2 % that stay at any count.

    No coordinate of theirs is right.
    """
    frames = expose(stage.direct + stage.ambient, rng)
    kind = rng.random(stage.seen.x.shape)
    frames[:, kind < 0.001] = 0
    frames[:, (kind >= 0.001) & (kind < 0.002)] = 255
    stuck = (kind >= 0.002) & (kind < 0.004)
    frames[:, stuck] = rng.integers(0, 256, int(stuck.sum()))
    return Shot(frames, np.where(kind < 0.004, np.nan, stage.seen.truth)[None])


def black_border(stage: Stage, rng: np.random.Generator) -> Shot:
    """A driver that scales the picture: 12 black columns at either end of the projector."""
    bright = (stage.seen.x > 12) & (stage.seen.x < stage.plan.width_px - 12)
    light = stage.direct * bright
    return Shot(
        expose(light + stage.ambient, rng), np.where(bright, stage.seen.truth, np.nan)[None]
    )


def pixel_grid(stage: Stage, rng: np.random.Generator) -> Shot:
    """A sharp projector: the light is constant over a projector pixel, with dark gaps between."""
    part = np.abs(stage.seen.x - np.rint(stage.seen.x))
    gaps = np.where(part > 0.45, 0.6, 1.0)
    light = stage.each(lambda i, x: gaps * stage.pattern(i, np.rint(x)))
    blurred = ndimage.gaussian_filter(light, (0, 0.5, 0.5))
    return at_edges(expose(blurred, rng), stage.seen.truth)


def bayer(stage: Stage, rng: np.random.Generator) -> Shot:
    """Raw frames of a colour camera, taken as grey: neighbours differ by their filters."""
    mosaic = np.empty(stage.seen.x.shape, np.float32)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = 0.55, 0.4
    mosaic[::2, 1::2] = mosaic[1::2, ::2] = 1.0
    return stage.shot(expose(mosaic * (stage.direct + stage.ambient), rng))


def fixed_pattern(stage: Stage, rng: np.random.Generator) -> Shot:
    """A sensor whose pixels differ by 2 % in gain and 2 counts in offset, always the same."""
    gain = 1.0 + 0.02 * rng.standard_normal(stage.seen.x.shape)
    offset = 2.0 * rng.standard_normal(stage.seen.x.shape)
    light = gain * (stage.direct + stage.ambient) + offset / EXPOSURE
    return stage.shot(expose(light, rng))


def moving_body(stage: Stage, rng: np.random.Generator) -> Shot:
    """Only the middle of the scene moves in depth, by up to 0.5 rad per frame; the rest is still."""
    v, u = np.mgrid[: stage.seen.x.shape[0], : stage.seen.x.shape[1]]
    speed = 0.5 * np.clip(1.2 - ((u - 300) / 140.0) ** 2 - ((v - 260) / 185.0) ** 2, 0, 1)
    travel = speed * stage.finest_px / (2 * np.pi)
    light = stage.each(lambda i, x: stage.pattern(i, x + i * travel))
    mean = stage.weights @ np.arange(stage.plan.frames)
    return Shot(expose(light, rng), (stage.seen.truth + mean * travel)[None])


def passing_shadow(stage: Stage, rng: np.random.Generator) -> Shot:
    """Somebody walks through the light: a shadow of 60 columns moves by 40 per frame."""
    light = stage.direct.copy()
    start = rng.integers(-300, 300)
    for i in range(len(light)):
        left = start + 40 * i
        light[i, :, max(0, left) : max(0, left + 60)] = 0.0
    return stage.shot(expose(light + stage.ambient, rng))


def broken_samples(stage: Stage, rng: np.random.Generator) -> Shot:
    """Broken transfers: in 0.05 % of all samples, any count."""
    frames = expose(stage.direct + stage.ambient, rng)
    hit = rng.random(frames.shape) < 0.0005
    frames[hit] = rng.integers(0, 256, int(hit.sum()))
    return stage.shot(frames)


def room_light(stage: Stage, rng: np.random.Generator) -> Shot:
    """Room light as strong as the projector, pulsing by 5 % from frame to frame."""
    room = 5.0 * stage.ambient * (1.0 + 0.05 * rng.standard_normal((len(stage.direct), 1, 1)))
    return stage.shot(expose(stage.direct + room, rng, exposure=0.75 * EXPOSURE))


def row_noise(stage: Stage, rng: np.random.Generator) -> Shot:
    """A sensor whose rows share an error of 1.5 counts, anew in every frame."""
    light = stage.direct + stage.ambient
    rows = 1.5 * rng.standard_normal((len(light), light.shape[1], 1)) / EXPOSURE
    return stage.shot(expose(light + rows, rng))


def smoothed(stage: Stage, rng: np.random.Generator) -> Shot:
    """A camera that denoises its frames: noise is shared by neighbours over 1 px rms."""
    light = EXPOSURE * (stage.direct + stage.ambient) + BLACK
    noisy = light + 4.0 * NOISE * rng.standard_normal(light.shape, dtype=np.float32)
    smooth = ndimage.gaussian_filter(noisy, (0, 0.7, 0.7))
    frames = np.clip(np.rint(smooth), 0, 255).astype(np.uint8)
    return at_edges(frames, stage.seen.truth)


RARE = {
    "rolling-bands": rolling_bands,
    "pwm-lines": pwm_lines,
    "auto-exposure": auto_exposure,
    "bad-pixels": bad_pixels,
    "black-border": black_border,
    "pixel-grid": pixel_grid,
    "bayer": bayer,
    "fixed-pattern": fixed_pattern,
    "moving-body": moving_body,
    "passing-shadow": passing_shadow,
    "broken-samples": broken_samples,
    "room-light": room_light,
    "row-noise": row_noise,
    "camera-denoise": smoothed,
}
