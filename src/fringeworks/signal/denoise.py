"""Denoising by empirical mode decomposition (EMD): of rows, and of frames (theory §7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks import _core
from fringeworks.signal.noise import noise_variance
from fringeworks.types import FloatMap, InputError

Denoiser = Literal["emd", "emd2d", "bemd"]
DENOISERS = ("emd", "emd2d", "bemd")
MAX_IMFS = 16
MAX_SIFTS = 100
FLAT = 0.2
"""An IMF's envelope mean has at most this root mean square, share of the IMF's."""
FIRST_SHARE = 0.593
"""White noise puts this share of its energy into the first IMF, …"""
FIRST_RATIO = 0.719
DECAY = 2.01
"""… and FIRST_SHARE / FIRST_RATIO · DECAY^(−k) into the k-th (Flandrin, Rilling, Gonçalves)."""
CONFIDENCE = 2.0
"""An IMF with at most this many times the noise's energy is noise."""
MAX_PLANAR = 8
MAX_PLANAR_SIFTS = 10
NOISE_MODES = 3
"""Modes of a frame that may be noise; slower ones hold too little of it to matter."""
GROWTH = 1.5
"""Windows of successive two-dimensional modes grow at least by this factor."""
MIN_EXTREMA = 8
"""A frame with fewer maxima or minima has no mode left."""


@dataclass(frozen=True)
class Decomposition:
    """A frame's modes, from fast to slow, and what is left; they add up to the frame."""

    imfs: NDArray[np.float64]
    """(h, k, w) by rows, zeros where a row has fewer, or (k, h, w) of a frame; counts."""
    residue: NDArray[np.float64]
    """(h, w), counts: the trend."""
    counts: NDArray[np.uint32]
    """Modes of every row, (h,); of a frame, (1,)."""
    unfinished: int = 0
    """Rows of which a mode met a limit before both criteria."""


def _checked(frame: NDArray[np.generic]) -> NDArray[np.float64]:
    values = np.asarray(frame)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"frame: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "fiu":
        raise InputError(f"frame: expected real numbers, got {values.dtype}")
    if not np.isfinite(values).all():
        raise InputError("frame: expected finite values, got NaN or infinity")
    return np.ascontiguousarray(values, dtype=np.float64)


def decompose_rows(
    frame: NDArray[np.generic],
    *,
    max_imfs: int = MAX_IMFS,
    max_sifts: int = MAX_SIFTS,
    flat: float = FLAT,
    patience: int = MAX_SIFTS,
) -> Decomposition:
    """Empirical mode decomposition of every row.

    Parameters
    ----------
    frame : (h, w) real array of finite values
    max_imfs : int, 1 … 64
    max_sifts : int, 1 … 10000
        Sifts per IMF at most.
    flat : float > 0
        Criterion II: root mean square of the envelopes' mean, as a share of the IMF's.
    patience : int ≥ 0
        Sifts after which criterion II alone suffices. Riding waves that never cross zero take tens
        of sifts; with 0 sifting ends as soon as the mean is flat, as many programs do.

    Returns
    -------
    Decomposition with imfs (h, k, w)

    Raises
    ------
    InputError for a frame or option that cannot be used.

    Notes
    -----
    Huang et al., Proc. R. Soc. London A 454:903, 1998; Boudraa & Cexus, Proc. ISCCSP 2006. Sifting
    takes the mean of the natural cubic spline envelopes away until (I) the numbers of extrema and
    zero crossings differ by at most one and (II) that mean is nearly zero. The residue has at most
    two extrema. Rows are mirrored at their ends.

    Examples
    --------
    >>> x = np.arange(400.0)
    >>> row = np.cos(0.5 * x) + 3 * np.cos(0.05 * x) + 0.01 * x
    >>> found = decompose_rows(row[None])
    >>> bool(np.abs(found.imfs.sum(axis=1) + found.residue - row).max() < 1e-12)
    True
    """
    values = _checked(frame)
    if not 1 <= max_imfs <= 64:
        raise InputError(f"max_imfs: expected 1 to 64, got {max_imfs}")
    if not 1 <= max_sifts <= 10_000:
        raise InputError(f"max_sifts: expected 1 to 10000, got {max_sifts}")
    if not flat > 0:
        raise InputError(f"flat: expected > 0, got {flat}")
    if not patience >= 0:
        raise InputError(f"patience: expected ≥ 0, got {patience}")
    return Decomposition(
        *_core.decompose_rows(
            values, max_imfs=max_imfs, max_sifts=max_sifts, flat=flat, patience=patience
        )
    )


def decompose_frame(frame: NDArray[np.generic], *, max_imfs: int = MAX_PLANAR) -> Decomposition:
    """Bidimensional empirical mode decomposition of a frame.

    Parameters
    ----------
    frame : (h, w) real array of finite values
    max_imfs : int, 1 … 64

    Returns
    -------
    Decomposition with imfs (k, h, w)

    Raises
    ------
    InputError for a frame that cannot be used.

    Notes
    -----
    Fast and adaptive form: envelopes are running maxima and minima over a window as wide as the
    extrema are apart, smoothed over the same window (Bhuiyan, Adhami, Khan, EURASIP J. Adv. Signal
    Process. 2008:728356), sifted until criterion II of ``decompose_rows`` or ten times.
    """
    values = _checked(frame)
    if not 1 <= max_imfs <= 64:
        raise InputError(f"max_imfs: expected 1 to 64, got {max_imfs}")
    windows: list[int] = []
    modes: list[NDArray[np.float64]] = []
    residue = values
    while len(modes) < max_imfs:
        window = _spacing(residue)
        if window is None:
            break
        if windows:
            window = max(window, _odd(GROWTH * windows[-1]))
        if window > min(values.shape):
            break
        mode = residue
        for _ in range(MAX_PLANAR_SIFTS):
            mean = _envelope_mean(mode, window)
            mode = mode - mean
            if np.sum(mean**2) <= FLAT**2 * np.sum(mode**2):
                break
        modes.append(mode)
        residue = residue - mode
        windows.append(window)
    stack = np.stack(modes) if modes else np.zeros((0, *values.shape))
    return Decomposition(stack, residue, np.array([len(modes)], np.uint32))


