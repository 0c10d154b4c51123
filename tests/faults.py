"""Faults of captures, each as a function of a scene and a plan, written apart from the decoder.

A fault takes a ``Stage`` (a scene under a plan's patterns) and a random generator. It returns a
``Shot``: the frames as a camera stores them, and the coordinates that a decoder should find.

Where the scene moves against the devices during the capture, the true coordinate is that at the
mean time of the frames, each weighted by what its set tells about the coordinate (1 / period²).
For hierarchical plans, that is the mean time of the finest set.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial

import numpy as np
from PIL import Image
from scipy import ndimage

from fringeworks.patterns import PhaseSteps
from tests.fault_scenes import pixels, see_fine
from tests.fault_stage import (
    AMBIENT,
    BLACK,
    EXPOSURE,
    LEAK,
    LENS_PX,
    Shot,
    Stage,
    at_edges,
    expose,
)

Fault = Callable[[Stage, np.random.Generator], Shot]


# The camera's noise.


def white_noise(stage: Stage, rng: np.random.Generator, noise: float) -> Shot:
    """Electronic noise of the camera, the same everywhere; 0: only rounding to whole counts."""
    return stage.shot(expose(stage.direct + stage.ambient, rng, noise=noise))


def shot_noise(stage: Stage, rng: np.random.Generator) -> Shot:
    """A camera limited by the number of photons: a read noise of 0.3, a gain of 0.2."""
    return stage.shot(expose(stage.direct + stage.ambient, rng, noise=0.3, gain=0.2))


# Frames that are not where the plan has them.


def lost(stage: Stage, rng: np.random.Generator, index: int | None = None) -> Shot:
    """The driver drops a frame. The last frame is doubled, or the next scan's first follows."""
    frames = expose(stage.direct + stage.ambient, rng)
    n = len(frames)
    index = int(rng.integers(n)) if index is None else index
    if rng.random() < 0.5:
        fill = expose(stage.direct[0] + stage.ambient, rng)
    else:
        fill = expose(stage.direct[n - 1 if index < n - 1 else n - 2] + stage.ambient, rng)
    return stage.shot(np.concatenate([np.delete(frames, index, 0), fill[None]]))


def swapped(stage: Stage, rng: np.random.Generator, pair: tuple[int, int] | None = None) -> Shot:
    """Two frames stored under each other's name."""
    frames = expose(stage.direct + stage.ambient, rng)
    a, b = pair or rng.choice(len(frames), 2, replace=False)
    frames[[a, b]] = frames[[b, a]]
    return stage.shot(frames)


def late(stage: Stage, rng: np.random.Generator, frames: int) -> Shot:
    """The camera triggers some patterns early or late: frame i shows pattern i − ``frames``.

    The ends show the scan before or after, or the projector's idle picture, white or black.
    """
    n = stage.plan.frames
    wanted = np.arange(n) - frames
    light = stage.direct[wanted % n].copy()
    ends = (wanted < 0) | (wanted >= n)
    idle = rng.choice(["wrap", "white", "black"])
    if idle != "wrap":
        level = 1.0 if idle == "white" else LEAK
        light[ends] = level * stage.seen.albedo * stage.seen.lit
    return stage.shot(expose(light + stage.ambient, rng))


def dark_frame(stage: Stage, rng: np.random.Generator, index: int | None = None) -> Shot:
    """The projector is off during one frame: the camera sees the ambient light only."""
    light = stage.direct.copy()
    light[rng.integers(len(light)) if index is None else index] = 0.0
    return stage.shot(expose(light + stage.ambient, rng))


# Light that is not as strong as the plan says.


def projector_gamma(stage: Stage, rng: np.random.Generator) -> Shot:
    """A projector with γ 2.2 under patterns drawn for γ 1."""
    return stage.shot(expose(stage.each(lambda i, x: stage.pattern(i, x) ** 2.2), rng))


def camera_curve(stage: Stage, rng: np.random.Generator) -> Shot:
    """A camera whose counts bend towards white like a hyperbolic tangent, which is no power."""
    light = np.tanh(1.5 * (stage.direct + stage.ambient)) / np.tanh(1.5)
    return stage.shot(expose(light, rng))


def saturation(stage: Stage, rng: np.random.Generator) -> Shot:
    """An exposure that is too long by a factor of 1.5: bright surfaces reach the limit."""
    return stage.shot(expose(stage.direct + stage.ambient, rng, exposure=1.5 * EXPOSURE))


def flicker(stage: Stage, rng: np.random.Generator) -> Shot:
    """The projector's light changes by 3 % rms from frame to frame."""
    gains = 1.0 + 0.03 * rng.standard_normal((len(stage.direct), 1, 1))
    return stage.shot(expose(gains * stage.direct + stage.ambient, rng))


