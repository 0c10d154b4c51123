"""Noise that neighbouring pixels share, estimated together with the form of an area."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.evaluate.tolerances.splines import LADDER, ORDER, design_of
from fringeworks.types import FloatMap

MOST = 2304
"""Number of pixels that tell the correlation, from the middle of an area: 48 × 48. Correlations are
then known to 0.02, and the estimate takes less time than the surface itself."""
LEAST = 64
"""Number of pixels that an estimate needs: four to each coefficient of the coarsest spline."""
INTERVALS = 11
"""Largest number of intervals of the spline that holds the form beside the noise. Form that is
finer would count as noise, and its variance then tells it from the stated one."""
LENGTHS = (3.0, 1.5, 0.75, 0.38, 0.19, 0.1)
"""Lengths of form that are tried, in sides of the pixels' square."""
HEIGHTS = 2.0 ** np.arange(-8.0, 14.0)
"""Heights of form that are tried, in standard deviations of the noise."""
UNKNOWN = 1e3
"""Prior standard deviation of bows, in standard deviations of the noise: nothing is known."""
BEFORE = np.array(
    [(0, c) for c in (-1, -2, -3)]
    + [(-1, c) for c in range(-3, 4)]
    + [(-2, c) for c in range(-2, 3)]
    + [(-3, c) for c in range(-1, 2)]
)
"""Rows and columns of the pixels before each pixel, that predict its noise: all within three."""
REACHES = (0.35, 0.5, 0.7, 1.0, 1.4)
"""Blurs of the noise that are tried first, px."""
APART = 0.03
"""Share of the noise that is not blurred, first."""
STEPS = 45
"""Largest number of evidences in the search for the blurs and the share. The estimate by lags that
follows does not need them better than to a twentieth."""
SEEN = 2
"""Largest distance of pixels, in rows and columns, whose correlation is that of the values. Farther
ones have that of the blur: 24 correlations are few beside ``MOST`` pixels."""
FARTHEST = 6
"""Largest distance of pixels that have noise in common: a blur of 1.5 px has 0.02 there."""
LEAST_POWER = 1e-2
"""Smallest spectral density of the noise, relative to the mean: estimated correlations may leave
negative ones by chance."""
JITTER = 1e-6
"""Share of independent noise that keeps equations of blurred noise solvable."""
MOST_LEVEL = 2.0
"""Largest variance, relative to the stated one, that counts as noise. What exceeds it may be a fine
texture of the surface, which is form; up to it, a texture is smaller than the noise itself."""


@dataclass(frozen=True)
class Neighbours:
    """Noise that neighbouring pixels share."""

    level: float
    """Variance of a pixel, relative to the stated one."""
    common: FloatMap
    """Correlation by the distance in rows and columns, from −k to k, (2k + 1, 2k + 1)."""

    @property
    def total(self) -> float:
        """Sum of the correlations: factor of the variance of a mean over many pixels."""
        return float(self.common.sum())

    @property
    def factor(self) -> float:
        """Factor of the stated variance. Near 1, it is not below 1: the form may hide a part
        of the noise. Where most of the noise is missing, it was stated too large."""
        return max(self.level, 1.0) if self.level * MOST_LEVEL > 1.0 else self.level

    def between(self, design: scipy.sparse.csr_matrix, pixel: NDArray[np.intp]) -> FloatMap:
        """Return the covariance of sums of the noise of pixels, weighted by a design (n, p)."""
        shared = correlations(pixel, self.common)
        return np.asarray((design.T @ (shared @ design)).toarray())

    def variance(self, pixel: NDArray[np.intp], weights: FloatMap) -> float:
        """Return the variance of a sum of the noise of pixels, of variance 1 each, by weights."""
        image = np.zeros(np.ptp(pixel, axis=0) + 1)
        row, column = (pixel - pixel.min(axis=0)).T
        image[row, column] = weights
        around = scipy.signal.fftconvolve(image, self.common, mode="same")
        return float(weights @ around[row, column])

    def draw(self, pixel: NDArray[np.intp], random: np.random.Generator) -> FloatMap:
        """Return noise of variance 1 at pixels, (n,)."""
        shape = np.ptp(pixel, axis=0) + len(self.common)
        far = len(self.common) // 2
        common = np.zeros(shape)
        common[: len(self.common), : len(self.common)] = self.common
        common = np.roll(common, (-far, -far), (0, 1))
        size = np.sqrt(np.maximum(np.fft.rfft2(common).real, 0.0))
        found = np.fft.irfft2(np.fft.rfft2(random.normal(size=shape)) * size, shape)
        row, column = (pixel - pixel.min(axis=0)).T
        return np.asarray(found[row, column])


