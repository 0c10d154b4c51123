"""Fringes on the reference plane and on a height map, ideal or as a camera would deliver them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.reference_plane import displacement_from_height
from fringeworks.simulate.jpeg import jpeg_compressed
from fringeworks.types import (
    MOST_SEED,
    Axis,
    FloatMap,
    Frozen,
    InputError,
    Pair,
    ReferencePlaneGeometry,
    check_fields,
    finite,
    positive,
    whole,
)

BIT_DEPTHS = (0, 8, 10, 12, 16)
"""Depths of simulated frames, bit; 0 for floating point. Industrial cameras deliver the others."""
FLICKER_BANDS = 3.0
"""Number of bands that a flickering lamp leaves in a frame: 100 Hz at 1/30 s of read-out."""
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
    grid_px: float
    grid_depth: float
    flicker: float
    jpeg: int


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
    grid_px: float = 4.0
    """Pitch of the projector's pixels in the camera's frame, px; ≥ 2."""
    grid_depth: float = 0.0
    """How dark the gaps between the projector's pixels are, 0…1; 0 for no visible grid."""
    flicker: float = 0.0
    """Amplitude of the lamp's flicker, which a rolling shutter turns into bands, share of light."""
    jpeg: int = 0
    """Quality of JPEG compression, 1…100, of frames of 8 bit; 0 for none."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            fringes=(positive(self.fringes), "> 0"),
            gamma=(positive(self.gamma), "> 0"),
            noise=(finite(self.noise) and self.noise >= 0, ">= 0"),
            gain=(finite(self.gain) and self.gain >= 0, ">= 0"),
            seed=(whole(self.seed, 0, MOST_SEED), "a whole number from 0 on"),
            bits=(self.bits in BIT_DEPTHS, f"one of {BIT_DEPTHS}"),
            ambient=(0 <= self.ambient < 1, "0 to 1"),
            contrast=(0 < self.contrast <= 1, "0 to 1"),
            grid_px=(self.grid_px >= 2, ">= 2"),
            grid_depth=(0 <= self.grid_depth < 1, "0 to 1"),
            flicker=(0 <= self.flicker < 1, "0 to 1"),
            jpeg=(0 <= self.jpeg <= 100, "0 to 100"),
            axis=(self.axis in ("x", "y"), "x or y"),
        )
        if self.jpeg and self.bits != 8:
            raise InputError(f"jpeg: expected frames of 8 bit, got bits = {self.bits}")


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


def _grid(position: FloatMap, across: FloatMap, settings: PairSettings) -> FloatMap:
    """Brightness of the projector's pixel grid, 0…1, at projected positions, px.

    The gaps between the projector's pixels move with the fringes; ``across`` is the position along
    the fringes, which does not move.
    """
    along, beside = (
        0.5 - 0.5 * np.cos(2.0 * np.pi * at / settings.grid_px) for at in (position, across)
    )
    grid: FloatMap = 1.0 - settings.grid_depth * (1.0 - along * beside)
    return grid


def _bands(rows: int, settings: PairSettings, rng: np.random.Generator) -> FloatMap:
    """Brightness of every row under a flickering lamp, (rows, 1); its phase differs by frame."""
    phase = 2.0 * np.pi * (FLICKER_BANDS * np.arange(rows) / rows + rng.random())
    return np.asarray(1.0 + settings.flicker * np.sin(phase))[:, None]


def _camera(light: FloatMap, settings: PairSettings, rng: np.random.Generator) -> NDArray[Any]:
    """Counts of a frame: flicker, noise, clipping at the sensor's limits, rounding, compression."""
    counts = FULL_RANGE * light
    if settings.flicker:
        counts = counts * _bands(counts.shape[0], settings, rng)
    variance = settings.noise**2 + settings.gain * np.maximum(counts, 0.0)
    if settings.noise or settings.gain:
        counts = counts + np.sqrt(variance) * rng.standard_normal(counts.shape)
    if not settings.bits:
        return counts
    largest = 2**settings.bits - 1
    # Clipping simulates the sensor, whose counts end at both limits.
    clipped = np.clip(np.rint(counts * (largest / FULL_RANGE)), 0, largest)
    quantised: NDArray[Any] = clipped.astype(np.uint8 if settings.bits == 8 else np.uint16)
    return jpeg_compressed(quantised, settings.jpeg) if settings.jpeg else quantised


def capture_pair(
    height_mm: FloatMap,
    geometry: ReferencePlaneGeometry,
    settings: PairSettings | None = None,
    *,
    albedo: FloatMap | float = 1.0,
    reference_albedo: FloatMap | float = 1.0,
) -> Pair:
    """Simulate the reference frame and the object frame of a height map.

    Parameters
    ----------
    height_mm : (h, w) float array
        Heights over the reference plane, below the pupils, mm.
    geometry : ReferencePlaneGeometry
    settings : PairSettings, optional
    albedo : (h, w) array or float, 0…1
        Reflectance of the object's surface; 0 in a hole.
    reference_albedo : (h, w) array or float, 0…1
        Reflectance of the reference plane.

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
    reflectance = _reflectance(albedo, height)
    background = _reflectance(reference_albedo, height)
    u = displacement_from_height(height, geometry)
    rows, columns = height.shape
    y, x = np.mgrid[:rows, :columns].astype(np.float64)
    position, across, length = (x, y, columns) if settings.axis == "x" else (y, x, rows)
    per_px = settings.fringes / length

    def light(at: FloatMap) -> FloatMap:
        wave = _waveform(at * per_px, settings)
        return wave * _grid(at, across, settings) if settings.grid_depth else wave

    rng = np.random.default_rng(settings.seed)
    return Pair(
        reference=_camera(background * light(position), settings, rng),
        object=_camera(reflectance * light(position - u), settings, rng),
        axis=settings.axis,
        geometry=geometry,
        truth_mm=height,
    )


def _reflectance(albedo: FloatMap | float, height: FloatMap) -> FloatMap:
    """Albedo as an array; ``InputError`` for another shape or values outside 0…1."""
    reflectance = np.asarray(albedo, np.float64)
    if reflectance.ndim and reflectance.shape != height.shape:
        raise InputError(f"albedo: expected shape {height.shape}, got {reflectance.shape}")
    if np.any(reflectance < 0) or np.any(reflectance > 1):
        raise InputError(
            f"albedo: expected values 0 to 1, got {np.min(reflectance):g} to "
            f"{np.max(reflectance):g}"
        )
    return reflectance


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
