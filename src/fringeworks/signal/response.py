"""The response of projector and camera together: measured, saved with a pair, and taken out.

Two forms. The exponent γ (I ∝ v^γ) straightens intensities and pre-distorts patterns. The table
φ → Δφ corrects phases of N steps, whatever the response's shape (theory §6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from fringeworks.patterns.plan import step_design
from fringeworks.signal.phase_table import BINS, places, tables_by_brightness
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, Pair, Provenance

RANGE = (0.4, 4.0)
"""Exponents that are looked for."""
SINUSOIDAL = 1e-7
"""A frame with less harmonic distortion than this needs no search."""
MAX_POINTS = 50_000
"""Pixels from which the exponent is found."""
BLACK_PERCENT = 0.1
"""Share of the darkest pixels, percent, above which the dark level lies."""


def harmonic_distortion(frame: FloatMap, period_px: float) -> float:
    """Energy of the second and third harmonic over that of the fringe, mean over the rows.

    Parameters
    ----------
    frame : (h, w) float array, fringes along x.
    period_px : float > 0
    """
    n = frame.shape[1]
    phase = 2.0j * np.pi * np.arange(n) / period_px
    lines = np.hanning(n) * np.exp(-np.arange(1, 4)[:, None] * phase)
    centred = frame - frame.mean(axis=1, keepdims=True)
    first, second, third = np.sum(np.abs(centred @ lines.T) ** 2, axis=0)
    return float((second + third) / first) if first > 0 else np.inf


def estimate_gamma(frame: FloatMap, period_px: float) -> float:
    """Exponent γ for which frame^(1/γ) is most nearly sinusoidal.

    Parameters
    ----------
    frame : (h, w) float array in 0…1, darkest 0, fringes along x.
    period_px : float > 0
        Period of the fringe.

    Returns
    -------
    γ between 0.4 and 4; 1 for a sinusoidal frame.

    Examples
    --------
    >>> wave = 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(400) / 40)
    >>> round(estimate_gamma(wave[None] ** 2.2, 40.0), 2)
    2.2
    """

    def distortion(gamma: float) -> float:
        return harmonic_distortion(frame ** (1.0 / gamma), period_px)

    if distortion(1.0) < SINUSOIDAL:
        return 1.0
    found = optimize.minimize_scalar(
        distortion, bounds=RANGE, method="bounded", options={"xatol": 1e-3}
    )
    return float(found.x)


@dataclass(frozen=True, eq=False, repr=False)
class Response(Frozen):
    """The response of one camera and projector."""

    camera: str
    projector: str
    gamma: float
    """Exponent of the light seen over the value sent to the projector."""
    steps: int
    """Number of steps that the table is for."""
    pattern_exponent: float
    """Exponent e of the patterns it was measured with: (½ + ½ cos φ)^e was sent."""
    table_rad: NDArray[np.float64]
    """What to take off a wrapped phase from −π on, (K, 256), rad; a harmonic series for each of K
    levels of brightness, because cameras bend the brightest counts."""
    brightness: tuple[float, ...]
    """Brightness A + B of the levels, (K,), counts, rising."""
    residual_rad: float
    """Root mean square of the phase error that the table left where it was made."""
    offset_rad: float = 0.0
    """First of the shifts that the table was made with, rad."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""


