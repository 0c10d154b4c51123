"""Empirical mode decomposition (EMD) of rows and of frames, and denoising with it (theory §7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.signal.bands import row_bands
from fringeworks.signal.noise import noise_variance
from fringeworks.types import (
    LARGEST,
    FloatMap,
    Frozen,
    InputError,
    Plotted,
    positive,
    sealed,
    unmasked,
    whole,
)

GROWTH = 1.5
"""Smallest ratio of the windows of successive modes of a frame.

Without it, successive modes could use the same window and hold the same waves. An empirical choice.
"""

MIN_EXTREMA = 8
"""Smallest number of maxima and of minima in a frame that has another mode.

With fewer, their mean distance does not determine a window. An empirical choice.
"""
Denoiser = Literal["emd", "emd2d", "bemd"]
DENOISERS = ("emd", "emd2d", "bemd")
"""Names of the denoising methods: by rows, by rows and columns, by modes of the whole frame."""

MAX_IMFS = 16
"""Default of the largest number of intrinsic mode functions (IMFs) of a row.

The mean period of white noise doubles from one IMF to the next (``DECAY``), so that 16 are enough
for rows of 65 000 pixels.
"""

IMF_LIMIT = 64
"""Largest ``max_imfs`` that is accepted, also by the kernel; far beyond any decomposition."""

MAX_SIFTS = 100
"""Default of the largest number of sifts per IMF.

It bounds the time. Rows of white noise and of noisy fringes meet both criteria within 50 sifts
(trials with rows of 400 and 4096 px).
"""

SIFT_LIMIT = 10_000
"""Largest ``max_sifts`` that is accepted, also by the kernel; it bounds the time of a call."""

PATIENCE_LIMIT = 10_000
"""Largest number of passes without progress: that of all passes."""
FLAT = 0.2
"""Largest root mean square of an IMF's envelope mean, as a share of the IMF's own.

A smaller share takes more sifts and evens out the amplitude of the modes. An empirical choice
within the range of 0.1 to 0.3 that is usual for stopping criteria.
"""

FIRST_SHARE = 0.593
"""Share of the energy of white noise in the first IMF (Flandrin, Rilling & Gonçalves, 2004)."""

FIRST_RATIO = 0.719
"""Factor β of the energy of white noise in later IMFs (Flandrin, Rilling & Gonçalves, 2004).

The k-th IMF holds the share FIRST_SHARE / FIRST_RATIO · DECAY^(−k), k ≥ 2.
"""

DECAY = 2.01
"""Factor ρ by which that energy falls from one IMF to the next (same source)."""

CONFIDENCE = 2.0
"""An IMF with at most this many times the energy of the noise counts as noise.

The energy of noise in the IMF of one row scatters. A factor of two covers 96 % of the IMFs of white
noise, and all of the first three (trial with 500 rows of 1000 px). A larger factor would also drop
weak fringes.
"""

MAX_PLANAR = 8
"""Default of the largest number of modes of a frame.

Windows grow by ``GROWTH`` or more, so that eight modes cover windows up to 17 times the first. An
empirical choice that bounds the time.
"""

MAX_PLANAR_SIFTS = 10
"""Largest number of sifts per mode of a frame.

Modes of running envelopes change little after a few sifts (Bhuiyan et al., 2008). An empirical
choice that bounds the time.
"""

NOISE_MODES = 3
"""Number of modes of a frame that may count as noise.

