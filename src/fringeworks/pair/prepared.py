"""The checked pair that all methods work on: float frames whose carrier runs along x."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.plain_reference import PlainReference, plain_reference
from fringeworks.pair.presence import without_fringes
from fringeworks.pair.projector_light import ProjectorLight, projector_light
from fringeworks.signal.bands import row_bands
from fringeworks.signal.filters import saturated_squares
from fringeworks.signal.noise import noise_variance
from fringeworks.signal.response import Response, check_devices, linearise
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, Pair, unmasked
from fringeworks.types.computed import cached_property

MIN_SIZE = 16
"""Smallest length of a frame's longer side, px.

A carrier needs three periods of at least 4 px (``carrier.MIN_PERIODS``, ``carrier.MIN_PERIOD_PX``),
which is 12 px; 16 px leave a margin. An empirical choice.
"""
QUANTISATION_VARIANCE = 1.0 / 12.0
"""Variance that rounding to whole counts adds, counts²: a uniform error over one count has 1/12."""
FLOAT_NOISE = 1e-7
"""Lower bound on the noise's standard deviation in float frames, as a share of the modulation.

About the resolution of single precision (6e-8). It keeps σ above 0 on frames without noise.
"""


@dataclass(frozen=True, eq=False, repr=False)
class PreparedPair(Frozen):
    """Checked reference and object frame, (h, w), turned so that the carrier runs along x.

    All maps have the shape (h, w) of the turned frames. The frames are float32 where that holds all
    captured counts exactly, and float64 otherwise.
    """

    reference: FloatMap
    """Counts as captured, or linearised; for a single frame, the plain fringes that fit its
    background."""
    object: FloatMap
    """Counts as captured, or linearised; with a black frame less its light, and with a white frame
    divided by the albedo."""
    reference_ok: BoolMap
    """False where the reference is not finite or saturated: these pixels are not fitted."""
    object_ok: BoolMap
    """False where the object frame is not finite or saturated: these pixels are not fitted."""
    wanted: BoolMap
    """False where the caller masked the pixel or the object frame is not finite."""
    gap: BoolMap
    """True where the reference frame is not finite."""
    saturated: BoolMap
    """True where the object frame is at the sensor's limit over a square of 3 × 3 px."""
    carrier: Carrier
    """Carrier of the reference. Its ``axis`` is that of the pair as captured, before turning."""
    integer: bool
    """Whether all captured frames hold integers."""
    albedo: FloatMap | None = None
    """Brightness of the object under white over its median, > 0; None without a white frame."""
    converged: bool = True
    """False for a single frame whose background was still changing when its search ended."""
    plane_sigma_px: FloatMap | None = None
    """Standard deviation of the displacement by that of the background's plane, (h, w), px; None
    for two frames."""

    @property
    def period(self) -> float:
        """Mean fringe period of the reference along x, px."""
        return self.carrier.period_px

    @property
    def frequency(self) -> tuple[float, float]:
        """Frequency of the carrier along x and y of the turned frames, cycles/px."""
        return 1.0 / self.carrier.period_px, self.carrier.cross_frequency

    @cached_property
    def modulation(self) -> float:
        """Mean amplitude B of the reference's fringes, counts: √2 × the standard deviation."""
        mean = self.mean_brightness
        square = self._mean_of_reference(lambda counts: np.square(counts - mean))
        return float(np.sqrt(2.0 * square))

    @cached_property
    def mean_brightness(self) -> float:
        """Mean of the reference, counts."""
        return self._mean_of_reference(lambda counts: counts)

    def _mean_of_reference(self, of: Callable[[FloatMap], FloatMap]) -> float:
        """Mean of a function of the reference's usable counts."""
        total = 0.0
        for band in row_bands(self.reference.shape, bytes_per_px=16):
            counts = self.reference[band.rows][self.reference_ok[band.rows]]
            total += float(of(counts.astype(np.float64)).sum())
        return total / max(int(np.count_nonzero(self.reference_ok)), 1)

    @cached_property
    def noise(self) -> tuple[float, float]:
        """Noise variance of reference and object frame, counts²; at least that of rounding."""
        floor = QUANTISATION_VARIANCE if self.integer else (FLOAT_NOISE * self.modulation) ** 2
        return (
            max(noise_variance(self.reference, self.reference_ok), floor),
            max(noise_variance(self.object, self.object_ok), floor),
        )

    @cached_property
    def object_empty(self) -> BoolMap:
        """True where the object frame shows no fringes although its surroundings do, (h, w)."""
        return without_fringes(self.object, self.object_ok, self.period, self.noise[1])

    @cached_property
    def reference_empty(self) -> BoolMap:
        """True where the reference shows no fringes although its surroundings do, (h, w)."""
        return without_fringes(self.reference, self.reference_ok, self.period, self.noise[0])

    def to_capture(self, values: np.ndarray) -> np.ndarray:
        """Turn a map, (h, w), back to the orientation of the pair as captured."""
        return values if self.carrier.axis == "x" else np.ascontiguousarray(values.T)


def fill_nearest(values: FloatMap, known: BoolMap) -> FloatMap:
    """Give every unknown pixel of a map the value of the nearest known pixel."""
    if known.all():
        return values
    nearest = scipy.ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return np.asarray(values[tuple(nearest)])


class _Frame(NamedTuple):
    """One checked frame; all maps are (h, w)."""

    values: FloatMap
    """Counts, of the type of ``_exact_type``; pixels that are not finite have the value of the
    nearest finite one."""
    finite: BoolMap
    saturated: BoolMap
    integer: bool


def _exact_type(kind: np.dtype[Any]) -> type[np.floating[Any]]:
    """The smaller of single and double precision that holds all counts of a type exactly."""
    return np.float32 if np.can_cast(kind, np.float32, "safe") else np.float64