def correlations(pixel: NDArray[np.intp], common: FloatMap) -> scipy.sparse.csr_matrix:
    """Return the correlations between pixels (n, 2) by those of their distances, (n, n)."""
    far = len(common) // 2
    table = _numbers(pixel, far)
    row, column = (pixel - pixel.min(axis=0) + far).T
    found = []
    for dr, dc in np.argwhere(np.abs(common) > JITTER) - far:
        other = table[row + dr, column + dc]
        at = np.flatnonzero(other >= 0)
        found.append((np.full(len(at), common[dr + far, dc + far]), at, other[at]))
    value, first, second = (np.concatenate(one) for one in zip(*found, strict=True))
    size = (len(pixel), len(pixel))
    return scipy.sparse.csr_matrix((value, (first, second)), size)


def _numbers(pixel: NDArray[np.intp], far: int) -> NDArray[np.intp]:
    """The number of the pixel at each row and column, −1 elsewhere, with a border."""
    row, column = (pixel - pixel.min(axis=0) + far).T
    table = np.full((int(row.max()) + far + 1, int(column.max()) + far + 1), -1)
    table[row, column] = np.arange(len(pixel))
    return table


def _pairs(
    pixel: NDArray[np.intp],
) -> Iterator[tuple[int, int, NDArray[np.intp], NDArray[np.intp]]]:
    """Each distance in rows and columns up to ``SEEN``, and the pairs of pixels that have it."""
    table = _numbers(pixel, SEEN)
    row, column = (pixel - pixel.min(axis=0) + SEEN).T
    for dr in range(SEEN + 1):
        for dc in range(-SEEN if dr else 1, SEEN + 1):
            other = table[row + dr, column + dc]
            one = np.flatnonzero(other >= 0)
            if len(one) >= LEAST:
                yield dr, dc, one, other[one]


class _Blur(NamedTuple):
    """Independent noise that a Gaussian has blurred, beside noise that it has not."""

    down: float
    """Standard deviation of the blur from row to row, px."""
    across: float
    """Standard deviation of the blur from column to column, px."""
    apart: float
    """Share of the variance that is not blurred."""

    def common(self, steps: FloatMap) -> FloatMap:
        """Return the correlations by steps (…, 2) in rows and columns."""
        size = np.array((self.down, self.across)) * 2.0
        blurred = np.exp(-np.sum((steps / size) ** 2, axis=-1))
        return np.where(np.any(steps != 0, axis=-1), (1.0 - self.apart) * blurred, 1.0)


class _Found(NamedTuple):
    """A form and noise that explain values."""

    worse: float
    """−2 times the logarithm of the evidence."""
    length: int
    """Number of the form's length."""
    height: float
    """Height of the form, in standard deviations of the noise."""
    level: float
    """Variance of the noise, relative to the stated one."""


