"""Which coefficients of lens distortion are estimated: as many as asked for, or as are useful."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.calibration.bundle import Adjusted, adjust
from fringeworks.rig.calibration.leave_out import LeftOut, leave_poses_out
from fringeworks.rig.calibration.parameters import DEVICE_SIZE, RIG_SIZE, pinhole_of
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.types import BoolMap, FloatMap, InputError, Pinhole, Rig

USEFUL_SIGMAS = 2.0
"""A coefficient closer to zero than this, in standard deviations that leaving poses out confirms,
is left out. Keeping it would add more variance to the rig than leaving it out adds error."""
FIRST_COEFFICIENT = 4
"""Place of k₁ among a device's parameters; k₂, p₁, p₂, k₃ follow."""
ORDER = ((8,), (5,), (6, 7))
"""Places of the coefficients that are examined, one group after the other: k₃, then k₂, then p₁ and
p₂ together. k₁ is always kept: every lens has some."""


def free_parameters(distortion: int | None) -> BoolMap:
    """Return which of the rig's parameters are estimated at first, (24,); None as 5."""
    if distortion not in (None, 0, 2, 4, 5):
        raise InputError(f"distortion: expected 0, 2, 4 or 5 coefficients, got {distortion}")
    free = np.ones(RIG_SIZE, bool)
    for device in (0, 1):
        first = DEVICE_SIZE * device + FIRST_COEFFICIENT
        free[first + (5 if distortion is None else distortion) : first + 5] = False
    return free


def without_useless(
    sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap
) -> tuple[Adjusted, LeftOut, BoolMap]:
    """Leave out coefficients of lens distortion that the poses do not determine, and fit again.

    Parameters
    ----------
    sightings : sequence of Sighting
    adjusted : Adjusted
        Their adjustment with all coefficients in ``free``.
    free : (24,) bool array

    Returns
    -------
    The adjustment without them, what leaving out poses shows, and what was estimated, (24,).
    """
    left_out = leave_poses_out(sightings, adjusted, free=free)
    for group in ORDER:
        useless = [
            places
            for device in (0, 1)
            if _useless(
                adjusted.rig, places := [DEVICE_SIZE * device + k for k in group], left_out, free
            )
        ]
        if useless:
            free = free.copy()
            free[np.concatenate(useless)] = False
            rig = _with_zeros(adjusted.rig, free)
            adjusted = adjust(sightings, rig, adjusted.poses, free=free)
            left_out = leave_poses_out(sightings, adjusted, free=free)
    return adjusted, left_out, free


def _useless(rig: Rig, places: list[int], left_out: LeftOut, free: BoolMap) -> bool:
    """Whether these coefficients together do not differ from zero."""
    # k₂ is examined only where k₃ has been left out: of two that share an effect one may be useful.
    k3 = places[0] - places[0] % DEVICE_SIZE + 8
    is_k2 = places[0] % DEVICE_SIZE == 5
    if not free[places].all() or (is_k2 and free[k3]):
        return False
    assert rig.covariance is not None
    values = np.concatenate((rig.camera.parameters, rig.projector.parameters))[places]
    covariance = rig.covariance[np.ix_(places, places)] * left_out.inflation**2
    distance2 = float(values @ np.linalg.solve(covariance, values)) / len(places)
    return distance2 < USEFUL_SIGMAS**2


def _with_zeros(rig: Rig, free: BoolMap) -> Rig:
    """The rig with all distortion that is not estimated at zero."""
    devices = [
        _device(device, free[DEVICE_SIZE * k : DEVICE_SIZE * (k + 1)])
        for k, device in enumerate((rig.camera, rig.projector))
    ]
    return Rig(devices[0], devices[1], rig.T_projector_camera)


def _device(device: Pinhole, free: BoolMap) -> Pinhole:
    values: FloatMap = np.where(free, device.parameters, 0.0)
    return pinhole_of(values, device)
