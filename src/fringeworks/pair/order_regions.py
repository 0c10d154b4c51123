"""Whole periods of the surfaces of a displacement, as the most likely ones by all of the evidence.

A method may give any surface beside a cliff an order that is off by whole periods. Where fringes
continue, two pixels have the same order; a link says by how many periods two places differ. The
orders n minimise Σ c |n_i − n_j| over neighbours, plus Σ |n_b − n_a − w| over the links: the
negative logarithm of a posterior with Laplace errors. Cuts of a graph find the minimum exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.prepared import PreparedPair, fill_nearest
from fringeworks.signal.filters import box_mean
from fringeworks.types import BoolMap, FloatMap

PATCH = 0.5
"""Side of the squares in which the object is compared with the reference, periods: half a fringe
determines brightness and modulation."""
MODEL_SHARE = 0.03
"""Misfit of a smooth surface, as a share of its modulation: straight lines interpolate the
waveform, and brightness and modulation count as constant in a patch."""
BROKEN = 4.0
"""Mean squared misfit at which a cliff is as likely as none, in variances of what noise and
``MODEL_SHARE`` leave."""
BENT = 0.2
"""Slope beyond that of the surroundings at which a cliff is as likely as none, px per px. Methods
smear a cliff of a fifth of a period over a period, others are steeper."""
LEAST = 0.02
"""Continuity of a certain cliff. It is not 0, so that surfaces without links keep their order."""
BLOCK = 1.0 / 6.0
"""Side of the blocks that have one order, periods: narrower surfaces show no fringes."""
MAX_BLOCKS = 40_000
"""Largest number of blocks, which bounds the time: the orders of 2 million pixels take 1.3 s."""
ODDS = 2.0
"""Factor of the weight of the links by which the orders must not change. With 4 instead, twice as
many pixels of ray-cast scenes are undecided, and as many are off by whole periods."""
MAX_MOVES = 16
"""Largest number of cuts by which orders are moved one period: more than any surface is high."""
COUNTS = 1000.0
"""Capacity of a link in the graph, whose capacities are whole numbers."""


class Links(NamedTuple):
    """Pairs of places whose orders are known to differ by so much."""

    rows: NDArray[np.intp]
    """(n, 2)"""
    columns: NDArray[np.intp]
    """(n, 2)"""
    whole: NDArray[np.int64]
    """Periods to add to the second more than to the first, (n,)."""


class Orders(NamedTuple):
    """The most likely orders; (h, w) maps."""

    whole: NDArray[np.int16]
    """Periods to add."""
    undecided: BoolMap
    """Where they depend on the weight of the evidence."""


class Compared(NamedTuple):
    """The object beside the reference at the matching points, in patches; (h, w) arrays."""

    object_mean: FloatMap
    reference_mean: FloatMap
    gain: FloatMap
    """Modulation of the object over that of the reference, at least 0."""
    misfit: FloatMap
    """Mean square of what they leave of the object, in variances that are usual."""


def compared(prepared: PreparedPair, u_px: FloatMap) -> Compared:
    """Compare the object with a + b s(x − u) in a patch around every pixel.

    Parameters
    ----------
    prepared : PreparedPair
    u_px : (h, w) array
        Its displacement, px; finite.
    """
    width = u_px.shape[1]
    place = np.clip(np.arange(width) - u_px, 0.0, width - 1.0)
    low = np.minimum(place.astype(np.intp), width - 2)
    frame = np.asarray(prepared.reference, np.float64)
    first, second = (np.take_along_axis(frame, low + k, axis=1) for k in (0, 1))
    seen, light = np.asarray(prepared.object, np.float64), first + (place - low) * (second - first)
    side = max(5, round(PATCH * prepared.period) | 1)
    seen_mean, light_mean = box_mean(seen, side), box_mean(light, side)
    both = box_mean(seen * light, side) - seen_mean * light_mean
    # Where the frames are even, as beside what was measured, rounding alone is left of them.
    rounding = np.finfo(float).eps * float(np.max(np.abs(light), initial=1.0)) ** 2
    power = np.maximum(box_mean(light * light, side) - light_mean**2, rounding)
    gain = np.maximum(both, 0.0) / power
    left = box_mean(seen * seen, side) - seen_mean**2 - gain * (2.0 * both - gain * power)
    misfit = np.maximum(left, 0.0) / usual_variance(prepared, gain)
    return Compared(seen_mean, light_mean, gain, misfit)


def usual_variance(prepared: PreparedPair, gain: FloatMap) -> FloatMap:
    """Variance that noise and the model of a smooth surface leave of the object, counts²."""
    usual = prepared.noise[0] + (MODEL_SHARE * prepared.modulation) ** 2
    return np.asarray(prepared.noise[1] + gain**2 * usual)


def continuity(prepared: PreparedPair, u_px: FloatMap) -> NDArray[np.float32]:
    """How likely the surface continues at a pixel.

    Parameters
    ----------
    prepared : PreparedPair
    u_px : (h, w) array
        Its displacement, px; NaN where unknown.

    Returns
    -------
    (h, w) array from ``LEAST`` to 1: 1 / (1 + (misfit / BROKEN)² + (bend / BENT)²), with the misfit
    of the object to a + b s(x − u) in a patch around the pixel.
    """
    known = np.isfinite(u_px)
    if not known.any():
        return np.full(u_px.shape, LEAST, np.float32)
    u = fill_nearest(u_px, known)
    misfit = compared(prepared, u).misfit
    likely = 1.0 / (1.0 + (misfit / BROKEN) ** 2 + (_bend(u, prepared.period) / BENT) ** 2)
    return np.where(known, np.maximum(likely, LEAST), LEAST).astype(np.float32)


def _bend(u: FloatMap, period_px: float) -> FloatMap:
    """Difference of the slope from that of the surroundings, (h, w), px per px."""
    slopes = np.gradient(scipy.ndimage.gaussian_filter(u, 1.0))
    side = 2 * round(period_px) + 1
    return np.asarray(np.hypot(*(slope - box_mean(slope, side, "edge") for slope in slopes)))


def likely_orders(continues: NDArray[np.float32], links: Links, period_px: float) -> Orders:
    """Find the whole periods that surfaces and links support together.

    Parameters
    ----------
    continues : (h, w) float32 array
        As from ``continuity``.
    links : Links
    period_px : float > 0

    Notes
    -----
    The rim of the frame counts as continued outside, with order 0. The sum is convex, so that steps
    of one period, each the best cut, end at its minimum. Orders are undecided where they change as
    the links weigh ``ODDS`` times as much, or as little.
    """
    graph = _Graph.of(continues, links, period_px)
    orders = graph.minimum(1.0, np.zeros(graph.count, np.int64))
    undecided = np.zeros(graph.count, bool)
    if orders.any() or links.whole.any():
        for weight in (ODDS, 1.0 / ODDS):
            undecided |= graph.minimum(weight, orders) != orders
    return Orders(graph.at_pixels(orders).astype(np.int16), graph.at_pixels(undecided))


@dataclass(frozen=True, eq=False)
class _Graph:
    """Blocks of pixels, and edges between them: neighbours first, then the rim, then links."""

    shape: tuple[int, int]
    """Of the frame, px."""
    side: int
    """Of the blocks, px."""
    ends: NDArray[np.intp]
    """(2, m); the last node, beside the blocks, is the surroundings of the frame."""
    weight: NDArray[np.float64]
    """(m,)"""
    whole: NDArray[np.int64]
    """(m,)"""
    is_link: BoolMap
    """(m,)"""

    @classmethod
    def of(cls, continues: NDArray[np.float32], links: Links, period_px: float) -> _Graph:
        h, w = continues.shape
        side = max(1, round(BLOCK * period_px), int(np.ceil(np.sqrt(h * w / MAX_BLOCKS))))
        rows, columns = (np.arange(0, n, side) for n in (h, w))
        number = np.arange(rows.size * columns.size).reshape(rows.size, columns.size)
        # A cliff may lie anywhere between the centres of two blocks.
        nearby = side * scipy.ndimage.minimum_filter(continues, side).astype(np.float64)
        middle = [np.minimum(v + side // 2, n - 1) for v, n in ((rows, h), (columns, w))]
        rim = np.concatenate((number[0], number[-1], number[:, 0], number[:, -1]))
        blocks = number[links.rows // side, links.columns // side]
        edges = (
            (number[:, :-1], number[:, 1:], nearby[np.ix_(middle[0], columns[1:])]),
            (number[:-1], number[1:], nearby[np.ix_(rows[1:], middle[1])]),
            (np.full(rim.size, number.size), rim, np.full(rim.size, float(side))),
            (blocks[:, 0], blocks[:, 1], np.ones(len(blocks))),
        )
        first, second, weight = (np.concatenate([e[k].ravel() for e in edges]) for k in range(3))
        is_link = np.arange(first.size) >= first.size - len(blocks)
        whole = np.zeros(first.size, np.int64)
        whole[is_link] = links.whole
        ends = np.stack((first, second)).astype(np.intp)
        return cls((h, w), side, ends, weight, whole, is_link)

    @property
    def count(self) -> int:
        """Number of blocks."""
        return int(np.prod([-(-n // self.side) for n in self.shape]))

    def at_pixels(self, values: np.ndarray) -> np.ndarray:
        """Values of the blocks at their pixels, (h, w)."""
        h, w = self.shape
        grid = values.reshape(-(-h // self.side), -1)
        return np.asarray(grid.repeat(self.side, axis=0).repeat(self.side, axis=1)[:h, :w])

    def minimum(self, link_weight: float, start: NDArray[np.int64]) -> NDArray[np.int64]:
        """Orders of the blocks at the minimum, from any start."""
        weight = np.where(self.is_link, link_weight, 1.0) * self.weight
        orders = np.append(start, 0)
        first, second = self.ends

        def total(n: NDArray[np.int64]) -> float:
            return float(np.sum(weight * np.abs(n[second] - n[first] - self.whole)))

        best, tried, moves = total(orders), 0, 0
        step = 1
        while tried < 2 and moves < MAX_MOVES:
            moved = orders + step * self._cut(weight, orders, step)
            after = total(moved)
            moves += 1
            if after < best - 1e-6 * (1.0 + best):
                orders, best, tried = moved, after, 0
            else:
                step, tried = -step, tried + 1
        return orders[:-1]

    def _cut(
        self, weight: NDArray[np.float64], orders: NDArray[np.int64], step: int
    ) -> NDArray[np.int64]:
        """1 for the nodes that a step lowers the sum most with, (count + 1,)."""
        first, second = self.ends
        apart = orders[second] - orders[first] - self.whole
        stay, ahead, behind = (weight * np.abs(apart + d) for d in (0, step, -step))
        size = self.count + 1
        alone = np.bincount(second, ahead - stay, size) - np.bincount(first, ahead - stay, size)
        alone[-1] = np.abs(alone).sum() + weight.sum()  # the surroundings stay
        source, sink = size, size + 1
        nodes, costs = np.arange(size), alone > 0
        starts = np.concatenate((first, nodes[costs], np.full(np.count_nonzero(~costs), source)))
        stops = np.concatenate((second, np.full(np.count_nonzero(costs), sink), nodes[~costs]))
        capacity = np.concatenate((ahead + behind - 2.0 * stay, alone[costs], -alone[~costs]))
        whole = np.round(COUNTS * capacity).astype(np.int32)
        graph = scipy.sparse.csr_array((whole, (starts, stops)), shape=(size + 2, size + 2))
        left = graph - scipy.sparse.csgraph.maximum_flow(graph, source, sink).flow
        left.data[left.data < 0] = 0
        left.eliminate_zeros()
        reached = np.zeros(size + 2, np.int64)
        reached[scipy.sparse.csgraph.breadth_first_order(left, source)[0]] = 1
        return reached[:size]
