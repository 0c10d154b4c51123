"""Stripes of several widths: what the optics resolve, and whether pictures are resized."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.protocols import Projector
from fringeworks.patterns.plan import equal_steps
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.uniform import black_picture, picture_type
from fringeworks.types import Axis, BoolMap, Finding, FloatMap, Frozen

PERIODS_PX = (3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)
"""Periods that are shown, projector px, the coarsest last."""
STEPS = 6
"""Phase steps of each period. The modulation is then free of the harmonics up to the fourth, which
a response that is not straight would turn into a change over the picture."""
SWING = 0.3
"""Amplitude of the stripes about half of full scale, so that video of limited range does not cut
them off."""
MIN_CONTRAST = 0.2
"""Smallest contrast of usable stripes, relative to the coarsest. Below, the fringes are so weak
that a longer period gives a smaller error."""
BEAT_SHARE = 0.03
"""Amplitude of a periodic change of the contrast over the picture, relative to its mean, from which
on pictures are resized. Linear interpolation between pixels gives 0.15 at a period of 4 px."""
BEAT_POWER = 25.0
"""Power of the strongest frequency of the contrast's profile, over the mean of the others, from
which on the change is periodic. Noise exceeds it in one profile of 10⁹."""
FINE_PX = 8.0
"""Longest period whose contrast shows that pictures are resized, projector px: linear interpolation
takes less than 4 % from coarser stripes."""
MIN_COUNT = 4
"""Smallest number of camera pixels whose mean is the contrast at a projector coordinate."""
MIN_COUNT_SHARE = 0.2
"""The same, relative to the median number of camera pixels at a projector coordinate: coordinates
at the rim of the lit area scatter more."""
EDGE_PX = 5
"""Side of the neighbourhood in which edges are looked for, camera px: wider than the blur of usual
lenses on both sides."""
EDGE_SHARE = 0.25
"""Change of the modulation in the neighbourhood, relative to the brightest pixel, from which on a
pixel lies at an edge. At the edges of a chessboard, the contrast of fine stripes changes by several
per cent, in step with the squares."""
EDGE_SIGMAS = 8.0
"""Change in standard deviations of the noise that an edge must exceed as well: the range of 25
values of noise is 4 to 6."""
MIN_COLUMNS = 32
"""Smallest number of projector columns that must be seen to look for a periodic change."""
SLOW_CYCLES = 3
"""Changes of the contrast with fewer cycles over the picture are shape and focus, not resizing."""
GRID_PARTS = 8
"""Parts of a projector pixel that the contrast is compared within: the coarse coordinates are known
to a third of one."""
LEAST_POWER = 1e-12
"""Divides instead of a zero."""


@dataclass(frozen=True, eq=False, repr=False)
class Stripes(Frozen):
    """Contrast of stripes."""

    axis: Axis
    period_px: FloatMap
    """Shown periods, (n,), projector px."""
    contrast: FloatMap
    """Median modulation over the lit pixels, (n,), relative to that of the coarsest period."""
    min_period_px: float
    """Period with the smallest phase error per pixel: contrast over period is largest."""
    camera_pixel_px: float
    """Projector px that a camera pixel spans; the median over the lit pixels."""
    blur_px: float
    """Standard deviation of the blur that the contrast shows beside the pixels' area, camera px."""
    profile_period_px: float
    """Period of the stripes that ``profile`` belongs to, projector px: the one that shows resized
    pictures, or the finest that is resolved."""
    place_px: FloatMap
    """Projector coordinates along the axis, (k,), px."""
    profile: FloatMap
    """Rms contrast of these stripes at each projector coordinate, (k,), relative to the mean."""
    findings: tuple[Finding, ...]


