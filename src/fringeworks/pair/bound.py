"""The smallest error that two frames allow: the Cramér–Rao bound of a window (theory §4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.prepared import PreparedPair, prepare
from fringeworks.pair.windows import MIN_RATIO, SCALE_LIMITS_PX, Windows
from fringeworks.signal.filters import weighted_sum
from fringeworks.types import FloatMap, InputError, Pair, unmasked

WINDOW_PERIODS = 0.25
"""Default width σ of the window, periods: it resolves what filters about the carrier resolve."""
NODES_PER_WIDTH = 4.0
"""Positions per width of the window at which the bound is computed; it is smooth between them."""
REACH_WIDTHS = 3.0
"""Distance at which the window is cut off, widths."""
RIDGE = 1e-9
"""Share of the diagonal that is added before inversion; it keeps windows without fringes finite."""

_ORDERS = {
    "1": [(0, 0)],
    "s": [(0, 0)],
    "ss": [(0, 0)],
    "d": [(0, 0)],
    "sd": [(0, 0)],
    "g": [(0, 0), (0, 1), (1, 0)],
    "sg": [(0, 0), (0, 1), (1, 0)],
    "gg": [(0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0)],
}
"""Products of which the window takes moments, and the moments: powers of y and x."""

Moments = dict[tuple[str, int, int], FloatMap]


def bound_px(
    pair: Pair | PreparedPair, displacement_px: FloatMap, *, window_px: float | None = None
) -> FloatMap:
    """Cramér–Rao bound of the displacement of every pixel, for a window of a given width.

    Parameters
    ----------
    pair : Pair or PreparedPair
    displacement_px : (h, w) float array
        Displacement of the fringes, as a method found it or as it is known, px; NaN where unknown.
    window_px : float, optional
        Width σ of the Gaussian window, 0.8 to 1000 px; a quarter of a period by default.

    Returns
    -------
    (h, w) float array, px
        Smallest standard deviation of any unbiased estimate of u from the pixels of the window;
        NaN where the displacement is unknown.

    Raises
    ------
    InputError for a displacement of another shape, a width out of its range, and frames that cannot
    be used.

    Notes
    -----
    In the window, the object is a + b·s(x − u − u_x i − u_y j) with unknown a, b, u, u_x, u_y, and
    the frames have white noise of variances σ_o² and σ_r². The window counts for N = 4π σ² pixels,
    and F = N / (σ_o² + b² σ_r²) · G ∗ (c cᵀ) with c = ∂d/∂(a, b, u, u_x, u_y): the bound is
    √(F⁻¹)_uu. Wider windows have smaller bounds and flatten what they do not resolve: an error is
    to be compared with the bound of the window that it resolves. See Kay, Fundamentals of
    Statistical Signal Processing: Estimation Theory, 1993, chapter 3.

    Examples
    --------
    >>> from fringeworks import analyse
    >>> from fringeworks.pair import bound_px
    >>> from fringeworks.simulate import standard_scene
    >>> scene = standard_scene("tilt", size=200, fringes=8, noise=2, bits=8)
    >>> found = analyse(scene, "windowed")
    >>> wide, narrow = (bound_px(scene, found.displacement_px, window_px=w) for w in (16, 8))
    >>> bool((wide < narrow).mean() > 0.99)
    True
    """
    prepared = pair if isinstance(pair, PreparedPair) else prepare(pair)
    turn = prepared.to_capture
    u = turn(unmasked(displacement_px, "displacement"))
    if u.shape != prepared.object.shape:
        shape = turn(prepared.object).shape
        raise InputError(f"displacement_px: expected shape {shape}, got {displacement_px.shape}")
    width = WINDOW_PERIODS * prepared.period if window_px is None else float(window_px)
    smallest, largest = SCALE_LIMITS_PX
    if not smallest <= width <= largest:
        raise InputError(f"window_px: expected {smallest:g} to {largest:g} px, got {width:g}")
    windows = Windows.of(prepared)
    step = max(1, int(width / NODES_PER_WIDTH))
    variance = _variance(_moments(windows, u.astype(np.float32), width, step), windows, width)
    # Windows without light have rounding in place of a variance.
    deviation = np.sqrt(np.where(variance > 0, variance, np.nan))
    rows, columns = (np.arange(n) / step for n in u.shape)
    bound = _core.interpolate_linear(deviation, rows=rows, columns=columns)
    return turn(np.where(np.isfinite(u), bound, np.nan))


def _moments(windows: Windows, u: NDArray[np.float32], width: float, step: int) -> Moments:
    """Means over the window of products with powers of the distance in widths, at nodes."""
    start = np.ascontiguousarray(np.where(np.isfinite(u), u, np.float32(0)))
    value, slope, known = windows.warp(start)
    seen = (known > 0).astype(np.float32)
    d = windows.object
    if windows.albedo is not None:
        # Windows divide by the albedo and weight its square.
        seen, d = seen * windows.albedo**2, d / windows.albedo
    s, g, d = value * seen, slope * seen, d * seen
    products = {"1": seen, "s": s, "ss": s * s, "d": d, "sd": s * d}
    products |= {"g": g, "sg": s * g, "gg": g * g}
    reach = int(REACH_WIDTHS * width) + 1
    t = np.arange(-reach, reach + 1) / width
    weight = np.exp(-0.5 * t * t)
    weight /= weight.sum()
    kernels = [weight * t**power for power in range(3)]
    return {
        (name, j, i): weighted_sum(values, kernels[j], kernels[i], border="zero", step=step).astype(
            np.float64
        )
        for name, values in products.items()
        for j, i in _ORDERS[name]
    }


def _variance(m: Moments, windows: Windows, width: float) -> FloatMap:
    """Variance of u, px², from the inverse of the Fisher matrix of (a, b, u, u_x, u_y)."""
    one = {"1": m["1", 0, 0], "s": m["s", 0, 0], "ss": m["ss", 0, 0]}
    share = np.maximum(one["1"], RIDGE)
    spread = one["ss"] - one["s"] ** 2 / share
    together = m["sd", 0, 0] - one["s"] * m["d", 0, 0] / share
    ratio = np.maximum(np.abs(together) / np.maximum(spread, RIDGE), MIN_RATIO)
    powers = ((0, 0), (0, 1), (1, 0))
    fisher = np.empty((*share.shape, 5, 5))
    fisher[..., 0, 0], fisher[..., 0, 1], fisher[..., 1, 1] = one["1"], one["s"], one["ss"]
    for k, (j, i) in enumerate(powers, 2):
        fisher[..., 0, k] = -ratio * m["g", j, i]
        fisher[..., 1, k] = -ratio * m["sg", j, i]
        for other, (jj, ii) in enumerate(powers, 2):
            fisher[..., k, other] = ratio**2 * m["gg", j + jj, i + ii]
    for k in range(1, 5):
        fisher[..., k, : min(k, 2)] = fisher[..., : min(k, 2), k]
    diagonal = np.einsum("...kk->...k", fisher)
    diagonal += RIDGE * np.maximum(diagonal, RIDGE)
    noise = windows.object_noise + ratio**2 * windows.reference_noise
    pixels = 4.0 * np.pi * width**2
    return np.asarray(noise / pixels * np.linalg.inv(fisher)[..., 2, 2])
