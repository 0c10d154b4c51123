"""Surfaces whose whole periods nothing in the two frames tells.

Along a line across the fringes, the light meets what is lit in order: of two places a < b, b has
the light of a later place of the projector. As many fringes lie between them as the *room* says,
((b − u_b) − (a − u_a)) / period, unless a wall hides some. One order more of a surface is one
period less of room on one side of it, and one more on the other. The fringes that the object shows
on both sides tell these orders apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.order_range import dark_places
from fringeworks.pair.order_regions import BROKEN, compared, usual_variance
from fringeworks.pair.prepared import PreparedPair, fill_nearest
from fringeworks.types import BoolMap, FloatMap

FREE_PERIODS = 1.0
"""Distance of surfaces from which on the gap between them is wide, and up to which broken places
belong to a surface, periods: filters smear a cliff over half a period on either side."""
FREE_AREA = 2.0
"""Smallest surface that must be told, square periods: the creases of a rough surface leave patches
of 1.5. The order of smaller ones stands unless the fringes contradict it."""
STEP_AREA = 0.25
"""Smallest surface that is looked at, square periods: smaller ones are scraps on a flank."""
STATES = 16
"""Places per period among which the light of a pixel is looked for: a sixteenth of a period changes
the brightness by up to two fifths of the modulation, half of which is the largest error."""
MAX_ROOM = 24.0
"""Largest room that is looked at, periods, which bounds the time. Beyond, nothing is told."""
SURE = 25.0
"""Difference of the misfit from which on an order is known, variances: that of 5 σ. The lines of a
side count as one, because they have their errors in common."""
MAX_LINES = 16
"""Most lines of a side that are looked at, which bounds the time: their median is needed."""
DARK_SHARE = 0.2
"""Part of a sinusoidal fringe that is dark (see ``DARK``), periods."""
RIM_PX = 2
"""Width of the rim of a shadow, px: pixels there see a part of both."""
MORE_ROOM = (1.0, 0.0, -1.0)
"""Room that is compared, periods more than measured."""
Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns of pixels."""


@dataclass(frozen=True, eq=False)
class Gaps:
    """Gaps between a surface and the known one beside it, along lines; arrays (n,)."""

    row: NDArray[np.intp]
    first: NDArray[np.intp]
    """Last column before the gap."""
    last: NDArray[np.intp]
    """First column beyond."""
    surface: NDArray[np.int32]
    """The surface whose order is asked for."""
    way: NDArray[np.int8]
    """1 where that is the one beyond, whose order takes room, −1 otherwise."""

    def at(self, chosen: BoolMap | NDArray[np.intp]) -> Gaps:
        """Some of the gaps."""
        row, first, last = self.row[chosen], self.first[chosen], self.last[chosen]
        return Gaps(row, first, last, self.surface[chosen], self.way[chosen])


def free_surfaces(
    prepared: PreparedPair, u_px: FloatMap, on: BoolMap, links: Places, least: int
) -> BoolMap:
    """Surfaces whose order nothing tells, and the broken places around them.

    Parameters
    ----------
    prepared : PreparedPair
    u_px : (h, w) float array
        Its displacement, px.
    on : (h, w) bool array
        Where the surface continues.
    links : rows and columns, (n, 2) each
        Pairs of places whose orders are known to fit together.
    least : int
        Fewest such pairs that join two surfaces.

    Notes
    -----
    The rim of the frame is known. From there on, a surface is that links or lines join to a known
    one, or whose order is far likelier than one more and one less.
    """
    period = prepared.period
    place, count = scipy.ndimage.label(on)
    area = np.bincount(place.ravel(), minlength=count + 1) / period**2
    rim = np.zeros(count + 1, bool)
    for side in (place[0], place[-1], place[:, 0], place[:, -1]):
        rim[side] = True
    rim[0] = False
    kept = rim | (area > STEP_AREA)
    kept[0] = False
    nothing = np.zeros(on.shape, bool)
    if not rim.any() or kept.sum() == rim.sum():
        return nothing  # without a known order there is nothing to compare with
    surfaces = np.where(kept[place], place, 0)
    part = _joined(u_px, period, surfaces, rim, place[links], least)
    known, open_ = np.zeros(count + 1, bool), np.zeros(count + 1, bool)
    known[part[rim]] = True
    open_[part[kept]] = True
    open_ &= ~known
    place = np.where(kept, part, 0)[place]
    known, open_ = _grown(prepared, u_px, place, known, open_)
    if not open_.any():
        return nothing
    around = scipy.ndimage.distance_transform_edt(~open_[place]) < 2.0 * FREE_PERIODS * period
    return np.asarray(around & ~known[place])