def check_stripes(
    projector: Projector,
    agreement: Agreement,
    lit: BoolMap,
    coordinate_px: FloatMap,
    *,
    axis: Axis = "x",
) -> Stripes:
    """Show stripes of several widths and measure their contrast.

    Parameters
    ----------
    projector : Projector
    agreement : Agreement
        Of projector and camera.
    lit : (h, w) bool array
        Pixels that the projector lights.
    coordinate_px : (h, w) array
        Projector coordinate along the axis, px; NaN where it is unknown.
    axis : "x" or "y"

    Returns
    -------
    Stripes, with a finding where pictures are resized on their way.

    Notes
    -----
    The modulation of a pixel does not depend on the stripes' phase, so it is smooth over the
    picture. If a picture is resized, new pixels lie now on and now between the old ones, and the
    contrast of fine stripes is high and low in turn.
    """
    power = [_power(projector, agreement, axis, period) for period in PERIODS_PX]
    usable = lit & (power[-1] > 0)
    coarse = np.where(usable, power[-1], np.nan)
    relative = [p / coarse for p in power]
    contrast = np.array([_root(float(np.nanmedian(r))) for r in relative])
    periods = np.array(PERIODS_PX)
    resolved = contrast >= MIN_CONTRAST
    best = int(np.argmax(np.where(resolved, contrast / periods, 0.0)))
    found: list[Finding] = []
    if not resolved[:-1].any():
        found.append(_unresolved(axis))
    judged = [int(k) for k in np.flatnonzero(resolved & (periods <= FINE_PX))]
    inside = np.where(_even(coarse, agreement), coordinate_px, np.nan)
    profiles = {k: _profile(_without_grid(relative[k], inside), inside) for k in judged or [best]}
    shown = next(iter(profiles))
    for k in judged:
        beat = _beat(*profiles[k])
        if beat is not None:
            shown = k
            found.append(_resized(axis, PERIODS_PX[k], *beat))
            break
    place, profile = profiles[shown]
    pixel = _pixel(np.where(usable, coordinate_px, np.nan))
    return Stripes(
        axis,
        periods,
        contrast,
        float(periods[best]),
        pixel,
        _blur(periods, contrast, pixel),
        float(periods[shown]),
        place.astype(np.float64),
        profile / (float(profile.mean()) if profile.size else 1.0),
        tuple(found),
    )


def _pixel(coordinate_px: FloatMap) -> float:
    """Projector px across a camera pixel: the median gradient of the coordinate."""
    along, down = np.gradient(coordinate_px.astype(np.float64), axis=(1, 0))
    gradient = np.hypot(along, down)
    return float(np.nanmedian(gradient)) if np.isfinite(gradient).any() else 0.0


def _blur(periods_px: FloatMap, contrast: FloatMap, pixel_px: float) -> float:
    """Standard deviation of a Gaussian blur, camera px, from the contrast of stripes.

    Its logarithm falls by 2π² σ²/p². The areas of a camera's and a projector's pixel take their
    share before, and the error of the logarithm is in inverse proportion to the contrast.
    """
    area = np.sinc(np.minimum(pixel_px / periods_px, 0.9)) * np.sinc(1.0 / periods_px)
    seen = (contrast > 0) & (pixel_px > 0)
    if np.count_nonzero(seen) < 2:
        return 0.0
    left = np.log((contrast / area / (contrast[-1] / area[-1]))[seen])
    rate = 2.0 * np.pi**2 * (1.0 / periods_px**2 - 1.0 / periods_px[-1] ** 2)[seen]
    weight = contrast[seen] ** 2
    square = -float(np.sum(weight * rate * left) / np.sum(weight * rate**2))
    return float(max(square, 0.0) ** 0.5 / pixel_px)


def _root(power: Any) -> Any:
    """Modulation from its power; noise alone may make the power negative."""
    return np.sqrt(np.maximum(power, 0.0))


def _power(
    projector: Projector, agreement: Agreement, axis: Axis, period_px: float
) -> NDArray[Any]:
    """Squared modulation of stripes, without the part that noise adds, (h, w), counts².

    Noise of variance σ² adds 4 σ² / N to the mean of B². Left in, dark parts of the picture would
    seem to have more contrast than bright ones.
    """
    label = f"stripes of {period_px:g} px"
    columns, rows = projector.size_px
    position = np.arange(columns)[None, :] if axis == "x" else np.arange(rows)[:, None]
    top = 2**projector.bits - 1
    frames = []
    for shift in equal_steps(STEPS):
        level = 0.5 + SWING * np.cos(2.0 * np.pi * position / period_px - shift)
        picture = np.broadcast_to(np.rint(top * level), (rows, columns))
        # Stripes that the optics do not resolve all look alike; black between them does not.
        agreement.take(black_picture(projector), "black")
        shown = picture.astype(picture_type(projector))
        frames.append(agreement.take(shown, label).pixels.astype(np.float32))
    phasor = np.tensordot(np.exp(1j * np.array(equal_steps(STEPS))), np.stack(frames), axes=1)
    added = 4.0 / STEPS * agreement.noise.usual.variance(np.mean(frames, axis=0))
    return np.asarray((2.0 / STEPS * np.abs(phasor)) ** 2 - added)


