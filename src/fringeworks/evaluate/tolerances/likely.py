"""Surfaces that are likely behind noisy distances: a posterior over how rough the form may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fringeworks.evaluate.tolerances.local_heights import (
    LENGTH,
    local_heights,
    parts_of_heights,
)
from fringeworks.types import FloatMap

LENGTH_RATIO = 1.4
"""Ratio of neighbouring lengths of form that are tried. The logarithm of the evidence of a form of
twenty waves changes by about one from one length to the next."""
LONGEST = 3.0
"""Longest length of form, in sides of the area: over the area, such a form is a bow."""
HEIGHT_RATIO = 1.25
"""Ratio of neighbouring heights of form that are tried: twenty waves tell it to a sixth."""
HEIGHTS = 48
"""Number of heights that are tried: down to 1/4,500 of the largest one."""
HIGHEST = 10.0
"""Largest height that is tried, in root mean squares of the form of least squares."""
NEGLIGIBLE = 1e-8
"""Variance of a part of the form, relative to the largest, that is left out."""
UNLIKELY = 6.0
"""Logarithm of the ratio of evidences from which on a length does not count: 0.25 %."""
STIFFNESS = 1e-3
"""Part of a coefficient's own data that is added to it where only its size is asked for."""

SLANT_STEP = np.radians(8.0)
"""First change of the direction of slanted waves that is tried. The slopes of the likeliest surface
tell a ridge's direction to a few degrees where it stands out of the noise."""
SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))
"""Neighbours of two lengths."""
STEPS = (1, 2, 2)
"""Steps between neighbouring lengths of each kind of form. Kinked ones have parts of all
lengths, so that their evidence changes half as fast."""
SLANTED = 3
"""Steps between the two lengths with which directions are tried: a ratio of 2.7."""
SLANT_ENOUGH = np.radians(1.5)
"""Change below which the direction is known: a ridge that is a tenth of the area wide moves by a
quarter of its width over the area then."""
SLANT_PRICE = float(np.log(np.pi / (2.0 * SLANT_ENOUGH)))
"""What the logarithm of the evidence pays for a direction: that of the number of directions that
can be told from each other."""

Key = tuple[int, int, int, int]
"""Numbers of the lengths across and along, of the direction of the waves, and of their kind, see
``KINDS``."""


Alike = Callable[[FloatMap], FloatMap]
"""How much values have in common, by their distance in lengths of form."""


@dataclass(frozen=True)
class Roughness:
    """Forms of two lengths along the sides of the area, and the heights that they may have."""

    waves: FloatMap
    """Independent parts of the form, as coefficients of the spline, (p, r)."""
    known: FloatMap
    """Inverse of the variance of each part, by the values alone, (r,)."""
    pull: FloatMap
    """Sum of the values times each part, over their variance, (r,)."""
    heights: FloatMap
    """Standard deviations of the form, (h,), mm."""
    evidence: FloatMap
    """Logarithm of the evidence of each height, (h,)."""


@dataclass(frozen=True)
class Trials:
    """Lengths and heights of form that are tried, with one course of the height over the area."""

    side: int
    """Number of coefficients along each side."""
    count: int
    """Number of lengths that are tried."""
    slants: list[float]
    """Directions of the first length from the first side, rad; the first one is 0."""
    roots: dict[Key, FloatMap]
    """Parts of the form for lengths and a direction, (p, r), once they have been computed."""
    normal: FloatMap
    """Of the equations of least squares, without what bows explain, (p, p)."""
    right: FloatMap
    """Of the same, (p,)."""
    heights: FloatMap
    """Heights that are tried, (h,), mm."""
    local: FloatMap
    """Factor of the height at each coefficient, (p,)."""
    price: float
    """Added to the logarithm of the evidence for factors that were not known before."""
    tried: dict[Key, Roughness]

    def evidence(self, key: Key) -> float:
        """Try two lengths; return the logarithm of their evidence, of all heights together."""
        waves = self.local[:, None] * self.root(key)
        found = _roughness(waves, self.normal, self.right, self.heights)
        price = SLANT_PRICE if key[2] else 0.0
        self.tried[key] = replace(found, evidence=found.evidence + self.price - price)
        return float(np.logaddexp.reduce(self.tried[key].evidence))

    def root(self, key: Key) -> FloatMap:
        """Return independent parts of the form, (p, r)."""
        if key not in self.roots:
            lengths = [LONGEST / LENGTH_RATIO**k for k in key[:2]]
            alike = KINDS[key[3]]
            if key[2]:
                self.roots[key] = _slanted(self.side, lengths, self.slants[key[2]], alike)
            else:
                sides = zip(lengths, alike, strict=True)
                self.roots[key] = np.kron(*(_root(self.side, *one) for one in sides))
        return self.roots[key]

    @property
    def best(self) -> Key:
        """The lengths of the greatest evidence."""
        return max(self.tried, key=lambda key: float(self.tried[key].evidence.max()))

    @property
    def top(self) -> float:
        """The greatest logarithm of an evidence."""
        return float(self.tried[self.best].evidence.max())


