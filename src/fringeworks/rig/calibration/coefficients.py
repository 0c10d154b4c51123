"""Which coefficients of lens distortion are estimated: as many as asked for, or as are useful."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.leave_out import LeftOut, leave_poses_out
from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    FURTHER_SIZE,
    RIG_SIZE,
    FurtherCamera,
    pinhole_of,
)
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


def device_places(further: int) -> list[int]:
    """Return where the parameters of every device begin, for a number of further cameras."""
    return [0, DEVICE_SIZE, *(RIG_SIZE + FURTHER_SIZE * k for k in range(further))]


def free_parameters(distortion: int | None, further: int = 0) -> BoolMap:
    """Return which of the devices' parameters are estimated at first, (24 …,); None as 5."""
    if distortion not in (None, 0, 2, 4, 5):
        raise InputError(f"distortion: expected 0, 2, 4 or 5 coefficients, got {distortion}")
    free = np.ones(RIG_SIZE + FURTHER_SIZE * further, bool)
    for place in device_places(further):
        first = place + FIRST_COEFFICIENT
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
    free : (24 …,) bool array

    Returns
    -------
    The adjustment without them, what leaving out poses shows, and what was estimated.
    """
    left_out = leave_poses_out(sightings, adjusted, free=free)
    places = device_places(len(adjusted.further))
    useless = [
        place + K3
        for place, device in zip(places, _devices(adjusted), strict=True)
        if free[place + K3] and _is_useless(device, adjusted, place, left_out)
    ]
    if useless:
        free = free.copy()
        free[useless] = False
        rig, further = _with_zeros(adjusted, free)
        poses, smooth = adjusted.poses, adjusted.smooth
        adjusted = adjust(sightings, rig, poses, free=free, further=further, smooth=smooth)
        left_out = leave_poses_out(sightings, adjusted, free=free)
    return adjusted, left_out, free


def _devices(adjusted: Adjusted) -> list[Pinhole]:
    """Camera, projector and further cameras."""
    rig = adjusted.rig
    return [rig.camera, rig.projector, *(other.camera for other in adjusted.further)]


def _is_useless(device: Pinhole, adjusted: Adjusted, place: int, left_out: LeftOut) -> bool:
    """Whether k₃ of the device whose parameters begin at a place does not differ from zero."""
    value = device.parameters[K3]
    sigma = np.sqrt(adjusted.covariance[place + K3, place + K3]) * left_out.inflation
    return bool(abs(value) < USEFUL_SIGMAS * sigma)


def _with_zeros(adjusted: Adjusted, free: BoolMap) -> tuple[Rig, tuple[FurtherCamera, ...]]:
    """All devices with all distortion that is not estimated at zero."""
    places = device_places(len(adjusted.further))
    devices = [
        _device(device, free[place : place + DEVICE_SIZE])
        for place, device in zip(places, _devices(adjusted), strict=True)
    ]
    further = tuple(
        FurtherCamera(device, other.T_camera_first)
        for device, other in zip(devices[2:], adjusted.further, strict=True)
    )
    return Rig(devices[0], devices[1], adjusted.rig.T_projector_camera), further


def _device(device: Pinhole, free: BoolMap) -> Pinhole:
    values: FloatMap = np.where(free, device.parameters, 0.0)
    return pinhole_of(values, device)
