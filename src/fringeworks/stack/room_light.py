"""Light that differs from frame to frame of a Gray code: of a room that flickers, or exposures.

Bits are compared with other frames. Where the light of the room or the exposure has changed between
them, the borders of the cells move, and bits look as if they were in doubt.
"""

from __future__ import annotations

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Planes
from fringeworks.stack.gray_frames import MIN_LEVEL_PIXELS
from fringeworks.stack.gray_light import codes_of_two_levels
from fringeworks.types import Finding, FloatMap
from fringeworks.types.numbers import percent

LEAST_CHANGE = 0.08
"""Smallest change of the light halfway between dark and lit, in contrasts, that is taken out: less
moves no bit that blur leaves a third of its contrast."""

FEWEST_FRAMES = 5
"""Frames of Gray codes, and of white and black, from which on their light is compared: the levels
of a pixel are medians of several frames."""

PIXELS = 8000
"""Approximate number of pixels that tell the light of the frames."""

SMALL = 0.05
"""Share of the pixels up to which a level of a frame is left out: noise and borders make some of
the other level."""

MOST_GAIN = 1.3
"""Largest factor on the projector's light, either way, that is taken out. Bits that blur makes grey
have less contrast, which is no other exposure."""

MOST_CHANGE = 0.4
"""Largest change that is taken out: half of the contrast makes a dark sample a lit one."""

CLEAR = 0.3
"""Contrast of a pixel over that of bright ones from which on its levels are told apart."""

PASSES = 4
"""Estimates after one another: each has the levels without the changes found before."""

FULL = 0.25
"""Largest distance of a sample from its level, in contrasts, away from borders."""

NEAR = 0.8
"""Least share of such samples under even light. Of the bits of a pixel, one is on a border, and
those that the camera does not resolve are grey."""

MOST_NAMED = 3
"""At most this many frames are named."""


def evened(planes: Planes, plan: PatternPlan) -> tuple[Planes, list[Finding]]:
    """The frames with Gray codes under one light, and what was taken out.

    Parameters
    ----------
    planes : (h, w) arrays in the order of the plan, counts
    plan : PatternPlan

    Returns
    -------
    planes
        Those whose light differs are replaced by computed ones of the same type.
    findings
        Empty where the light is the same.

    Notes
    -----
    Away from the borders of its cells, a pixel shows I_k = d_k D + e_k S b_k in frame k: its level
    D by the light of the room, the light S of the projector, and the bit b_k. Medians over a sample
    of pixels give d_k by dark samples and e_k by lit ones. D and S are those of the median frame.
    Samples at the largest count of the type keep their value.
    """
    frames = _frames(plan)
    if len(frames) < FEWEST_FRAMES:
        return planes, []
    step = max(1, int((planes[0].size / PIXELS) ** 0.5))
    values = np.stack([planes[k][::step, ::step].ravel() for k in frames]).astype(np.float64)
    kind = planes[0].dtype
    top = float(np.iinfo(kind).max) if kind.kind == "u" else np.inf
    values = values[:, np.isfinite(values).all(axis=0) & (values.max(axis=0) < top)]
    light = _light(values)
    if light is None:
        return planes, []
    room, gain, change, both = light
    changed = np.flatnonzero((np.abs(change) > LEAST_CHANGE) & _resolved(plan, frames, both))
    if not changed.size:
        return planes, []
    dark = planes[frames[0]] / np.float32(room[0])
    for k, d in zip(frames[1:], room[1:], strict=True):
        np.minimum(dark, planes[k] / np.float32(d), out=dark)
    out = list(planes)
    for n in changed:
        plane = planes[frames[n]]
        even = (plane - np.float32(room[n]) * dark) / np.float32(gain[n]) + dark
        if kind.kind == "u":
            even = np.where(plane < top, np.clip(np.rint(even), 0.0, top), top)
        out[frames[n]] = even.astype(kind)
    return out, [_told(plan, [frames[n] for n in changed], change[changed])]


def _frames(plan: PatternPlan) -> list[int]:
    """Frames of the Gray codes of two levels, and of white and black light; none without codes."""
    bits = [range(first, first + code.frames) for first, code in codes_of_two_levels(plan)]
    light = [k for kind in ("white", "black") if (k := plan.uniform(kind)) is not None]
    return [*chain(*bits), *light] if bits else []