def _checked_frame(name: str, frame: NDArray[Any]) -> _Frame:
    """Check a captured frame, mark its saturated pixels and fill its gaps."""
    array = unmasked(frame, f"{name} frame")
    if array.ndim != 2:
        raise InputError(f"{name} frame: expected shape (h, w), got {array.shape}")
    if array.dtype.kind not in "uif":
        raise InputError(f"{name} frame: expected integer or float counts, got {array.dtype}")
    values: FloatMap = array.astype(_exact_type(array.dtype))
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f"{name} frame: expected finite values, got none")
    values = fill_nearest(values, finite)
    if not values.any():
        raise InputError(f"{name} frame: expected fringes, got an all-black frame")
    return _Frame(values, finite, saturated_squares(array), array.dtype.kind in "ui")


def _pixels_to_measure(mask: BoolMap | None, finite: BoolMap) -> BoolMap:
    """Finite pixels of the object frame that the caller did not mask."""
    if mask is None:
        return finite.copy()
    if mask.shape != finite.shape:
        raise InputError(f"mask: expected shape {finite.shape}, got {mask.shape}")
    wanted: BoolMap = finite & np.asarray(mask, bool)
    if not wanted.any():
        raise InputError("mask: expected at least one pixel to measure, got none")
    return wanted


def _reference_of(
    pair: Pair, object_: _Frame, response: Response | None
) -> tuple[Carrier, _Frame, PlainReference | None]:
    """Carrier, the captured reference or the plain fringes that replace a missing one, and what is
    known of the latter."""
    if pair.reference is None:
        plain = plain_reference(object_.values, object_.finite & ~object_.saturated, pair)
        everywhere = np.ones(plain.reference.shape, bool)
        frame = _Frame(plain.reference, everywhere, ~everywhere, object_.integer)
        return plain.carrier, frame, plain
    reference = _checked_frame("reference", pair.reference)
    if reference.values.shape != object_.values.shape:
        raise InputError(
            f"frames: expected equal shapes, got reference {reference.values.shape} and "
            f"object {object_.values.shape}"
        )
    if response is not None:
        reference = reference._replace(values=linearise(reference.values, response))
    return find_carrier(reference.values, pair.axis), reference, None


def _light_of(pair: Pair, object_: _Frame, response: Response | None) -> ProjectorLight:
    """The object frame as black and white frames let it be seen, linearised.

    A response is that of the projector's light alone, without ambient light and paint.
    """
    if pair.white is None:
        light = projector_light(object_.values, pair.black, None, None)
    else:
        white = _checked_frame("white", pair.white)
        usable = white.finite & ~white.saturated
        light = projector_light(object_.values, pair.black, white.values, usable)
    return light if response is None else light._replace(object=linearise(light.object, response))


def prepare(pair: Pair, *, response: Response | None = None) -> PreparedPair:
    """Check a pair and bring it into the form that the methods work on.

    Parameters
    ----------
    pair : Pair
        Two frames of equal shape (h, w), or the object frame alone; not mutated.
    response : Response, optional
        Both frames are linearised by it after their saturated pixels were marked. The pair must
        name the devices of the response.

    Returns
    -------
    PreparedPair
        Float frames; transposed where the fringes vary along y.

    Raises
    ------
    InputError
        If the frames differ in shape, are not 2-D, or are too small; if a frame is black, constant
        or has no finite value; if the reference has no fringes; if the mask has another shape or
        leaves no pixel; if black is as bright as the object, or white is saturated everywhere; for
        a single frame, if it has no plane background; if the response is of other devices.

    Notes
    -----
    Pixels that are not finite are not measured (``Reason.MASKED``). They are filled
    with the nearest finite value, because the filters need a value everywhere.

    Examples
    --------
    >>> x = np.arange(64.0)
    >>> frame = np.tile(100 + 50 * np.cos(2 * np.pi * x / 16), (48, 1))
    >>> prepared = prepare(Pair(frame.T, frame.T))
    >>> prepared.carrier.axis, prepared.object.shape, round(prepared.period, 3)
    ('y', (48, 64), 16.0)
    """
    if not isinstance(pair, Pair):
        raise InputError(
            f"pair: expected a Pair, got {type(pair).__name__}; read_capture and read_pair read one"
        )
    if response is not None:
        check_devices(response, pair.camera, pair.projector)
    object_ = _checked_frame("object", pair.object)
    wanted = _pixels_to_measure(pair.mask, object_.finite)
    shape = object_.values.shape
    if max(shape) < MIN_SIZE:
        raise InputError(
            f"frames: expected at least {MIN_SIZE} px on the longer side, got shape {shape}"
        )
    light = _light_of(pair, object_, response)
    carrier, reference, plain = _reference_of(pair, object_._replace(values=light.object), response)
    if float(np.ptp(object_.values)) == 0.0:
        constant = object_.values.flat[0]
        raise InputError(f"object frame: expected fringes, got the constant {constant:g}")

    def turn(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values if carrier.axis == "x" else values.T)

    return PreparedPair(
        reference=turn(reference.values),
        object=turn(light.object),
        reference_ok=turn(reference.finite & ~reference.saturated),
        object_ok=turn(object_.finite & ~object_.saturated & light.usable),
        wanted=turn(wanted),
        gap=turn(~reference.finite),
        saturated=turn(object_.saturated),
        carrier=carrier,
        integer=reference.integer and object_.integer and light.albedo is None,
        albedo=None if light.albedo is None else turn(light.albedo),
        converged=plain is None or plain.converged,
        plane_sigma_px=None if plain is None else turn(plain.sigma_px),
    )
