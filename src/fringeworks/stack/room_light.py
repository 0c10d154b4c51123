"""Light that differs from frame to frame of a Gray code: of a room that flickers, or exposures.

Bits are compared with other frames. Where the light of the room or the exposure has changed between
them, the borders of the cells move, and bits look as if they were in doubt.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Planes
from fringeworks.stack.gray_frames import MIN_LEVEL_PIXELS
from fringeworks.stack.gray_light import codes_of_two_levels
from fringeworks.statistics.quantiles import median
from fringeworks.types import Finding, FloatMap
from fringeworks.types.numbers import percent

LEAST_CHANGE = 0.08
"""Smallest change of the light halfway between dark and lit, in contrasts, that is told: less moves
no bit that blur leaves a third of its contrast."""

LEAST_TAKEN = 0.05
"""Smallest change of a bit, or of the middle of white and black, that is taken out. Of light that
surfaces throw on each other, bits see half: white looks brighter and black darker by as much, and
their middle is the same."""

FEWEST_FRAMES = 5
"""Frames of Gray codes, and of white and black, from which on their light is compared: the levels
of a pixel are medians of several frames."""

PIXELS = 8000
"""Approximate number of pixels that tell the light of the frames."""

SMALL = 0.05
"""Share of the pixels up to which a level of a frame is left out: noise and borders make some of
the other level."""

MOST_CHANGE = 0.4
"""Largest change that is taken out: half of the contrast makes a dark sample a lit one, and a white
frame that is none looks like one that is darker by half."""

CLEAR = 0.3
"""Contrast of a pixel over that of bright ones from which on its levels are told apart."""

SCATTER = 0.05
"""Usual distance of samples from those lines, in contrasts."""

ALIKE = 1.0
"""Usual difference of d and e, which keeps d near e where the room is so dark that no line shows
it."""

BLUR = 0.2
"""Usual m, which counts where all pixels have the same share of the room's light, so that the lines
have no slope to see."""

FITS = 3
"""Fits of the lines, each without the outliers of the one before."""

OUTLIERS = 4.0
"""Distance of outliers from the lines, in medians of all distances: samples on borders."""

PASSES = 4
"""Estimates after one another: each has the levels without the changes found before."""

FULL = 0.25
"""Largest distance of a sample from its level, in contrasts, away from borders."""

NEAR = 0.8
"""Least share of such samples under even light. Of the bits of a pixel, one is on a border, and
those that the camera does not resolve are grey."""

GAIN_SHARE = 0.5
"""Change of the contrast, over that of the light halfway between dark and lit, from which on it is
the exposure that differs. Light of the room leaves the contrast as it is; an exposure changes it by
as much at least where the room has less than one and a half times the projector's light."""

MOST_FRAMES = 0.75
"""Share of the frames that must show it. Levels of pixels whose frames differ are unsure."""

MOST_NAMED = 3
"""At most this many frames are named."""


