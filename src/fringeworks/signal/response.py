"""The common response of a projector and a camera: its measurement and its correction (theory §6).

The response has two forms. The exponent γ, with I ∝ v^γ, linearises frames and pre-distorts
patterns. The table φ → Δφ corrects the phases of N steps for a response of any shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import SINGULAR_CONDITION, step_design
from fringeworks.signal.filters import saturated_squares
from fringeworks.signal.gamma import (
    GAMMA_RANGE,
    MISFIT_PRECISION,
    gamma_of_frames,
    shifts_or_equal,
)
from fringeworks.signal.phase_table import TABLE_BINS, table_position, tables_by_brightness
from fringeworks.types import FloatMap, Frozen, InputError, Pair, Provenance, unmasked

DARK_PERCENT = 0.1
"""Percentile of a frame that counts as its dark brightness, percent.

The minimum itself would depend on single noisy or dead pixels. An empirical choice.
"""

MIN_MODULATION_SHARE = 0.2
"""Smallest modulation of a pixel that the response is measured from.

As a share of the 95th percentile, which is that of the white plane. It excludes shadow and dark
surroundings. An empirical choice.
"""

LARGEST_ERROR_RAD = 0.36
"""Largest phase error that a response makes, rms, rad: that of three steps with γ = 4.

That is the end of ``GAMMA_RANGE``. If more than that remains after the correction, the phases do
not follow the projected ones.
"""

AGREEMENT = 0.5
"""Length of the mean of exp(i·difference) from which on two phases agree, 0…1.

Unrelated phases have 0; phases with the error of a response have 0.9 or more.
"""


@dataclass(frozen=True, eq=False, repr=False)
class Response(Frozen):
    """The common response of one camera and one projector."""

    camera: str
    """Name of the camera."""
    projector: str
    """Name of the projector."""
    gamma: float
    """Exponent γ of the observed light over the value sent to the projector."""
    steps: int
    """Number N of steps that the table corrects."""
    pattern_exponent: float
    """Exponent e of the patterns that the response was measured with, (½ + ½ cos φ)^e."""
    table_rad: NDArray[np.float64]
    """Phase error at the middles of equal bins from −π on, (K, 256), rad; one table for each
    brightness, because the response of cameras bends near their limit."""
    brightness: tuple[float, ...]
    """Brightness A + B of the K tables, counts, rising."""
    residual_rad: float
    """Standard deviation of the phase error that remains in the measured frames, rad."""
    offset_rad: float = 0.0
    """First of the shifts that the tables were measured with, rad."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""