@dataclass(frozen=True)
class Bows:
    """Polynomials up to the second degree and motions of the body, of which nothing is known before
    the values."""

    forms: FloatMap
    """Independent parts of variance 1, as coefficients of the spline, (p, k)."""
    normal: FloatMap
    """Of the equations of least squares, (p, p)."""
    right: FloatMap
    """Of the equations of least squares, (p,)."""

    def freed(self) -> tuple[FloatMap, FloatMap]:
        """Return the equations without what bows explain."""
        seen = self.normal @ self.forms
        return self.normal - seen @ seen.T, self.right - seen @ (self.forms.T @ self.right)

    def beside(self, waves: FloatMap, right: FloatMap | None = None) -> FloatMap:
        """Return waves with the bow of least squares beside them, (p,)."""
        right = self.right if right is None else right
        return np.asarray(waves + self.forms @ (self.forms.T @ (right - self.normal @ waves)))


@dataclass(frozen=True)
class Draws:
    """Coefficients that are drawn, each with its mirror image."""

    likely: FloatMap
    """Of the posterior, (2, p)."""
    again: FloatMap
    """The same, had the posterior's mean been measured under noise again, (2, p)."""


@dataclass(frozen=True)
class Likely:
    """The posterior of a spline's coefficients."""

    choices: tuple[Roughness, ...]
    weights: FloatMap
    """Probability of each choice and height, (c, h)."""
    bows: Bows

    @cached_property
    def mean(self) -> FloatMap:
        """Mean of the coefficients, (p,)."""
        found = np.zeros(len(self.bows.right))
        for one, weights in zip(self.choices, self.weights, strict=True):
            v = one.heights[:, None] ** 2
            found += one.waves @ (weights @ (v * one.pull / (1.0 + v * one.known)))
        return self.bows.beside(found)

    @cached_property
    def _of_mean(self) -> list[FloatMap]:
        """``pull`` of each choice, if the mean were measured without noise."""
        right = self.bows.freed()[0] @ self.mean
        return [one.waves.T @ right for one in self.choices]

    def draw(self, random: np.random.Generator) -> Draws:
        """Draw likely surfaces, and those that would be likely if the mean was measured again."""
        number = int(random.choice(self.weights.size, p=self.weights.ravel()))
        c, h = divmod(number, self.weights.shape[1])
        one, bows = self.choices[c], self.bows
        left = one.heights[h] ** 2 / (1.0 + one.heights[h] ** 2 * one.known)
        waves, noise = random.normal(size=(2, len(left)))
        flat, flat_noise = random.normal(size=(2, bows.forms.shape[1]))
        nothing = np.zeros(len(bows.right))
        own = bows.beside(one.waves @ (left * one.pull))
        moved = bows.beside(one.waves @ (np.sqrt(left) * waves), nothing) + bows.forms @ flat
        far = bows.beside(one.waves @ (left * self._of_mean[c]), bows.normal @ self.mean)
        shaken = left * np.sqrt(one.known) * noise
        by_noise = bows.beside(one.waves @ shaken, nothing) + bows.forms @ flat_noise
        signs = np.array([[1.0], [-1.0]])
        return Draws(own + signs * moved, far + signs * (moved + by_noise))


