"""Windows that neither see through cliffs nor take paint for shape (theory §4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
from fringeworks.pair.windows import (
    CONFIDENCE,
    FINEST,
    Fitted,
    Windows,
    is_rare,
    mean_square,
    unexplained,
)
from fringeworks.signal.filters import box_mean, widened
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
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
MIN_EDGE_SHARE = 0.05
"""Number of such pixels over that of those which windows of no size explain. Paint has 0.2 to 0.5;
creases of a surface have up to 0.01."""
MIN_LEFT_SHARE = 0.01
"""Share of them that cliffs must leave unexplained, for paint to be searched."""
CONTINUED_SHARE = 0.8
"""Share of the misfit of a patch that surfaces continued up to a crease must stay below."""
REACH_PERIODS = 2.0
"""Distance from what windows leave up to which an albedo is used, periods. At low contrast, an
albedo takes over a part of the fringes, which displaces a plane by its σ. An empirical choice."""
KEPT_OF_START = 0.5
"""Error of a displacement beside paint, over what the windows have changed of their start.

An albedo that was found with the start explains a part of its errors. In a scene with paint and a
step of a fifth of a period, 3.6 % of the errors lie beyond 5 σ without this part, 1.5 % with 0.3,
and 0.8 % with 0.6.
"""
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

    Of several explanations, the one with fewer kinds of edges is chosen where its misfit is rare.
    """
    poor = unexplained(plain.misfit, windows.object_noise)
    # Smaller windows follow a crease of the surface, but neither a cliff nor an edge of paint.
    left = windows.left(plain)
    unclear = poor & unexplained(left, windows.object_noise)
    if is_rare(poor) or is_rare(unclear):
        return None
    pair = _Pair(windows.above_dark(), start_px, tuple(widths), settings, left, poor, unclear)
    smooth, edges = Explanation(plain, start_px, windows.albedo), None
    for candidate in pair.candidates(smooth, paint and windows.albedo is None):
        edges = pair.measured(candidate)
        if is_rare(poor & ~edges.explained):
            break
    return edges