def phase_of_steps(
    frames: NDArray[np.generic], shifts_rad: Sequence[float] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wrapped phase and modulation of N frames I_n = A + B cos(φ − δ_n).

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    shifts_rad : (n,) floats, optional
        Shifts δ_n, rad; 2π k / n for k = 0 … n − 1 where not given.

    Returns
    -------
    phase : (h, w) float64 array, −π … π rad
    modulation : (h, w) float64 array, counts

    Raises
    ------
    InputError
        If there are fewer than three frames, or the shifts do not determine the phase.

    Notes
    -----
    Least squares in A, B cos φ and B sin φ, for any shifts (Greivenkamp, Optical Engineering
    23:350, 1984; theory §5).

    Examples
    --------
    >>> shifts = [0.0, 1.5, 3.0, 4.5]
    >>> frames = np.stack([np.full((2, 2), 50 + 30 * np.cos(1.0 - s)) for s in shifts])
    >>> phase, modulation = phase_of_steps(frames, shifts)
    >>> round(float(phase[0, 0]), 6), round(float(modulation[0, 0]), 6)
    (1.0, 30.0)
    """
    stack = unmasked(frames, "frames")
    if stack.ndim != 3 or stack.shape[0] < 3:
        raise InputError(f"frames: expected shape (n ≥ 3, h, w), got {stack.shape}")
    n = stack.shape[0]
    shifts = shifts_or_equal(n, shifts_rad)
    if shifts.shape != (n,):
        raise InputError(f"shifts: expected {n} values, got {shifts.shape}")
    design = step_design(shifts)
    if np.linalg.cond(design) > SINGULAR_CONDITION:
        degrees = ", ".join(f"{d:g}" for d in np.degrees(shifts))
        raise InputError(f"shifts: expected at least three that differ modulo 360°, got {degrees}°")
    solver = np.linalg.pinv(design)
    _, cosine, sine = np.tensordot(solver, stack.astype(np.float64), axes=1)
    return np.arctan2(sine, cosine), np.hypot(sine, cosine)


def correct_phase(
    phase_rad: FloatMap, response: Response, brightness: FloatMap | None = None
) -> FloatMap:
    """Remove the response's phase error from a wrapped phase.

    Parameters
    ----------
    phase_rad : (h, w) float array
        Wrapped phase of ``response.steps`` steps, rad.
    response : Response
    brightness : (h, w) float array, optional
        A + B per pixel, counts; that of the brightest table where not given.

    Returns
    -------
    (h, w) float array, rad

    Notes
    -----
    Linear interpolation along the phase and between the tables of neighbouring brightness.
    """
    known = np.asarray(response.brightness)
    seen = np.full(phase_rad.shape, known[-1]) if brightness is None else brightness
    row = np.interp(np.where(np.isfinite(seen), seen, known[0]), known, np.arange(known.size))
    darker = np.minimum(row.astype(np.intp), known.size - 1)
    brighter = np.minimum(darker + 1, known.size - 1)
    below, share = table_position(phase_rad)

    def error(row: NDArray[np.intp]) -> FloatMap:
        table = response.table_rad
        left, right = table[row, below % TABLE_BINS], table[row, (below + 1) % TABLE_BINS]
        return np.asarray(left * (1.0 - share) + right * share)

    part = row - darker
    return np.asarray(phase_rad - error(darker) * (1.0 - part) - error(brighter) * part)


def measure_response(
    frames: NDArray[np.generic],
    ideal_rad: FloatMap,
    *,
    camera: str,
    projector: str,
    shifts_rad: Sequence[float] | None = None,
    pattern_exponent: float = 1.0,
) -> Response:
    """Measure the response of a camera and a projector from N steps on a white plane.

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    ideal_rad : (h, w) float array
        Phase that was projected, modulo 2π, rad; NaN where unknown. It must not depend on the
        response: use 2π x / p with x from a Gray code (``smooth_coordinate``).
    camera, projector : str
        Names of the devices; the response applies only to frames of the same two.
    shifts_rad : (n,) floats, optional
        As for ``phase_of_steps``.
    pattern_exponent : float > 0
        As for ``gamma_of_frames``.

    Returns
    -------
    Response

    Raises
    ------
    InputError
        If a name is empty, the shapes differ, the frames do not hold whole fringes, no exponent of
        0.4 … 4 explains them, or the phases do not follow the projected ones.

    Notes
    -----
    A common offset of the phases is where the plan's steps start. It is no error of the response,
    and is removed before the fits.
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
    strong = modulation > MIN_MODULATION_SHARE * np.percentile(modulation, 95)
    seen = np.where(strong, phase, np.nan)
    along = _mean_direction(seen - ideal_rad)
    against = _mean_direction(-seen - ideal_rad)
    ideal_rad = ideal_rad + np.angle(along)
    tables, medians = tables_by_brightness(seen, ideal_rad, brightness)
    steps = len(frames)
    known = np.where(strong, ideal_rad, np.nan)
    gamma = gamma_of_frames(frames, known, shifts_rad, pattern_exponent)
    first = 0.0 if shifts_rad is None else float(shifts_rad[0])
    response = Response(
        camera, projector, gamma, steps, pattern_exponent, tables, medians, 0.0, first
    )
    residual = np.exp(1j * (correct_phase(seen, response, brightness) - ideal_rad))
    residual = np.angle(residual * np.conj(np.nanmean(residual)))
    left = float(np.nanstd(residual))
    _check_fit(left, gamma * pattern_exponent, backwards=abs(against) > AGREEMENT)
    return replace(response, residual_rad=left)


def _mean_direction(phase_rad: FloatMap) -> complex:
    """Mean of exp(i φ) over the finite phases; 0 where there are none."""
    known = phase_rad[np.isfinite(phase_rad)]
    return complex(np.mean(np.exp(1j * known))) if known.size else 0j


def _check_fit(left_rad: float, exponent: float, *, backwards: bool) -> None:
    """Refuse a response that does not explain the frames that it was measured from."""
    if left_rad > LARGEST_ERROR_RAD:
        likely = (
            "the steps run the other way: give their shifts with the other sign"
            if backwards
            else "likely the period, the order or the sign of the steps is not what was projected, "
            "the surface is not flat, or the fringes are too weak"
        )
        raise InputError(
            f"response: expected phases that differ from the projected ones by at most "
            f"{LARGEST_ERROR_RAD} rad rms after the correction, got {left_rad:.2f} rad; {likely}"
        )
    low, high = GAMMA_RANGE
    if not low + MISFIT_PRECISION < exponent < high - MISFIT_PRECISION:
        end = low if exponent < 1.0 else high
        raise InputError(
            f"response: expected an exponent γ between {low} and {high}, got frames that fit best "
            f"at the end of this range, {end}; likely the camera's own gamma is switched on, the "
            "frames are saturated, or another light changed during the capture"
        )


def linearise(frame: NDArray[np.generic], response: Response) -> NDArray[np.float64]:
    """Convert a frame to what a projector with γ = 1 would have produced.

    Parameters
    ----------
    frame : (h, w) real array, counts
    response : Response

    Returns
    -------
    (h, w) float64 array, counts, with the same dark brightness and maximum

    Raises
    ------
    InputError
        If no pixel is finite.

    Notes
    -----
    The brightness over the dark is raised to the power 1/γ. The albedo of a surface does not
    matter, because a power turns a factor into another factor.
    """
    values = np.asarray(unmasked(frame, "frame"), dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        raise InputError("frame: expected finite values, got none")
    dark = float(np.percentile(finite, DARK_PERCENT))
    span = float(finite.max()) - dark
    if span <= 0:
        return values
    with np.errstate(invalid="ignore"):
        share = np.maximum((values - dark) / span, 0.0)
    return np.asarray(dark + span * share ** (1.0 / response.gamma))


def check_devices(response: Response, camera: str | None, projector: str | None) -> None:
    """Refuse a response unless a capture names the devices that it was measured with.

    Parameters
    ----------
    response : Response
    camera, projector : str or None
        Names of the capture's devices; None where the capture does not name them.

    Raises
    ------
    InputError
        If a name is missing or differs.
    """
    for name, value in {"camera": camera, "projector": projector}.items():
        expected = getattr(response, name)
        if value is None:
            raise InputError(
                f"response: made for {name} {expected!r}, but the capture does not name its {name}"
            )
        if value != expected:
            raise InputError(f"response: made for {name} {expected!r}, the capture is of {value!r}")


def apply_response(pair: Pair, response: Response) -> Pair:
    """Linearise the frames of a pair.

    Parameters
    ----------
    pair : Pair
        Its ``camera`` and ``projector`` must be those of the response.
    response : Response

    Returns
    -------
    Pair with frames that a projector with γ = 1 would have produced; NaN where the frame is
    saturated. ``reconstruct`` and ``prepare`` take a response themselves, and give saturated pixels
    their reason.

    Raises
    ------
    InputError
        If the pair is of other devices or does not name them.
    """
    check_devices(response, pair.camera, pair.projector)

    def straight(frame: NDArray[Any]) -> FloatMap:
        # Floats have no limit of counts: later steps would no longer see the saturation.
        return np.where(saturated_squares(frame), np.nan, linearise(frame, response))

    return replace(
        pair,
        reference=None if pair.reference is None else straight(pair.reference),
        object=straight(pair.object),
        notes=(*pair.notes, response_note(response)),
    )


def response_note(response: Response) -> str:
    """What was done to the frames, in one sentence."""
    return f"frames corrected for a response with γ = {response.gamma:.3f}"