def likely(normal: FloatMap, right: FloatMap, side: int, rigid: FloatMap) -> Likely:
    """Return the posterior of the coefficients of a tensor product of cubic splines.

    Parameters
    ----------
    normal : (p, p) array
        Of the equations of least squares, values weighted by the inverse of their variance.
    right : (p,) array
        Of the same.
    side : int
        Number of coefficients along each side.
    rigid : (p, j) array
        Forms by motions and the size of the body.

    Notes
    -----
    A bow and a motion of which nothing is known, and waves that are a Gaussian process (Rasmussen &
    Williams, Gaussian Processes for Machine Learning, 2006, ch. 2 and 5): neighbours are alike by
    exp(−x²/2a² − y²/2b²), with two unknown lengths a and b. A priori, the lengths are uniform in
    their logarithms and the height is uniform (Gelman, Bayesian Analysis 1, 2006). All lengths and
    heights that the values support count, by their evidence. So do heights that vary from place to
    place, see ``local_heights``.
    """
    bows = _bows(normal, right, side, rigid)
    normal, right = bows.freed()
    count = 1 + int(np.log(LONGEST * (side - 3)) / np.log(LENGTH_RATIO))
    heights = _heights(normal, right)
    alike = Trials(side, count, [0.0], {}, normal, right, heights, np.ones(side * side), 0.0, {})
    _search(alike)
    local = _with_local_heights(alike, side)
    key = alike.best
    found = {key: local.evidence(key)}
    if local.top > alike.top - UNLIKELY:
        _around(local, found)
    every = [*alike.tried.values(), *local.tried.values()]
    evidence = np.array([one.evidence for one in every])
    kept = evidence.max(axis=1) > evidence.max() - UNLIKELY
    weights = np.exp(evidence[kept] - evidence.max())
    choices = tuple(one for one, keep in zip(every, kept, strict=True) if keep)
    return Likely(choices, weights / weights.sum(), bows)


def _with_local_heights(alike: Trials, side: int) -> Trials:
    """The same for heights that vary from place to place, in the way that suits the values best."""
    one = alike.tried[alike.best]
    root = _root(side, LENGTH)
    height = one.heights[int(np.argmax(one.evidence))]
    parts = parts_of_heights(root, root)
    local, price = local_heights(height * one.waves, alike.normal, alike.right, parts)
    return replace(alike, local=local, price=price, tried={})


def _search(trials: Trials) -> None:
    """Try equal lengths, the long ones first, then the neighbours of all that are likely, then
    directions."""
    found: dict[Key, float] = {}
    for k in range(trials.count):
        found[k, k, 0, 0] = trials.evidence((k, k, 0, 0))
        if found[k, k, 0, 0] < max(found.values()) - 3.0 * UNLIKELY:
            break
    _slant(trials, found)
    _around(trials, found)
    _kink(trials, found)
    _around(trials, found)


def _around(trials: Trials, found: dict[Key, float]) -> None:
    """Try the neighbours of all lengths that are likely."""
    while True:
        best = max(found.values())
        ends = [key for key, value in found.items() if value > best - UNLIKELY]
        around = {
            (i + STEPS[kink] * di, j + STEPS[kink] * dj, way, kink)
            for i, j, way, kink in ends
            for di, dj in SIDES
        } - set(found)
        new = [key for key in around if min(key) >= 0 and max(key[:2]) < trials.count]
        if not new:
            return
        for key in sorted(new):
            found[key] = trials.evidence(key)


def _slant(trials: Trials, found: dict[Key, float]) -> None:
    """Find the direction of waves that are longer along it than across, where the values tell one.

    A direction that was not known before is one of many, which its evidence pays for.
    """
    equal = max(found, key=lambda key: found[key])
    lengths = (equal[0], max(equal[0] - SLANTED, 0))

    def tried(angle: float) -> float:
        trials.slants[:] = [0.0, angle]
        trials.roots.pop((*lengths, 1, 0), None)
        return trials.evidence((*lengths, 1, 0))

    best, step = _steepest(trials), SLANT_STEP
    top = tried(best)
    while top > found[equal] and step > SLANT_ENOUGH:
        for angle in (best - step, best + step):
            value = tried(angle)
            if value > top:
                best, top = angle, value
                break
        step *= 0.5
    if tried(best) > found[equal]:
        found[(*lengths, 1, 0)] = top
    else:
        del trials.tried[(*lengths, 1, 0)]


def _kink(trials: Trials, found: dict[Key, float]) -> None:
    """Try forms with kinks, such as roofs and narrow dents, from the lengths of smooth ones on: the
    likeliest lengths of such forms are longer."""
    for way, kind in ((0, 1), (1, 1), (1, 2)):
        smooth = [key for key in found if key[2:] == (way, 0)]
        if not smooth:
            continue
        i, j, *_ = max(smooth, key=lambda key: found[key])
        best = -np.inf
        while min(i, j) >= 0:
            key = (i, j, way, kind)
            found[key] = trials.evidence(key)
            if found[key] <= best:
                break
            best, i = found[key], i - STEPS[kind]
            j = max(j - STEPS[kind], 0) if kind == 1 else j