def _odd(width: float) -> int:
    return 2 * int(np.ceil(0.5 * (width - 1.0))) + 1


def _spacing(frame: FloatMap) -> int | None:
    """Mean distance of neighbouring extrema, odd; None where there are too few."""
    if min(frame.shape) < 3 or float(np.ptp(frame)) == 0.0:
        return None
    top, bottom = ndimage.maximum_filter(frame, 3), ndimage.minimum_filter(frame, 3)
    moving = top > bottom
    count = min(int(np.count_nonzero((frame == end) & moving)) for end in (top, bottom))
    if count < MIN_EXTREMA:
        return None
    return max(3, _odd(float(np.sqrt(frame.size / count))))


def _envelope_mean(frame: FloatMap, window: int) -> NDArray[np.float64]:
    upper = ndimage.uniform_filter(ndimage.maximum_filter(frame, window), window)
    lower = ndimage.uniform_filter(ndimage.minimum_filter(frame, window), window)
    return np.asarray(0.5 * (upper + lower))


def denoise(
    frame: NDArray[np.generic], method: Denoiser = "emd", *, noise: float | None = None
) -> NDArray[np.float64]:
    """A frame without the modes that are no stronger than noise.

    Parameters
    ----------
    frame : (h, w) real array of finite values, fringes along the rows
    method : "emd", "emd2d" or "bemd"
        By rows; by rows, then by columns, along which fringes are slow and noise is not; or by the
        modes of the whole frame.
    noise : float ≥ 0, optional
        Standard deviation of the white noise, counts; measured where left out.

    Returns
    -------
    (h, w) float64 array; the frame itself where nothing is noise.

    Raises
    ------
    InputError for a frame or method that cannot be used.

    Notes
    -----
    Energy threshold: white noise of variance σ² leaves 0.593 σ² in the first IMF and
    0.825 · 2.01^(−k) σ² in the k-th (Flandrin, Rilling, Gonçalves, IEEE SPL 11(2):112, 2004); an
    IMF of a row with at most twice that is dropped. For "bemd" the noise's energies are those of
    a field of noise taken through the same decomposition.
    """
    values = _checked(frame)
    if method not in DENOISERS:
        raise InputError(f"denoise: expected one of {', '.join(DENOISERS)}, got {method!r}")
    if noise is not None and not noise >= 0:
        raise InputError(f"noise: expected ≥ 0, got {noise}")
    variance = noise_variance(values, np.ones(values.shape, bool)) if noise is None else noise**2
    if method == "bemd":
        return _without_planar_noise(values, variance)
    smooth = _without_row_noise(values, variance)
    if method == "emd":
        return smooth
    return np.ascontiguousarray(_without_row_noise(smooth.T, variance).T)


def _without_row_noise(values: FloatMap, variance: float) -> NDArray[np.float64]:
    found = decompose_rows(np.ascontiguousarray(values))
    energy = np.mean(found.imfs**2, axis=2)
    k = np.arange(1, found.imfs.shape[1] + 1)
    expected = FIRST_SHARE / FIRST_RATIO * DECAY ** (-k.astype(float))
    expected[:1] = FIRST_SHARE
    dropped = energy <= CONFIDENCE * variance * expected
    return np.asarray(values - np.einsum("hkw,hk->hw", found.imfs, dropped))


def _without_planar_noise(values: FloatMap, variance: float) -> NDArray[np.float64]:
    found = decompose_frame(values, max_imfs=NOISE_MODES)
    pure = np.random.default_rng(0).standard_normal(values.shape)
    expected = np.mean(decompose_frame(pure, max_imfs=NOISE_MODES).imfs ** 2, axis=(1, 2))
    out = np.asarray(values, dtype=np.float64)
    for mode, share in zip(found.imfs, expected, strict=False):
        if np.mean(mode**2) > CONFIDENCE * variance * share:
            break  # slower modes hold fringes
        out = out - mode
    return out


def remove_trend(frame: NDArray[np.generic]) -> NDArray[np.float64]:
    """A frame without the residue of its rows: shading that has no fringe's shape.

    Parameters
    ----------
    frame : (h, w) real array of finite values

    Returns
    -------
    (h, w) float64 array around zero
    """
    values = _checked(frame)
    return np.asarray(values - decompose_rows(values).residue)


def normalise(frame: NDArray[np.generic]) -> NDArray[np.float64]:
    """A fringe frame between its envelopes: −1 at the minima, 1 at the maxima.

    Parameters
    ----------
    frame : (h, w) real array of finite values, fringes along the rows

    Returns
    -------
    (h, w) float64 array; NaN in rows without three extrema, and where the envelopes meet

    Notes
    -----
    (I − m) / a with the mean m and the half distance a of the envelopes by rows. Noise makes
    envelopes of its own: ``denoise`` first.
    """
    values = _checked(frame)
    upper, lower = _core.row_envelopes(values)
    half = 0.5 * (upper - lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = np.where(half > 0, (values - 0.5 * (upper + lower)) / half, np.nan)
    return np.asarray(shown)