class _Field:
    """Values of pixels, over their stated noise, and the forms that they may have."""

    def __init__(self, pixel: NDArray[np.intp], values: FloatMap, sigma: FloatMap) -> None:
        low, span = pixel.min(axis=0), np.maximum(np.ptp(pixel, axis=0), 1)
        sides = [k for k in LADDER if k <= INTERVALS and 4 * (k + ORDER - 1) ** 2 <= len(values)]
        k = max(sides)
        self.pixel = pixel
        plain = design_of((pixel - low) / span, k)
        self.values = _level(pixel, values / sigma, 1.0 / sigma)
        # Coefficients in standard deviations of the noise.
        self.design = scipy.sparse.csr_matrix(plain.multiply(np.median(sigma) / sigma[:, None]))
        side = k + ORDER - 1
        self.waves = []
        for one in LENGTHS:
            root = _waves(side, one)
            self.waves.append(np.kron(root, root))
        at = (np.arange(side) - 1.0) / (side - 3)
        powers = (np.ones(side), at, at**2 - 1.0 / (3.0 * (side - 3) ** 2))
        pairs = [(i, j) for i in range(3) for j in range(3 - i)]
        self.bows = UNKNOWN * np.column_stack([np.kron(powers[i], powers[j]) for i, j in pairs])
        far = int(np.abs(BEFORE).max())
        table = _numbers(pixel, far)
        row, column = (pixel - low + far).T
        self.before = np.stack([table[row + r, column + c] for r, c in BEFORE], axis=1)
        self.patterns, number = np.unique(self.before >= 0, axis=0, return_inverse=True)
        self.pattern = number.ravel()

    def whitening(self, blur: _Blur | None) -> tuple[scipy.sparse.csr_matrix, float]:
        """Return what makes blurred noise independent, (n, n), and the logarithm of the determinant
        of its covariance.

        Notes
        -----
        Each pixel's noise is predicted by that of the pixels near it that come before it
        (Vecchia, J. R. Stat. Soc. B 50, 1988).
        """
        n = len(self.values)
        if blur is None:
            return scipy.sparse.identity(n, format="csr"), 0.0
        steps = BEFORE.astype(float)
        there = self.patterns
        both = (there[:, :, None] & there[:, None]) * blur.common(steps[:, None] - steps)
        every = np.arange(len(BEFORE))
        both[:, every, every] = 1.0 + JITTER
        to = there * blur.common(steps)
        weight = np.linalg.solve(both, to[:, :, None])[:, :, 0]
        left = np.maximum(1.0 + JITTER - np.sum(weight * to, axis=1), JITTER)[self.pattern]
        size = -weight[self.pattern] / np.sqrt(left)[:, None]
        seen = self.before >= 0
        first = np.nonzero(seen)[0]
        entries = np.concatenate((1.0 / np.sqrt(left), size[seen]))
        places = np.append(np.arange(n), first), np.append(np.arange(n), self.before[seen])
        found = scipy.sparse.csr_matrix((entries, places), (n, n))
        return found, float(np.sum(np.log(left)))

    def equations(self, blur: _Blur | None) -> tuple[FloatMap, FloatMap, float, float]:
        """Return both sides of the equations of the coefficients, the sum of the squares of the
        values, and the logarithm of the determinant of the noise."""
        white, volume = self.whitening(blur)
        design, values = (white @ self.design).toarray(), white @ self.values
        return design.T @ design, design.T @ values, float(values @ values), volume

    def explained(self, blur: _Blur | None, lengths: range) -> _Found:
        """Return the likeliest form beside noise of a blur."""
        normal, right, squares, volume = self.equations(blur)
        seen = normal @ self.bows
        own = self.bows.T @ seen + np.eye(self.bows.shape[1])
        solved = np.linalg.solve(own, np.column_stack((seen.T, self.bows.T @ right)))
        normal, right_freed = normal - seen @ solved[:, :-1], right - seen @ solved[:, -1]
        squares -= float(right @ self.bows @ solved[:, -1])
        volume += float(np.linalg.slogdet(own)[1])
        free = len(self.values) - self.bows.shape[1]
        found = []
        for number in lengths:
            waves = self.waves[number]
            known, turn = np.linalg.eigh(waves.T @ normal @ waves)
            pull = turn.T @ (waves.T @ right_freed)
            gain = 1.0 + HEIGHTS[:, None] ** 2 * np.maximum(known, 0.0)
            left = squares - np.sum(HEIGHTS[:, None] ** 2 * pull**2 / gain, axis=1)
            left = np.maximum(left, np.finfo(float).eps * squares) / free
            worse = free * np.log(left) + np.sum(np.log(gain), axis=1) + volume
            best = int(np.argmin(worse))
            found.append(
                _Found(float(worse[best]), number, float(HEIGHTS[best]), float(left[best]))
            )
        return min(found)

    def by_lags(self, blur: _Blur, form: _Found) -> tuple[float, FloatMap]:
        """Return the variance of the noise and its correlations.

        Notes
        -----
        A step of expectation-maximisation: the covariance of two pixels is the mean product of what
        the likeliest form leaves of them, and the covariance of the form there.
        """
        normal, right, squares, _ = self.equations(blur)
        root = np.column_stack((form.height * self.waves[form.length], self.bows))
        lower = np.linalg.cholesky(root.T @ normal @ root + np.eye(root.shape[1]))
        posterior = scipy.linalg.solve_triangular(lower, root.T, lower=True)
        mean = posterior.T @ (posterior @ right)
        free = len(self.values) - self.bows.shape[1]
        level = max(squares - float(right @ mean), 0.0) / free
        left = self.values - self.design @ mean
        unsure = np.sqrt(level) * np.asarray(self.design @ posterior.T)
        common = blur.common(np.mgrid[2 * (slice(-FARTHEST, FARTHEST + 1.0),)].transpose(1, 2, 0))
        variance = float(np.mean(left**2) + np.mean(np.sum(unsure**2, axis=1)))
        for dr, dc, one, other in _pairs(self.pixel):
            products = left[one] * left[other]
            products += np.einsum("nk,nk->n", unsure[one], unsure[other])
            value = float(products.mean()) / variance
            common[FARTHEST + dr, FARTHEST + dc] = common[FARTHEST - dr, FARTHEST - dc] = value
        return variance, _possible(common)


