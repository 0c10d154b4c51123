"""Black and white frames: what the projector's light alone shows of an object, and its albedo."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.signal.filters import box_mean
from fringeworks.types import BoolMap, FloatMap, InputError

MIN_WHITE = 0.02
"""Smallest brightness under white, as a share of its median, that counts do not only guess: less is
black paint or shadow, and is not fitted. An empirical choice."""


class ProjectorLight(NamedTuple):
    """An object frame without the light of the room and without paint; (h, w) maps."""

    object: FloatMap
    """Counts of the projector's light on an object of albedo 1."""
    albedo: FloatMap | None
    """Brightness under white over its median, > 0; None without a white frame."""
    usable: BoolMap
    """False where the frames do not tell the albedo."""


def without_light(name: str, black: NDArray[Any] | float, frame: FloatMap) -> FloatMap:
    """Take the light that the projector does not send from a frame.

    Parameters
    ----------
    name : str
        Of the frame, for errors.
    black : (h, w) array or float
        Counts of the same scene while the projector shows black, or the camera's black level.
    frame : (h, w) float array, counts

    Raises
    ------
    InputError where the black frame has another shape, or is as bright as the frame.
    """
    level = np.asarray(black, np.float64)
    if level.ndim and level.shape != frame.shape:
        raise InputError(f"black frame: expected shape {frame.shape}, got {level.shape}")
    if not np.isfinite(level).any():
        raise InputError("black: expected finite counts, got none")
    lit = frame.astype(np.float64) - level
    if not np.nanmedian(lit) > 0:
        raise InputError(
            f"black: expected less light than in the {name} frame, got a median of "
            f"{float(np.nanmedian(level)):g} counts against {float(np.median(frame)):g}"
        )
    return lit


def projector_light(
    frame: FloatMap,
    black: NDArray[Any] | float | None,
    white: FloatMap | None,
    white_usable: BoolMap | None,
) -> ProjectorLight:
    """Take ambient light from an object frame, and divide by the albedo that a white frame shows.

    Parameters
    ----------
    frame : (h, w) float array, counts
        Object under fringes.
    black : (h, w) array or float, optional
        Object while the projector shows black, or the black level, counts.
    white : (h, w) float array, optional
        Object while the projector shows white, counts.
    white_usable : (h, w) bool array, optional
        Where the white frame is finite and below the sensor's limit.

    Raises
    ------
    InputError where shapes differ, black is as bright as the frame, or white is not brighter.
    """
    usable = np.ones(frame.shape, bool)
    if black is not None:
        frame = without_light("object", black, frame)
        usable &= np.isfinite(frame)
        frame = np.where(usable, frame, 0.0)
    if white is None or white_usable is None:
        return ProjectorLight(frame, None, usable)
    if white.shape != frame.shape:
        raise InputError(f"white frame: expected shape {frame.shape}, got {white.shape}")
    lit = white.astype(np.float64) if black is None else without_light("white", black, white)
    usable &= white_usable & np.isfinite(lit)
    if not usable.any():
        raise InputError("white frame: expected pixels below the sensor's limit, got none")
    usual = float(np.median(lit[usable]))
    if not usual > 0:
        raise InputError(f"white frame: expected light, got a median of {usual:g} counts")
    albedo = lit / usual
    usable &= albedo > MIN_WHITE
    albedo = np.where(usable, albedo, 1.0)
    return ProjectorLight(frame / albedo, albedo, usable)


def noise_factor(albedo: FloatMap, usable: BoolMap, width_px: float) -> FloatMap:
    """Noise of a frame that was divided by an albedo, over that of its typical pixel, (h, w).

    Parameters
    ----------
    albedo : (h, w) float array > 0
    usable : (h, w) bool array
    width_px : float
        Width over which a method averages noise, px.

    Notes
    -----
    The division multiplies white noise of one level by 1/β: a method that averages over a window
    has the mean of 1/β² there.
    """
    square = np.where(usable, 1.0 / albedo**2, 0.0)
    side = 2 * int(width_px) + 1
    around, share = (box_mean(values, side) for values in (square, usable.astype(np.float64)))
    typical = float(np.median(square[usable])) if usable.any() else 1.0
    return np.asarray(np.sqrt(around / np.maximum(share, 1e-6) / typical))
