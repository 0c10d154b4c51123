"""Whether the light changes although the picture does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.agreement import MAX_INCOMPLETE
from fringeworks.scan.uniform import uniform_picture
from fringeworks.types import CameraSettings, DeviceProblem, Finding, FloatMap, Frozen

FRAMES = 48
"""Frames that are compared: one to two seconds, over which any beat with mains shows."""
SKIPPED_FRAMES = 12
"""Frames after a new picture that are not compared, because the picture is still changing."""
BANDS = 16
"""Bands of rows whose brightness is followed, because a rolling shutter turns flicker into
stripes."""
FLICKER_SIGMAS = 6.0
"""Change of a band's brightness, over that of noise, from which on the light flickers. Chance
exceeds it once in 10⁸ measurements, and none of 100 clean devices did."""
MIN_FLICKER = 0.002
"""Change of the brightness that matters, relative to the light: half a count of 255. The phase then
errs by up to 0.004 rad."""


LEAST_VARIANCE = 1e-6
"""Lower bound on the variance of a band's brightness by noise, counts²: cameras without noise exist
in tests only."""


@dataclass(frozen=True, eq=False, repr=False)
class Flicker(Frozen):
    """Changes of the brightness under one picture."""

    in_black: float
    """Standard deviation of the brightness under black, relative to white, noise taken away."""
    in_white: float
    """The same under white."""
    black: FloatMap
    """Brightness under black of every frame and band of rows, (frames, bands), relative to the
    light of white."""
    white: FloatMap
    """The same under white."""
    frame_s: float
    """Time from one frame to the next, s."""
    findings: tuple[Finding, ...]


def check_flicker(projector: Projector, camera: Camera) -> Flicker:
    """Show black and white for a while, and follow the brightness.

    Parameters
    ----------
    projector : Projector
    camera : Camera

    Returns
    -------
    Flicker

    Raises
    ------
    DeviceProblem where frames do not come.
    """
    camera.configure(CameraSettings(triggered=False))
    series = {}
    for name, level in (("black", 0.0), ("white", 1.0)):
        projector.show(uniform_picture(projector, level))
        camera.discard()
        series[name] = _series(camera)
    rise = max(float(series["white"][0].mean() - series["black"][0].mean()), 1.0)
    depth = {name: _changes(bands, noise) for name, (bands, noise, _) in series.items()}
    relative = {name: value / rise for name, (value, _) in depth.items()}
    found = [
        _finding(name, relative[name], depth[name][1])
        for name in ("black", "white")
        if depth[name][1] > FLICKER_SIGMAS and relative[name] > MIN_FLICKER
    ]
    black, white = (series[name][0] / rise for name in ("black", "white"))
    # Light of the room shows under both; it is one finding.
    return Flicker(
        relative["black"], relative["white"], black, white, series["white"][2], tuple(found[:1])
    )


def _series(camera: Camera) -> tuple[FloatMap, FloatMap, float]:
    """Brightness of bands of rows in frames that follow each other, and its variance by noise.

    The noise is that of the differences of pixels between frames, within each band. The last value
    is the time between frames, s.
    """
    times: list[float] = []
    rows: list[FloatMap] = []
    noise: list[FloatMap] = []
    last: list[FloatMap] = []
    for _ in range((FRAMES + SKIPPED_FRAMES) * MAX_INCOMPLETE):
        grab = camera.grab()
        if not grab.complete:
            continue
        bands = np.array_split(grab.pixels.astype(np.float32), min(BANDS, len(grab.pixels)))
        if last:
            pairs = zip(bands, last, strict=True)
            noise.append(np.array([0.5 * float((a - b).var()) / a.size for a, b in pairs]))
        last = bands
        times.append(grab.host_s)
        rows.append(np.array([float(band.mean()) for band in bands]))
        if len(rows) == FRAMES + SKIPPED_FRAMES:
            # Frames may arrive in bunches; the mean time between them is still the camera's.
            period_s = (times[-1] - times[SKIPPED_FRAMES]) / (FRAMES - 1)
            variance = np.median(noise[SKIPPED_FRAMES:], axis=0)
            return np.stack(rows[SKIPPED_FRAMES:]), variance, period_s
    raise DeviceProblem(f"{camera.name}: expected complete frames, got too few")


def _changes(bands: FloatMap, noise: FloatMap) -> tuple[float, float]:
    """Largest standard deviation of a band beyond noise, counts; and its significance."""
    expected = np.maximum(noise, LEAST_VARIANCE)
    scatter = expected * np.sqrt(2.0 / (len(bands) - 1))
    excess = bands.var(axis=0, ddof=1) - expected
    worst = int(np.argmax(excess / scatter))
    return float(np.sqrt(max(excess[worst], 0.0))), float(excess[worst] / scatter[worst])


def _finding(picture: str, depth: float, sigmas: float) -> Finding:
    causes: tuple[str, ...] = ("lamps on mains (100 or 120 Hz)", "an automatic exposure or gain")
    advice = (
        "switch off or shade the lamps, or use an exposure of a multiple of 10 ms (mains of 50 "
        "Hz) or 8.33 ms (60 Hz); switch off automatic exposure and gain"
    )
    if picture == "white":
        causes = (
            "the projector's colour wheel or lamp control",
            "an exposure that is no multiple of the projector's refresh period",
            *causes,
        )
        advice = f"use an exposure of whole refresh periods of the projector; {advice}"
    return Finding(
        "flicker",
        f"the brightness under {picture} changes by {depth:.1%} of white from frame to frame",
        causes,
        advice,
        figures={"depth_share": depth, "significance": sigmas},
    )