@dataclass(frozen=True)
class _Light:
    """The light of frames, (N,) each."""

    room: FloatMap
    """Light of the room, d."""
    gain: FloatMap
    """Light of the projector, e."""
    contrast: FloatMap
    """Lit less dark samples over usual ones, e (1 − 2 m): it does not depend on the room."""
    change: FloatMap
    """Change of the light halfway between dark and lit, contrasts."""
    both: NDArray[np.bool_]
    """Whether the frame shows both levels, as only bits do."""


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
    D by the light of the room, the light S of the projector, and the bit b_k, which blur and light
    of other surfaces bring from 0 and 1 to m_k and 1 − m_k. D and S are the medians of the dark and
    the lit bits of a pixel. Over a sample of pixels, I_k / S is a line over D / S for dark samples,
    and one for lit samples, both with the slope d_k: their heights e_k m_k and e_k (1 − m_k) give
    e_k. Samples at the largest count of the type keep their value.
    """
    frames = _frames(plan)
    if len(frames) < FEWEST_FRAMES:
        return planes, []
    step = max(1, int((planes[0].size / PIXELS) ** 0.5))
    values = np.stack([planes[k][::step, ::step].ravel() for k in frames]).astype(np.float64)
    kind = planes[0].dtype
    top = float(np.iinfo(kind).max) if kind.kind == "u" else np.inf
    values = values[:, np.isfinite(values).all(axis=0) & (values.max(axis=0) < top)]
    white, black = plan.uniform("white"), plan.uniform("black")
    light = _light(values, [None if k not in (white, black) else k == white for k in frames])
    if light is None:
        return planes, []
    room, gain, change = light.room, light.gain, light.change
    resolved = _resolved(plan, frames, light.both)
    size = np.where(resolved, np.abs(change), 0.0)
    if white in frames and black in frames:
        of_light = [frames.index(k) for k in (white, black)]
        if change[of_light[0]] > 0.0 > change[of_light[1]]:  # as of light between surfaces
            size[of_light] = abs(float(np.mean(change[of_light])))
    changed = np.flatnonzero(size > LEAST_TAKEN)
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
    return out, _findings(plan, frames, light, changed[np.abs(change[changed]) > LEAST_CHANGE])


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


def _light(values: FloatMap, given: list[bool | None]) -> _Light | None:
    """The light of frames by a sample of their pixels, (N, n) counts; None where they do not tell.

    ``given`` says whether all of a frame is lit (white) or dark (black); None for a bit.
    """
    bits = np.array([one is None for one in given])
    values = values[:, np.ptp(values[bits], axis=0) > 0.0]
    even = values
    for _ in range(PASSES):
        dark, contrast, lit = _levels(even, given)
        bright = np.quantile(contrast, 0.95) if contrast.size else np.inf
        clear = (contrast > CLEAR * bright) & (dark > 0.0)
        if np.count_nonzero(clear) < MIN_LEVEL_PIXELS:
            return None
        seen = dark[clear] / contrast[clear]
        parts = [
            _of_frame(v[clear] / contrast[clear], seen, b[clear])
            for v, b in zip(values, lit, strict=True)
        ]
        room, gain, shown, both = np.array(parts).T
        if min(room.min(), gain.min()) <= 0.0:
            return None
        room, gain = room / np.median(room[bits]), gain / np.median(gain[bits])
        change = (room - 1.0) * float(np.median(seen)) + 0.5 * (gain - 1.0)
        if not np.any(np.abs(change) > LEAST_TAKEN):
            break
        even = (values - room[:, None] * dark) / gain[:, None] + dark
    before, after = (_near_levels(v[:, clear], given) for v in (values, even))
    told = after > max(NEAR, before) and np.abs(change).max() < MOST_CHANGE
    return _Light(room, gain, shown, change, both > 0.0) if told else None


def _near_levels(values: FloatMap, given: list[bool | None]) -> float:
    """Share of the samples that are near their level."""
    dark, contrast, lit = _levels(values, given)
    return float(np.mean(np.abs((values - dark) / contrast - lit) < FULL))


def _levels(
    values: FloatMap, given: list[bool | None]
) -> tuple[FloatMap, FloatMap, NDArray[np.bool_]]:
    """Dark level and contrast of every pixel by its bits, and which of its samples are lit."""
    bits = np.array([one is None for one in given])
    seen = values[bits]
    lit = np.array([np.full(values.shape[1], bool(one)) for one in given])
    lit[bits] = seen > 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    order, columns = np.sort(seen, axis=0), np.arange(values.shape[1])
    darks = len(seen) - np.count_nonzero(lit[bits], axis=0)
    dark = order[np.maximum(darks - 1, 0) // 2, columns]
    bright = order[np.minimum((darks + len(seen)) // 2, len(seen) - 1), columns]
    return dark, bright - dark, lit


def _of_frame(
    samples: FloatMap, dark: FloatMap, lit: NDArray[np.bool_]
) -> tuple[float, float, float, bool]:
    """d, e and the contrast of a frame, and whether it shows both levels, from samples and dark
    levels over the contrast of their pixels."""
    fewest = max(MIN_LEVEL_PIXELS, SMALL * lit.size)
    some_dark, some_lit = np.count_nonzero(~lit) >= fewest, np.count_nonzero(lit) >= fewest
    if not some_lit:
        return float(np.median((samples / dark)[~lit])), 1.0, 1.0, False
    if not some_dark:  # light of the room and of the projector change alike
        change = float(np.median((samples / (dark + 1.0))[lit]))
        return change, change, 1.0, False
    design: FloatMap = np.column_stack((dark, ~lit, lit)).astype(np.float64)
    priors: FloatMap = np.array([[1.0 / ALIKE, -1.0 / ALIKE, -1.0 / ALIKE], [0.0, 1.0 / BLUR, 0.0]])
    kept = np.ones(lit.size, bool)
    found: FloatMap = np.zeros(3)
    for _ in range(FITS):
        used, seen = design[kept], samples[kept]
        # Levels are as wrong as samples, and alike at many pixels: these count as one.
        unit = SCATTER**2 * len(used)
        normal = used.T @ used / unit + priors.T @ priors
        found = np.linalg.solve(normal, used.T @ seen / unit)
        off = np.abs(samples - design @ found)
        kept = off <= OUTLIERS * max(median(off), SCATTER)
    room, low, high = map(float, found)
    return room, low + high, high - low, True


def _findings(
    plan: PatternPlan, frames: list[int], light: _Light, changed: NDArray[np.intp]
) -> list[Finding]:
    """What was taken out: other exposures, or light of the room, whichever changes more."""
    if not changed.size:
        return []
    labels = [plan.labels()[frames[n]] for n in changed]
    both = changed[light.both[changed]]  # frames of one level do not tell
    shown = light.contrast[light.both]
    # The usual contrast is that of most frames, or of what pixels show in all of them.
    units = np.array([[median(shown) if shown.size else 1.0], [1.0]])
    off = np.abs(light.contrast[both] / units - 1.0)
    by_gain = (off > GAIN_SHARE * np.abs(light.change[both])).all(axis=0)
    if np.count_nonzero(by_gain) > MOST_FRAMES * both.size:
        return [_of_exposures(plan, labels, light.gain[changed])]
    return [_of_room(labels, light.change[changed])]


def _of_exposures(plan: PatternPlan, labels: list[str], gains: FloatMap) -> Finding:
    """Frames with other exposures, in words."""
    axes = {code.axis for _, code in codes_of_two_levels(plan)}
    others = f"the others along {axes.pop()}" if len(axes) == 1 else "the others"
    least, most = float(gains.min()), float(gains.max())
    if len(labels) == 1:
        said = f"frame {labels[0]} has another exposure than {others} ({most:.2f} times)"
    else:
        said = f"frames {_listed(labels)} have other exposures than {others} ({least:.2f} to "
        said += f"{most:.2f} times)"
    return Finding(
        "exposure",
        f"{said}; taken out",
        ("automatic exposure", "a projector that was not yet bright"),
        "fix the exposure, and take the frames again",
        frames=tuple(labels),
        figures={"least": least, "most": most},
    )


def _of_room(labels: list[str], change: FloatMap) -> Finding:
    """Frames in other light of the room, in words."""
    most = float(np.abs(change).max())
    return Finding(
        "flicker",
        f"the light of {_listed(labels)} differs from that of the other "
        f"frames of the Gray code, by up to {percent(most)} of its contrast; taken out",
        ("light of the room that flickers", "automatic exposure"),
        "switch off the light of the room, or expose for whole periods of the mains, and fix the "
        "exposure",
        frames=tuple(labels),
        figures={"change": most},
    )


def _listed(labels: list[str]) -> str:
    """Names of frames, as many as are read."""
    more = f" and {len(labels) - MOST_NAMED} more" if len(labels) > MOST_NAMED else ""
    return f"{', '.join(labels[:MOST_NAMED])}{more}"