def _grown(
    prepared: PreparedPair, u_px: FloatMap, place: NDArray[np.int32], known: BoolMap, open_: BoolMap
) -> tuple[BoolMap, BoolMap]:
    """The known surfaces, with those that gaps tell from there on, and those that stay open."""
    period = prepared.period
    size = np.bincount(place.ravel(), minlength=known.size) / period**2
    near = _near(place, known, FREE_PERIODS * period) | (size < FREE_AREA)
    evidence = _Evidence.of(prepared, u_px) if open_.any() else None
    while evidence is not None and open_.any():
        found = _told(evidence, _gaps(place, known, open_), open_, near)
        if not found.any():
            break
        known, open_ = known | found, open_ & ~found
    return known, open_


def _near(place: NDArray[np.int32], known: BoolMap, reach_px: float) -> BoolMap:
    """Surfaces that steps of less than some pixels lead to from known ones, by number."""
    close = scipy.ndimage.distance_transform_edt(place == 0) < 0.5 * reach_px
    whole, count = scipy.ndimage.label(close)
    led = np.zeros(count + 1, bool)
    led[whole[known[place]]] = True
    led[0] = False
    near = np.zeros(known.size, bool)
    near[place[led[whole]]] = True
    return near


def _joined(
    u_px: FloatMap,
    period_px: float,
    place: NDArray[np.int32],
    rim: BoolMap,
    links: NDArray[np.int32],
    least: int,
) -> NDArray[np.int32]:
    """The lowest number of the surfaces that a surface belongs together with, by its own.

    Notes
    -----
    A line to the next surface leaves it no order more where less than a period of room is left.
    Surfaces belong together where lines lead from one to the other and back.
    """
    row, column = np.nonzero(place)
    label = place[row, column]
    light = (column - u_px[row, column]) / period_px
    between = np.flatnonzero((row[1:] == row[:-1]) & (label[1:] != label[:-1]))
    pairs = np.stack((label[between], label[between + 1]))
    room = light[between + 1] - light[between]
    full = np.where(room < 1.0, 1, -1)
    edges, which = np.unique(pairs, axis=1, return_inverse=True)
    votes = np.bincount(which.ravel(), full, minlength=edges.shape[1])
    number = np.bincount(which.ravel(), minlength=edges.shape[1])
    edges = edges[:, (votes > 0) & (number >= least)]
    both, times = np.unique(np.sort(links, axis=1).T, axis=1, return_counts=True)
    both = both[:, (times >= least) & (both > 0).all(axis=0)]
    around = np.flatnonzero(rim)
    edges = np.concatenate((edges, both, both[::-1], [around, np.roll(around, 1)]), axis=1)
    graph = scipy.sparse.coo_array((np.ones(edges.shape[1]), edges), shape=(rim.size, rim.size))
    part = scipy.sparse.csgraph.connected_components(graph.tocsr(), connection="strong")[1]
    _, first = np.unique(part, return_index=True)
    return np.asarray(first[part], np.int32)


def _gaps(place: NDArray[np.int32], known: BoolMap, open_: BoolMap) -> Gaps:
    """Gaps along rows between open surfaces and the known ones next to them."""
    columns = np.arange(place.shape[1])
    before = np.maximum.accumulate(np.where(known[place], columns, -1), axis=1)
    beyond = np.where(known[place], columns, columns.size)
    beyond = np.minimum.accumulate(beyond[:, ::-1], axis=1)[:, ::-1]
    parts = []
    for way, near, valid in ((1, before, before >= 0), (-1, beyond, beyond < columns.size)):
        row, column = np.nonzero(open_[place] & valid)
        there = near[row, column]
        # Of the pixels with one known place, those of the surface that are the closest.
        order = np.lexsort((np.abs(column - there), place[row, column], there, row))
        row, column, there = row[order], column[order], there[order]
        key = np.stack((row, there, place[row, column]))
        first = np.append(True, (np.diff(key, axis=1) != 0).any(axis=0))[: row.size]
        row, column, there = row[first], column[first], there[first]
        a, b = (there, column) if way > 0 else (column, there)
        parts.append((row, a, b, place[row, column], np.full(row.size, way, np.int8)))
    rows, firsts, lasts, surfaces, ways = zip(*parts, strict=True)
    ends = np.concatenate(rows), np.concatenate(firsts), np.concatenate(lasts)
    return Gaps(*ends, np.concatenate(surfaces), np.concatenate(ways))


def _told(evidence: _Evidence, gaps: Gaps, open_: BoolMap, near: BoolMap) -> BoolMap:
    """Open surfaces whose order is known from the gaps beside them, by number.

    Notes
    -----
    The misfit of both sides together is −2 log likelihood of an order. It is measured in what the
    best order leaves per pixel, or in that of noise where this is less. Most surfaces continue, so
    small ones, and those near known ones, keep their order where none is far likelier. Others need
    evidence, and an order that explains the gaps (``BROKEN``).
    A side without room for another period needs no misfit: the light would have to run backwards.
    """
    found = np.zeros(open_.size, bool)
    for number in np.flatnonzero(open_):
        sides = [_some(gaps, (gaps.surface == number) & (gaps.way == way)) for way in (1, -1)]
        if min(side.row.size for side in sides) == 0:
            found[number] = near[number]
            continue
        if all(np.median(evidence.room(side)) < 1.0 for side in sides):
            found[number] = True
            continue
        energy, pixels = np.zeros(len(MORE_ROOM)), 0.0
        for side in sides:
            cost = np.median(evidence.costs(side), axis=0)
            energy += cost[:: side.way[0]]
            pixels += float(np.median(side.last - side.first)) - 1.0
        usual = max(float(energy.min()) / max(pixels, 1.0), 1.0)
        odds = float((energy[[0, 2]] - energy[1]).min()) / usual
        continued = odds > -SURE
        found[number] = continued if near[number] else (odds > SURE and usual < BROKEN)
    return found


