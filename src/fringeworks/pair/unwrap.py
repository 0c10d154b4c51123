"""Phase unwrapping in space: three algorithms, one contract, and a choice by the data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from fringeworks import _core
from fringeworks.types import BoolMap, FloatMap, InputError

Algorithm = Literal["auto", "reliability", "guided", "least_squares"]
ALGORITHMS = ("auto", "reliability", "guided", "least_squares")
PhaseField = NDArray[np.float32]

NOISY = 1e-4
"""Share of residues above which the map is taken for noisy, and guided."""
GUIDE_SIGMA_PX = 3.0
"""Width of the window over which the guide's phasor is averaged."""
GUIDE_REACH_PX = 7
"""Half the side of the box that measures the local frequency."""
LARGEST_RAD = 1e6
"""Beyond, single precision no longer holds a phase."""
MAX_STEPS = 300
"""Conjugate gradient steps of the weighted least squares."""
TOLERANCE = 1e-5
"""Share of the residual at which they end."""


class Unwrapped(NamedTuple):
    """An unwrapped phase, and how it was come by."""

    phase: PhaseField
    """(h, w), rad; congruent with the input modulo 2π, NaN where masked."""
    region: NDArray[np.uint32]
    """0 where masked; 1 for the largest connected region, 2 for the next …; orders of different
    regions are unrelated."""
    algorithm: str
    """The one that was used."""
    residues: int
    """Loops of four pixels that do not close: none where every path gives the same."""


def unwrap(
    phase_rad: FloatMap,
    mask: BoolMap | None = None,
    *,
    quality: FloatMap | None = None,
    algorithm: Algorithm = "auto",
) -> Unwrapped:
    """Unwrap a phase map.

    Parameters
    ----------
    phase_rad : (h, w) float array
        Wrapped phase, rad; not mutated. Pixels that are not finite count as masked.
    mask : (h, w) bool array, optional
        True where the phase is valid.
    quality : (h, w) float array, ≥ 0, optional
        How far each pixel is to be trusted, for instance its modulation; 0 or NaN counts as
        masked. Sorts the pixels ("reliability"), or weights them.
    algorithm : str
        "reliability": sorting by reliability, exact where no residue makes the path matter.
        "guided": the phasor is averaged along the local frequency, the average unwrapped, and
        its fringe order handed to the raw phase; for noise.
        "least_squares": the phase whose differences fit best, by cosine transforms; its order
        handed to the raw phase.
        "auto": "guided" where more than one loop in 10 000 is a residue, else "reliability".

    Returns
    -------
    Unwrapped, a named tuple (phase, region, algorithm, residues).

    Raises
    ------
    InputError where the phase is not 2-D, values lie beyond 10⁶ rad, shapes differ, no pixel is
    valid, or the algorithm is unknown.

    Notes
    -----
    Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35):7437, 2002 (reliability); Ghiglia &
    Romero, JOSA A 11(1):107, 1994 (least squares). Residues: Goldstein, Zebker, Werner, Radio
    Science 23(4):713, 1988. Guided: theory §6; what is left wrong is what noise beyond π shifts.

    Examples
    --------
    >>> ramp = np.tile(np.linspace(0, 20, 50), (40, 1))
    >>> result = unwrap(np.angle(np.exp(1j * ramp)))
    >>> bool(np.allclose(np.diff(result.phase, axis=1), 20 / 49, atol=1e-5))
    True
    >>> result.algorithm, result.residues, int(result.region.max())
    ('reliability', 0, 1)
    """
    if algorithm not in ALGORITHMS:
        raise InputError(f"algorithm: expected one of {', '.join(ALGORITHMS)}, got {algorithm!r}")
    phase, valid, weight = _checked(phase_rad, mask, quality)
    usable = valid.astype(np.uint8)
    residues = _core.count_residues(phase, usable)
    if algorithm == "auto":
        algorithm = "guided" if residues > NOISY * valid.sum() else "reliability"
    if algorithm == "reliability":
        rough = None if weight is None else weight.max() - weight
        unwrapped, region = _core.unwrap_reliability(phase, usable, rough)
        return Unwrapped(unwrapped, region, algorithm, residues)
    weights = valid.astype(np.float32) if weight is None else weight
    solve = _guided if algorithm == "guided" else _least_squares
    smooth, region = solve(phase, valid, weights)
    return Unwrapped(_congruent(smooth, phase), region, algorithm, residues)


