"""Exposure for fringes: one setting for most of the scene, or several for all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.brightness import Brightness, amount_of, light_per_ms, measure_brightness
from fringeworks.scan.exposure_range import (
    LONGEST_MS,
    ExposureRange,
    configured,
    exposure_range,
)
from fringeworks.scan.saturation import CLIPPED_SHARE, largest_count
from fringeworks.types import CameraSettings, DeviceProblem, InputError


class TooDark(DeviceProblem):
    """The scene is too dark at the largest exposure and gain."""


class TooBright(DeviceProblem):
    """The scene is too bright at the smallest exposure and gain."""


class Unsteady(DeviceProblem):
    """The light flickers at an exposure, and longer ones are too bright."""


TARGET = 0.9
"""Brightness of white that exposures aim at, share of full scale: the rest is for noise and for
lamps that flicker."""
SATURATED = 0.01
"""Share of the lit pixels that may be saturated by default: highlights would otherwise make all
other pixels dark."""
TRIALS = 12
"""Largest number of trial exposures. Four are usual; each takes about twelve frames."""
STEP = 4.0
"""Factor between trial exposures while the scene is too dark or too bright to be judged."""
MOST_RISE = 16.0
"""Largest factor by which one trial raises the exposure: weak light measures its ratio badly."""
SETTLED = 1.04
"""Ratio of the wanted amount of light to the present one that is not corrected any more."""
DARK = 0.04
"""Rise from black to white that bright pixels must reach, share of full scale: the modulation is
then 5 counts of 8 bit, the least that decodes with usual noise."""
DISOBEYS = 1.5
"""Ratio of the measured change of brightness to the expected one from which on an exposure does not
obey. Noise and light from the room change it by a few per cent. Empirical."""
COMPARED_PIXELS = 100
"""Smallest number of pixels for that comparison: their mean has a tenth of a pixel's noise."""
LEAST_RISE = 1e-6
"""Smallest mean rise from black to white in that comparison, share of full scale, so that the ratio
stays finite; the rise of one count of 16 bit is 15 times as large."""
BRIGHT_TAIL = 1e-3
"""Share of the lit pixels that may be brighter than the shortest exposure of a series allows."""
DARK_TAIL = 0.005
"""Share of the lit pixels that may be darker than the longest exposure of a series allows: borders
of shadows and of the projected picture."""


def auto_exposure(
    projector: Projector,
    camera: Camera,
    *,
    saturated: float = SATURATED,
    longest_ms: float = LONGEST_MS,
    whole_periods: bool = True,
) -> CameraSettings:
    """Choose exposure and gain for fringes, and set the camera to them.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Without automatic exposure and gain.
    saturated : float
        Share of the lit pixels that may be saturated under white, 0…1. Lit pixels are brighter
        under white than under black by more than noise.
    longest_ms : float
        Longest exposure, ms.
    whole_periods : bool
        Whether exposures must be whole refresh periods of the projector. Other exposures see a
        changing part of the period, and flicker with colour wheels and pulsed light.

    Returns
    -------
    CameraSettings as read back: the longest exposure that is not too bright, and gain for the part
    of a period that is missing. The brightest samples of fringes are those of white, so the
    modulation is then the largest without saturation.

    Raises
    ------
    DeviceProblem for a scene that is too dark or too bright, a camera that does not obey, and
    frames that do not come; InputError for settings that the devices do not allow.
    """
    if not 0 <= saturated < 1:
        raise InputError(f"saturated: expected 0 to 1, got {saturated}")
    allowed = exposure_range(projector, camera, longest_ms=longest_ms, whole_periods=whole_periods)
    return exposure_in(projector, camera, allowed, saturated)


