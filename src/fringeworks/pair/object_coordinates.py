"""Displacement over a known plane → projector coordinates of the object."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import CoordinateMap, DisplacementMap, FloatMap, InputError, Reason, sealed


def object_coordinates(
    displacement: DisplacementMap, reference: CoordinateMap, *, modulation: float, level: FloatMap
) -> CoordinateMap:
    """Find the projector coordinate that lights every pixel of the object.

    Parameters
    ----------
    displacement : DisplacementMap
        (h, w), along the camera axis in which the fringes of the plan's axis change.
    reference : CoordinateMap
        Of the reference plane, (h, w), for the same camera.
    modulation : float
        Mean modulation of the reference frame, counts.
    level : (h, w) array
        Mean brightness of the object frame around every pixel, counts.

    Returns
    -------
    CoordinateMap, NaN where the displacement is, or the reference at its matching point.

    Raises
    ------
    InputError for maps of other shapes.

    Notes
    -----
    The object's pixel x gets the light of the reference's pixel x − u of its row, so that its
    coordinate is q(x − u), between pixels by straight lines, and σ² = (q′ σ_u)² + σ_q². For fringes
    that change along y, columns take the place of rows.
    """
    if reference.coordinate_px.shape != displacement.displacement_px.shape:
        raise InputError(
            f"reference coordinates: expected shape {displacement.displacement_px.shape} of the "
            f"frames, got {reference.coordinate_px.shape}"
        )
    (first, second), share = at_reference(displacement, reference.coordinate_px)
    noise = np.maximum(*at_reference(displacement, reference.sigma_px)[0])
    steep = second - first
    found = first + share * steep
    sigma = np.hypot(steep * displacement.sigma_px, noise)
    ok = np.isfinite(found) & np.isfinite(displacement.displacement_px)
    reason = displacement.reason.copy()
    reason[~ok & (reason == Reason.OK)] = Reason.OUTSIDE
    return CoordinateMap(
        coordinate_px=sealed(np.where(ok, found, np.nan)),
        sigma_px=sealed(np.where(ok, sigma, np.nan)),
        modulation=sealed(displacement.modulation_ratio * modulation),
        background=sealed(level),
        reason=sealed(reason),
        axis=reference.axis,
        periods_px=(),
    )


def at_reference(
    displacement: DisplacementMap, values: FloatMap
) -> tuple[tuple[FloatMap, FloatMap], FloatMap]:
    """Values of a map of the reference at the two pixels beside x − u, each (h, w), and the share
    of the second."""
    turned = displacement.axis == "y"

    def turn(given: NDArray[Any]) -> NDArray[Any]:
        return given.T if turned else given

    u = turn(displacement.displacement_px)
    width = u.shape[1]
    place = np.arange(width) - np.where(np.isfinite(u), u, 0.0)
    low = np.clip(np.floor(place), 0, width - 2).astype(np.intp)
    wide = turn(values).astype(np.float64)
    beside = [turn(np.take_along_axis(wide, low + k, axis=1)) for k in (0, 1)]
    return (beside[0], beside[1]), turn(place - low)
