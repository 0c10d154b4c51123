"""A projector whose pixels have dark gaps, before a camera that collects light over its pixels.

The simulator shares nothing with ``fringeworks.simulate``: every camera pixel is integrated over its
area in closed form, so that the beat of the two grids appears as it does before real devices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

PARTS = 3
"""Parts per side that a camera pixel is cut into where the grids are turned against each other: the
boxes of nine parts cover a turned square to 2 % of its area."""
REACH_SIGMAS = 4.0
"""Reach of the blur; less than 10⁻⁴ of the light goes farther."""


def flat_view(shape, magnification, *, turned_deg=0.0, tilt=0.0, curved_px=0.0, start=(7.3, 5.6)):
    """Projector columns and rows that camera pixels look at, each (h, w), px.

    ``magnification`` is in camera px per projector px. It falls by ``tilt`` (a share) over the
    frame, and ``curved_px`` lifts the middle of the scene as a sphere does.
    """
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    angle = np.deg2rad(turned_deg)
    u_turned, v_turned = (
        u * np.cos(angle) - v * np.sin(angle),
        u * np.sin(angle) + v * np.cos(angle),
    )
    scale = 1.0 + 0.5 * tilt * u / shape[1]
    middle = ((u / shape[1] - 0.5) ** 2 + (v / shape[0] - 0.5) ** 2) * 4.0
    x = u_turned / magnification * scale + start[0] - curved_px * middle
    y = v_turned / magnification + start[1]
    # All of it lies on the projector, also where the grids are turned.
    return x - min(0.0, x.min() - 4.0), y - min(0.0, y.min() - 4.0)


@dataclass
class PixelGaps:
    """What a camera sees of a projector with square pixels of light and dark gaps between them."""

    x: np.ndarray
    """Projector column at the middle of every camera pixel, (h, w), px."""
    y: np.ndarray
    """Projector row, (h, w), px."""
    size_px: tuple[int, int]
    """Columns and rows of the projector."""
    fill: float = 0.9
    """Lit side of a projector pixel over its pitch."""
    defocus_px: float = 0.0
    """Standard deviation of the blur, projector px."""
    open_side: float = 1.0
    """Side of a camera pixel that collects light, over its pitch."""
    white: float = 0.6
    ambient_light: float = 0.03

    def __post_init__(self):
        self.shape = self.x.shape
        self.ambient = np.full(self.shape, self.ambient_light)
        self._shares = self._matrix()

    def projected(self, light):
        """Light of a picture (rows, columns) on the sensor, (h, w)."""
        return self.white * (self._shares @ light.ravel()).reshape(self.shape)

    def _matrix(self):
        """Share of every projector pixel (columns) in every camera pixel (rows)."""
        slopes = [[self.open_side * g for g in np.gradient(c)[::-1]] for c in (self.x, self.y)]
        turned = max(np.abs(slopes[0][1]).max(), np.abs(slopes[1][0]).max()) > 1e-9
        parts = PARTS if turned else 1
        offsets = (np.arange(parts) + 0.5) / parts - 0.5
        total = 0
        for right in offsets:
            for down in offsets:
                taps = []
                for centre, (along, across), length in zip(
                    (self.x, self.y), slopes, self.size_px, strict=True
                ):
                    place = centre + right * along + down * across
                    wide = (np.abs(along) + np.abs(across)) / parts
                    taps.append(_lit_shares(place, wide, length, self.fill, self.defocus_px))
                total = total + self._sparse(*taps)
        return total / parts**2

    def _sparse(self, columns, rows):
        (column, x_share), (row, y_share) = columns, rows
        index = (row[:, None] * self.size_px[0] + column[None]).reshape(-1, self.x.size)
        share = (y_share[:, None] * x_share[None]).reshape(-1, self.x.size)
        pixel = np.broadcast_to(np.arange(self.x.size), index.shape)
        size = self.x.size, self.size_px[0] * self.size_px[1]
        entries = share.ravel(), (pixel.ravel(), index.ravel())
        return scipy.sparse.csr_array(entries, shape=size)


def _lit_shares(place, wide, length, fill, defocus_px):
    """Numbers of the projector pixels that a box sees, and their shares, each (taps, n)."""
    place, wide = place.ravel(), wide.ravel()
    reach = int(np.ceil(0.5 * wide.max() + 0.5 * fill + REACH_SIGMAS * defocus_px))
    nearest = np.rint(place).astype(int)
    number = nearest + np.arange(-reach, reach + 1)[:, None]
    low, high = place - 0.5 * wide - number, place + 0.5 * wide - number
    half = 0.5 * fill
    area = [_ramp(t + h, defocus_px) for h in (half, -half) for t in (high, low)]
    share = (area[0] - area[1] - area[2] + area[3]) / wide / fill
    return np.clip(number, 0, length - 1), np.where((number >= 0) & (number < length), share, 0.0)


def _ramp(t, sigma):
    """Integral of a blurred step."""
    if sigma == 0:
        return np.maximum(t, 0.0)
    z = t / sigma
    return t * scipy.special.ndtr(z) + sigma * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)


def stack_of(seen, plan, *, noise=1.0, exposure=1.3, seed=0):
    """Frames of a plan, (n, h, w) uint8, by a linear projector."""
    from fringeworks.patterns.encode import encode

    rng = np.random.default_rng(seed)
    top = 2.0**plan.bits - 1.0
    frames = []
    for picture in encode(plan):
        light = seen.projected(np.asarray(picture, float) / top) + seen.ambient
        counts = 255.0 * exposure * light
        counts = counts + np.hypot(noise, 0.1 * np.sqrt(counts)) * rng.standard_normal(counts.shape)
        frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return np.stack(frames)