def drift(stage: Stage, rng: np.random.Generator) -> Shot:
    """The ambient light rises during the capture, by 5 to 20 % of the projector's light."""
    rise = rng.uniform(0.05, 0.20) * np.linspace(0, 1, len(stage.direct))[:, None, None]
    return stage.shot(expose(stage.direct + stage.ambient + rise * stage.seen.albedo, rng))


def lamp(stage: Stage, rng: np.random.Generator) -> Shot:
    """A lamp that warms up: 15 % of the first frame's light more in every frame."""
    gains = 1.0 + 0.15 * np.arange(len(stage.direct))[:, None, None]
    return stage.shot(expose(gains / gains.max() * stage.direct + stage.ambient, rng))


def wrong_steps(stage: Stage, rng: np.random.Generator) -> Shot:
    """Steps of 147° where the plan has 150°: all shifts are 2 % too small."""
    light = stage.each(partial(_shifted, stage, lambda s, _: 0.98 * s))
    return stage.shot(expose(light, rng), any_offset=True)


def random_steps(stage: Stage, rng: np.random.Generator) -> Shot:
    """A phase shifter that errs by 5° rms in every frame."""
    errors = np.radians(5.0) * rng.standard_normal(stage.plan.frames)
    light = stage.each(partial(_shifted, stage, lambda s, i: s + errors[i]))
    return stage.shot(expose(light, rng), any_offset=True)


def _shifted(stage: Stage, shift: Callable, i: int, x: np.ndarray) -> np.ndarray:
    """A pattern whose shift is changed by a function of the shift and the frame."""
    for first, block in stage.plan.placed:
        if first <= i < first + block.frames and isinstance(block, PhaseSteps):
            change = shift(block.shifts_rad[i - first], i) - block.shifts_rad[i - first]
            return stage.pattern(i, x - change * block.period_px / (2.0 * np.pi))
    return stage.pattern(i, x)


# What the optics and the scene do.


def _blurred(stage: Stage, sigma_px: float, i: int, x: np.ndarray) -> np.ndarray:
    """A pattern under a Gaussian blur over projector columns.

    Fringes go on beyond the projector's ends, so that its border does not shift the phase.
    """
    fine, beyond = 8, 5.0 * sigma_px
    position = np.arange(-beyond, stage.plan.width_px + beyond, 1.0 / fine)
    at = position if stage.is_phase(i) else np.clip(position, -0.5, stage.plan.width_px - 0.51)
    table = ndimage.gaussian_filter1d(stage.pattern(i, at), sigma_px * fine, mode="nearest")
    return np.interp(x, position, table)


def defocus(stage: Stage, rng: np.random.Generator) -> Shot:
    """A projector out of focus by 3 px rms."""
    return stage.shot(expose(stage.each(partial(_blurred, stage, 3.0)), rng))


def interreflection(stage: Stage, rng: np.random.Generator) -> Shot:
    """A second surface adds 15 % of the light that it receives from other projector columns."""
    second = 0.62 * stage.plan.width_px - 0.35 * stage.seen.x

    def pattern(i: int, x: np.ndarray) -> np.ndarray:
        return stage.pattern(i, x) + 0.15 * _blurred(stage, 4.0, i, second)

    return stage.shot(expose(0.9 * stage.each(pattern), rng))


def mixed_pixels(stage: Stage, rng: np.random.Generator) -> Shot:
    """Pixels average over their area and a lens blur of 0.5 px: at depth steps over two surfaces."""
    return _moved(stage, rng, np.zeros((stage.plan.frames, 2)))


def blending(stage: Stage, rng: np.random.Generator) -> Shot:
    """The exposure lasts into the next pattern: each frame holds 10 % of the next."""
    following = np.concatenate([stage.direct[1:], stage.direct[-1:]])
    light = 0.9 * stage.direct + 0.1 * following + stage.ambient
    return stage.shot(expose(light, rng), any_offset=True)


# Motion.


def _moved(stage: Stage, rng: np.random.Generator, shifts: np.ndarray) -> Shot:
    """A camera displaced by (columns, rows) in every frame, whose pixels and lens average.

    The true coordinate of a pixel on one surface is the mean weighted with the reflected light.
    """
    fine = see_fine(stage.scene, stage.plan.width_px)
    reflected = fine.albedo * fine.lit
    ambient = AMBIENT * fine.albedo

    def image(light: np.ndarray, shift: np.ndarray) -> np.ndarray:
        return ndimage.gaussian_filter(pixels(light, (float(shift[0]), float(shift[1]))), LENS_PX)

    light = [
        image(reflected * stage.pattern(i, fine.x) + ambient, shift)
        for i, shift in enumerate(shifts)
    ]
    mean = stage.weights @ shifts
    return at_edges(expose(np.stack(light), rng), stage.at(tuple(mean)).truth)


