"""Phase unwrapping in space."""

from __future__ import annotations

import numpy as np

from fringeworks import _core
from fringeworks.types import BoolMap, FloatMap, InputError


def unwrap(phase_rad: FloatMap, mask: BoolMap | None = None) -> tuple[FloatMap, np.ndarray]:
    """Unwrap a phase map by sorting by reliability.

    Parameters
    ----------
    phase_rad : (h, w) float array
        Wrapped phase, rad; not mutated. Pixels that are not finite count as masked.
    mask : (h, w) bool array, optional
        True where the phase is valid.

    Returns
    -------
    phase : (h, w) float32 array, rad
        Congruent with the input modulo 2π; NaN where masked.
    region : (h, w) uint32 array
        0 where masked; 1 for the largest connected region, 2 for the next …; orders of different
        regions are unrelated.

    Raises
    ------
    InputError where the phase is not 2-D, the mask's shape differs, or no pixel is valid.

    Notes
    -----
    Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35):7437, 2002.

    Examples
    --------
    >>> ramp = np.tile(np.linspace(0, 20, 50), (40, 1))
    >>> phase, region = unwrap(np.angle(np.exp(1j * ramp)))
    >>> bool(np.allclose(np.diff(phase, axis=1), 20 / 49, atol=1e-5)), int(region.max())
    (True, 1)
    """
    phase = np.ascontiguousarray(phase_rad, dtype=np.float32)
    if phase.ndim != 2:
        raise InputError(f"phase: expected shape (h, w), got {phase.shape}")
    valid = np.isfinite(phase)
    if mask is not None:
        if mask.shape != phase.shape:
            raise InputError(f"mask: expected shape {phase.shape}, got {mask.shape}")
        valid &= np.asarray(mask, bool)
    if not valid.any():
        raise InputError("phase: expected at least one valid pixel, got none")
    filled = np.where(valid, phase, np.float32(0.0))
    unwrapped, region = _core.unwrap_reliability(filled, valid.astype(np.uint8))
    return unwrapped, region
