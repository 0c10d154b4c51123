"""The projector's light in time: whether an exposure sees all of it, or a part that changes.

DMD projectors send greys as pulses, colour wheels and strobed panels send light in turns, and some
panels alternate between two greys. An exposure that is no whole number of their periods sees now
more and now less of it, by another share for every grey.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.clock import clock_of
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.agreement import MAX_INCOMPLETE
from fringeworks.scan.brightness import amount_of
from fringeworks.scan.exposure_range import ROUNDED_SHARE
from fringeworks.scan.saturation import CLIPPED_SHARE, largest_count
from fringeworks.scan.uniform import uniform_picture
from fringeworks.types import CameraSettings, DeviceProblem

USUAL_REFRESH_S = 1.0 / 60.0
"""Refresh period where the projector does not tell its own, s."""
GREYS = (1.0, 0.6, 0.3)
"""Grey levels whose light is followed, share of full scale. White alone does not show pulses: a DMD
sends it without a break. 0.6 and 0.3 are 153 and 76 of 255, whose bits differ in five places."""
RESTARTS = 5
"""Times that the camera is started anew under one picture, at moments that are spread over a
refresh period: a camera that keeps step with the projector sees one part of the period only."""
FRAMES = 3
"""Frames after each restart. Where the camera does not keep step, they see further parts."""
SETTLED_FRAMES = 8
"""Frames after a new picture that are not used, because the picture is still changing."""
SETTLED_S = 0.25
"""Time after a new picture over which frames are not used, s: longer than usual delays."""
FOLLOWED_PIXELS = 20_000
"""Pixels of a frame that are followed, on a grid: the eigenvalues of noise then scatter by 3 %."""
LIT_QUANTILE = 0.99
"""Quantile of the rise from black that counts as the brightest: a few pixels are highlights."""
LIT_SHARE = 0.25
"""Share of that rise from which on pixels are followed: others hold more noise than light."""
MOST_CLIPPED = 0.5
"""Share of pixels at the camera's limit from which on a grey is not followed, because its changes
are hidden."""
SIGNIFICANT = 6.0
"""Largest eigenvalue of the frames' covariance above the median, over the median above the
smallest, from which on the light changes. Noise of single pixels gives 0.7 to 1.6 in 48
measurements of steady devices."""
LEAST_RIPPLE = 0.002
"""Change of the light that matters, relative to white: half a count of 255."""
LEAST_VARIANCE = 1e-6
"""Lower bound on the scatter of the eigenvalues, counts²: cameras without noise exist in tests
only."""
ROOM_FACTOR = 10.0
"""Ratio of two variances that chance explains: of 15 frames each, once in 10⁴ pairs (F
distribution). The light of the room changes under every grey as under black."""
MOST_BRIGHTER = 1.05
"""Ratio by which another exposure may raise the brightness: white was chosen at 0.9 of full
scale."""
MIN_RISE_COUNTS = 0.5
"""Smallest mean rise from black to white with which changes are judged, counts."""
MOST_RIPPLE = 0.02
"""Change of the light, relative to white, up to which a scan is taken. Four steps then err by 0.014
rad, as by noise of a 70th of the modulation; changes of 5 % made scans fail for other reasons."""


@dataclass(frozen=True)
class Ripple:
    """Change of the light from frame to frame at one exposure."""

    exposure_ms: float
    depth: float
    """Largest standard deviation of the brightness over the greys, relative to the brightest grey
    below the camera's limit, 0…1; that of the room's light is taken away. NaN where too little
    light is seen, or too much."""
    grey: float
    """Grey level where it is largest, share of full scale."""
    white: float
    """The same under white alone; NaN where white is at the camera's limit."""
    significance: float
    """How far it stands out of the noise; see ``SIGNIFICANT``."""

    @property
    def steady(self) -> bool:
        """Whether the exposure sees the same light in every frame."""
        return self.depth < LEAST_RIPPLE or bool(
            np.isfinite(self.depth) and self.significance < SIGNIFICANT
        )

    @property
    def picture(self) -> str:
        """The grey where it is largest, in words."""
        return "white" if self.grey == 1.0 else f"a grey of {self.grey:.0%}"

    def __str__(self) -> str:
        return f"{self.depth:.1%} at {self.exposure_ms:.4g} ms"


