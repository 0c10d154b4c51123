"""Pixels far from a smooth surface: alone they are outliers, several side by side are a dent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.surface.form import FAR_SIGMAS
from fringeworks.types import BoolMap, FloatMap

AROUND = 8
"""Pixels around a pixel."""
TOGETHER = 3
"""Pixels side by side, far on the same side, that are a form. Interpolation of frames may spread
the fault of one pixel to a second one."""
TOGETHER_SIGMAS = 4.0
"""Distance in robust standard deviations beyond which they count as far. Noise that is independent
makes three such neighbours in one of 10⁸ areas of a million pixels."""
MOST_SUSPECT = 0.05
"""Share of pixels up to which a surface is fitted again without the far ones and those around them.
Where more are far, the surface is not smooth, and its residuals say so."""


def _suspects(places: FloatMap, left: FloatMap) -> BoolMap:
    """Return which pixels are far from a surface, with those around them, (n,).

    A surface follows a narrow dent in part, which hides it: only its middle is far then. The
    surface of all other pixels does not. None where too many are.
    """
    found: BoolMap = np.zeros(len(left), bool)
    at = np.flatnonzero(_sizes(left) > TOGETHER_SIGMAS)
    if len(at):
        found[_around(places, at)] = True
    return found if found.mean() <= MOST_SUSPECT else np.zeros(len(left), bool)


def _sizes(left: FloatMap) -> FloatMap:
    return np.asarray(np.abs(left) / max(robust_sigma(left), np.finfo(float).tiny))


def _around(places: FloatMap, at: NDArray[np.intp]) -> NDArray[np.intp]:
    """Some pixels, each with those around it, (m, 9)."""
    tree = scipy.spatial.cKDTree(places)
    return np.asarray(tree.query(places[at], k=min(AROUND + 1, len(places)))[1], np.intp)


def outliers(
    places: FloatMap, left: FloatMap, left_without: Callable[[BoolMap], FloatMap]
) -> tuple[BoolMap, bool]:
    """Tell outliers from small forms that a smooth surface does not follow.

    Parameters
    ----------
    places : (n, 2) array
    left : (n,) array
        What the surface leaves of the values, in standard deviations.
    left_without : function
        The same of a surface through those pixels alone that a mask (n,) keeps.

    Returns
    -------
    tuple of (n,) array, which pixels are far and alone, and bool, whether others are far together
    """
    near = _suspects(places, left)
    left = left_without(~near) if near.any() else left
    away = _sizes(left)
    far = away > FAR_SIGMAS
    form: BoolMap = np.zeros(len(left), bool)
    at = np.flatnonzero(away > TOGETHER_SIGMAS)
    if len(at) < TOGETHER:
        return far, False
    around = _around(places, at)
    alike = away[around] > TOGETHER_SIGMAS
    alike &= np.sign(left[around]) == np.sign(left[at])[:, None]
    together = np.count_nonzero(alike, axis=1) >= TOGETHER
    form[around[together][alike[together]]] = True
    return far & ~form, bool(together.any())
