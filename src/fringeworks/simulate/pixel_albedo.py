"""Albedo of the bodies in a view, averaged over every camera pixel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.simulate.bodies import Body
from fringeworks.types import FloatMap

COARSE_SAMPLES = 8
"""Number of points of a pixel at which a varying albedo is sampled everywhere: enough to notice an
edge in the pixel or its neighbours."""
DENSE_SAMPLES = 144
"""Number of points of a pixel at which the albedo is sampled near edges. The positions of edges are
then true to 0.004 px, as the tests require: calibration finds corners to about that."""
GOLDEN_SECTION = 0.618
"""Step of the sample lattice over the number of samples: near the golden section, points spread
evenly over the pixel."""


def pixel_albedo(bodies: Sequence[Body], world: FloatMap, body: NDArray[np.int32]) -> FloatMap:
    """Compute the mean reflectance over every pixel.

    Parameters
    ----------
    bodies : sequence of Body
    world : (h, w, 3) array
        What the pixels' centres see, in world coordinates, mm.
    body : (h, w) int array
        Number of the body that each pixel sees; −1 for none.

    Returns
    -------
    (h, w) array, 0…1; 0 where no body is seen.
    """
    albedo = np.zeros(body.shape)
    for k, item in enumerate(bodies):
        seen = body == k
        if not callable(item.albedo):
            albedo[seen] = item.albedo
        elif seen.any():
            rows, columns = (slice(c.min(), c.max() + 1) for c in np.nonzero(seen))
            part = seen[rows, columns]
            surface = np.zeros((*part.shape, 2))
            surface[part] = item.local(world[rows, columns][part])[:, :2]
            albedo[rows, columns][part] = _mean_albedo(item.albedo, surface)[part]
    return albedo


def _mean_albedo(
    albedo_at: Callable[[FloatMap, FloatMap], FloatMap], surface: FloatMap
) -> FloatMap:
    """Mean over every pixel of an albedo that depends on the surface's x and y, (h, w)."""
    down, across = _change_per_pixel(surface, 0), _change_per_pixel(surface, 1)
    samples = [albedo_at(*_at(surface, across, down, a, b)) for a, b in _lattice(COARSE_SAMPLES)]
    mean = np.mean(samples, axis=0)
    # An edge may lie between the few points, so pixels beside a varying one count as well.
    near_edge = scipy.ndimage.maximum_filter(
        np.max(samples, axis=0), 3
    ) > scipy.ndimage.minimum_filter(np.min(samples, axis=0), 3)
    here = (surface[near_edge], across[near_edge], down[near_edge])
    # The same lattice would err alike in all pixels along an edge. Shifted at random in every
    # pixel, its errors average out.
    shift_a, shift_b = np.random.default_rng(0).random((2, int(near_edge.sum())))
    total = np.zeros(shift_a.size)
    for a, b in _lattice(DENSE_SAMPLES):
        total += albedo_at(
            *_at(*here, (a + shift_a + 0.5) % 1.0 - 0.5, (b + shift_b + 0.5) % 1.0 - 0.5)
        )
    mean[near_edge] = total / DENSE_SAMPLES
    return np.asarray(mean)


def _lattice(n: int) -> Iterator[tuple[float, float]]:
    """n points of a unit square about 0, one in each of n rows and n columns."""
    step = next(m for m in range(round(GOLDEN_SECTION * n), n + 1) if math.gcd(m, n) == 1)
    for k in range(n):
        yield (k + 0.5) / n - 0.5, (k * step % n + 0.5) / n - 0.5


def _at(
    surface: FloatMap, across: FloatMap, down: FloatMap, a: Any, b: Any
) -> tuple[FloatMap, FloatMap]:
    """x and y on the surface at the fractions (a, b) of a pixel from its centre."""
    x, y = (surface[..., k] + a * across[..., k] + b * down[..., k] for k in (0, 1))
    return x, y


def _change_per_pixel(surface: FloatMap, axis: int) -> FloatMap:
    """Change of the surface's x and y from pixel to pixel along an axis."""
    if surface.shape[axis] < 2:
        return np.zeros_like(surface)
    return np.asarray(np.gradient(surface, axis=axis))