def measure_ripple(projector: Projector, camera: Camera, *, seed: int = 0) -> Ripple:
    """Show black, white and greys, and follow their light at the camera's present exposure.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    seed : int
        Of the moments at which the camera is started.

    Raises
    ------
    DeviceProblem where frames do not come.
    """
    rng = np.random.default_rng(seed)
    settings = camera.configure(CameraSettings(triggered=False))
    series = {level: _series(projector, camera, level, rng) for level in (0.0, *GREYS)}
    exposure_ms = settings.exposure_ms or float("nan")
    clipped = CLIPPED_SHARE * largest_count(settings, series[0.0].dtype)
    dark = series[0.0].mean(axis=0)
    bright = {level: series[level].mean(axis=0) - dark for level in GREYS}
    below = [k for k in GREYS if np.mean(series[k].max(axis=0) < clipped) > 1.0 - MOST_CLIPPED]
    rise = bright[below[0]] if below else np.zeros(1)
    lit = rise > LIT_SHARE * np.quantile(rise, LIT_QUANTILE)
    if not lit.any() or float(rise[lit].mean()) < MIN_RISE_COUNTS:
        return Ripple(exposure_ms, float("nan"), 1.0, float("nan"), 0.0)
    room = ROOM_FACTOR * max(_excess(series[0.0][:, lit])[0], 0.0)
    found = {}
    for level in below:
        excess, significance = _excess(series[level][:, lit])
        depth = float(np.sqrt(max(excess - room, 0.0))) / float(rise[lit].mean())
        found[level] = min(depth, 1.0), significance
    worst = max(found, key=lambda level: found[level][0])
    white = found.get(1.0, (float("nan"), 0.0))[0]
    return Ripple(exposure_ms, found[worst][0], worst, white, found[worst][1])


def _series(
    projector: Projector, camera: Camera, level: float, rng: np.random.Generator
) -> NDArray[Any]:
    """Frames of a grey, each after some of the restarts, (frames, pixels of a grid), counts."""
    clock = clock_of(projector)
    refresh_s = projector.refresh_s or USUAL_REFRESH_S
    shown_s = projector.show(uniform_picture(projector, level))
    for _ in range(SETTLED_FRAMES * MAX_INCOMPLETE):
        if camera.grab().host_s > shown_s + SETTLED_S:
            break
    seen: list[NDArray[Any]] = []
    for k in range(RESTARTS):
        clock.wait_until(clock.now_s() + (k + rng.random()) / RESTARTS * refresh_s)
        camera.configure(CameraSettings(triggered=False))
        camera.discard()
        for _ in range(FRAMES * MAX_INCOMPLETE):
            grab = camera.grab()
            if grab.complete:
                stride = max(1, round(float(np.sqrt(grab.pixels.size / FOLLOWED_PIXELS))))
                seen.append(grab.pixels[::stride, ::stride].ravel())
            if len(seen) == (k + 1) * FRAMES:
                break
        else:
            raise DeviceProblem(f"{camera.name}: expected complete frames, got too few")
    return np.stack(seen)


def _excess(frames: NDArray[Any]) -> tuple[float, float]:
    """Variance that frames of one picture have in common beyond noise, counts², and how far it
    stands out of the noise.

    The largest eigenvalue of the frames' covariance: light that changes does so by one pattern, be
    it all over the frame, in stripes of a rolling shutter, or in a checkerboard of dithering, while
    noise spreads over all eigenvalues. A steady drift is taken away.
    """
    design = np.vander(np.linspace(-1.0, 1.0, len(frames)), 2)
    kept = scipy.linalg.null_space(design.T).T
    off = kept @ frames.astype(np.float64)
    values = np.linalg.eigvalsh(off @ off.T / off.shape[1])
    usual = float(np.median(values))
    excess = float(values[-1]) - usual
    scatter = max(usual - float(values[0]), LEAST_VARIANCE)
    return excess / len(values), excess / scatter