def _level(pixel: NDArray[np.intp], values: FloatMap, weights: FloatMap) -> FloatMap:
    """Values without the bow of least squares: bows of any size are then within ``UNKNOWN``."""
    row, column = ((pixel - pixel.mean(axis=0)) / np.maximum(np.ptp(pixel, axis=0), 1)).T
    bows = np.stack([row**i * column**j for i in range(3) for j in range(3 - i)], axis=-1)
    bows *= weights[:, None]
    return np.asarray(values - bows @ np.linalg.lstsq(bows, values, rcond=None)[0])


def _waves(side: int, length: float) -> FloatMap:
    """Independent parts of a form of a length along one side, (side, r)."""
    at = np.arange(side) / (side - 3)
    size, turn = np.linalg.eigh(np.exp(-0.5 * ((at[:, None] - at) / length) ** 2))
    kept = size > JITTER * size[-1]
    return np.asarray(turn[:, kept] * np.sqrt(size[kept]))


def _possible(common: FloatMap) -> FloatMap:
    """Correlations near given ones that noise can have: without negative power."""
    size = 4 * len(common)
    wide = np.pad(common, (size - len(common) + 1) // 2)[:size, :size]
    power = np.fft.fft2(np.fft.ifftshift(wide))
    return common if power.real.min() > LEAST_POWER else _clipped(common, power.real)


def _clipped(common: FloatMap, power: FloatMap) -> FloatMap:
    found = np.fft.fftshift(np.fft.ifft2(np.maximum(power, LEAST_POWER)).real)
    middle, far = len(found) // 2, len(common) // 2
    found = found[middle - far : middle + far + 1, middle - far : middle + far + 1]
    return np.asarray(found / found[far, far])


def neighbours(pixel: NDArray[np.intp], values: FloatMap, sigma: FloatMap) -> Neighbours | None:
    """Return the noise that neighbouring pixels share; None where the values do not tell any, and
    where it is far larger than was stated.

    Parameters
    ----------
    pixel : (n, 2) array
        Rows and columns.
    values : (n,) array, mm
    sigma : (n,) array
        Stated standard deviation of each, mm.

    Notes
    -----
    Independent noise that was blurred by a Gaussian, from row to row and from column to column,
    beside noise that was not, and a form that is a Gaussian process with bows: those of the
    greatest evidence (Rasmussen & Williams, 2006, ch. 5). More than independent noise counts where
    its evidence pays for three more unknowns (Schwarz, Ann. Statist. 6, 1978). JPEG and demosaicing
    are no blurs: the correlations of close pixels are those of the values, see ``by_lags``.
    """
    if len(values) < LEAST or not np.any(values - values[0]):
        return None
    middle = pixel[np.argmin(np.sum((pixel - pixel.mean(axis=0)) ** 2, axis=1))]
    near = np.argsort(np.abs(pixel - middle).max(axis=1), kind="stable")[:MOST]
    field = _Field(pixel[near], values[near], sigma[near])
    every = range(len(LENGTHS))
    alone = field.explained(None, every)
    tried = {}
    for reach in REACHES:
        blur = _Blur(reach, reach, APART)
        tried[blur] = field.explained(blur, every)
        if tried[blur].worse > min(tried.values()).worse:
            break
    blur = min(tried, key=lambda one: tried[one])
    form = tried[blur]
    price = 3.0 * np.log(len(near))
    if form.worse > alone.worse + price:
        return None
    lengths = range(max(form.length - 1, 0), min(form.length + 2, len(LENGTHS)))
    blur = _likeliest(blur, lambda one: field.explained(one, lengths).worse)
    form = field.explained(blur, every)
    if form.worse > alone.worse - price or form.level > MOST_LEVEL:
        return None
    found = Neighbours(*field.by_lags(blur, form))
    # Less than the stated, independent noise is no noise of its own: rounding, as of perfect data.
    told = found.level < MOST_LEVEL and found.factor * found.total > 1.0
    return found if told else None


def _likeliest(first: _Blur, worse: Callable[[_Blur], float]) -> _Blur:
    """The blur of the greatest evidence, near a first one."""

    def blur(x: FloatMap) -> _Blur:
        down, across = np.exp(np.clip(x[:2], -3.0, 1.0))
        return _Blur(float(down), float(across), float(1.0 / (1.0 + np.exp(-x[2]))))

    start = [np.log(first.down), np.log(first.across), np.log(first.apart)]
    start_simplex = np.array([start, *(start + step for step in np.diag((0.3, 0.3, 2.0)))])
    options = {"maxfev": STEPS, "xatol": 0.03, "fatol": 0.5, "initial_simplex": start_simplex}
    found = scipy.optimize.minimize(
        lambda x: worse(blur(x)), start, method="Nelder-Mead", options=options
    )
    return blur(found.x)