def exposure_in(
    projector: Projector, camera: Camera, allowed: ExposureRange, saturated: float = SATURATED
) -> CameraSettings:
    """Choose exposure and gain in a range as ``auto_exposure`` does."""
    amount, good, bright = allowed.least, 0.0, np.inf
    tried: list[Brightness] = []
    best: Brightness | None = None
    unsteady: list[CameraSettings] = []
    for _ in range(TRIALS):
        seen = _trial(projector, camera, allowed, amount, unsteady)
        _check_obeys(camera, tried[-1] if tried else None, seen)
        # Cameras round their gain: there may be no setting nearer to what is wanted.
        repeated = any(one.settings == seen.settings for one in tried)
        tried.append(seen)
        amount, level = seen.amount, _level(seen, saturated)
        if level >= CLIPPED_SHARE:
            if amount <= allowed.least * SETTLED:
                raise _too_bright(camera, seen, allowed)
            if repeated and best is not None:
                _check_dark(camera, best, saturated)
                return configured(camera, best.settings)
            bright = min(bright, amount)
            amount = max(amount / STEP, np.sqrt(good * bright), allowed.least)
            continue
        best = seen if amount >= good else best
        good = max(good, amount)
        wanted = amount * min(TARGET / level, MOST_RISE)
        chosen = amount_of(allowed.settings(wanted if wanted < bright else np.sqrt(good * bright)))
        if repeated or max(chosen / amount, amount / chosen) <= SETTLED:
            _check_dark(camera, seen, saturated)
            return seen.settings
        amount = chosen
    raise DeviceProblem(
        f"{camera.name}: expected a steady brightness, got none in {TRIALS} trials: the light "
        "flickers, something moves, or an automatic exposure is on"
    )


def exposure_series(
    projector: Projector,
    camera: Camera,
    count: int,
    *,
    longest_ms: float = LONGEST_MS,
    whole_periods: bool = True,
) -> list[CameraSettings]:
    """Choose several settings so that every lit pixel is well exposed in at least one.

    Parameters
    ----------
    projector, camera, longest_ms, whole_periods
        As for ``auto_exposure``.
    count : int
        Number of exposures; ≥ 1. One is that of ``auto_exposure``.

    Returns
    -------
    Settings as read back, the shortest exposure first; fewer than ``count`` where the range of
    exposures has fewer steps or the scene needs fewer. The camera is left at the last.

    Raises
    ------
    As ``auto_exposure``; a scene of which a part is too bright even for the shortest exposure is
    refused only where that holds for half of the lit pixels.

    Notes
    -----
    The brightness of the lit pixels spans a ratio R. With n exposures in steps of s = R^(1/n), the
    brightest pixels reach the target in the first, the darkest 1/s of the target in the last, and
    all others at least 1/s in one of them.
    """
    if count < 1:
        raise InputError(f"count: expected >= 1 exposures, got {count}")
    if count == 1:
        return [
            auto_exposure(projector, camera, longest_ms=longest_ms, whole_periods=whole_periods)
        ]
    allowed = exposure_range(projector, camera, longest_ms=longest_ms, whole_periods=whole_periods)
    return series_in(projector, camera, allowed, count)


def series_in(
    projector: Projector, camera: Camera, allowed: ExposureRange, count: int
) -> list[CameraSettings]:
    """Choose two settings or more in a range as ``exposure_series`` does."""
    seen = _sweep(projector, camera, allowed)
    light, bounded = light_per_ms(seen)
    if np.mean(bounded) > 0.5:
        raise _too_bright(camera, seen[0], allowed)
    darkest, brightest = np.quantile(light, (DARK_TAIL, 1.0 - BRIGHT_TAIL))
    step = (brightest / darkest) ** (1.0 / count)
    first = max(TARGET / brightest, allowed.least)
    last = min(max(TARGET / (step * darkest), first), allowed.most)
    series: list[CameraSettings] = []
    for amount in np.geomspace(min(first, last), last, count):
        settings = configured(camera, allowed.settings(float(amount), fill=False))
        if settings not in series:
            series.append(settings)
    return series


def _sweep(projector: Projector, camera: Camera, allowed: ExposureRange) -> list[Brightness]:
    """Brightness from the least amount of light up, until the darkest pixels are well exposed."""
    unsteady: list[CameraSettings] = []
    amount, seen = allowed.least, [_trial(projector, camera, allowed, allowed.least, unsteady)]
    while (amount := seen[-1].amount * STEP) < allowed.most * STEP / SETTLED:
        light, _ = light_per_ms(seen)
        if light.size and np.quantile(light, DARK_TAIL) * seen[-1].amount >= TARGET / STEP:
            break
        seen.append(_trial(projector, camera, allowed, min(amount, allowed.most), unsteady))
        _check_obeys(camera, seen[-2], seen[-1])
    _check_dark(camera, seen[-1], 0.5)
    return seen