def nudged(stage: Stage, rng: np.random.Generator) -> Shot:
    """Somebody touches the tripod: the camera moves by 1 px between two sets, or set and code."""
    firsts = [first for first, block in stage.plan.placed if block.frames > 1][1:]
    since = firsts[rng.integers(len(firsts))]
    shifts = np.zeros((stage.plan.frames, 2))
    shifts[since:, 0] = 1.0
    return _moved(stage, rng, shifts)


def vibration(stage: Stage, rng: np.random.Generator) -> Shot:
    """The camera shakes by 0.3 px rms along rows and columns, anew in every frame."""
    return _moved(stage, rng, 0.3 * rng.standard_normal((stage.plan.frames, 2)))


def _phase_motion(stage: Stage, rng: np.random.Generator, turns: np.ndarray) -> Shot:
    """Surfaces that move in depth: coordinates change by ``turns`` rad of the finest fringes."""
    travel = turns * stage.finest_px / (2.0 * np.pi)
    width = stage.plan.width_px

    def pattern(i: int, x: np.ndarray) -> np.ndarray:
        now = x + travel[i]
        return stage.pattern(i, now) * (now < width - 0.5)

    truth = stage.seen.truth + stage.weights @ travel
    truth = np.where(truth < width - 0.5, truth, np.nan)
    return Shot(expose(stage.each(pattern), rng), truth[None])


def motion(stage: Stage, rng: np.random.Generator) -> Shot:
    """The object moves at constant speed: 0.2 rad of the finest fringes per frame."""
    return _phase_motion(stage, rng, 0.2 * np.arange(stage.plan.frames))


def accelerating(stage: Stage, rng: np.random.Generator) -> Shot:
    """The object starts from rest and reaches 0.4 rad of the finest fringes per frame."""
    n = stage.plan.frames
    return _phase_motion(stage, rng, 0.2 * np.arange(n) ** 2 / (n - 1))


# How frames are stored.


def jpeg(stage: Stage, rng: np.random.Generator, quality: int) -> Shot:
    """Grey frames stored as JPEG."""
    frames = []
    for frame in expose(stage.direct + stage.ambient, rng):
        with io.BytesIO() as file:
            Image.fromarray(frame).save(file, "JPEG", quality=quality)
            frames.append(np.asarray(Image.open(file)))
    return at_edges(np.stack(frames), stage.seen.truth)


def colour(stage: Stage, rng: np.random.Generator) -> Shot:
    """8-bit colour frames with unequal channels, as float32 luminance."""
    light = stage.direct + stage.ambient
    shares = ((1.0, 0.299), (0.7, 0.587), (0.45, 0.114))
    grey = sum(w * expose(c * light, rng, noise=0.3).astype(np.float32) for c, w in shares)
    return stage.shot(np.asarray(grey, np.float32))


def twelve_bits(stage: Stage, rng: np.random.Generator) -> Shot:
    """A 12-bit camera with a noise of 5 counts, stored in 16-bit files."""
    light = 16.0 * (EXPOSURE * (stage.direct + stage.ambient) + BLACK)
    counts = light + 5.0 * rng.standard_normal(light.shape, dtype=np.float32)
    return stage.shot(np.clip(np.rint(counts), 0, 4095).astype(np.uint16))


def clipped_black(stage: Stage, rng: np.random.Generator) -> Shot:
    """A black level set too low by 8 counts, in a dark room: dark samples are stored as 0."""
    return stage.shot(expose(stage.direct, rng, black=-8.0))


FAULTS: dict[str, Fault] = {
    "quantised": partial(white_noise, noise=0.0),
    **{f"noise-{s}": partial(white_noise, noise=float(s)) for s in (1, 2, 4, 8)},
    "shot-noise": shot_noise,
    "nudged": nudged,
    "lost": lost,
    "swapped": swapped,
    **{f"late{k:+d}": partial(late, frames=k) for k in (1, 2, 3, -1, -2, -3)},
    "dark-frame": dark_frame,
    "gamma-2.2": projector_gamma,
    "camera-curve": camera_curve,
    "flicker": flicker,
    "drift": drift,
    "lamp": lamp,
    "jpeg-80": partial(jpeg, quality=80),
    "jpeg-50": partial(jpeg, quality=50),
    "vibration": vibration,
    "blending": blending,
    "interreflection": interreflection,
    "defocus": defocus,
    "saturation": saturation,
    "mixed-pixels": mixed_pixels,
    "motion": motion,
    "accelerating": accelerating,
    "wrong-steps": wrong_steps,
    "random-steps": random_steps,
    "colour": colour,
    "12-bit": twelve_bits,
    "clipped-black": clipped_black,
}