def safe_period(
    projector: Projector, camera: Camera, present: Ripple
) -> tuple[float | None, tuple[Ripple, ...]]:
    """Find the shortest exposure that, with its multiples, sees the same light in every frame.

    Whole refresh periods are tried first. Colour wheels turn and backlights pulse up to four times
    in a refresh, and dithering in time repeats after two or four.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Its gain makes up for the exposure as far as it can. It is left at its present settings.
    present : Ripple
        At the present exposure.

    Returns
    -------
    period_ms : float or None
        Multiples of this exposure are safe, ms; None where no exposure was found to be.
    tried : tuple of Ripple
        The ripples at all exposures that were tried.
    """
    settings = camera.configure(CameraSettings())
    limits = camera.limits()
    refresh_ms = 1e3 * (projector.refresh_s or USUAL_REFRESH_S)
    low, high = limits.exposure_ms or (0.0, np.inf)
    tried = [present]

    def steady(part: float) -> bool:
        seen = np.isfinite(tried[-1].depth)
        # What is at the camera's limit at one exposure is so at longer ones.
        if not low <= part * refresh_ms <= high or (part > 1.0 and not seen):
            return False
        if abs(part * refresh_ms - present.exposure_ms) <= ROUNDED_SHARE * present.exposure_ms:
            return present.steady
        camera.configure(_compensated(settings, part * refresh_ms, limits.gain_db))
        tried.append(measure_ripple(projector, camera))
        return tried[-1].steady

    try:
        found = _shortest(steady)
    finally:
        camera.configure(CameraSettings(settings.exposure_ms, settings.gain_db))
    return (None if found is None else found * refresh_ms), tuple(tried)


def _shortest(steady: Callable[[float], bool]) -> float | None:
    """The shortest safe exposure, refresh periods."""
    if not steady(1.0):
        return next((part for part in (2.0, 4.0) if steady(part)), None)
    if steady(1 / 2):
        return 1 / 4 if steady(1 / 4) else 1 / 2
    return 1 / 3 if steady(1 / 3) else 1.0


def is_whole(exposure_ms: float, period_ms: float) -> bool:
    """Whether an exposure is a whole number of periods, one or more, up to rounding."""
    periods = exposure_ms / period_ms
    return round(periods) >= 1 and abs(periods - round(periods)) <= ROUNDED_SHARE * periods


def _compensated(
    settings: CameraSettings, exposure_ms: float, gain_db: tuple[float, float] | None
) -> CameraSettings:
    """Settings with another exposure, and the gain that keeps the brightness where possible."""
    if gain_db is None or settings.exposure_ms is None:
        return CameraSettings(exposure_ms=exposure_ms)
    wanted = (settings.gain_db or 0.0) + 20.0 * np.log10(settings.exposure_ms / exposure_ms)
    return CameraSettings(exposure_ms=exposure_ms, gain_db=float(np.clip(wanted, *gain_db)))


def safe_settings(
    camera: Camera, settings: CameraSettings, period_ms: float
) -> CameraSettings | None:
    """The settings with the safe exposure next to the present one.

    None where the camera has no such exposure, or no gain that is low enough for it.
    """
    if settings.exposure_ms is None:
        return None
    limits = camera.limits()
    low, high = limits.exposure_ms or (0.0, np.inf)
    exposure_ms = max(1, round(settings.exposure_ms / period_ms)) * period_ms
    if not low <= exposure_ms <= high:
        return None
    wanted = _compensated(settings, exposure_ms, limits.gain_db)
    return wanted if amount_of(wanted) <= MOST_BRIGHTER * amount_of(settings) else None


def check_steady(projector: Projector, camera: Camera) -> None:
    """Refuse an exposure that sees a changing part of the projector's light.

    Exposures of whole refresh periods are taken to be safe; others are measured, which takes three
    seconds.

    Raises
    ------
    DeviceProblem with the change of the light, and the exposures that are safe.
    """
    exposure_ms = camera.configure(CameraSettings()).exposure_ms
    refresh_ms = 1e3 * (projector.refresh_s or USUAL_REFRESH_S)
    if exposure_ms is None or is_whole(exposure_ms, refresh_ms):
        return
    ripple = measure_ripple(projector, camera)
    if not np.isfinite(ripple.depth) or ripple.steady or ripple.depth <= MOST_RIPPLE:
        return
    raise DeviceProblem(
        f"{camera.name}: expected the same light in every frame of one picture, got changes by "
        f"{ripple} under {ripple.picture}: the projector sends light in pulses, as by "
        "a colour wheel, bit planes or black frames; expose for whole refresh periods "
        f"({refresh_ms:.4g} ms and its multiples), or let the set-up find shorter exposures"
    )


def ripple_words(tried: Sequence[Ripple]) -> str:
    """The ripples of exposures in words, the shortest first."""
    seen = sorted((r for r in tried if np.isfinite(r.depth)), key=lambda r: r.exposure_ms)
    return ", ".join(f"{r.exposure_ms:.4g} ms: {r.depth:.1%}" for r in seen)
