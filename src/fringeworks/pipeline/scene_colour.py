"""What the points of a stack look like: brightness or colour, and the noise of the colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.stack.even_light import texture
from fringeworks.stack.exposure_colours import colour_of_exposures
from fringeworks.stack.frames import Stack, saturation_of
from fringeworks.stack.grey_card import CHANNELS, check_gains
from fringeworks.types import Decoded, Finding, FloatMap, InputError, Pixels, PointCloud, sealed
from fringeworks.types.numbers import percent

FEWEST = 100
"""Smallest number of pixels without saturation that tell what frames show of the channels."""
JUDGED = 100_000
"""Approximate number of pixels of which the median noise is computed."""


def scene_brightness(stacks: Sequence[Stack], found: Decoded) -> FloatMap | None:
    """Brightness (h, w) or colour (h, w, 3) of the scene, counts; None where the plan does not show
    it."""
    seen, gains = stacks[0].colour, stacks[0].white_balance
    if len(stacks) > 1:
        seen = colour_of_exposures(stacks)
        if seen is None:
            return next(iter(found.maps.values())).background
    if seen is not None:
        if len(stacks) == 1:
            seen = _without_saturation(seen, stacks[0], found)
        if gains is None:
            return sealed(seen)
        return sealed(np.asarray(seen * np.array(check_gains(gains), seen.dtype)))
    try:
        return sealed(texture(stacks[0].frames, stacks[0].plan))
    except InputError:
        return None  # the plan shows the scene under fringes only


def _without_saturation(seen: FloatMap, stack: Stack, found: Decoded) -> FloatMap:
    """The colour, as bright as the fitted fringes where some samples of a pixel are saturated.

    The mean of a pixel's samples is wrong there, while the fit leaves saturated samples out.
    """
    limit = saturation_of(stack.frames[0].dtype, stack.saturation)
    if not np.isfinite(limit):
        return seen
    full = np.zeros(stack.frames[0].shape, bool)
    for frame in stack.frames:
        full |= frame >= limit
    fitted = next(iter(found.maps.values())).background
    known = np.isfinite(fitted) & (fitted > 0)
    places, others = np.flatnonzero(full & known), np.flatnonzero(~full & known)
    if not places.size or others.size < FEWEST:
        return seen
    # What the frames show of the three channels: luminance, one of them, or a combination.
    light, flat = np.ravel(fitted), np.reshape(seen, (-1, len(CHANNELS))).astype(np.float64)
    others = others[:: max(1, others.size // JUDGED)]
    weights = np.linalg.lstsq(flat[others], light[others], rcond=None)[0]
    shown = flat[places] @ weights
    lit = shown > 0
    flat[places[lit]] *= (light[places[lit]] / shown[lit])[:, None]
    return np.asarray(flat.reshape(seen.shape), np.float32)


def colour_findings(stacks: Sequence[Stack], points: PointCloud) -> tuple[Finding, ...]:
    """The noise of the points' colour, where it is known."""
    noise, colour = stacks[0].colour_noise, stacks[0].colour
    if noise is None or colour is None or len(stacks) > 1:
        return ()
    ok = np.asarray(points.reason == 0) & (np.asarray(colour) > 0).all(axis=-1)
    places = np.flatnonzero(ok)
    if not places.size:
        return ()
    chosen = np.reshape(colour, (-1, len(CHANNELS)))[places[:: max(1, places.size // JUDGED)]]
    shares = [
        float(np.median(np.sqrt(model.variance(chosen[:, c])) / chosen[:, c]))
        for c, model in enumerate(noise)
    ]
    words = ", ".join(f"{name} {percent(s)}" for name, s in zip(CHANNELS, shares, strict=True))
    return (
        Finding(
            "colour",
            f"standard deviation of the points' colour by noise, median: {words}",
            figures={f"{n} / %": 100.0 * s for n, s in zip(CHANNELS, shares, strict=True)},
            severity="note",
            pixels=Pixels(places.size, ok.size),
        ),
    )