def _trial(
    projector: Projector,
    camera: Camera,
    allowed: ExposureRange,
    amount: float,
    unsteady: list[CameraSettings],
) -> Brightness:
    """Brightness at an amount of light, or at the next larger one where white is not seen.

    Settings at which it was not seen are added to ``unsteady``. There the light flickers if larger
    amounts are too bright, so the second failure at the same settings is the last one.
    """
    while True:
        asked = allowed.settings(amount)
        got = configured(camera, asked)
        # What a camera does not tell is taken to be as asked for; brightness will show.
        settings = replace(
            got,
            exposure_ms=got.exposure_ms or asked.exposure_ms,
            gain_db=asked.gain_db if got.gain_db is None else got.gain_db,
        )
        try:
            return measure_brightness(projector, camera, settings)
        except DeviceProblem as error:
            # Black and white are equal if nothing is seen, or if all is saturated.
            grab = camera.grab()
            full = largest_count(settings, grab.pixels.dtype)
            if np.median(grab.pixels) >= CLIPPED_SHARE * full and amount > allowed.least:
                raise
            if np.median(grab.pixels) >= CLIPPED_SHARE * full:
                raise _too_bright(camera, None, allowed) from None
            if asked in unsteady:
                raise Unsteady(str(error)) from error
            if amount >= allowed.most / SETTLED:
                raise
            unsteady.append(asked)
            amount = min(amount * STEP, allowed.most)


def _level(seen: Brightness, saturated: float) -> float:
    """Brightness of white that no more than a share of the lit pixels exceed, share of full."""
    if not seen.lit.any():
        return float(seen.white.max())
    return float(np.quantile(seen.white[seen.lit], 1.0 - saturated))


def _check_dark(camera: Camera, seen: Brightness, share: float) -> None:
    """``DeviceProblem`` where even the bright pixels see too little of the projector."""
    rise = (seen.white - seen.black)[seen.lit]
    level = float(np.quantile(rise, 1.0 - share)) if rise.size else 0.0
    if level < DARK:
        raise TooDark(
            f"{camera.name}: expected white to be brighter than black by {DARK:.0%} of full scale, "
            f"got {level:.1%} at {_told(seen.settings)}: too dark; open the aperture, move "
            "the devices closer, use a brighter lamp, allow a longer exposure, or darken the room"
        )


def _check_obeys(camera: Camera, before: Brightness | None, now: Brightness) -> None:
    """``DeviceProblem`` where the brightness does not follow the settings."""
    if before is None:
        return
    expected = now.amount / before.amount
    # Pixels chosen in the darker pair of frames would be those whose noise is positive.
    brighter = now if expected > 1 else before
    both = brighter.lit & ~before.saturated & ~now.saturated
    if np.count_nonzero(both) < COMPARED_PIXELS or 1 / DISOBEYS < expected < DISOBEYS:
        return
    rises = [float(np.mean((b.white - b.black)[both])) for b in (before, now)]
    change = rises[1] / max(rises[0], LEAST_RISE)
    if not 1 / DISOBEYS <= change / expected <= DISOBEYS:
        raise DeviceProblem(
            f"{camera.name}: expected {expected:.2g} times the brightness at {_told(now.settings)} "
            f"as at {_told(before.settings)}, got {change:.2g} times: the camera does not obey; "
            "switch off its automatic exposure and gain"
        )


def _too_bright(camera: Camera, seen: Brightness | None, allowed: ExposureRange) -> TooBright:
    """The error for a scene that is too bright at the least amount of light."""
    what = "all pixels"
    if seen is not None:
        what = f"{float(np.mean(seen.saturated[seen.lit])):.0%} of the lit pixels"
    shorter = ", or allow exposures that are no whole refresh periods" if allowed.period_ms else ""
    return TooBright(
        f"{camera.name}: expected few saturated pixels at the shortest exposure "
        f"({_told(allowed.settings(0.0))}), got {what}: too bright; close the aperture, dim the "
        f"projector, or move the devices away{shorter}"
    )


def _told(settings: CameraSettings) -> str:
    parts = [] if settings.exposure_ms is None else [f"{settings.exposure_ms:.3g} ms"]
    parts += [] if settings.gain_db is None else [f"{settings.gain_db:.1f} dB"]
    return " and ".join(parts) or "the present settings"
