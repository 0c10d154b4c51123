"""Fringes on the reference plane and on a height map, ideal or as a camera would deliver them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.reference_plane import displacement_from_height
from fringeworks.types import (
    Axis,
    FloatMap,
    Frozen,
    InputError,
    Pair,
    ReferencePlaneGeometry,
    check_fields,
)

BIT_DEPTHS = (0, 8, 10, 12, 16)
"""Depths of simulated frames, bit; 0 for floating point. Industrial cameras deliver the others."""
FULL_RANGE = 255.0
"""Brightness of full light, counts of 8 bit, in which noise and amplitudes are given."""


class PairOptions(TypedDict, total=False):
    """Fields of ``PairSettings`` as keyword options; each is explained there."""

    fringes: float
    gamma: float
    noise: float
    gain: float
    bits: int
    ambient: float
    contrast: float
    axis: Axis
    seed: int


@dataclass(frozen=True)
class PairSettings:
    """How the fringes of a pair are projected and seen.

    Raises
    ------
    InputError for a value out of its range.
    """

    fringes: float = 10.0
    """f₀, number of periods across the frame; > 0."""
    gamma: float = 1.0
    """Exponent of the projector's response, I_out ∝ I_in^γ; > 0."""
    noise: float = 0.0
    """Standard deviation of the Gaussian read noise, counts of 8 bit; ≥ 0."""
    gain: float = 0.0
    """Shot noise: variance per count, counts of 8 bit, σ² = gain · I; ≥ 0."""
    bits: int = 0
    """Quantisation: 8, 10, 12 or 16 bit, or 0 for floating point."""
    ambient: float = 0.0
    """Constant light in both frames, as a share of the full range, 0…1."""
    contrast: float = 1.0
    """Share of the remaining range that the fringes fill, 0…1."""
    axis: Axis = "x"
    """Direction in which the fringes vary."""
    seed: int = 0
    """Seed of the noise; equal seeds give equal frames."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            fringes=(self.fringes > 0, "> 0"),
            gamma=(self.gamma > 0, "> 0"),
            noise=(self.noise >= 0, ">= 0"),
            gain=(self.gain >= 0, ">= 0"),
            bits=(self.bits in BIT_DEPTHS, f"one of {BIT_DEPTHS}"),
            ambient=(0 <= self.ambient < 1, "0 to 1"),
            contrast=(0 < self.contrast <= 1, "0 to 1"),
            axis=(self.axis in ("x", "y"), "x or y"),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Row(Frozen):
    """One row of a pair: the dissertation's one-dimensional experiment (theory §3)."""

    reference: FloatMap
    """Fringes on the reference plane, (n,), counts."""
    object: FloatMap
    """Fringes on the object, (n,), counts."""
    height_mm: FloatMap
    """(n,), mm."""
    displacement_px: FloatMap
    """u, (n,), px."""


def _waveform(cycles: FloatMap, settings: PairSettings) -> FloatMap:
    """Brightness, 0…1, at a position counted in periods."""
    wave = (0.5 + 0.5 * np.cos(2.0 * np.pi * cycles)) ** settings.gamma
    light: FloatMap = settings.ambient + (1.0 - settings.ambient) * settings.contrast * wave
    return light


def _camera(light: FloatMap, settings: PairSettings, rng: np.random.Generator) -> NDArray[Any]:
    """Counts of a frame: noise, then clipping at the sensor's limits and rounding."""
    counts = FULL_RANGE * light
    variance = settings.noise**2 + settings.gain * np.maximum(counts, 0.0)
    if settings.noise or settings.gain:
        counts = counts + np.sqrt(variance) * rng.standard_normal(counts.shape)
    if not settings.bits:
        return counts
    largest = 2**settings.bits - 1
    # Clipping simulates the sensor, whose counts end at both limits.
    clipped = np.clip(np.rint(counts * (largest / FULL_RANGE)), 0, largest)
    quantised: NDArray[Any] = clipped.astype(np.uint8 if settings.bits == 8 else np.uint16)
    return quantised


def capture_pair(
    height_mm: FloatMap,
    geometry: ReferencePlaneGeometry,
    settings: PairSettings | None = None,
    *,
    albedo: FloatMap | float = 1.0,
) -> Pair:
    """Simulate the reference frame and the object frame of a height map.

    Parameters
    ----------
    height_mm : (h, w) float array
        Heights over the reference plane, below the pupils, mm.
    geometry : ReferencePlaneGeometry
    settings : PairSettings, optional
    albedo : (h, w) array or float, 0…1
        Reflectance of the object's surface; the reference plane has 1.

    Returns
    -------
    Pair with the true height. Frames are float64 (bits = 0), uint8 or uint16, counts.

    Raises
    ------
    InputError where a height reaches the pupils, and for an albedo of another shape or outside
    0…1.

    Notes
    -----
    s(x) = (½ + ½ cos 2πf₀x/N)^γ scaled to 0…255, d(x) = albedo · s(x − u) with u of theory (3).

    Examples
    --------
    >>> geometry = ReferencePlaneGeometry(distance_mm=800.0, baseline_mm=300.0)
    >>> pair = capture_pair(np.full((4, 64), 10.0), geometry, PairSettings(fringes=4, bits=8))
    >>> pair.object.dtype, pair.reference.shape
    (dtype('uint8'), (4, 64))
    """
    settings = settings or PairSettings()
    height = np.asarray(height_mm, np.float64)
    if height.ndim != 2:
        raise InputError(f"height: expected shape (h, w), got {height.shape}")
    reflectance = np.asarray(albedo, np.float64)
    if reflectance.ndim and reflectance.shape != height.shape:
        raise InputError(f"albedo: expected shape {height.shape}, got {reflectance.shape}")
    if np.any(reflectance < 0) or np.any(reflectance > 1):
        raise InputError(
            f"albedo: expected values 0 to 1, got {np.min(reflectance):g} to "
            f"{np.max(reflectance):g}"
        )
    u = displacement_from_height(height, geometry)
    rows, columns = height.shape
    if settings.axis == "x":
        position, length = np.arange(columns, dtype=np.float64)[None, :], columns
    else:
        position, length = np.arange(rows, dtype=np.float64)[:, None], rows
    per_px = settings.fringes / length
    reference = np.broadcast_to(_waveform(position * per_px, settings), height.shape)
    deformed = reflectance * _waveform((position - u) * per_px, settings)
    rng = np.random.default_rng(settings.seed)
    return Pair(
        reference=_camera(reference.copy(), settings, rng),
        object=_camera(deformed, settings, rng),
        axis=settings.axis,
        geometry=geometry,
        truth_mm=height,
    )


def deformed_row(
    height_mm: FloatMap, geometry: ReferencePlaneGeometry, *, fringes: float = 10.0
) -> Row:
    """Compute the ideal fringes of one row: s = 127.5 + 127.5 cos(2π f₀ t / N) (theory §3).

    Parameters
    ----------
    height_mm : (n,) array
        Heights over the reference plane, below the pupils, mm.
    geometry : ReferencePlaneGeometry
    fringes : float > 0
        f₀, number of periods in the row.

    Returns
    -------
    Row
    """
    u = displacement_from_height(height_mm, geometry)
    t = np.arange(u.size, dtype=np.float64)
    settings = PairSettings(fringes=fringes)
    per_px = fringes / u.size
    return Row(
        reference=FULL_RANGE * _waveform(t * per_px, settings),
        object=FULL_RANGE * _waveform((t - u) * per_px, settings),
        height_mm=np.asarray(height_mm, np.float64),
        displacement_px=u,
    )
