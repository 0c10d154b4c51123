"""Surfaces beside a cliff: planes that are offered to pixels which windows have smeared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.misfit import mean_square, usual_noise
from fringeworks.pair.windows import Fitted, Windows
from fringeworks.signal.filters import box_mean, median_of_nine, widened
from fringeworks.types import BoolMap

IMPROVEMENT = 0.6
"""Share of the present misfit of a patch that another surface must stay below. An empirical choice:
nearer to 1, noise would move pixels."""
CLEAN_NOISE = 2.0
"""Mean squared misfit up to which a place is explained, in variances of the usual noise."""
CLEAN_SHARE = 1e-4
"""The same as a share of the squared modulation, on frames without noise."""
CLEAN_PX = 11
"""Side of the squares that must be explained around a pixel whose surface is offered."""
STEEP, STEEP_WIDTHS = 0.4, 3
"""Slope of the displacement beyond that of its surroundings, px per px, from which it may be a
cliff that windows have smeared; and how far these reach, in widths of the window."""
PAINT_EDGE = 0.3
"""Price of an edge of the albedo below which its surface is not offered."""
REACH_WIDTHS, REACH_PX = 4, 8
"""Largest distance of a surface that is offered: so many widths of the window, and px."""
MARGINS_PX, BASES_PX = (6, 3), (8, 5)
"""Distance behind the first explained pixel at which a surface is taken, and base of its slopes,
px: when the windows have smeared the cliff, and when they know where it is."""
MAX_CHANGE_PERIODS = 0.5
"""Largest correction of a displacement: a larger one would change the fringe order."""
SAME_PERIODS = 1.0 / 300.0
"""Difference up to which two surfaces at a pixel count as the same one."""


class Surfaces(NamedTuple):
    """A model of the object frame; (h, w) maps. It shows offset + gain · s(x − u)."""

    u: NDArray[np.float32]
    """Displacement, px; finite."""
    offset: NDArray[np.float32]
    gain: NDArray[np.float32]

    @staticmethod
    def of(
        found: Fitted, start_px: NDArray[np.float32], albedo: NDArray[np.float32] | None
    ) -> Surfaces:
        """What windows found, and a start where they found nothing."""
        known = np.isfinite(found.displacement_px)
        offset = np.where(known, found.offset, np.float32(0))
        gain = np.where(known, found.modulation_ratio, np.float32(1))
        if albedo is not None:
            offset, gain = albedo * offset, albedo * gain
        return Surfaces(np.where(known, found.displacement_px, start_px), offset, gain)

    def left(self, windows: Windows) -> NDArray[np.float32]:
        """What the model leaves of the object, (h, w), in modulations; NaN without data."""
        value, _, known = windows.warp(self.u)
        left = windows.object - self.offset - self.gain * value
        return np.where(known > 0, left, np.float32(np.nan))


@dataclass(frozen=True, eq=False)
class Offers:
    """The surfaces that are explained, and what a pixel must gain to take one of them."""

    windows: Windows
    surfaces: Surfaces
    clean: BoolMap
    """Where a surface is explained, and offered to others."""
    most: NDArray[np.float32]
    """Mean squared misfit of a patch that an offer must stay below."""
    width_px: float
    """Width of the windows that found the surfaces."""
    is_first: bool
    """Whether these windows did not know where cliffs are."""

    @staticmethod
    def of(
        windows: Windows,
        surfaces: Surfaces,
        left: NDArray[np.float32],
        width_px: float,
        edge_weight: NDArray[np.float32] | None,
        is_first: bool,
    ) -> Offers:
        """Find what is explained by what the surfaces leave; edges of the albedo are not."""
        patches = mean_square(left)
        noise = CLEAN_NOISE * usual_noise(patches, windows.object_noise) + CLEAN_SHARE
        rough = _steep(surfaces.u, width_px)
        if edge_weight is not None:
            rough |= edge_weight < PAINT_EDGE
        clean = (mean_square(left, CLEAN_PX) < noise) & np.isfinite(left)
        clean &= ~widened(rough, 3 if is_first else 1)
        most = np.maximum(np.float32(IMPROVEMENT) * patches, np.float32(noise))
        return Offers(windows, surfaces, clean, most, width_px, is_first)

    def taken(self, where: BoolMap) -> Surfaces:
        """The surfaces after pixels that are not clean have taken the best offers."""
        windows = self.windows
        return Surfaces(
            *_core.relocate_surfaces(
                windows.pair,
                {
                    "displacement": self.surfaces.u,
                    "offset": self.surfaces.offset,
                    "gain": self.surfaces.gain,
                },
                {
                    "clean": self.clean.astype(np.uint8),
                    "present": np.where(where & ~self.clean, self.most, np.float32(0)),
                    "reach": int(REACH_WIDTHS * self.width_px) + REACH_PX,
                    "margin": MARGINS_PX[0 if self.is_first else 1],
                    "base": BASES_PX[0 if self.is_first else 1],
                    "max_change": MAX_CHANGE_PERIODS * windows.period_px,
                    "same": SAME_PERIODS * windows.period_px,
                },
            )
        )

    def continued(self, where: BoolMap) -> Surfaces:
        """The same without single pixels that took another surface than those around them."""
        taken = self.taken(where)
        median = median_of_nine(taken.u)
        return taken._replace(u=np.where(where & ~self.clean, median, taken.u))


def _steep(u: NDArray[np.float32], width_px: float) -> BoolMap:
    """Where the displacement is much steeper than around."""
    side = 2 * int(STEEP_WIDTHS * width_px) + 1
    steep = np.zeros(u.shape, bool)
    for axis in (0, 1):
        slope: NDArray[np.float32] = np.gradient(u, axis=axis)
        around = box_mean(slope, side, "edge")
        steep |= np.abs(slope - around) > STEEP
    return steep