def phase_of_steps(
    frames: NDArray[np.generic], shifts_rad: Sequence[float] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wrapped phase of N frames I_n = A + B cos(φ − δ_n).

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    shifts_rad : (n,) floats, optional
        δ_n; 2π n / N where left out.

    Returns
    -------
    phase : (h, w), −π … π
    modulation : (h, w), counts

    Raises
    ------
    InputError for fewer than three frames or shifts that do not determine the phase.

    Notes
    -----
    Least squares in A, B cos φ and B sin φ, for any shifts (Greivenkamp, Optical Engineering
    23:350, 1984).
    """
    stack = np.asarray(frames)
    if stack.ndim != 3 or stack.shape[0] < 3:
        raise InputError(f"frames: expected shape (n ≥ 3, h, w), got {stack.shape}")
    n = stack.shape[0]
    shifts = 2.0 * np.pi * np.arange(n) / n if shifts_rad is None else np.asarray(shifts_rad)
    if shifts.shape != (n,):
        raise InputError(f"shifts: expected {n} values, got {shifts.shape}")
    design = step_design(shifts)
    if np.linalg.cond(design) > 1e3:
        raise InputError("shifts: expected three or more that differ, got none that do")
    solver = np.linalg.pinv(design)
    _, cosine, sine = np.tensordot(solver, stack.astype(np.float64), axes=1)
    return np.arctan2(sine, cosine), np.hypot(sine, cosine)


def smooth_coordinate(
    coordinate: FloatMap, valid: BoolMap, *, sigma_px: float = 15.0
) -> NDArray[np.float64]:
    """A projector coordinate on a flat board, free of the steps of the code it came from.

    Parameters
    ----------
    coordinate : (h, w) float array, such as a decoded Gray code, projector px
    valid : (h, w) bool array
    sigma_px : float > 0
        Width of the smoothing about a cubic surface, camera px.

    Returns
    -------
    (h, w) float array; NaN where not valid, or too far from the surface
    """
    h, w = coordinate.shape
    y, x = np.mgrid[-1.0 : 1.0 : h * 1j, -1.0 : 1.0 : w * 1j]
    powers = [(i, j) for i in range(4) for j in range(4 - i)]
    places = np.flatnonzero(valid)
    if places.size < 1000:
        raise InputError(f"coordinate: expected 1000 valid pixels or more, got {places.size}")
    some = places[:: max(1, places.size // 20_000)]

    def terms(at: NDArray[np.intp]) -> FloatMap:
        return np.column_stack([x.flat[at] ** i * y.flat[at] ** j for i, j in powers])

    design, values = terms(some), coordinate.flat[some].astype(np.float64)
    kept = np.ones(some.size, bool)
    for _ in range(10):
        solved = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        off = np.abs(values - design @ solved)
        kept = off <= max(3.0 * 1.4826 * float(np.median(off[kept])), 1e-9)
    spread = 1.4826 * float(np.median(off[kept]))
    surface = sum(c * x**i * y**j for c, (i, j) in zip(solved, powers, strict=True))
    rest = np.where(valid, coordinate - surface, 0.0)
    near = valid & (np.abs(rest) <= max(6.0 * spread, 1e-9))
    weight = ndimage.gaussian_filter(near.astype(float), sigma_px)
    smooth = ndimage.gaussian_filter(np.where(near, rest, 0.0), sigma_px)
    return np.where(near, surface + smooth / np.maximum(weight, 1e-6), np.nan)


def correct_phase(
    phase_rad: FloatMap, response: Response, brightness: FloatMap | None = None
) -> FloatMap:
    """A wrapped phase of ``response.steps`` steps without the response's error, (h, w), rad.

    ``brightness`` is A + B per pixel, counts; left out, that of the brightest level is taken.
    """
    levels = np.asarray(response.brightness)
    seen = np.full(phase_rad.shape, levels[-1]) if brightness is None else brightness
    row = np.interp(np.where(np.isfinite(seen), seen, levels[0]), levels, np.arange(levels.size))
    below = np.minimum(row.astype(np.intp), levels.size - 1)
    above = np.minimum(below + 1, levels.size - 1)
    left, share = places(phase_rad)

    def at(level: NDArray[np.intp]) -> FloatMap:
        table = response.table_rad
        near, next_ = table[level, left % BINS], table[level, (left + 1) % BINS]
        return np.asarray(near * (1.0 - share) + next_ * share)

    part = row - below
    return np.asarray(phase_rad - at(below) * (1.0 - part) - at(above) * part)


def gamma_of_frames(
    frames: NDArray[np.generic],
    ideal_rad: FloatMap,
    shifts_rad: Sequence[float] | None = None,
    pattern_exponent: float = 1.0,
) -> float:
    """Exponent γ that explains N frames of a white plane.

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    ideal_rad : (h, w) float array, NaN where unknown
    shifts_rad : (n,) floats, optional
    pattern_exponent : float > 0
        Exponent e of the patterns, (½ + ½ cos φ)^e.

    Returns
    -------
    γ, between 0.4 and 4 over e

    Notes
    -----
    Least squares of I_n = a + b·(½ + ½ cos(φ − δ_n))^(eγ), a and b free at every pixel: dark
    level, ambient light and albedo have no say.
    """
    n = len(frames)
    shifts = 2.0 * np.pi * np.arange(n) / n if shifts_rad is None else np.asarray(shifts_rad)
    places = np.flatnonzero(np.isfinite(ideal_rad))
    if places.size == 0:
        raise InputError("ideal phase: expected known pixels, got none")
    places = places[:: max(1, places.size // MAX_POINTS)]
    seen = np.asarray(frames).reshape(n, -1)[:, places].astype(np.float64)
    seen = seen - seen.mean(axis=0)
    wave = 0.5 + 0.5 * np.cos(ideal_rad.ravel()[places] - shifts[:, None])

    def misfit(exponent: float) -> float:
        light = wave**exponent
        light = light - light.mean(axis=0)
        gain = np.sum(light * seen, axis=0) / np.maximum(np.sum(light**2, axis=0), 1e-12)
        return float(np.sum((seen - gain * light) ** 2))

    coarse = np.geomspace(*RANGE, 25)
    k = int(np.argmin([misfit(exponent) for exponent in coarse]))
    around = (coarse[max(k - 1, 0)], coarse[min(k + 1, coarse.size - 1)])
    best = optimize.minimize_scalar(
        misfit, bounds=around, method="bounded", options={"xatol": 1e-4}
    )
    return float(best.x) / pattern_exponent


def measure_response(
    frames: NDArray[np.generic],
    ideal_rad: FloatMap,
    *,
    camera: str,
    projector: str,
    shifts_rad: Sequence[float] | None = None,
    pattern_exponent: float = 1.0,
) -> Response:
    """Response of a camera and projector, from N steps on a white plane.

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    ideal_rad : (h, w) float array
        The phase that was projected, rad, modulo 2π; NaN where unknown. From a coordinate that
        does not depend on intensities: 2π x / p of a Gray code (``smooth_coordinate``).
    camera, projector : str
        Names of the devices; the response is applied to captures of the same two only.
    shifts_rad, pattern_exponent : as in ``phase_of_steps`` and ``gamma_of_frames``

    Raises
    ------
    InputError for frames that cannot be used, or an empty name.
    """
    for name, value in (("camera", camera), ("projector", projector)):
        if not value.strip():
            raise InputError(f"{name}: expected a name, got {value!r}")
    if not pattern_exponent > 0:
        raise InputError(f"pattern_exponent: expected > 0, got {pattern_exponent}")
    phase, modulation = phase_of_steps(frames, shifts_rad)
    brightness = np.mean(np.asarray(frames), axis=0, dtype=np.float64) + modulation
    if ideal_rad.shape != phase.shape:
        raise InputError(f"ideal phase: expected shape {phase.shape}, got {ideal_rad.shape}")
    strong = modulation > 0.2 * np.percentile(modulation, 95)
    seen = np.where(strong, phase, np.nan)
    table, levels = tables_by_brightness(seen, ideal_rad, brightness)
    steps = len(frames)
    known = np.where(strong, ideal_rad, np.nan)
    gamma = gamma_of_frames(frames, known, shifts_rad, pattern_exponent)
    offset = 0.0 if shifts_rad is None else float(shifts_rad[0])
    found = Response(camera, projector, gamma, steps, pattern_exponent, table, levels, 0.0, offset)
    left = np.exp(1j * (correct_phase(seen, found, brightness) - ideal_rad))
    left = np.angle(left * np.conj(np.nanmean(left)))
    return replace(found, residual_rad=float(np.nanstd(left)))


def predistort(values: FloatMap, response: Response) -> FloatMap:
    """Values to send, 0…1, so that the light seen is proportional to ``values`` (0…1)."""
    if values.size and not (values.min() >= 0.0 and values.max() <= 1.0):
        raise InputError(
            f"pattern: expected values from 0 to 1, got {values.min():g} to {values.max():g}"
        )
    return np.asarray(values ** (1.0 / response.gamma))


def linearise(frame: NDArray[np.generic], response: Response) -> NDArray[np.float64]:
    """A frame as a projector without exponent would have made it.

    The dark level is taken off, the inverse exponent applied, and range and level put back; how
    bright a surface is does not matter, because a power turns a factor into a factor.
    """
    values = np.asarray(frame, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        raise InputError("frame: expected finite values, got none")
    dark = float(np.percentile(finite, BLACK_PERCENT))
    span = float(finite.max()) - dark
    if span <= 0:
        return values
    with np.errstate(invalid="ignore"):
        share = np.maximum((values - dark) / span, 0.0)
    return np.asarray(dark + span * share ** (1.0 / response.gamma))


def check_devices(response: Response, camera: str | None, projector: str | None) -> None:
    """Refuse a response of other devices than those of a capture, or of unnamed ones."""
    for name, value in {"camera": camera, "projector": projector}.items():
        own = getattr(response, name)
        if value is None:
            raise InputError(
                f"response: made for {name} {own!r}, but the capture does not name its {name}"
            )
        if value != own:
            raise InputError(f"response: made for {name} {own!r}, the capture is of {value!r}")


def apply_response(capture: Pair, response: Response) -> Pair:
    """A capture with its frames linearised.

    Raises
    ------
    InputError where the capture is of other devices, or does not name its own.
    """
    check_devices(response, capture.camera, capture.projector)
    note = f"response of γ = {response.gamma:.3f} taken out"
    return replace(
        capture,
        reference=None if capture.reference is None else linearise(capture.reference, response),
        object=linearise(capture.object, response),
        notes=(*capture.notes, note),
    )
