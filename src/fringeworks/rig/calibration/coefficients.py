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
K3 = 8
"""Place of k₃ among a device's parameters, the only coefficient that is left out by itself. Leaving
out k₂, p₁ and p₂ as well made rigs from different poses of a real board disagree by 1.6 stated
standard deviations, instead of 1.1 with all of them."""


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
    """Leave out k₃ where the poses do not determine it, and fit again.

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
    useless = [
        place
        for place in (K3, DEVICE_SIZE + K3)
        if free[place] and _is_useless(adjusted.rig, place, left_out)
    ]
    if useless:
        free = free.copy()
        free[useless] = False
        adjusted = adjust(sightings, _with_zeros(adjusted.rig, free), adjusted.poses, free=free)
        left_out = leave_poses_out(sightings, adjusted, free=free)
    return adjusted, left_out, free


def _is_useless(rig: Rig, place: int, left_out: LeftOut) -> bool:
    """Whether a coefficient does not differ from zero."""
    assert rig.covariance is not None
    value = np.concatenate((rig.camera.parameters, rig.projector.parameters))[place]
    sigma = np.sqrt(rig.covariance[place, place]) * left_out.inflation
    return bool(abs(value) < USEFUL_SIGMAS * sigma)


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
