"""Phase unwrapping in space: three algorithms, and the choice between them (theory §5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.signal.bands import by_bands, row_bands
from fringeworks.types import BoolMap, FloatMap, InputError, unmasked

Algorithm = Literal["auto", "reliability", "guided", "least_squares"]
ALGORITHMS = ("auto", "reliability", "guided", "least_squares")
"""Names of the algorithms."""
PhaseField = NDArray[np.float32]
Regions = NDArray[np.uint32]

GUIDES_PX = ((1.0, 3), (1.5, 4), (3.0, 7))
"""Windows of the guide, px: the width σ of the Gaussian over which it averages the phasor, and half
the side of the box in which it measures the local frequency.

Over a window the frequency must be nearly constant. A wide one suppresses more noise, a narrow one
follows steep terrain; which one leaves the fewest jumps is seen afterwards. On 700 simulated
terrains the mean share of wrong orders was 17 % with the widest alone, 4 % with all three.
"""
FEWER_JUMPS = 0.9
"""Largest ratio of jumps, guided to reliability, at which "auto" takes "guided".

Noise that calls for a guide gives ratios of 0.3 to 0.9. On steep terrain without noise, a guide can
also have a few per cent fewer jumps with more wrong orders. An empirical choice.
"""
MAX_ROUGHNESS = 1e30
"""Roughness of a pixel at the border or beside a masked one, where it cannot be measured, rad²."""
TINY_ROUGHNESS = 1e-12
"""Smallest scale of the expected roughness, rad²: without noise, the quality still decides ties."""
MAX_PHASE_RAD = 1e6
"""Largest absolute phase, rad; single precision resolves 0.06 rad there."""
MAX_CG_STEPS = 300
"""Largest number of conjugate gradient steps of the weighted least squares.

It bounds the time where weights of very different size slow the convergence; the fringe order needs
the solution only to within half a period. An empirical choice.
"""
CG_TOLERANCE = 1e-5
"""Norm of the residual, as a share of the right side's, at which conjugate gradients stop.

