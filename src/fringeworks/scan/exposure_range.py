"""What exposures a scan may use: whole refresh periods of the projector, and the camera's gain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.brightness import amount_of
from fringeworks.types import CameraSettings, DeviceProblem, InputError

LONGEST_MS = 250.0
"""Longest exposure by default, ms: a scan of 12 frames then takes about ten seconds, and four
frames of white arrive well within the time for which ``Agreement`` waits."""
ROUNDED_SHARE = 0.01
"""Largest difference between the exposure that was asked for and the one that the camera reports,
relative. A larger one is no rounding; 1 % of a period makes 1 % of flicker at most."""

PARTS_OF_REFRESH = (2, 3, 4)
"""Parts of a refresh period in which colour wheels turn once and backlights pulse once: at 60 Hz,
wheels of 120, 180 and 240 Hz."""


@dataclass(frozen=True)
class ExposureRange:
    """Exposures and gains that a scan may use."""

    shortest_ms: float
    """Shortest exposure, ms."""
    longest_ms: float
    """Longest exposure, ms."""
    period_ms: float | None
    """Exposures are multiples of this, ms; None where any exposure is allowed."""
    gain_db: tuple[float, float] | None
    """Lowest and highest gain, dB; None for a camera without gain."""

    @property
    def least(self) -> float:
        """Smallest exposure times gain, ms."""
        return amount_of(self.settings(0.0))

    @property
    def most(self) -> float:
        """Largest exposure times gain, ms."""
        return amount_of(self.settings(np.inf))

    def settings(self, amount: float, *, fill: bool = True) -> CameraSettings:
        """Choose the longest exposure and the lowest gain for an amount of light.

        Parameters
        ----------
        amount : float
            Exposure times gain, ms; limited to what the range allows.
        fill : bool
            Whether gain makes up for the part of a period that exposures cannot have. Otherwise the
            exposure is rounded to the nearest period, and gain is used beyond the longest exposure
            only.
        """
        gain_db = self.gain_db
        floor = 1.0 if gain_db is None else float(10.0 ** (gain_db[0] / 20.0))
        wanted_ms = min(max(amount / floor, self.shortest_ms), self.longest_ms)
        exposure_ms = wanted_ms
        if self.period_ms is not None:
            periods = wanted_ms / self.period_ms
            # A hair above the whole number, because periods such as 16.667 ms are rounded.
            whole = np.floor(periods + 1e-3) if fill else np.rint(periods)
            exposure_ms = float(max(whole, 1.0) * self.period_ms)
        if gain_db is None:
            return CameraSettings(exposure_ms=exposure_ms)
        at_limit = wanted_ms >= self.longest_ms
        wanted = amount / exposure_ms if fill or at_limit else floor
        ratio = min(max(wanted, floor), float(10.0 ** (gain_db[1] / 20.0)))
        return CameraSettings(exposure_ms=exposure_ms, gain_db=float(20.0 * np.log10(ratio)))


def exposure_range(
    projector: Projector, camera: Camera, *, longest_ms: float, whole_periods: bool
) -> ExposureRange:
    """Return the exposures and gains that a scan with these devices may use.

    Raises
    ------
    InputError for a longest exposure that the camera or the projector's refresh period does not
    allow, and for a projector whose refresh period is unknown where whole periods are wanted.
    """
    limits = camera.limits()
    low, high = limits.exposure_ms or (0.0, longest_ms)
    high = min(high, longest_ms)
    if not whole_periods:
        if not longest_ms > 0 or high < low:
            raise InputError(f"longest_ms: expected at least {low:g} ms, got {longest_ms:g}")
        return ExposureRange(low or 1e-3 * high, high, None, limits.gain_db)
    if projector.refresh_s is None:
        raise InputError(
            f"projector {projector.name}: expected a known refresh period for exposures of whole "
            "periods; allow any exposure with whole_periods = False"
        )
    period_ms = 1e3 * projector.refresh_s
    # A camera whose limit is a rounded period can still expose for that period.
    first = max(1, int(np.ceil(low / period_ms - ROUNDED_SHARE)))
    last = int(np.floor(high / period_ms + ROUNDED_SHARE))
    if last < first:
        raise InputError(
            f"longest_ms: expected at least {first * period_ms:.1f} ms, "
            f"{first} refresh period{'s' if first > 1 else ''} of the projector {projector.name}, "
            f"got {high:g} ms"
        )
    return ExposureRange(first * period_ms, last * period_ms, period_ms, limits.gain_db)


def shorter_ranges(projector: Projector, camera: Camera) -> Iterator[ExposureRange]:
    """Ranges of exposures that are shorter than a refresh period, the safest first.

    Whether these see the same light in every frame must be measured.
    """
    anything = exposure_range(projector, camera, longest_ms=LONGEST_MS, whole_periods=False)
    for part in PARTS_OF_REFRESH:
        period_ms = 1e3 * (projector.refresh_s or 0.0) / part
        if anything.shortest_ms <= period_ms <= anything.longest_ms:
            yield replace(anything, shortest_ms=period_ms, period_ms=period_ms)
    yield anything


def configured(camera: Camera, settings: CameraSettings) -> CameraSettings:
    """Set a camera, and return the settings as read back.

    Raises
    ------
    DeviceProblem where the camera reports an exposure that differs by more than rounding.
    """
    got = camera.configure(settings)
    wanted_ms, got_ms = settings.exposure_ms, got.exposure_ms
    if wanted_ms and got_ms and abs(got_ms - wanted_ms) > ROUNDED_SHARE * wanted_ms:
        raise DeviceProblem(
            f"{camera.name}: expected an exposure of {wanted_ms:.3f} ms, got {got_ms:.3f} ms: "
            "switch off its automatic exposure, or lower its frame rate so that the exposure fits"
        )
    return got