def _even(coarse: FloatMap, agreement: Agreement) -> BoolMap:
    """Pixels whose neighbours are as bright: blur mixes the stripes at edges of another albedo."""
    modulation = _root(np.nan_to_num(coarse))
    brightest = scipy.ndimage.maximum_filter(modulation, EDGE_PX)
    step = brightest - scipy.ndimage.minimum_filter(modulation, EDGE_PX)
    noise = np.sqrt(2.0 / STEPS * agreement.noise.usual.variance(brightest / (2.0 * SWING)))
    return np.asarray(step < EDGE_SHARE * brightest + EDGE_SIGMAS * noise)


def _without_grid(power: FloatMap, coordinate_px: FloatMap) -> FloatMap:
    """Power relative to the mean one at the same place on a projector pixel.

    Camera pixels that see halves of two projector pixels have less contrast than those that see one
    alone, so that the contrast beats with the pixel grids without any resizing.
    """
    known = np.isfinite(power) & np.isfinite(coordinate_px)
    part = np.zeros(power.shape, int)
    part[known] = (coordinate_px[known] % 1.0 * GRID_PARTS).astype(int) % GRID_PARTS
    count = np.bincount(part[known], minlength=GRID_PARTS)
    total = np.bincount(part[known], power[known], minlength=GRID_PARTS)
    mean = total / np.maximum(count, 1)
    usual = float(total.sum() / max(count.sum(), 1))
    return np.asarray(power * (usual / np.where(mean > 0.0, mean, max(usual, LEAST_POWER)))[part])


def _profile(power: FloatMap, coordinate_px: FloatMap) -> tuple[NDArray[Any], FloatMap]:
    """Projector coordinates that enough pixels see, px, and the rms contrast at each."""
    known = np.isfinite(power) & np.isfinite(coordinate_px)
    if not known.any():
        return np.empty(0, int), np.empty(0)
    place = np.rint(coordinate_px[known]).astype(int)
    first = int(place.min())
    count = np.bincount(place - first)
    enough = count >= max(MIN_COUNT, MIN_COUNT_SHARE * np.median(count[count > 0]))
    mean = np.bincount(place - first, power[known])[enough] / count[enough]
    return np.flatnonzero(enough) + first, np.asarray(_root(mean))


def _beat(x: NDArray[Any], profile: FloatMap) -> tuple[float, float] | None:
    """Amplitude and period of a periodic change of the contrast; None where there is none."""
    if len(x) < MIN_COLUMNS:
        return None
    mean = float(profile.mean())
    scaled = np.linspace(-1.0, 1.0, len(x))
    profile = profile - np.polyval(np.polyfit(scaled, profile, 4), scaled)
    whole = np.zeros(x[-1] - x[0] + 1)
    whole[x - x[0]] = profile * np.hanning(len(x) + 2)[1:-1]
    power = np.abs(np.fft.rfft(whole)) ** 2
    power[: SLOW_CYCLES + 1] = 0.0
    peak = int(np.argmax(power))
    others = np.delete(power, slice(max(0, peak - 2), peak + 3))[SLOW_CYCLES + 1 :]
    # A Hann window halves the amplitude.
    amplitude = 4.0 * float(np.sqrt(power[peak])) / len(x) / mean
    if amplitude < BEAT_SHARE or power[peak] < BEAT_POWER * max(float(others.mean()), 1e-12):
        return None
    return amplitude, len(whole) / peak


def _unresolved(axis: Axis) -> Finding:
    return Finding(
        "contrast",
        f"stripes along {axis} of {PERIODS_PX[-2]:g} px or less have less than "
        f"{MIN_CONTRAST:.0%} of the contrast of {PERIODS_PX[-1]:g} px",
        ("a projector or camera that is out of focus", "a camera with too few pixels"),
        "focus the projector, then the camera, on the object",
    )


def _resized(axis: Axis, period_px: float, amplitude: float, beat_px: float) -> Finding:
    return Finding(
        "scale",
        f"the contrast of stripes of {period_px:g} px along {axis} changes by "
        f"{amplitude:.0%} every {beat_px:.3g} px",
        (
            "a video mode that is not the projector's own",
            "keystone correction, zoom or overscan of the projector",
            "scaling by the operating system",
        ),
        "set the output to the projector's own resolution, and switch off keystone correction, "
        "digital zoom and overscan",
        figures={f"amplitude_share_{axis}": amplitude, f"beat_{axis}_px": beat_px},
    )