def _some(gaps: Gaps, chosen: BoolMap) -> Gaps:
    """At most ``MAX_LINES`` of the chosen gaps, at even distances."""
    index = np.flatnonzero(chosen)
    index = index[:: -(-index.size // MAX_LINES) or 1]
    return gaps.at(index)


class _Evidence(NamedTuple):
    """Both frames as gaps are compared in; (h, w) arrays."""

    prepared: PreparedPair
    u: FloatMap
    """Displacement, px; finite."""
    level: FloatMap
    """Brightness of the object where the reference's is 0."""
    gain: FloatMap
    """Modulation of the object over that of the reference."""
    unlit: BoolMap

    @staticmethod
    def of(prepared: PreparedPair, u_px: FloatMap) -> _Evidence:
        """Compare a pair, moved by its displacement."""
        u = fill_nearest(u_px, np.isfinite(u_px))
        beside = compared(prepared, u)
        level = beside.object_mean - beside.gain * beside.reference_mean
        return _Evidence(prepared, u, level, beside.gain, _unlit(prepared))

    def ends(self, gaps: Gaps) -> tuple[FloatMap, FloatMap]:
        """Places of the projector's light at both ends, px on the reference, (n,)."""
        start, stop = (at - self.u[gaps.row, at] for at in (gaps.first, gaps.last))
        return start, stop

    def room(self, gaps: Gaps) -> FloatMap:
        """Room between the ends, periods, (n,)."""
        start, stop = self.ends(gaps)
        return np.asarray((stop - start) / self.prepared.period)

    def costs(self, gaps: Gaps) -> FloatMap:
        """Misfit of the object in gaps with a period more of room, as much, and one less, (n, 3),
        in variances; 0 for gaps of more room than ``MAX_ROOM``.

        Notes
        -----
        The brightness of each pixel is that of some place of the reference, and these follow each
        other in order. Of all ways through the gap, dynamic programming finds the one that fits
        best. A way may leave out places: a wall hides them.
        """
        room = self.room(gaps)
        near = room < MAX_ROOM
        cost = np.zeros((room.size, len(MORE_ROOM)))
        if near.any():
            best = np.minimum.accumulate(self._ways(gaps.at(near)), axis=1)
            for k, more in enumerate(MORE_ROOM):
                last = np.floor((room[near] + more) * STATES).astype(np.intp)
                there = np.take_along_axis(best, np.maximum(last, 0)[:, None], axis=1)[:, 0]
                cost[near, k] = np.where(last >= 0, there, np.inf)
        return cost

    def _ways(self, gaps: Gaps) -> FloatMap:
        """Misfit of the best way to every place of the reference from the first on, (n, k)."""
        start, _ = self.ends(gaps)
        states = np.arange(int(np.ceil((self.room(gaps).max() + 1.0) * STATES)) + 1)
        at = start[:, None] + states * self.prepared.period / STATES
        rows = np.broadcast_to(gaps.row[:, None], at.shape)
        frame = np.asarray(self.prepared.reference, np.float64)
        light = scipy.ndimage.map_coordinates(frame, (rows, at), order=1, mode="nearest")
        length = gaps.last - gaps.first
        total = np.where(states == 0, 0.0, np.inf) + np.zeros((gaps.row.size, 1))
        for step in range(1, int(length.max())):
            on = np.flatnonzero(step < length)
            row, column = gaps.row[on], gaps.first[on] + step
            share = step / length[on]
            level, gain = (
                (1.0 - share) * values[row, gaps.first[on]] + share * values[row, gaps.last[on]]
                for values in (self.level, self.gain)
            )
            model = level[:, None] + gain[:, None] * light[on]
            off = (self.prepared.object[row, column][:, None] - model) ** 2
            off /= usual_variance(self.prepared, gain)[:, None]
            off[self.unlit[row, column]] = 0.0
            total[on] = np.minimum.accumulate(total[on], axis=1) + off
        return total


def _unlit(prepared: PreparedPair) -> BoolMap:
    """Pixels that may lie in a shadow or on its rim, (h, w): dark for longer than a fringe is."""
    dark = dark_places(prepared)[0] > 0
    run = np.ones((1, int(DARK_SHARE * prepared.period) + 1), bool)
    core = scipy.ndimage.binary_opening(dark, run)
    return np.asarray(scipy.ndimage.binary_dilation(core, np.ones((1, 2 * RIM_PX + 1), bool)))
