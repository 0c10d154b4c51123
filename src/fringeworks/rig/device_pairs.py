"""Pairs of devices of a rig with several cameras, each as a rig of its own with its covariance."""

from __future__ import annotations

from typing import Literal

import numpy as np

from fringeworks.rig.pinhole import inverse, skew
from fringeworks.types import FloatMap, InputError, MultiRig, Pinhole, Rig, multi_rig_parameters

DEVICE_SIZE = 9
"""Number of parameters of a device."""
POSE_SIZE = 6
"""Number of parameters of a pose."""
RIG_SIZE = 2 * DEVICE_SIZE + POSE_SIZE
"""Number of parameters of a pair of devices."""
FURTHER_SIZE = DEVICE_SIZE + POSE_SIZE
"""Number of parameters of every camera after the first."""

Device = int | Literal["projector"]
"""A camera by its number, from 0, or the projector."""


def camera_pair(rig: MultiRig, camera: int, other: Device = "projector") -> Rig:
    """Return a camera and another device of a rig as a rig of two devices.

    Parameters
    ----------
    rig : MultiRig
    camera : int
        Number of the camera, from 0.
    other : int or "projector"
        The projector, or another camera, which then takes the projector's place.

    Returns
    -------
    Rig in the camera's coordinates, with its share of the covariance and its residuals.

    Raises
    ------
    InputError for a camera that the rig does not have, for one camera twice, and for a projector
    that is not calibrated.

    Examples
    --------
    >>> from fringeworks.simulate import standard_cameras
    >>> rig = standard_cameras(scale=0.1)
    >>> round(camera_pair(rig, 0).baseline_mm), round(camera_pair(rig, 0, 1).baseline_mm)
    (174, 342)
    """
    devices = [_device(rig, camera), _device(rig, other)]
    if camera == other:
        raise InputError(f"pair: expected two devices, got camera {camera + 1} twice")
    T = _pose(rig, other) @ inverse(_pose(rig, camera))
    covariance = None
    if rig.covariance is not None:
        by = pair_by_parameters(rig, camera, other)
        covariance = by @ rig.covariance @ by.T
        covariance = 0.5 * (covariance + covariance.T)
    residual = None
    if rig.residual_px is not None:
        second = -1 if isinstance(other, str) else other
        residual = rig.residual_px[camera], rig.residual_px[second]
    return Rig(devices[0], devices[1], T, covariance, residual, rig.provenance)


def pair_by_parameters(rig: MultiRig, camera: int, other: Device) -> FloatMap:
    """Derivative of a pair's 24 parameters by those of the whole rig, (24, 24 …).

    Notes
    -----
    With T_o and T_c from the first camera to both devices, R = R_o R_cᵀ and t = t_o − R t_c. For
    rotation errors ω_o and ω_c, ω = ω_o − R ω_c and δt = δt_o − ω × R t_c − R δt_c.
    """
    calibrated = rig.projector is not None
    by = np.zeros((RIG_SIZE, len(multi_rig_parameters(len(rig.cameras), projector=calibrated))))
    unit = np.eye(DEVICE_SIZE)
    places: tuple[Device, Device] = (camera, other)
    for k, device in enumerate(places):
        first = _device_place(rig, device)
        by[DEVICE_SIZE * k : DEVICE_SIZE * (k + 1), first : first + DEVICE_SIZE] = unit
    R = (_pose(rig, other) @ inverse(_pose(rig, camera)))[:3, :3]
    turned = R @ _pose(rig, camera)[:3, 3]
    turn, shift = slice(2 * DEVICE_SIZE, 2 * DEVICE_SIZE + 3), slice(RIG_SIZE - 3, RIG_SIZE)
    for device, factor in ((other, np.eye(3)), (camera, -R)):
        if device == 0:
            continue
        first = _pose_place(rig, device)
        by[turn, first : first + 3] += factor
        by[shift, first : first + 3] += skew(turned) @ factor
        by[shift, first + 3 : first + POSE_SIZE] += factor
    return by


def _device(rig: MultiRig, device: Device) -> Pinhole:
    if isinstance(device, str):
        if rig.projector is None:
            raise InputError("pair: expected a calibrated projector, got a rig of cameras alone")
        return rig.projector
    if not 0 <= device < len(rig.cameras):
        raise InputError(
            f"camera: expected a number from 0 to {len(rig.cameras) - 1}, got {device}"
        )
    return rig.cameras[device]


def _pose(rig: MultiRig, device: Device) -> FloatMap:
    """The transform from the first camera to a device, (4, 4), mm."""
    if isinstance(device, str):
        if rig.T_projector_camera is None:
            raise InputError("pair: expected a calibrated projector, got a rig of cameras alone")
        return rig.T_projector_camera
    return np.asarray(rig.T_camera_first[device])


def _device_place(rig: MultiRig, device: Device) -> int:
    """Where a device's nine parameters begin."""
    if isinstance(device, str):
        return DEVICE_SIZE
    before = DEVICE_SIZE if rig.projector is None else RIG_SIZE
    return 0 if device == 0 else before + FURTHER_SIZE * (device - 1)


def _pose_place(rig: MultiRig, device: Device) -> int:
    """Where the six parameters of a device's pose begin; the first camera has none."""
    return 2 * DEVICE_SIZE if isinstance(device, str) else _device_place(rig, device) + DEVICE_SIZE
