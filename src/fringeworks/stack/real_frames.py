"""What the frames of a set really show: their real phase steps and gains, from the frames alone.

Every frame of a set shows I_n = α_n A + k_n c + q_n s, with A, c = B cos φ and s = B sin φ of the
pixel. As planned, α_n = 1, k_n = cos δ_n and q_n = sin δ_n. Wrong steps, flicker, light that
changes and motion change these three numbers of a frame alike in all pixels. The samples of all
pixels therefore still lie in a space of three dimensions, which four or more frames show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.stack.fits import fit_samples
from fringeworks.statistics.quantiles import median

SIGNIFICANT_DECREASE = 6.0
"""Decrease of the residuals that counts as significant, in standard deviations of its value under
noise alone. Noise alone reaches six in far less than one stack of a million."""

USEFUL = 0.01
"""Smallest share of the residuals' variance that the real frames must explain.

Below, the phase errors are less than about a tenth of the noise. An empirical choice.
"""

SEPARABLE = 10.0
"""Smallest variance of the weakest of the three dimensions, over that of the noise.

Below, noise turns the dimensions. An empirical choice.
"""

MAX_ALIGNED = 0.9
"""Largest magnitude of the mean of e^{iφ} over the pixels: at 0.9 they hold a quarter of a fringe.

With less of a fringe, background and fringe cannot be distinguished.
"""

OUTLIERS = 16.0
"""Squared residual of a pixel over the median, above which it is left out, for example at edges
that move. Empirical; noise alone exceeds it in fewer than 0.3 % of the pixels."""


@dataclass(frozen=True)
class RealFrames:
    """What the frames of a set show of A, c and s."""

    design: NDArray[np.float64]
    """(N, 3): α_n, k_n and q_n."""

    @property
    def shifts_rad(self) -> NDArray[np.float64]:
        """Phase steps δ_n, rad, up to a common one."""
        k, q = self._circle()
        return np.asarray(np.arctan2(q, k))

    @property
    def fringe_gains(self) -> NDArray[np.float64]:
        """Modulation over background of every frame, relative to the mean of all."""
        gains = np.hypot(*self._circle())
        return np.asarray(gains / gains.mean())

    def _circle(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(k_n, q_n) / α_n about the centre of the circle through them.

        Adding shares of c and s to A does not change the phase, but moves these points. Where all
        frames have the same modulation over background, the points lie on a circle about zero.
        """
        k, q = (self.design[:, 1:] / self.design[:, :1]).T
        conic = np.column_stack((2.0 * k, 2.0 * q, np.ones_like(k)))
        centre = np.linalg.lstsq(conic, k**2 + q**2, rcond=None)[0]
        return k - centre[0], q - centre[1]

    @property
    def light_gains(self) -> NDArray[np.float64]:
        """Background of every frame over the mean of all."""
        return np.asarray(self.design[:, 0] / self.design[:, 0].mean())


def real_frames(
    planes: list[NDArray[Any]], pixels: NDArray[np.intp], planned: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Estimate what the frames of a set show, from many pixels.

    Parameters
    ----------
    planes : (1, n) arrays, one per frame, counts
    pixels : (m,) integer array
        Pixels with fringes, none of them saturated.
    planned : (N, 3) array
        What the frames should show: 1, cos δ_n and sin δ_n.

    Returns
    -------
    (N, 3) array: α_n, k_n and q_n of every frame; None where three frames, noise, or too little of
    a fringe do not determine it, or where the frames show what was planned.

    Notes
    -----
    The space is that of the three largest principal components of the samples. The result is the
    planned design projected into it, so that nothing is changed that the frames do not contradict.
    Errors of the design within this space leave no residuals. They shift the phase by a function
    of the phase itself (``stack.ripple``). A first estimate from all pixels finds outliers, and the
    second does without them.
    """
    steps = len(planned)
    if steps < 4 or pixels.size < 10 * steps:
        return None
    residual = np.eye(steps) - planned @ np.linalg.pinv(planned)
    _, vectors = np.linalg.eigh(_core.sample_moments(planes, pixels))
    square = _core.sample_squares(planes, pixels, np.ascontiguousarray(vectors[:, :-3].T))
    pixels = pixels[square <= OUTLIERS * median(square)]
    moments = _core.sample_moments(planes, pixels)
    powers, vectors = np.linalg.eigh(moments)
    space = vectors[:, -3:]
    n = float(pixels.size)
    after = float(max(powers[:-3].sum(), 0.0))
    before = float(np.einsum("ij,ji->", residual, moments))
    variance = after / (n * (steps - 3))
    if variance <= 0 or powers[-3] / n < SEPARABLE * variance:
        return None
    freedom = 3.0 * (steps - 3)
    significance = ((before - after) / variance - freedom) / np.sqrt(2.0 * freedom)
    explained = 1.0 - after / before
    if significance < SIGNIFICANT_DECREASE or explained < USEFUL:
        return None
    design = space @ (space.T @ planned)
    c, s = fit_samples(planes, design_rows(design)).at(pixels).fitted[1:]
    phasor = (c + 1j * s) / np.maximum(np.hypot(c, s), np.finfo(float).tiny)
    if abs(np.mean(phasor)) > MAX_ALIGNED:
        return None
    return np.asarray(design)


def design_rows(design: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    """A design matrix as tuples, one per frame."""
    return tuple((float(a), float(c), float(s)) for a, c, s in design)