The first three hold more than 90 % of the energy of white noise (trial with 300 × 300 px).
"""


def most_modes(shape: tuple[int, ...], max_imfs: int) -> int:
    """Largest number of modes of a frame, whose windows grow from 3 px to its shorter side."""
    growing = np.log(max(min(shape), 3) / 3.0) / np.log(GROWTH)
    return min(max_imfs, 1 + int(growing))


def odd(width: float) -> int:
    """The smallest odd whole number that is not below a width."""
    return 2 * int(np.ceil(0.5 * (width - 1.0))) + 1


def spacing(frame: FloatMap) -> int | None:
    """Mean distance of extrema as an odd number of px; None where there are too few."""
    if min(frame.shape) < 3 or float(np.ptp(frame)) == 0.0:
        return None
    counts = [0, 0]
    for band in row_bands(frame.shape, bytes_per_px=32, halo=1):
        part = frame[band.seen]
        ends = scipy.ndimage.maximum_filter(part, 3), scipy.ndimage.minimum_filter(part, 3)
        varying = ends[0] > ends[1]
        for k, end in enumerate(ends):
            counts[k] += int(np.count_nonzero(((part == end) & varying)[band.inner]))
    count = min(counts)
    if count < MIN_EXTREMA:
        return None
    return max(3, odd(float(np.sqrt(frame.size / count))))


def envelope_mean(frame: FloatMap, window: int) -> NDArray[np.float64]:
    """Mean of the upper and the lower running envelope."""
    mean = np.empty(frame.shape)
    for band in row_bands(frame.shape, bytes_per_px=32, halo=window, least=4 * window):
        part = frame[band.seen]
        upper = scipy.ndimage.uniform_filter(scipy.ndimage.maximum_filter(part, window), window)
        lower = scipy.ndimage.uniform_filter(scipy.ndimage.minimum_filter(part, window), window)
        upper += lower
        del lower
        upper *= 0.5
        mean[band.rows] = upper[band.inner]
    return mean


@dataclass(frozen=True, eq=False, repr=False)
class Decomposition(Plotted, Frozen):
    """The modes of a frame, from fast to slow, and the residue; their sum is the frame."""

    imfs: NDArray[np.float64]
    """Modes, counts: (h, k, w) by rows, with zeros where a row has fewer; (k, h, w) of a frame."""
    residue: NDArray[np.float64]
    """What remains after the last mode, the trend; (h, w), counts."""
    counts: NDArray[np.uint32]
    """Number of modes of every row, (h,), or of the frame, (1,)."""
    unfinished: int = 0
    """Number of rows in which a mode reached a limit before it met both criteria."""


def _checked(frame: NDArray[np.generic]) -> NDArray[np.float64]:
    """The frame as a contiguous array of finite float64 values."""
    values = unmasked(frame, "frame")
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"frame: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "fiu":
        raise InputError(f"frame: expected real numbers, got {values.dtype}")
    if not (values.min() >= -LARGEST and values.max() <= LARGEST):
        raise InputError(f"frame: expected finite values up to {LARGEST:g}, got others")
    return np.ascontiguousarray(values, dtype=np.float64)


def decompose_rows(
    frame: NDArray[np.generic],
    *,
    max_imfs: int = MAX_IMFS,
    max_sifts: int = MAX_SIFTS,
    flat: float = FLAT,
    patience: int = MAX_SIFTS,
) -> Decomposition:
    """Decompose every row of a frame into intrinsic mode functions (IMFs).

    Parameters
    ----------
    frame : (h, w) real array of finite values, counts
    max_imfs : int, 1 … 64
        Largest number of IMFs per row.
    max_sifts : int, 1 … 10000
        Largest number of sifts per IMF.
    flat : float > 0
        Criterion II: largest root mean square of the envelope mean, as a share of the IMF's.
    patience : int ≥ 0
        Number of sifts after which criterion II alone suffices. Waves that ride on others without
        crossing zero take tens of sifts. With 0, sifting ends as soon as the mean is flat.

    Returns
    -------
    Decomposition with imfs of shape (h, k, w)

    Raises
    ------
    InputError
        If the frame is not real, finite and two-dimensional, or an option is out of range.

    Notes
    -----
    Sifting subtracts the mean of the two natural cubic spline envelopes until (I) the numbers of
    extrema and zero crossings differ by at most one and (II) that mean is nearly zero. The residue
    has at most two extrema. Rows are mirrored at their ends. Huang et al., Proc. R. Soc. London A
    454:903, 1998; Boudraa & Cexus, Proc. ISCCSP 2006; theory §7.

    Examples
    --------
    >>> x = np.arange(400.0)
    >>> row = np.cos(0.5 * x) + 3 * np.cos(0.05 * x) + 0.01 * x
    >>> modes = decompose_rows(row[None])
    >>> bool(np.abs(modes.imfs.sum(axis=1) + modes.residue - row).max() < 1e-12)
    True
    """
    values = _checked(frame)
    if not whole(max_imfs, 1, IMF_LIMIT):
        raise InputError(f"max_imfs: expected 1 to {IMF_LIMIT}, got {max_imfs}")
    if not whole(max_sifts, 1, SIFT_LIMIT):
        raise InputError(f"max_sifts: expected 1 to {SIFT_LIMIT}, got {max_sifts}")
    if not positive(flat):
        raise InputError(f"flat: expected > 0, got {flat}")
    if not whole(patience, 0, PATIENCE_LIMIT):
        raise InputError(f"patience: expected 0 to {PATIENCE_LIMIT}, got {patience}")
    imfs, residue, counts, unfinished = _core.decompose_rows(
        values, max_imfs=max_imfs, max_sifts=max_sifts, flat=flat, patience=patience
    )
    return Decomposition(sealed(imfs), sealed(residue), sealed(counts), unfinished)


def decompose_frame(frame: NDArray[np.generic], *, max_imfs: int = MAX_PLANAR) -> Decomposition:
    """Decompose a frame into two-dimensional modes.

    Parameters
    ----------
    frame : (h, w) real array of finite values, counts
    max_imfs : int, 1 … 64
        Largest number of modes.

    Returns
    -------
    Decomposition with imfs of shape (k, h, w)

    Raises
    ------
    InputError
        If the frame is not real, finite and two-dimensional, or ``max_imfs`` is out of range.

    Notes
    -----
    The fast and adaptive form: envelopes are running maxima and minima, smoothed over the same
    window. The window is as wide as the mean distance of the extrema. Sifting ends at criterion II
    of ``decompose_rows`` or after ten sifts. Bhuiyan, Adhami & Khan, EURASIP J. Adv. Signal
    Process. 2008:728356.

    Examples
    --------
    >>> y, x = np.mgrid[:64, :64]
    >>> frame = np.cos(0.9 * x) * np.cos(0.8 * y) + 0.01 * x
    >>> modes = decompose_frame(frame)
    >>> bool(np.abs(modes.imfs.sum(axis=0) + modes.residue - frame).max() < 1e-12)
    True
    """
    values = _checked(frame)
    if not whole(max_imfs, 1, IMF_LIMIT):
        raise InputError(f"max_imfs: expected 1 to {IMF_LIMIT}, got {max_imfs}")
    windows: list[int] = []
    # Memory that no mode is written to is never taken from the system.
    stack = np.empty((most_modes(values.shape, max_imfs), *values.shape))
    residue = np.array(values)
    while len(windows) < len(stack):
        window = spacing(residue)
        if window is None:
            break
        if windows:
            window = max(window, odd(GROWTH * windows[-1]))
        if window > min(values.shape):
            break
        mode = stack[len(windows)]
        mode[:] = residue
        for _ in range(MAX_PLANAR_SIFTS):
            mean = envelope_mean(mode, window)
            mode -= mean
            removed = np.vdot(mean, mean)
            del mean
            if removed <= FLAT**2 * np.vdot(mode, mode):
                break
        residue -= mode
        windows.append(window)
    count = np.array([len(windows)], np.uint32)
    return Decomposition(sealed(stack[: len(windows)]), sealed(residue), sealed(count))


def denoise(
    frame: NDArray[np.generic], method: Denoiser = "emd", *, noise: float | None = None
) -> NDArray[np.float64]:
    """Remove the modes of a frame that are no stronger than noise.

    Parameters
    ----------
    frame : (h, w) real array of finite values, fringes along the rows, counts
    method : "emd", "emd2d" or "bemd"
        "emd" decomposes the rows. "emd2d" decomposes the rows, then the columns, along which
        fringes change slowly but noise does not. "bemd" decomposes the whole frame.
    noise : float ≥ 0, optional
        Standard deviation of the white noise, counts; measured where not given.

    Returns
    -------
    (h, w) float64 array, counts; the frame itself where no mode counts as noise.

    Raises
    ------
    InputError
        If the frame is not real, finite and two-dimensional, or an option is out of range.

    Notes
    -----
    White noise of variance σ² leaves 0.593 σ² in the first IMF and 0.825 · 2.01^(−k) σ² in the k-th
    (Flandrin, Rilling & Gonçalves, IEEE SPL 11(2):112, 2004). An IMF of a row with at most twice
    that energy is dropped. For "bemd" a field of white noise passes through the same decomposition
    and gives the energies.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> clean = np.tile(100 + 40 * np.cos(np.arange(256) / 2.5), (16, 1))
    >>> noisy = clean + rng.normal(scale=5.0, size=clean.shape)
    >>> bool(np.std(denoise(noisy, "bemd") - clean) < 3.0)
    True
    """
    values = _checked(frame)
    if method not in DENOISERS:
        raise InputError(f"denoise: expected one of {', '.join(DENOISERS)}, got {method!r}")
    if noise is not None and not noise >= 0:
        raise InputError(f"noise: expected ≥ 0 counts, got {noise}")
    variance = noise_variance(values, np.ones(values.shape, bool)) if noise is None else noise**2
    if method == "bemd":
        return _without_planar_noise(values, variance)
    smooth = _without_row_noise(values, variance)
    if method == "emd":
        return smooth
    return np.ascontiguousarray(_without_row_noise(smooth.T, variance).T)


def _without_row_noise(values: FloatMap, variance: float) -> NDArray[np.float64]:
    """The frame without the IMFs of its rows that count as noise."""
    smooth = np.empty(values.shape)
    for band in row_bands(values.shape, bytes_per_px=64):
        rows = np.ascontiguousarray(values[band.rows])
        modes = decompose_rows(rows).imfs
        energy = np.mean(modes**2, axis=2)
        k = np.arange(1, modes.shape[1] + 1)
        expected = FIRST_SHARE / FIRST_RATIO * DECAY ** (-k.astype(float))
        expected[:1] = FIRST_SHARE
        dropped = energy <= CONFIDENCE * variance * expected
        smooth[band.rows] = rows - np.einsum("hkw,hk->hw", modes, dropped)
    return smooth


def _without_planar_noise(values: FloatMap, variance: float) -> NDArray[np.float64]:
    """The frame without the fastest of its modes, as long as they count as noise."""
    white = np.random.default_rng(0).standard_normal(values.shape)
    expected = _energies(decompose_frame(white, max_imfs=NOISE_MODES))
    del white
    modes = decompose_frame(values, max_imfs=NOISE_MODES)
    out = np.array(values, dtype=np.float64)
    for mode, energy, share in zip(modes.imfs, _energies(modes), expected, strict=False):
        if energy > CONFIDENCE * variance * share:
            break  # all slower modes hold fringes
        out -= mode
    return out


def _energies(modes: Decomposition) -> list[float]:
    """Mean square of every mode of a frame, counts²."""
    return [float(np.vdot(mode, mode)) / mode.size for mode in modes.imfs]