def _checked(
    phase_rad: FloatMap, mask: BoolMap | None, quality: FloatMap | None
) -> tuple[PhaseField, BoolMap, PhaseField | None]:
    """Phase with zeros in its gaps, valid pixels, and the quality scaled to 1 where given."""
    values = np.asarray(phase_rad)
    if values.ndim != 2:
        raise InputError(f"phase: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "fiu":
        raise InputError(f"phase: expected real numbers, got {values.dtype}")
    valid = np.isfinite(values)
    if mask is not None:
        if mask.shape != values.shape:
            raise InputError(f"mask: expected shape {values.shape}, got {mask.shape}")
        valid &= np.asarray(mask, bool)
    weight = None
    if quality is not None:
        if quality.shape != values.shape:
            raise InputError(f"quality: expected shape {values.shape}, got {quality.shape}")
        with np.errstate(invalid="ignore"):
            valid &= np.isfinite(quality) & (quality > 0)
    if not valid.any():
        raise InputError("phase: expected at least one valid pixel, got none")
    largest = float(np.abs(values[valid]).max())
    if largest > LARGEST_RAD:
        raise InputError(f"phase: expected at most {LARGEST_RAD:g} rad, got {largest:.3g}")
    if quality is not None:
        weight = np.where(valid, quality, 0.0)
        weight = np.ascontiguousarray(weight / weight.max(), dtype=np.float32)
    filled = np.where(valid, values, 0.0)
    return np.ascontiguousarray(filled, dtype=np.float32), valid, weight


def _congruent(smooth: PhaseField, phase: PhaseField) -> PhaseField:
    """The raw phase with the fringe order of a smooth one."""
    turn = np.float32(2.0 * np.pi)
    return np.asarray(phase + turn * np.round((smooth - phase) / turn), dtype=np.float32)


Solved = tuple[PhaseField, NDArray[np.uint32]]


def _guided(phase: PhaseField, valid: BoolMap, weight: PhaseField) -> Solved:
    """Unwrapped phase of the locally averaged phasor, and its regions."""
    mean = _core.average_phasor(phase, weight, sigma=GUIDE_SIGMA_PX, reach=GUIDE_REACH_PX)
    return _core.unwrap_reliability(np.angle(mean), valid.astype(np.uint8), None)


def _wrap(values: FloatMap) -> FloatMap:
    return values - 2.0 * np.pi * np.round(values / (2.0 * np.pi))


def _divergence(along_x: FloatMap, along_y: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """Sum of what flows into each pixel, from differences between neighbours."""
    total = np.zeros(shape)
    total[:, :-1] += along_x
    total[:, 1:] -= along_x
    total[:-1] += along_y
    total[1:] -= along_y
    return total


def _poisson(shape: tuple[int, int]) -> Callable[[FloatMap], FloatMap]:
    """Solver of Poisson's equation with reflecting borders, by cosine transforms."""
    wave_y, wave_x = (2.0 * np.cos(np.pi * np.arange(n) / n) - 2.0 for n in shape)
    eigenvalue = wave_y[:, None] + wave_x[None, :]
    eigenvalue[0, 0] = 1.0

    def solve(source: FloatMap) -> FloatMap:
        spectrum = fft.dctn(source, norm="ortho", workers=-1) / eigenvalue
        spectrum[0, 0] = 0.0
        return np.asarray(fft.idctn(spectrum, norm="ortho", workers=-1))

    return solve


def _least_squares(phase: PhaseField, valid: BoolMap, weight: PhaseField) -> Solved:
    """Weighted least squares by conjugate gradients, preconditioned by the unweighted solver."""
    raw = phase.astype(np.float64)
    link_x = np.minimum(weight[:, 1:], weight[:, :-1]).astype(np.float64) ** 2
    link_y = np.minimum(weight[1:], weight[:-1]).astype(np.float64) ** 2
    source = _divergence(
        link_x * _wrap(np.diff(raw, axis=1)), link_y * _wrap(np.diff(raw, axis=0)), raw.shape
    )
    poisson = _poisson(raw.shape)
    uniform = bool((weight == weight.flat[0]).all())
    found = poisson(source / float(weight.flat[0]) ** 2) if uniform else np.zeros(raw.shape)
    if not uniform:
        residual, direction, before = source, source, 0.0
        target = TOLERANCE * float(np.linalg.norm(source))
        for _ in range(MAX_STEPS):
            if float(np.linalg.norm(residual)) <= target:
                break
            step = poisson(residual)
            rho = float(np.vdot(residual, step))
            direction = step if before == 0.0 else step + (rho / before) * direction
            before = rho
            pushed = _divergence(
                link_x * np.diff(direction, axis=1),
                link_y * np.diff(direction, axis=0),
                raw.shape,
            )
            alpha = rho / float(np.vdot(direction, pushed))
            found = found + alpha * direction
            residual = residual - alpha * pushed
    region = _regions(valid)
    # Each region's constant is free: take the one that lies best on the raw phase.
    offset = np.zeros(int(region.max()) + 1)
    labels = np.arange(1, offset.size)
    phasor = np.exp(1j * (raw - found))
    real, imaginary = (ndimage.sum_labels(p, region, labels) for p in (phasor.real, phasor.imag))
    offset[1:] = np.arctan2(imaginary, real)
    smooth = np.where(valid, found + offset[region], np.nan)
    return smooth.astype(np.float32), region


def _regions(valid: BoolMap) -> NDArray[np.uint32]:
    """Connected regions, numbered by falling size."""
    label, count = ndimage.label(valid)
    size = np.bincount(label.ravel(), minlength=count + 1)
    rank = np.zeros(count + 1, np.uint32)
    rank[1 + np.argsort(-size[1:], kind="stable")] = np.arange(1, count + 1)
    return np.asarray(rank[label])
