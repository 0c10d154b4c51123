"""Windows that neither see through cliffs nor take paint for shape (theory §4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.albedo import (
    albedo_error,
    change,
    edge_weight,
    explained,
    next_albedo,
    paint_edges,
)
from fringeworks.pair.cliffs import NEAR_WALL_PX, Cliffs, find_cliffs
from fringeworks.pair.misfit import is_rare, mean_square, unexplained
from fringeworks.pair.windows import CONFIDENCE, FINEST, Fitted, Windows
from fringeworks.signal.filters import widened
from fringeworks.types import BoolMap, ByteMap

SMALL_WINDOW_PERIODS = 0.5
"""Width of the windows, periods, from which on their estimates follow the surface."""
MAX_PASSES = 3
"""Largest number of times that the albedo is found, with windows between them that know it."""
SETTLED = 0.065
"""Rms change of the albedo near its edges, up to which another pass is not needed. An empirical
choice: later passes change the displacement by less than its σ."""
MIN_EDGE_PIXELS = 20
"""Number of pixels on edges from which the object counts as painted."""
MEDIAN_STEP = 7
"""Every so many values determine a median."""
NORMAL_MEDIAN = 0.6745
"""Median of |z| for a standard normal variable z."""
MIN_EDGE_SHARE = 0.05
"""Number of such pixels over that of those which windows of no size explain. Paint has 0.2 to 0.5;
creases of a surface have up to 0.01."""
MIN_LEFT_SHARE = 0.01
"""Share of them that cliffs must leave unexplained, for paint to be searched."""
CONTINUED_SHARE = 0.8
"""Share of the misfit of a patch that surfaces continued up to a crease must stay below."""
WALL_SIGMA = 2.0
"""Factor of σ of a pixel on a wall over that of the surface that it was given."""


class FitSettings(TypedDict):
    """Keyword options of ``Windows.fit`` that a user chooses."""

    iterations: int
    confidence: float


class Edges(NamedTuple):
    """A pair with paint or cliffs, measured."""

    fitted: Fitted
    albedo: NDArray[np.float32] | None
    """Albedo over that of the reference, (h, w); None without paint."""
    walls: BoolMap | None
    """Pixels on either side of a cliff, (h, w); None without cliffs."""
    explained: BoolMap
    """Where these edges explain the object, (h, w)."""


def across_edges(
    windows: Windows,
    plain: Fitted,
    start_px: NDArray[np.float32],
    widths: Sequence[float],
    *,
    paint: bool = True,
    **settings: Unpack[FitSettings],
) -> Edges | None:
    """Fit windows again that know cliffs and paint, where the object has hard edges of either.

    Parameters
    ----------
    windows : Windows
    plain : Fitted
        What windows of all widths found that know neither.
    start_px : (h, w) float32 array
        Displacement that they started from, px.
    widths : sequence of float
        Widths σ of the windows, px.
    paint : bool
        Whether to search paint; it is not searched where a white frame has shown the albedo.
    **settings
        Of ``Windows.fit``.

    Returns
    -------
    Edges, in which places that are not explained so are those of ``plain``; None where the windows
    explain both frames, or no edge is found.

    Notes
    -----
    With the matching reference s(x − u) and the level c of the object without light over its gain,
    d = β·(c + s). Where windows cross a cliff or an edge of β, they explain neither side; what they
    leave shows where. Cliffs are searched first: there, surfaces from either side explain what no
    smooth one does. β and a smooth correction of u then come from ``joint_albedo``, from windows
    that know β better with every pass.
    """
    paint = paint and windows.albedo is None
    poor = unexplained(plain.misfit, windows.object_noise)
    # Smaller windows follow a crease of the surface, but neither a cliff nor an edge of paint.
    unclear = poor & unexplained(windows.left(plain), windows.object_noise)
    if is_rare(poor) or is_rare(unclear):
        return None
    search = _Search(windows, plain, start_px, widths)
    search.search_cliffs()
    if paint and search.cliffs is not None and not search.cliffs.certain:
        # Paint may look like cliffs, and explains all of these places then.
        other = _Search(windows, plain, start_px, widths)
        other.search_paint(unclear)
        other.continuations_px = [search.cliffs.displacement_px]
        if other.albedo is not None:
            result = other.result(settings)
            if is_rare(poor & ~result.explained):
                return result
    if search.cliffs is not None:
        first = search.cliffs.displacement_px
        search.search_cliffs()
        if not search.cliffs.walls.any():
            # Creases only.
            search.continuations_px = [first, search.cliffs.displacement_px]
            search.cliffs, search.start_px = None, start_px
            search.plain = search.continued(plain, windows.left(plain), settings)
    if search.cliffs is not None:
        least = MIN_LEFT_SHARE * int(np.count_nonzero(unclear))
        unclear &= unexplained(search.cliffs.left, windows.object_noise)
        paint = paint and int(np.count_nonzero(unclear)) > least
    if paint and not is_rare(unclear):
        search.search_paint(unclear)
    if not search.found_paint and search.cliffs is None:
        return None if search.plain is plain else Edges(search.plain, None, None, ~poor)
    return search.result(settings)


class _Search:
    """The search for the edges of a pair: what is known of them, and windows that know it."""

    def __init__(
        self,
        windows: Windows,
        plain: Fitted,
        start_px: NDArray[np.float32],
        widths: Sequence[float],
    ) -> None:
        self.windows = windows.above_dark()
        self.plain = plain
        self.widths = list(widths)
        self.first_start_px = self.start_px = start_px
        self.albedo = windows.albedo
        self.cliffs: Cliffs | None = None
        self.continuations_px: list[NDArray[np.float32]] = []
        self.small = next(
            (k for k, w in enumerate(widths) if w <= SMALL_WINDOW_PERIODS * windows.period_px),
            len(widths) - 1,
        )

    @property
    def walls(self) -> ByteMap | None:
        return None if self.cliffs is None else self.cliffs.walls.astype(np.uint8)

    @property
    def found_paint(self) -> bool:
        """Whether there is an albedo that no white frame has shown."""
        return self.albedo is not None and self.windows.albedo is None

    def fit(self, widths: Sequence[float], **settings: Unpack[FitSettings]) -> Fitted:
        """Windows that know what is known."""
        return self.windows.fit(
            self.start_px, widths, albedo=self.albedo, walls=self.walls, **settings
        )

    def search_cliffs(self) -> Fitted:
        """Search walls with windows that know what is known, and return what these found."""
        found = self.fit(self.widths[: self.small + 1], iterations=1, confidence=FINEST)
        self.cliffs = find_cliffs(
            self.windows,
            found,
            self.start_px,
            self.widths[self.small],
            albedo=self.albedo,
            edge_weight=None if self.albedo is None else edge_weight(self.albedo),
            before=self.cliffs,
        )
        self.start_px = self.first_start_px
        if self.cliffs is not None:
            self.start_px = self.cliffs.start_from(self.first_start_px, self.widths[0])
        return found

    def continued(self, found: Fitted, left: NDArray[np.float32], settings: FitSettings) -> Fitted:
        """Small windows that start from the surfaces on either side of a crease, where they leave
        less than what was found."""
        near_paint = np.zeros(left.shape, bool)
        if self.albedo is not None:
            near_paint = widened(paint_edges(self.albedo), int(0.5 * self.windows.period_px))
        before = mean_square(left)
        for start_px in self.continuations_px:
            again = self.windows.fit(
                start_px, self.widths[self.small :], albedo=self.albedo, **settings
            )
            determined = np.isfinite(again.displacement_px)
            again = again._replace(
                scale=np.where(determined, again.scale + self.small, again.scale)
            )
            after = mean_square(self.windows.left(again, self.albedo))
            better = determined & (after < CONTINUED_SHARE * before) & ~near_paint
            better |= ~np.isfinite(found.displacement_px)
            found = found.replaced(again, better)
            before = np.where(better, after, before)
        return found

    def search_paint(self, unclear: BoolMap) -> None:
        """Find the albedo of places that are not clear, with windows that know it better with every
        pass."""
        min_edge_pixels = MIN_EDGE_SHARE * int(np.count_nonzero(unclear))
        # The smallest windows add noise only; the edges are known by then.
        fine = self.widths[: self.small + 2]
        misfit = self.plain.misfit.flat[::MEDIAN_STEP]
        scatter = float(np.nanmedian(np.abs(misfit))) / NORMAL_MEDIAN
        found = self.fit(self.widths[:1], iterations=1, confidence=CONFIDENCE)
        for _ in range(MAX_PASSES):
            u = np.where(np.isfinite(found.displacement_px), found.displacement_px, self.start_px)
            if self.cliffs is not None:
                u = np.where(self.cliffs.near, self.cliffs.displacement_px, u)
            before = self.albedo
            self.albedo = next_albedo(self.windows, found, u, before, scatter, self.cliffs)
            edges = int(np.count_nonzero(paint_edges(self.albedo)))
            if edges < max(min_edge_pixels, MIN_EDGE_PIXELS):
                self.albedo = None
                return
            if before is not None and change(before, self.albedo) < SETTLED:
                break
            if self.cliffs is None:
                found = self.fit(fine, iterations=1, confidence=CONFIDENCE)
            else:
                found = self.search_cliffs()

    def result(self, settings: FitSettings) -> Edges:
        """Windows of all widths that know the edges, where they explain the object; where an albedo
        does not, those that know the cliffs only."""
        found, better = self.judged(settings)
        walls = None if self.cliffs is None else self.cliffs.walls & better
        edges = Edges(self.plain.replaced(found, better), self.albedo, walls, better)
        if walls is None or not self.found_paint or is_rare(~better):
            return edges
        self.albedo = None
        other = self.result(settings)
        assert other.walls is not None
        return Edges(
            other.fitted.replaced(found, better),
            edges.albedo,
            walls | (other.walls & ~better),
            better | other.explained,
        )

    def judged(self, settings: FitSettings) -> tuple[Fitted, BoolMap]:
        """Windows of all widths that know the edges, and where they explain the object."""
        found = self.fit(self.widths, **settings)
        if self.continuations_px:
            found = self.continued(found, self.windows.left(found, self.albedo), settings)
        mixed = None
        if self.cliffs is not None:
            found = _on_walls(self.windows, found, self.cliffs, self.albedo)
            mixed = widened(self.cliffs.walls, NEAR_WALL_PX)
        better = explained(self.windows, found, self.plain.misfit, self.albedo, mixed)
        if self.albedo is not None and self.found_paint:
            error = albedo_error(self.plain, found, self.windows.period_px)
            if self.cliffs is not None:
                error = np.where(self.cliffs.zone, np.float32(0), error)
            found = found._replace(
                modulation_ratio=self.albedo * found.modulation_ratio,
                sigma_px=np.sqrt(found.sigma_px**2 + error),
            )
        return found, better


def _on_walls(
    windows: Windows, found: Fitted, cliffs: Cliffs, albedo: NDArray[np.float32] | None
) -> Fitted:
    """Give pixels on walls the surface of the side that explains them better."""
    beta = np.float32(1) if albedo is None else albedo
    side = _core.wall_sides(
        windows.pair,
        {
            "displacement": found.displacement_px,
            "offset": beta * found.offset,
            "gain": beta * found.modulation_ratio,
        },
        cliffs.walls.astype(np.uint8),
    )
    from_side = found._replace(
        displacement_px=found.displacement_px.flat[side],
        sigma_px=np.float32(WALL_SIGMA) * found.sigma_px.flat[side],
        modulation_ratio=found.modulation_ratio.flat[side],
        offset=found.offset.flat[side],
        scale=found.scale.flat[side],
    )
    return found.replaced(from_side, side >= 0)