@dataclass(frozen=True, eq=False)
class Explanation:
    """What may explain the object: smooth surfaces alone, cliffs, paint, or both."""

    plain: Fitted
    """What windows found that know neither; it stays where this does not explain the object."""
    start_px: NDArray[np.float32]
    """Displacement that windows start from, px."""
    albedo: NDArray[np.float32] | None = None
    """Albedo, found or shown by a white frame; None where it counts as constant."""
    cliffs: Cliffs | None = None
    creases_px: tuple[NDArray[np.float32], ...] = ()
    """Displacements with the surfaces on either side continued up to creases, px."""

    @property
    def walls(self) -> ByteMap | None:
        return None if self.cliffs is None else self.cliffs.walls.astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Pair:
    """A pair whose object has edges, and the windows that measure it."""

    windows: Windows
    start_px: NDArray[np.float32]
    """Displacement that windows start from which know no cliffs, px."""
    widths: tuple[float, ...]
    settings: FitSettings
    left: NDArray[np.float32]
    """What windows of all widths that know no edges leave of the object, in modulations."""
    poor: BoolMap
    """Where they do not explain it."""
    unclear: BoolMap
    """Where no window explains it, not even a small one."""

    @property
    def small(self) -> int:
        """Index of the first width whose windows follow the surface."""
        limit = SMALL_WINDOW_PERIODS * self.windows.period_px
        return next((k for k, w in enumerate(self.widths) if w <= limit), len(self.widths) - 1)

    def candidates(self, smooth: Explanation, paint: bool) -> Iterator[Explanation]:
        """Explanations, those with fewer kinds of edges first; none where no edge is found."""
        unclear = self.unclear
        found, _ = self.with_cliffs(smooth)
        if found.cliffs is not None:
            first = found.cliffs
            if paint and not first.certain:
                # Paint may look like cliffs, and explains all of these places then.
                painted = self.with_paint(smooth, unclear)
                if painted.albedo is not None:
                    yield replace(painted, creases_px=(first.displacement_px,))
            found, _ = self.with_cliffs(found)
            assert found.cliffs is not None
            if found.cliffs.walls.any():
                least = MIN_LEFT_SHARE * int(np.count_nonzero(unclear))
                unclear = unclear & unexplained(found.cliffs.left, self.windows.object_noise)
                paint = paint and int(np.count_nonzero(unclear)) > least
            else:
                creases = (first.displacement_px, found.cliffs.displacement_px)
                found = replace(smooth, creases_px=creases)
                found = replace(found, plain=self.continued(smooth.plain, self.left, found))
        if paint and not is_rare(unclear):
            found = self.with_paint(found, unclear)
        if self.is_painted(found) or found.cliffs is not None or found.creases_px:
            yield found

    def is_painted(self, known: Explanation) -> bool:
        """Whether there is an albedo that no white frame has shown."""
        return known.albedo is not None and self.windows.albedo is None

    def fit(
        self, known: Explanation, widths: Sequence[float], **settings: Unpack[FitSettings]
    ) -> Fitted:
        """Windows that know an explanation."""
        return self.windows.fit(
            known.start_px, widths, albedo=known.albedo, walls=known.walls, **settings
        )

    def with_cliffs(self, known: Explanation) -> tuple[Explanation, Fitted]:
        """Search walls with windows that know an explanation; what these found, too."""
        found = self.fit(known, self.widths[: self.small + 1], iterations=1, confidence=FINEST)
        cliffs = find_cliffs(
            self.windows,
            found,
            known.start_px,
            self.widths[self.small],
            albedo=known.albedo,
            edge_weight=None if known.albedo is None else edge_weight(known.albedo),
            before=known.cliffs,
        )
        start = self.start_px
        if cliffs is not None:
            start = cliffs.start_from(start, self.widths[0])
        return replace(known, cliffs=cliffs, start_px=start), found

    def with_paint(self, known: Explanation, unclear: BoolMap) -> Explanation:
        """Find the albedo of places that are not clear, with windows that know it better with every
        pass; None where it has hardly any edges."""
        min_edge_pixels = MIN_EDGE_SHARE * int(np.count_nonzero(unclear))
        # The smallest windows add noise only; the edges are known by then.
        fine = self.widths[: self.small + 2]
        misfit = known.plain.misfit.flat[::MEDIAN_STEP]
        scatter = float(np.nanmedian(np.abs(misfit))) / NORMAL_MEDIAN
        found = self.fit(known, self.widths[:1], iterations=1, confidence=CONFIDENCE)
        for _ in range(MAX_PASSES):
            u = np.where(np.isfinite(found.displacement_px), found.displacement_px, known.start_px)
            if known.cliffs is not None:
                u = np.where(known.cliffs.near, known.cliffs.displacement_px, u)
            before = known.albedo
            albedo = next_albedo(self.windows, found, u, before, scatter, known.cliffs)
            edges = int(np.count_nonzero(paint_edges(albedo)))
            if edges < max(min_edge_pixels, MIN_EDGE_PIXELS):
                return replace(known, albedo=None)
            known = replace(known, albedo=albedo)
            if before is not None and change(before, albedo) < SETTLED:
                break
            if known.cliffs is None:
                found = self.fit(known, fine, iterations=1, confidence=CONFIDENCE)
            else:
                known, found = self.with_cliffs(known)
        return known

    def continued(self, found: Fitted, left: NDArray[np.float32], known: Explanation) -> Fitted:
        """Small windows that start from the surfaces on either side of a crease, where they leave
        less than what was found."""
        near_paint = np.zeros(left.shape, bool)
        if known.albedo is not None:
            near_paint = widened(paint_edges(known.albedo), int(0.5 * self.windows.period_px))
        before = mean_square(left)
        for start_px in known.creases_px:
            again = self.windows.fit(
                start_px, self.widths[self.small :], albedo=known.albedo, **self.settings
            )
            determined = np.isfinite(again.displacement_px)
            again = again._replace(
                scale=np.where(determined, again.scale + self.small, again.scale)
            )
            after = mean_square(self.windows.left(again, known.albedo))
            better = determined & (after < CONTINUED_SHARE * before) & ~near_paint
            better |= ~np.isfinite(found.displacement_px)
            found = found.replaced(again, better)
            before = np.where(better, after, before)
        return found

    def measured(self, known: Explanation) -> Edges:
        """Windows of all widths that know the edges, where they explain the object; where an albedo
        does not, those that know the cliffs only."""
        if not self.is_painted(known) and known.cliffs is None:
            return Edges(known.plain, None, None, ~self.poor)
        found, better = self.judged(known)
        walls = None if known.cliffs is None else known.cliffs.walls & better
        edges = Edges(known.plain.replaced(found, better), known.albedo, walls, better)
        if walls is None or not self.is_painted(known) or is_rare(~better):
            return edges
        other = self.measured(replace(known, albedo=None))
        assert other.walls is not None
        return Edges(
            other.fitted.replaced(found, better),
            edges.albedo,
            walls | (other.walls & ~better),
            better | other.explained,
        )

    def judged(self, known: Explanation) -> tuple[Fitted, BoolMap]:
        """Windows of all widths that know the edges, and where they explain the object."""
        found = self.fit(known, self.widths, **self.settings)
        if known.creases_px:
            found = self.continued(found, self.windows.left(found, known.albedo), known)
        mixed = None
        if known.cliffs is not None:
            found = _on_walls(self.windows, found, known.cliffs, known.albedo)
            mixed = widened(known.cliffs.walls, NEAR_WALL_PX)
        better = explained(self.windows, found, known.plain.misfit, known.albedo, mixed)
        if self.is_painted(known):
            better &= widened(self.poor, round(REACH_PERIODS * self.windows.period_px))
        if known.albedo is not None and self.is_painted(known):
            error = albedo_error(known.plain, found, self.windows.period_px)
            error += _kept_of_start(found, known.start_px, self.windows.period_px)
            if known.cliffs is not None:
                error = np.where(known.cliffs.zone, np.float32(0), error)
            found = found._replace(
                modulation_ratio=known.albedo * found.modulation_ratio,
                model_variance=found.model_variance + error,
            )
        return found, better


def _kept_of_start(
    found: Fitted, start_px: NDArray[np.float32], period_px: float
) -> NDArray[np.float32]:
    """Variance by what an albedo has kept of the start's error, (h, w), px²."""
    square = (found.displacement_px - start_px) ** 2
    np.nan_to_num(square, copy=False)
    return np.asarray(np.float32(KEPT_OF_START**2) * box_mean(square, int(0.5 * period_px) | 1))


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
        unlike_finer=np.float32(WALL_SIGMA**2) * found.unlike_finer.flat[side],
        modulation_ratio=found.modulation_ratio.flat[side],
        offset=found.offset.flat[side],
        scale=found.scale.flat[side],
    )
    return found.replaced(from_side, side >= 0)
