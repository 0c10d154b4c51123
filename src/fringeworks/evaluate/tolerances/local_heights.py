"""Heights of form that vary from place to place: a dented plane is flat beside its dent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fringeworks.types import FloatMap

SPREAD = 1.0
"""Prior standard deviation of the logarithm of the local height. The mean error of the bottom of 24
dents is 0.0 σ with 1, +0.4 σ with 2, and −1.8 σ with equal heights. The mean gain in the logarithm
of the evidence, on eight dented planes, is 21 with 0.5, 29 with 1 and 34 with 2."""
LENGTH = 0.3
"""Length over which the local height varies, as a share of the side of the area. The mean gain in
the logarithm of the evidence, on eight dented planes, is 27 with 0.2, 29 with 0.3 and 21 with 0.5.
"""
COARSE = 1e-2
"""Parts of the local height with a smaller variance, relative to the largest part, are left out."""
MOST_STEPS = 8
"""Largest number of steps of scoring. Four to six are usual."""
LARGEST_STEP = 1.5
"""Largest change of the logarithm of a local height in one step, so that the step stays within the
range of its linear prediction."""
SHORTER = (1.0, 0.4, 0.15)
"""Fractions of a step that are tried until the evidence grows."""
SETTLED = 0.05
"""Gain of the logarithm of the evidence in one step below which the steps end."""


class Scored(NamedTuple):
    """The evidence of local heights, with its derivatives by their parts."""

    evidence: float
    """Logarithm, relative to a surface without form."""
    slope: FloatMap
    """Its derivative by each part, (c,)."""
    information: FloatMap
    """Expected negative second derivatives (Fisher's information), (c, c)."""


def parts_of_heights(root: FloatMap, other: FloatMap) -> FloatMap:
    """Return independent parts of the logarithm of the local height, (p, c).

    Parameters
    ----------
    root, other : (side, r) array
        Parts along each side, of variance 1 in total, alike over ``LENGTH``.
    """
    found = np.kron(root, other)
    size = np.sum(found**2, axis=0)
    return np.asarray(SPREAD * found[:, size > COARSE * size.max()])


def local_heights(
    waves: FloatMap, normal: FloatMap, right: FloatMap, parts: FloatMap
) -> tuple[FloatMap, float]:
    """Return the likely local height of each coefficient, and the price of not knowing it before.

    Parameters
    ----------
    waves : (p, r) array
        Parts of a form that is equally high everywhere, each of variance 1.
    normal, right : (p, p) and (p,) array
        Of the equations of least squares, without what bows explain.
    parts : (p, c) array
        See ``parts_of_heights``.

    Returns
    -------
    tuple of (p,) array, and float
        Heights of mean logarithm 0, and what is added to the logarithm of the evidence.

    Notes
    -----
    The logarithm of the height is a Gaussian process itself. Its maximum a posteriori is found by
    Fisher's scoring of the marginal likelihood. The price is that of Laplace's approximation
    (MacKay, Neural Computation 4, 1992): a surface that is equally rough everywhere keeps its
    greater evidence.
    """
    unit = np.eye(parts.shape[1])
    at = np.zeros(parts.shape[1])
    scored = _scored(waves, normal, right, parts, at)
    best = scored.evidence
    for _ in range(MOST_STEPS):
        step = np.linalg.solve(scored.information + unit, scored.slope - at)
        step *= min(1.0, LARGEST_STEP / max(float(np.abs(parts @ step).max()), LARGEST_STEP))
        gain = 0.0
        for shorter in SHORTER:
            new = _scored(waves, normal, right, parts, at + shorter * step)
            gain = new.evidence - 0.5 * float(np.sum((at + shorter * step) ** 2)) - best
            if gain > 0.0:
                at, scored, best = at + shorter * step, new, best + gain
                break
        if gain < SETTLED:
            break
    log = parts @ at
    volume = float(np.linalg.slogdet(scored.information + unit)[1])
    return np.exp(log - log.mean()), -0.5 * float(at @ at) - 0.5 * volume


def _scored(
    waves: FloatMap, normal: FloatMap, right: FloatMap, parts: FloatMap, at: FloatMap
) -> Scored:
    """The evidence of heights exp(parts · at), and its derivatives.

    With the prior covariance K = U Uᵀ and M = N − N C N of the posterior covariance C, the slope by
    the logarithm of height i is rᵢ mᵢ − (K M)ᵢᵢ, of the mean m and what it leaves r = b − N m.
    """
    own = np.exp(parts @ at)[:, None] * waves
    seen = normal @ own
    gram = own.T @ seen
    gain = np.eye(len(gram)) + gram
    solved = np.linalg.solve(gain, np.column_stack((own.T @ right, gram, seen.T)))
    x, shrunk, back = solved[:, 0], solved[:, 1 : 1 + len(gram)], solved[:, 1 + len(gram) :]
    evidence = 0.5 * float(right @ own @ x) - 0.5 * float(np.linalg.slogdet(gain)[1])
    known = own @ back
    left = right - seen @ x
    slope = parts.T @ (left * (own @ x) - np.diag(known))
    both = known * known.T + (own @ shrunk @ own.T) * (normal - seen @ back)
    return Scored(evidence, slope, parts.T @ both @ parts)