def _resolved(plan: PatternPlan, frames: list[int], both: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Frames that are surely not grey, (N,): fine bits of one level may be, because the camera does
    not resolve them."""
    shown, sure = dict(zip(frames, both, strict=True)), set(frames)
    for first, code in codes_of_two_levels(plan):
        of_code = range(first, first + code.frames)
        last = max((k for k in of_code if shown[k]), default=first)
        sure -= set(of_code[last + 1 - first :])
    return np.array([k in sure for k in frames])


def _light(
    values: FloatMap,
) -> tuple[FloatMap, FloatMap, FloatMap, NDArray[np.bool_]] | None:
    """d_k and e_k of every frame, the change of the light halfway between dark and lit, in
    contrasts, and whether both levels are there, (N,) each; None where the frames do not tell."""
    values = values[:, np.ptp(values, axis=0) > 0.0]
    even = values
    for _ in range(PASSES):
        dark, contrast, lit = _levels(even)
        bright = np.quantile(contrast, 0.95) if contrast.size else np.inf
        clear = (contrast > CLEAR * bright) & (dark > 0.0)
        if np.count_nonzero(clear) < MIN_LEVEL_PIXELS:
            return None
        seen = dark[clear], contrast[clear]
        one = [_of_frame(v[clear], *seen, b[clear]) for v, b in zip(values, lit, strict=True)]
        room, gain, both = np.array(one).T
        if min(room.min(), gain.min()) <= 0.0:
            return None
        room, gain = room / np.median(room), gain / np.median(gain)
        ratio = float(np.median(dark[clear] / contrast[clear]))
        change = (room - 1.0) * ratio + 0.5 * (gain - 1.0)
        if not np.any(np.abs(change) > LEAST_CHANGE):
            break
        even = (values - room[:, None] * dark) / gain[:, None] + dark
    change[np.abs(np.log(gain)) > np.log(MOST_GAIN)] = 0.0
    before, after = (float(np.mean(_off_level(v[:, clear]) < FULL)) for v in (values, even))
    told = after > max(NEAR, before) and np.abs(change).max() < MOST_CHANGE
    return (room, gain, change, both > 0.0) if told else None


def _off_level(values: FloatMap) -> FloatMap:
    """Distance of samples from their level, in contrasts."""
    dark, contrast, lit = _levels(values)
    return np.abs((values - dark) / contrast - lit)


def _levels(values: FloatMap) -> tuple[FloatMap, FloatMap, NDArray[np.bool_]]:
    """Dark level and contrast of every pixel, and which of its samples are lit."""
    lit = values > 0.5 * (values.min(axis=0) + values.max(axis=0))
    order, columns = np.sort(values, axis=0), np.arange(values.shape[1])
    darks = len(values) - np.count_nonzero(lit, axis=0)
    dark = order[(darks - 1) // 2, columns]
    bright = order[(darks + len(values)) // 2, columns]
    return dark, bright - dark, lit


def _of_frame(
    samples: FloatMap, dark: FloatMap, contrast: FloatMap, lit: NDArray[np.bool_]
) -> tuple[float, float, bool]:
    """d and e of a frame, and whether it shows both levels; of one level, light of the room and of
    the projector change alike, or the latter does not."""
    fewest = max(MIN_LEVEL_PIXELS, SMALL * lit.size)
    some_dark, some_lit = np.count_nonzero(~lit) >= fewest, np.count_nonzero(lit) >= fewest
    if not some_dark:
        change = float(np.median(samples / (dark + contrast)))
        return change, change, False
    room = float(np.median((samples / dark)[~lit]))
    if not some_lit:
        return room, 1.0, False
    return room, float(np.median(((samples - room * dark) / contrast)[lit])), True


def _told(plan: PatternPlan, frames: list[int], change: FloatMap) -> Finding:
    """What was taken out, in words."""
    labels = [plan.labels()[k] for k in frames]
    more = f" and {len(labels) - MOST_NAMED} more" if len(labels) > MOST_NAMED else ""
    most = float(np.abs(change).max())
    return Finding(
        "flicker",
        f"the light of {', '.join(labels[:MOST_NAMED])}{more} differs from that of the other "
        f"frames of the Gray code, by up to {percent(most)} of its contrast; taken out",
        ("light of the room that flickers", "automatic exposure"),
        "switch off the light of the room, or expose for whole periods of the mains, and fix the "
        "exposure",
        frames=tuple(labels),
        figures={"change": most},
    )