def _steepest(trials: Trials) -> float:
    """Direction of the steepest slopes of the likeliest surface, rad from the first side."""
    one = trials.tried[trials.best]
    v = one.heights[int(np.argmax(one.evidence))] ** 2
    surface = (one.waves @ (v * one.pull / (1.0 + v * one.known))).reshape(trials.side, -1)
    first, second = np.gradient(surface)
    return 0.5 * float(np.arctan2(2.0 * np.sum(first * second), np.sum(first**2 - second**2)))


def _bows(normal: FloatMap, right: FloatMap, side: int, rigid: FloatMap) -> Bows:
    at = (np.arange(side) - 1.0) / (side - 3)
    # The coefficients of the cubic spline that is x².
    powers = (np.ones(side), at, at**2 - 1.0 / (3.0 * (side - 3) ** 2))
    pairs = [(i, j) for i in range(3) for j in range(3 - i)]
    forms = np.column_stack([*(np.kron(powers[i], powers[j]) for i, j in pairs), rigid])
    forms /= np.sqrt(np.einsum("pk,pk->k", forms, normal @ forms)) + np.finfo(float).tiny
    size, turn = np.linalg.eigh(forms.T @ normal @ forms)
    seen = size > NEGLIGIBLE * size[-1]
    return Bows(forms @ turn[:, seen] / np.sqrt(size[seen]), normal, right)


def _smooth(apart: FloatMap) -> FloatMap:
    """How much coefficients have in common, by their distance in lengths of form."""
    return np.asarray(np.exp(-0.5 * apart**2))


def _kinked(apart: FloatMap) -> FloatMap:
    """The same of forms whose slope may jump (Matérn with ν = 3/2; Rasmussen & Williams, ch. 4)."""
    far = np.sqrt(3.0) * np.abs(apart)
    return np.asarray((1.0 + far) * np.exp(-far))


KINDS = ((_smooth, _smooth), (_kinked, _kinked), (_kinked, _smooth))
"""Kinds of form across and along their direction: waves, dents, and ridges with an edge."""


def _root(side: int, length: float, alike: Alike = _smooth) -> FloatMap:
    """Independent parts of the coefficients along one side, (side, r)."""
    at = np.arange(side) / (side - 3)
    size, turn = np.linalg.eigh(alike((at[:, None] - at) / length))
    kept = size > NEGLIGIBLE * size[-1]
    return np.asarray(turn[:, kept] * np.sqrt(size[kept]))


def _slanted(
    side: int, lengths: Sequence[float], slant: float, alike: tuple[Alike, Alike]
) -> FloatMap:
    """Independent parts of the coefficients for lengths along and across a direction, (p, r)."""
    at = np.arange(side) / (side - 3)
    first, second = (one.ravel() for one in np.meshgrid(at, at, indexing="ij"))
    along = (np.cos(slant) * first + np.sin(slant) * second) / lengths[0]
    across = (np.cos(slant) * second - np.sin(slant) * first) / lengths[1]
    common = alike[0](along[:, None] - along) * alike[1](across[:, None] - across)
    size, turn = np.linalg.eigh(common)
    kept = size > NEGLIGIBLE * size[-1]
    return np.asarray(turn[:, kept] * np.sqrt(size[kept]))


def _heights(normal: FloatMap, right: FloatMap) -> FloatMap:
    """Heights of the form that are tried, (h,), mm."""
    weight = float(np.trace(normal))
    stiff = STIFFNESS * weight / len(normal)
    fitted = np.linalg.solve(normal + stiff * np.eye(len(normal)), right)
    size = np.sqrt(np.diag(normal) @ fitted**2 / weight) + np.finfo(float).tiny
    return np.asarray(HIGHEST * size * HEIGHT_RATIO ** -np.arange(float(HEIGHTS)))


def _roughness(waves: FloatMap, normal: FloatMap, right: FloatMap, heights: FloatMap) -> Roughness:
    known, turn = np.linalg.eigh(waves.T @ normal @ waves)
    known = np.maximum(known, 0.0)
    waves = waves @ turn
    pull = waves.T @ right
    v = heights[:, None] ** 2
    gain = 1.0 + v * known
    evidence = 0.5 * np.sum(v * pull**2 / gain - np.log(gain), axis=1)
    # Heights are tried at equal ratios: a uniform prior weighs each by its size.
    return Roughness(waves, known, pull, heights, evidence + np.log(heights))
