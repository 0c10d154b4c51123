"""Whether a camera obeys its exposure, proved by light and not by what the driver reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.pixel_formats import full_scale
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.agreement import MAX_INCOMPLETE
from fringeworks.scan.differences import ROUNDING_VARIANCE, compared
from fringeworks.scan.rhythm import USUAL_REFRESH_S
from fringeworks.scan.uniform import black_picture, white_picture
from fringeworks.types import BoolMap, CameraSettings, DeviceProblem, FloatMap, Frozen

Verdict = Literal["obeyed", "ignored", "automatic", "another ratio"]
"""What a camera does with its exposure."""

WATCHED_S = 1.8
"""Time for which black and white are each watched, s. Light and a new exposure arrive within 0.5 s
even with slow webcams, and automatic exposures need 0.3 to 3 s to settle."""
SETTLED_S = 1.0
"""Time after which brightness is measured, s."""
SETTLED_SHARE = 0.6
"""Share of ``WATCHED_FRAMES`` after which brightness is measured."""
WATCHED_FRAMES = 40
"""Smallest number of frames for which black and white are each watched. Automatic exposures count
in frames: from the dark, some need 25 until white no longer saturates."""
MAX_DRIFT = 0.1
"""Largest drift of the brightness after it has changed, relative to the change. Automatic exposures
take back half of it and more; frames of a camera without one drift by noise."""
DRIFT_SCATTER = 4.0
"""A drift must exceed the scatter of the last frames about a straight line this many times, so that
flicker is not mistaken for an automatic exposure."""
MIN_DRIFT_COUNTS = 1.0
"""Smallest drift that counts, counts. Noise moves the mean over a frame by less than 0.1."""
RATIO_TOLERANCE = 0.1
"""Largest deviation of the ratio of brightness from that of the exposures, relative. Cameras that
obey deviate by less than 3 %; a response with a gamma of 1/2.2 makes 1.37 from 2."""
NOISE_SIGMAS = 4.0
"""Standard deviations of its noise by which a ratio may deviate in addition."""
SATURATED_SHARE = 0.95
"""Share of full scale from which on a pixel counts as saturated: noise of brighter pixels is
clipped, which lowers their mean."""
LIT_SHARE = 0.1
"""Pixels count as lit by the projector from this share of the 99th percentile of white minus black.
Others add noise."""
MIN_USED_SHARE = 0.25
"""Smallest share of the lit pixels that must not be saturated."""
MIN_CONTRAST_COUNTS = 4.0
"""Smallest mean of white minus black at the shorter exposure, counts. Rounding to whole counts errs
by less than 0.1 count in the mean, 3 % of this."""
MAX_TRIES = 6
"""Pairs of exposures that are tried, each twice or half as long or as bright as the last."""
USUAL_EXPOSURE_MS = 33.3
"""Exposure to start with where the camera does not tell its own, ms: that of webcams indoors."""
RATIO = 2.0
"""Ratio of the two exposures. Drivers that count in powers of two can set it exactly."""


@dataclass(frozen=True, eq=False, repr=False)
class ExposureProof(Frozen):
    """Whether a camera obeys its exposure, with the figures that prove it."""

    verdict: Verdict
    """``obeyed``; ``ignored``: the exposure has no effect; ``automatic``: the brightness drifts
    back after it has changed; ``another ratio``: the brightness follows, but not in proportion."""
    asked_ms: tuple[float, float]
    """The shorter and the longer exposure that were asked for, ms."""
    read_back_ms: tuple[float | None, float | None]
    """What the camera reported, ms; None where it does not tell."""
    expected_ratio: float
    """Ratio of the exposures: as read back where they differ there, as asked for elsewhere."""
    ratio: float
    """Ratio of white minus black at both exposures; NaN for an automatic exposure."""
    ratio_sigma: float
    """Standard deviation of ``ratio`` from noise and flicker; NaN for an automatic exposure."""
    drift: float
    """Part of a change of brightness that was taken back afterwards; 0 for none."""
    used_share: float
    """Share of the lit pixels that are not saturated; NaN for an automatic exposure."""
    series: tuple[FloatMap, ...] = ()
    """Mean brightness of every frame, counts: under black and under white at the shorter, the
    longer and again the shorter exposure."""

    @property
    def obeyed(self) -> bool:
        """Whether the camera obeys."""
        return self.verdict == "obeyed"

    def __str__(self) -> str:
        short, long = self.asked_ms
        figures = (
            f"{short:.3g} and {long:.3g} ms: expected a ratio of {self.expected_ratio:.2f}, got "
            f"{self.ratio:.2f} ± {self.ratio_sigma:.2f}"
        )
        return {
            "obeyed": f"the exposure obeys ({figures})",
            "ignored": f"the camera ignores its exposure ({figures}): set it with the camera's own "
            "program",
            "automatic": f"an automatic exposure is on: {100 * self.drift:.0f} % of a change of "
            "brightness were taken back; switch it off with the camera's own program",
            "another ratio": f"the brightness follows the exposure by another ratio ({figures}): "
            "the camera rounds its exposures, or its response is curved",
        }[self.verdict]


@dataclass(frozen=True, eq=False)
class _Watched:
    """Frames of a picture that was shown for a while."""

    means: FloatMap
    """Mean of every frame, counts."""
    settled: NDArray[np.float32]
    """(n, h, w), the last frames, counts."""


@dataclass(frozen=True)
class _Unfit:
    """Exposures at which nothing can be proved."""

    reason: str
    """What was expected and what came."""
    factor: float
    """What to multiply the exposures with."""


def exposure_obeys(
    projector: Projector, camera: Camera, *, start_ms: float | None = None
) -> ExposureProof:
    """Find out by light whether a camera obeys its exposure.

    Black and white are filmed at two exposures, the shorter one twice. White minus black must have
    the ratio of the exposures, over the pixels that the projector lights and that are not
    saturated. Takes 13 s, more where the exposure must be changed until brightness is right.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Free-running. Its exposure is set back to what it reported before, where it reported one.
    start_ms : float, optional
        The longer exposure to begin with, ms; by default the one that the camera reports.

    Returns
    -------
    ExposureProof

    Raises
    ------
    DeviceProblem where white is not brighter than black, or saturates at all exposures; InputError
    where the camera's exposure cannot be set at all.

    Notes
    -----
    Exposures are whole numbers of the projector's refresh periods, because colour wheels and pulse
    width modulation make others unequal. Where white saturates in one period, grey is shown.
    """
    before = camera.configure(CameraSettings(triggered=False))
    period_ms = 1e3 * (projector.refresh_s or USUAL_REFRESH_S)
    longer_ms = start_ms or before.exposure_ms or USUAL_EXPOSURE_MS
    periods = max(1.0, float(np.floor(longer_ms / RATIO / period_ms)))
    bounds = camera.limits().exposure_ms or (0.0, np.inf)
    reason = ""
    white = white_picture(projector)
    try:
        if periods == 1.0 and _saturates(projector, camera, RATIO * period_ms, bounds):
            white = white // 2
        for _ in range(MAX_TRIES):
            short_ms = periods * period_ms
            if short_ms < bounds[0] or RATIO * short_ms > bounds[1]:
                break
            found = _tried(projector, camera, short_ms, white)
            if isinstance(found, ExposureProof):
                return found
            reason = found.reason
            if found.factor < 1.0 and periods == 1.0:
                # Parts of a refresh period are unequal; grey is dimmer than white at whole ones.
                white = white // 2
            periods = max(1.0, float(np.floor(found.factor * periods)))
    finally:
        if before.exposure_ms is not None:
            camera.configure(CameraSettings(exposure_ms=before.exposure_ms))
    raise DeviceProblem(f"{camera.name}: {reason or _no_exposure(bounds)}")


def _no_exposure(bounds: tuple[float, float]) -> str:
    return f"expected exposures of several ms, got limits of {bounds[0]:g} to {bounds[1]:g} ms"


def _saturates(
    projector: Projector, camera: Camera, exposure_ms: float, bounds: tuple[float, float]
) -> bool:
    """Whether white is beyond full scale at the longer exposure, so that a grey is shown."""
    if not bounds[0] <= exposure_ms <= bounds[1]:
        return False
    told = camera.configure(CameraSettings(exposure_ms=exposure_ms))
    level = _watch(projector, camera, white_picture(projector)).settled.mean(axis=0)
    bright = level >= LIT_SHARE * np.percentile(level, 99)
    saturated = level >= SATURATED_SHARE * _full_scale(told, camera)
    return int(np.sum(saturated)) > (1.0 - MIN_USED_SHARE) * int(np.sum(bright))


def _tried(
    projector: Projector, camera: Camera, short_ms: float, white: NDArray[Any]
) -> ExposureProof | _Unfit:
    """The proof with an exposure and its double."""
    asked = short_ms, RATIO * short_ms
    told: list[CameraSettings] = []
    filmed: list[tuple[_Watched, _Watched]] = []
    for exposure_ms in (*asked, short_ms):
        told.append(camera.configure(CameraSettings(exposure_ms=exposure_ms)))
        black = _watch(projector, camera, black_picture(projector))
        filmed.append((black, _watch(projector, camera, white)))
        if len(filmed) == 2 and _drift(filmed) <= MAX_DRIFT:
            # Without a drift, saturation shows before the shorter exposure is filmed again.
            _, share = _used_pixels(filmed, _full_scale(told[0], camera))
            if share < MIN_USED_SHARE:
                return _saturated(share)
    read_back = told[0].exposure_ms, told[1].exposure_ms
    drift = _drift(filmed)
    series = tuple(watched.means for both in filmed for watched in both)
    if drift > MAX_DRIFT:
        nan, expected = float("nan"), _expected(asked, read_back)
        return ExposureProof("automatic", asked, read_back, expected, nan, nan, drift, nan, series)
    used, share = _used_pixels(filmed, _full_scale(told[0], camera))
    if share < MIN_USED_SHARE:
        return _saturated(share)
    contrasts = [_contrast(dark, lit, used) for dark, lit in filmed]
    if contrasts[0][0] < MIN_CONTRAST_COUNTS:
        reason = (
            f"expected white to be {MIN_CONTRAST_COUNTS:g} counts brighter than black, got "
            f"{contrasts[0][0]:.1f}: point the camera at the projected picture, or open the "
            "aperture"
        )
        return _Unfit(reason, 2.0)
    proof = _judged(asked, read_back, contrasts, drift, share)
    if proof.ratio_sigma > RATIO_TOLERANCE * proof.expected_ratio:
        reason = (
            f"expected steady brightness, got a ratio of {proof.ratio:.2f} ± "
            f"{proof.ratio_sigma:.2f} between two exposures: the light flickers or something moves"
        )
        return _Unfit(reason, 1.0)
    return replace(proof, series=series)


def _saturated(used_share: float) -> _Unfit:
    return _Unfit(
        f"expected white below full scale, got {100 * (1 - used_share):.0f} % of the lit pixels "
        "saturated: close the aperture, or dim the projector",
        0.5,
    )


def _judged(
    asked: tuple[float, float],
    read_back: tuple[float | None, float | None],
    contrasts: list[tuple[float, float]],
    drift: float,
    share: float,
) -> ExposureProof:
    (first, s1), (long, s2), (last, s3) = contrasts
    short, s_short = 0.5 * (first + last), 0.5 * float(np.hypot(s1, s3))
    ratio = long / short
    sigma = ratio * float(np.hypot(s2 / long, s_short / short))
    expected = _expected(asked, read_back)
    margin = NOISE_SIGMAS * sigma
    verdict: Verdict = "another ratio"
    if abs(ratio - expected) <= RATIO_TOLERANCE * expected + margin:
        verdict = "obeyed"
    elif abs(ratio - 1.0) <= RATIO_TOLERANCE + margin:
        verdict = "ignored"
    return ExposureProof(verdict, asked, read_back, expected, ratio, sigma, drift, share)


def _full_scale(told: CameraSettings, camera: Camera) -> float:
    """Largest count of the camera; by the type of its frames where it does not tell its format."""
    if told.pixel_format is not None:
        return float(full_scale(told.pixel_format))
    return float(np.iinfo(camera.grab().pixels.dtype).max)


def _expected(asked: tuple[float, float], told: tuple[float | None, float | None]) -> float:
    """Ratio of the exposures. A camera that reports two equal ones has ignored one."""
    if told[0] is None or told[1] is None or told[1] / told[0] < 1.0 + 2.0 * RATIO_TOLERANCE:
        return asked[1] / asked[0]
    return told[1] / told[0]


def _watch(projector: Projector, camera: Camera, picture: NDArray[Any]) -> _Watched:
    """Film a picture until its brightness has settled."""
    shown_s = projector.show(picture)
    camera.discard()
    means: list[float] = []
    settled: list[NDArray[np.float32]] = []
    incomplete = 0
    passed_s = 0.0
    while passed_s < WATCHED_S or len(means) < WATCHED_FRAMES:
        grab = camera.grab()
        passed_s = grab.host_s - shown_s
        if not grab.complete:
            incomplete += 1
            if incomplete > MAX_INCOMPLETE + len(means):
                raise DeviceProblem(
                    f"{camera.name}: expected complete frames, got {incomplete} incomplete ones"
                )
            continue
        frame = compared(grab.pixels)
        means.append(float(frame.mean()))
        if passed_s >= SETTLED_S and len(means) > SETTLED_SHARE * WATCHED_FRAMES:
            settled.append(frame)
    return _Watched(np.array(means), np.array(settled))


def _drift(filmed: list[tuple[_Watched, _Watched]]) -> float:
    """Part of the rise from black to white that was taken back, every time; 0 for none."""
    drifts = []
    for black, white in filmed:
        last = white.settled.mean(axis=(1, 2))
        peak = float(white.means.max())
        back = peak - float(last.mean())
        line = np.polynomial.Polynomial.fit(np.arange(last.size), last, 1)
        scatter = float(np.std(last - line(np.arange(last.size))))
        least = max(MIN_DRIFT_COUNTS, DRIFT_SCATTER * scatter)
        rise = peak - float(min(black.means.min(), white.means.min()))
        drifts.append(back / rise if back > least else 0.0)
    # Flicker that is slow against the frame rate can look like a drift once, but not every time.
    return min(drifts)


def _used_pixels(filmed: list[tuple[_Watched, _Watched]], top: float) -> tuple[BoolMap, float]:
    """Pixels that are lit and not saturated, and their share of those that are lit."""
    whites = [white.settled.mean(axis=0) for _, white in filmed]
    rise = whites[1] - filmed[1][0].settled.mean(axis=0)
    lit = rise >= LIT_SHARE * np.percentile(rise, 99)
    used = lit & (np.max(whites, axis=0) < SATURATED_SHARE * top)
    return used, float(used.sum() / max(1, lit.sum()))


def _contrast(black: _Watched, white: _Watched, used: BoolMap) -> tuple[float, float]:
    """Mean of white minus black, and its standard deviation, counts."""
    levels = [watched.settled[:, used].mean(axis=1, dtype=np.float64) for watched in (black, white)]
    variance = sum(float(level.var(ddof=1)) / level.size for level in levels)
    # Rounding alone leaves equal frames, whose scatter is 0.
    variance += 2.0 * ROUNDING_VARIANCE / max(1, int(used.sum()))
    return float(levels[1].mean() - levels[0].mean()), float(np.sqrt(variance))