The fringe order needs the solution only to within half a period. An empirical choice.
"""


class Unwrapped(NamedTuple):
    """An unwrapped phase, its regions, and how it was obtained."""

    phase: PhaseField
    """(h, w), rad; equal to the input modulo 2π, NaN where masked."""
    region: Regions
    """(h, w); 0 where masked, 1 in the largest connected region, 2 in the next, and so on.

    The fringe orders of different regions are unrelated.
    """
    algorithm: str
    """The algorithm that was used: "reliability", "guided" or "least_squares"."""
    residues: int
    """Number of loops of 2 × 2 pixels whose wrapped differences do not add up to 0. With none, the
    result does not depend on the path."""
    converged: bool = True
    """False where "least_squares" ended at its largest number of steps: its orders may be wrong.
    The other algorithms do not iterate."""


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
        Wrapped phase, rad; not mutated. Pixels that are not finite are masked.
    mask : (h, w) bool array, optional
        True where the phase is valid. A masked array of NumPy has one of its own as well.
    quality : (h, w) float array, ≥ 0, optional
        Reliability of each pixel, for instance its modulation; pixels with 0 or NaN are masked.
        Taken as proportional to 1/σ of the phase: "reliability" adds the noise that follows from it
        to the roughness that it sees, the other algorithms use it as a weight.
    algorithm : str
        "reliability": joins pixels along the most reliable edges first; exact where there are no
        residues.
        "guided": averages the phasor along the local frequency, unwraps the average, and gives its
        fringe order to the input; for noise. Of three windows, the one with the fewest jumps.
        "least_squares": fits the phase to the wrapped differences by cosine transforms, and gives
        its fringe order to the input.
        "auto": "reliability" where there are no residues; else both run, and "guided" is kept where
        it has clearly fewer jumps.

    Returns
    -------
    Unwrapped
        Named tuple (phase, region, algorithm, residues, converged).

    Raises
    ------
    InputError
        If the phase is not 2-D, not real or beyond 10⁶ rad, if shapes differ, if no pixel is valid,
        or if the algorithm is unknown.

    Notes
    -----
    Theory §5, "Unwrapping". Reliability: Herráez, Burton, Lalor, Gdeisat, Applied Optics
    41(35):7437, 2002, doi:10.1364/AO.41.007437. Least squares: Ghiglia & Romero, JOSA A 11(1):107,
    1994, doi:10.1364/JOSAA.11.000107. Residues: Goldstein, Zebker, Werner, Radio Science 23(4):713,
    1988, doi:10.1029/RS023i004p00713. "guided" still makes errors where the noise of a pixel
    exceeds π.

    A jump is a pair of neighbours that differ by more than π after unwrapping, weighted by the
    square of the lower quality. True surfaces have few of them, wrong orders cause them. Their sum
    is the cost of minimum-jump unwrapping: Flynn, JOSA A 14(10):2692, 1997,
    doi:10.1364/JOSAA.14.002692.

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
    residues = _core.count_residues(phase, valid.view(np.uint8))
    if algorithm == "auto" and residues == 0:
        algorithm = "reliability"
    if algorithm == "reliability":  # one candidate: nothing to compare
        return Unwrapped(*_by_reliability(phase, valid, weight), algorithm, residues)
    weights = valid.astype(np.float32) if weight is None else weight
    if algorithm == "least_squares":
        fitted, region, converged = _least_squares(phase, valid, weights)
        return Unwrapped(fitted, region, algorithm, residues, converged)
    best = None
    for name, phase_found, region in _candidates(algorithm, phase, valid, weight):
        cost = _cost(name, phase_found, weights)
        if best is None or cost < best[0]:
            best = cost, Unwrapped(phase_found, region, name, residues)
    assert best is not None
    return best[1]


def _candidates(
    algorithm: str, phase: PhaseField, valid: BoolMap, weight: PhaseField | None
) -> Iterator[tuple[str, PhaseField, Regions]]:
    """Name, unwrapped phase and regions of the ways that may be the best, one after the other."""
    if algorithm == "auto":
        yield ("reliability", *_by_reliability(phase, valid, weight))
    weights = valid.astype(np.float32) if weight is None else weight
    for window in GUIDES_PX:
        yield ("guided", *_guided(phase, valid, weights, window))


def _cost(name: str, unwrapped: PhaseField, weight: PhaseField) -> float:
    """Weighted number of jumps; "reliability" is preferred, for it assumes less than a guide."""
    return _jumps(unwrapped, weight) * (FEWER_JUMPS if name == "reliability" else 1.0)


def _checked(
    phase_rad: FloatMap, mask: BoolMap | None, quality: FloatMap | None
) -> tuple[PhaseField, BoolMap, PhaseField | None]:
    """Phase with zeros where masked, valid pixels, and the quality scaled to a maximum of 1."""
    hidden = np.ma.getmaskarray(phase_rad) if np.ma.is_masked(phase_rad) else None
    values = np.ascontiguousarray(phase_rad)
    if values.ndim != 2:
        raise InputError(f"phase: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "fiu":
        raise InputError(f"phase: expected real numbers, got {values.dtype}")
    valid = np.isfinite(values)
    if hidden is not None:
        valid &= ~hidden
    if mask is not None:
        mask = unmasked(mask, "mask")
        if mask.shape != values.shape or mask.dtype.kind not in "bui":
            raise InputError(
                f"mask: expected shape {values.shape} of bool, got {mask.shape} of {mask.dtype}"
            )
        valid &= np.asarray(mask, bool)
    weight = None
    if quality is not None:
        quality = unmasked(quality, "quality")
        if quality.shape != values.shape:
            raise InputError(f"quality: expected shape {values.shape}, got {quality.shape}")
        if quality.dtype.kind not in "fiu":
            raise InputError(f"quality: expected real numbers, got {quality.dtype}")
        with np.errstate(invalid="ignore"):
            valid &= np.isfinite(quality) & (quality > 0)
    if not valid.any():
        raise InputError("phase: expected at least one valid pixel, got none")
    largest = max(
        float(values.max(initial=0, where=valid)), -float(values.min(initial=0, where=valid))
    )
    if largest > MAX_PHASE_RAD:
        raise InputError(f"phase: expected at most {MAX_PHASE_RAD:g} rad, got {largest:.3g}")
    if quality is not None:
        weight = np.where(valid, quality, 0.0)
        weight = np.ascontiguousarray(weight / weight.max(), dtype=np.float32)
    filled = values if valid.all() else np.where(valid, values, 0.0)
    return np.ascontiguousarray(filled, dtype=np.float32), valid, weight


def _congruent(smooth: PhaseField, phase: PhaseField) -> PhaseField:
    """Phase plus the whole periods that bring it closest to a smooth one, which is overwritten."""
    period = np.float32(2.0 * np.pi)
    whole = np.subtract(smooth, phase, out=smooth)
    whole /= period
    np.round(whole, out=whole)
    whole *= period
    whole += phase
    return whole


def _jumps(unwrapped: PhaseField, weight: PhaseField) -> float:
    """Weighted number of neighbours that differ by more than π."""
    total = 0.0
    for band in row_bands(unwrapped.shape, bytes_per_px=24, halo=1):
        below = slice(band.rows.start, band.seen.stop)
        for axis, rows in ((0, below), (1, band.rows)):
            phase, quality = (
                np.moveaxis(unwrapped[rows], axis, 0),
                np.moveaxis(weight[rows], axis, 0),
            )
            # NaN compares false: links to masked pixels do not count.
            jump = np.abs(np.diff(phase, axis=0)) > np.pi
            total += float(np.sum(np.minimum(quality[1:], quality[:-1])[jump] ** 2))
    return total


def _by_reliability(
    phase: PhaseField, valid: BoolMap, weight: PhaseField | None
) -> tuple[PhaseField, Regions]:
    """Unwrapped phase by sorting by reliability, and its regions."""
    rough = None if weight is None else _roughness(phase, valid, weight)
    return _core.unwrap_reliability(phase, valid.view(np.uint8), rough)


def _roughness(phase: PhaseField, valid: BoolMap, weight: PhaseField) -> PhaseField:
    """Second differences of the phase plus those expected from its noise, rad².

    The differences of one pixel are a single sample of its noise; the quality says how much is
    expected there, k/q². The scale k is the median of q² times the differences.
    """
    whole = scipy.ndimage.binary_erosion(valid, np.ones((3, 3)))
    second = np.zeros(phase.shape, np.float32)
    padded = np.pad(phase, 1)
    rows, columns = phase.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        before, after = (
            padded[1 + s * dy : 1 + s * dy + rows, 1 + s * dx : 1 + s * dx + columns]
            for s in (-1, 1)
        )
        second += (_wrap(before - phase) - _wrap(phase - after)) ** 2
    square = np.where(valid, weight, 1.0) ** 2
    scale = float(np.median((second * square)[whole])) if whole.any() else 1.0
    with np.errstate(all="ignore"):  # a quality may be many powers of ten below the largest one
        rough = np.where(whole, second, MAX_ROUGHNESS) + max(scale, TINY_ROUGHNESS) / square
    return np.ascontiguousarray(np.minimum(rough, MAX_ROUGHNESS), dtype=np.float32)


def _guided(
    phase: PhaseField, valid: BoolMap, weight: PhaseField, window: tuple[float, int]
) -> tuple[PhaseField, Regions]:
    """Phase with the orders of the locally averaged phasor, and its regions."""
    sigma, reach = window
    average = _core.average_phasor(phase, weight, sigma=sigma, reach=reach)
    angle = by_bands(np.angle, average, dtype=np.float32)
    del average
    smooth, region = _core.unwrap_reliability(angle, valid.view(np.uint8), None)
    return _congruent(smooth, phase), region


def _wrap(values: FloatMap) -> FloatMap:
    """Values modulo 2π, −π…π."""
    return values - 2.0 * np.pi * np.round(values / (2.0 * np.pi))


def _divergence(along_x: FloatMap, along_y: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """Divergence at each pixel of a field given on the links to its right and lower neighbours."""
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
        spectrum = scipy.fft.dctn(source, norm="ortho", workers=-1) / eigenvalue
        spectrum[0, 0] = 0.0
        return np.asarray(scipy.fft.idctn(spectrum, norm="ortho", workers=-1))

    return solve


def _least_squares(
    phase: PhaseField, valid: BoolMap, weight: PhaseField
) -> tuple[PhaseField, Regions, bool]:
    """Phase with the orders of the field whose differences fit best, its regions, and whether the
    solution converged."""
    raw = phase.astype(np.float64)
    link_x = np.minimum(weight[:, 1:], weight[:, :-1]).astype(np.float64) ** 2
    link_y = np.minimum(weight[1:], weight[:-1]).astype(np.float64) ** 2
    source = _divergence(
        link_x * _wrap(np.diff(raw, axis=1)), link_y * _wrap(np.diff(raw, axis=0)), raw.shape
    )
    if bool((weight == weight.flat[0]).all()):
        fitted, converged = _poisson(raw.shape)(source / float(weight.flat[0]) ** 2), True
    else:
        fitted, converged = _conjugate_gradients(source, link_x, link_y)
    region = _regions(valid)
    # The constant of each region is free: take the mean difference from the wrapped phase.
    offset = np.zeros(int(region.max()) + 1)
    labels = np.arange(1, offset.size)
    phasor = np.exp(1j * (raw - fitted))
    real, imaginary = (
        scipy.ndimage.sum_labels(p, region, labels) for p in (phasor.real, phasor.imag)
    )
    offset[1:] = np.arctan2(imaginary, real)
    smooth = np.where(valid, fitted + offset[region], np.nan)
    return _congruent(smooth.astype(np.float32), phase), region, converged


def _conjugate_gradients(
    source: FloatMap, link_x: FloatMap, link_y: FloatMap
) -> tuple[FloatMap, bool]:
    """Solve the weighted Poisson equation, preconditioned by the unweighted solver; return the
    solution, and whether its residual fell below the tolerance.

    ``link_x`` and ``link_y`` are the weights of the links between neighbouring pixels.
    """
    poisson = _poisson(source.shape)
    solution = np.zeros(source.shape)
    residual, direction, previous_rho = source, source, 0.0
    target = CG_TOLERANCE * float(np.linalg.norm(source))
    for _ in range(MAX_CG_STEPS):
        if float(np.linalg.norm(residual)) <= target:
            return solution, True
        step = poisson(residual)
        rho = float(np.vdot(residual, step))
        direction = step if previous_rho == 0.0 else step + (rho / previous_rho) * direction
        previous_rho = rho
        product = _divergence(
            link_x * np.diff(direction, axis=1), link_y * np.diff(direction, axis=0), source.shape
        )
        alpha = rho / float(np.vdot(direction, product))
        solution = solution + alpha * direction
        residual = residual - alpha * product
    return solution, float(np.linalg.norm(residual)) <= target


def _regions(valid: BoolMap) -> Regions:
    """Connected regions, numbered by decreasing size; 0 where invalid."""
    label, count = scipy.ndimage.label(valid)
    size = np.bincount(label.ravel(), minlength=count + 1)
    rank = np.zeros(count + 1, np.uint32)
    rank[1 + np.argsort(-size[1:], kind="stable")] = np.arange(1, count + 1)
    return np.asarray(rank[label])
