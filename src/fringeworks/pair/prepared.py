"""A capture made ready for analysis: checked once, in float, fringes varying along the columns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.plain_reference import plain_reference
from fringeworks.signal.noise import noise_variance
from fringeworks.types import Axis, BoolMap, FloatMap, InputError, Pair

MIN_SIZE = 16
"""Smallest frame side along the fringes' direction, px."""
QUANTISATION_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True)
class PreparedPair:
    """Reference and object frame, (h, w) float64, the carrier along x (columns)."""

    reference: NDArray[np.float64]
    """As captured, or, for a single frame, the plain fringe that lies on its background."""
    object: NDArray[np.float64]
    reference_ok: BoolMap
    """False where the reference has a gap or is saturated: not to be fitted to."""
    object_ok: BoolMap
    """False where the object frame has a gap or is saturated: not to be fitted to."""
    wanted: BoolMap
    """False where the caller masked the pixel or the object frame is not finite."""
    gap: BoolMap
    """True where the reference frame is not finite."""
    saturated: BoolMap
    """True where the object frame is at the sensor's limit over a whole 3 × 3 neighbourhood."""
    carrier: Carrier
    """Found on the reference; its axis is that of the capture, not of these arrays."""
    integer: bool
    """Whether the frames came as whole counts."""

    @property
    def period(self) -> float:
        """Mean fringe period of the reference, px."""
        return self.carrier.period_px

    @property
    def frequency(self) -> tuple[float, float]:
        """The carrier along the columns and along the rows of these arrays, cycles/px."""
        return 1.0 / self.carrier.period_px, self.carrier.across

    @cached_property
    def modulation(self) -> float:
        """Mean amplitude of the reference's fringe, counts: √2 × its standard deviation."""
        return float(np.sqrt(2.0) * self.reference[self.reference_ok].std())

    @cached_property
    def level(self) -> float:
        """Mean of the reference, counts."""
        return float(self.reference[self.reference_ok].mean())

    @cached_property
    def noise(self) -> tuple[float, float]:
        """Noise variance of reference and object frame, counts², with a floor for rounding."""
        floor = QUANTISATION_VARIANCE if self.integer else (1e-7 * self.modulation) ** 2
        return (
            max(noise_variance(self.reference, self.reference_ok), floor),
            max(noise_variance(self.object, self.object_ok), floor),
        )

    def to_capture(self, values: np.ndarray) -> np.ndarray:
        """Turn a map of these arrays back to the capture's orientation."""
        return values if self.carrier.axis == "x" else np.ascontiguousarray(values.T)


def fill_nearest(values: FloatMap, known: BoolMap) -> FloatMap:
    """The map with every unknown pixel given the value of the nearest known one."""
    if known.all():
        return values
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def _frame(name: str, frame: np.ndarray) -> tuple[FloatMap, BoolMap, BoolMap]:
    """Values with gaps filled, finite pixels, and saturated pixels of one frame."""
    array = np.asarray(frame)
    if array.ndim != 2:
        raise InputError(f"{name} frame: expected shape (h, w), got {array.shape}")
    if array.dtype.kind not in "uif":
        raise InputError(f"{name} frame: expected integer or float counts, got {array.dtype}")
    values: FloatMap = array.astype(np.float64)
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f"{name} frame: expected finite values, got none")
    if array.dtype.kind == "u":
        at_limit = array == np.iinfo(array.dtype).max
        saturated = ndimage.binary_opening(at_limit, np.ones((3, 3)))
    else:
        saturated = np.zeros(values.shape, bool)
    values = fill_nearest(values, finite)
    if not values.any():
        raise InputError(f"{name} frame: expected fringes, got an all-black frame")
    return values, finite, saturated


def prepare(capture: Pair) -> PreparedPair:
    """Check a capture and bring it into the form that the analyses work on.

    Parameters
    ----------
    capture : Pair
        Two frames of equal shape, or the object's alone; not mutated.

    Returns
    -------
    PreparedPair, transposed where the fringes vary along y.

    Raises
    ------
    InputError where frames differ in shape, are not 2-D, too small, black, constant, without one
    finite value, or the reference has no fringes.

    Notes
    -----
    Pixels that are not finite are left out (``Reason.MASKED``); their neighbours' values fill the
    gap so that filters have something to run over.
    """
    object_, object_finite, object_saturated = _frame("object", capture.object)
    wanted = object_finite.copy()
    if capture.mask is not None:
        if capture.mask.shape != object_.shape:
            raise InputError(f"mask: expected shape {object_.shape}, got {capture.mask.shape}")
        wanted &= np.asarray(capture.mask, bool)
        if not wanted.any():
            raise InputError("mask: expected at least one pixel to measure, got none")
    if max(object_.shape) < MIN_SIZE:
        raise InputError(
            f"frames: expected at least {MIN_SIZE} px along the fringes' direction, "
            f"got shape {object_.shape}"
        )
    if capture.reference is None:
        carrier, reference = plain_reference(object_, object_finite, capture)
        reference_finite = np.ones(object_.shape, bool)
        reference_saturated = ~reference_finite
        dtypes = [np.asarray(capture.object).dtype]
    else:
        reference, reference_finite, reference_saturated = _frame("reference", capture.reference)
        if reference.shape != object_.shape:
            raise InputError(
                f"frames: expected equal shapes, got reference {reference.shape} and "
                f"object {object_.shape}"
            )
        carrier = find_carrier(reference, capture.axis)
        dtypes = [np.asarray(frame).dtype for frame in (capture.reference, capture.object)]
    if float(np.ptp(object_)) == 0.0:
        raise InputError(f"object frame: expected fringes, got the constant {object_.flat[0]:g}")

    def orient(values: np.ndarray, axis: Axis = carrier.axis) -> np.ndarray:
        return np.ascontiguousarray(values if axis == "x" else values.T)

    return PreparedPair(
        reference=orient(reference),
        object=orient(object_),
        reference_ok=orient(reference_finite & ~reference_saturated),
        object_ok=orient(object_finite & ~object_saturated),
        wanted=orient(wanted),
        gap=orient(~reference_finite),
        saturated=orient(object_saturated),
        carrier=carrier,
        integer=all(d.kind in "ui" for d in dtypes),
    )
