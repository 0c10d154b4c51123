"""Temporal unwrapping: which fringe order every phase of several periods has, proved beforehand.

Phases of M periods say where a point lies modulo each of them. An integer combination of phases is
the phase of another, longer period (two of them: the beat of heterodyning). A chain of such
combinations, from one that spans the projector down to the periods themselves, resolves all
orders by rounding; how much noise it stands can be told before anything is measured. Hierarchical,
heterodyne and number-theoretic choices of periods differ in their chain only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import InputError

TURN = 2.0 * np.pi
MAX_COMBINATIONS = 20_000
"""Combinations that are looked through: coefficients are tried as far as this allows."""
COMMENSURATE = 1e-6
"""Distance from a whole number of turns, per turn, that counts as whole."""
CODE_REACH = 0.6
"""Distance from the middle of its code cell that a coordinate may have, share of the cell: half of
it, and a tenth because the threshold of its bits never sits exactly half-way."""

CODE_ROOM = 0.45
"""Largest share of a turn that this reach may take."""


@dataclass(frozen=True)
class OrderChain:
    """How the fringe orders of several periods are found, one rounding after the other.

    The first combination gives the coordinate over the whole range (or a code does); every further
    one refines it: x ← x + wrap(c·t − g x) / g, with t the phases in turns and g = c·f.
    """

    periods_px: tuple[float, ...]
    """Periods p_m of the M phases; their frequencies f are 1/p."""
    low_px: float
    """Smallest coordinate."""
    high_px: float
    """Largest coordinate."""
    repeats_px: float
    """Distance after which all phases are the same again; infinity where there is none."""
    combinations: NDArray[np.float64]
    """Coefficients c, (K, M), whole numbers, from the longest period to the shortest."""
    amplification: NDArray[np.float64]
    """What every rounding makes of the M phase errors, (K' , M), in turns per turn."""
    room: NDArray[np.float64]
    """How large that may become before the rounding goes wrong, (K',), turns."""

    @property
    def frequencies(self) -> NDArray[np.float64]:
        """g of every combination, (K,), turns per px."""
        found: NDArray[np.float64] = self.combinations @ (1.0 / np.asarray(self.periods_px))
        return found

    def margin(self, sigma_rad: Sequence[float] | float) -> float:
        """Least room of a rounding, in standard deviations of its error.

        Parameters
        ----------
        sigma_rad : float or (M,) floats
            Standard deviation of the phases, rad.
        """
        sigma = np.broadcast_to(np.asarray(sigma_rad, float) / TURN, len(self.periods_px))
        spread = np.sqrt((self.amplification**2) @ sigma**2)
        with np.errstate(divide="ignore"):
            return float(np.min(self.room / spread, initial=np.inf))

    @property
    def largest_sigma_rad(self) -> float:
        """Phase noise at which the least room is five standard deviations, rad."""
        return self.margin(1.0) / 5.0


def repeat_distance(periods_px: Sequence[float], up_to_px: float) -> float:
    """Shortest distance that holds every period a whole number of times, px.

    Infinity where none up to four times ``up_to_px`` does.
    """
    first = max(periods_px)
    count = np.arange(1, max(int(4.0 * up_to_px / first), 1) + 1)
    turns = first * count[:, None] / np.asarray(periods_px)
    off = np.abs(turns - np.rint(turns)) / np.maximum(turns, 1.0)
    whole = np.flatnonzero((off < COMMENSURATE).all(axis=1))
    return float(first * count[whole[0]]) if whole.size else float("inf")


def order_chain(
    periods_px: Sequence[float],
    range_px: tuple[float, float],
    *,
    weights: Sequence[float] | None = None,
    code_step_px: float | None = None,
) -> OrderChain:
    """The chain of combinations that stands the most noise.

    Parameters
    ----------
    periods_px : (M,) floats > 0
        Periods of the fringes, projector px.
    range_px : (low, high)
        Coordinates that are to be told apart, projector px.
    weights : (M,) floats > 0, optional
        Inverse variances of the phases against each other; equal where left out.
    code_step_px : float > 0, optional
        Cell of a code (Gray) that says where in the range a point lies.

    Returns
    -------
    OrderChain

    Raises
    ------
    InputError where the periods cannot tell the coordinates of the range apart.

    Notes
    -----
    The combination c = Σ c_m t_m has the frequency g = c·f and the error c·ε. Going from one
    to a finer one is a rounding whose argument errs by (c' − (g'/g) c)·ε and must stay below half a
    turn. Among all chains the one with the largest least room is found, a widest path over the
    combinations that no other one beats in both length and error (heterodyne beats: Reich, Ritter
    & Thesing, SPIE 3100, 1997; number theory: Gushov & Solodkin, Opt. Lasers Eng. 14:311, 1991).
    """
    low, high = (float(v) for v in range_px)
    length = high - low
    frequency = 1.0 / np.asarray(periods_px, float)
    error = 1.0 / np.sqrt(np.ones(len(periods_px)) if weights is None else np.asarray(weights))
    repeats = repeat_distance(periods_px, length)
    cells, g = _combinations(frequency)
    if code_step_px is None:
        if repeats < length * (1.0 - COMMENSURATE):
            raise InputError(
                f"periods: {_list(periods_px)} px repeat after {repeats:g} px, but the projector "
                f"has {length:g} px: expected another period or a Gray code"
            )
        starts = g * length <= 1.0 + COMMENSURATE
        room_of_start = np.full(g.size, np.inf)
    else:
        reach = CODE_REACH * code_step_px
        starts = g * reach < CODE_ROOM
        room_of_start = 0.5 - g * reach
    if not starts.any():
        longest = f"{1.0 / g.min():g}" if g.size else "0"
        wanted = f"{length:g} px"
        if code_step_px is not None:
            least = CODE_REACH * code_step_px / CODE_ROOM
            wanted = f"{least:g} px, better twice the {code_step_px:g} px of a code cell,"
        raise InputError(
            f"periods: {_list(periods_px)} px and their beats span {longest} px, expected "
            f"{wanted} or more"
        )
    path = _widest_path(cells, g, error, starts, room_of_start, frequency)
    rows, room = _roundings(cells[path], g[path], room_of_start[path[0]], frequency)
    if code_step_px is None:
        rows, room = rows[1:], room[1:]
    used = _binding(rows, room)
    return OrderChain(
        periods_px=tuple(float(p) for p in periods_px),
        low_px=low,
        high_px=high,
        repeats_px=repeats,
        combinations=cells[path],
        amplification=rows[used],
        room=room[used],
    )


def _binding(rows: NDArray[np.float64], room: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Roundings that are not safe already whenever another one is."""
    load = np.abs(rows) / room[:, None]
    kept = np.asarray(np.abs(rows).sum(axis=1) > 0)
    for k in range(len(rows)):
        others = kept.copy()
        others[k] = False
        if kept[k] and np.any(np.all(load[others] >= load[k], axis=1)):
            kept[k] = False
    return kept


def _list(periods_px: Sequence[float]) -> str:
    return ", ".join(f"{p:g}" for p in periods_px)


def _combinations(
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Integer combinations with a positive frequency up to the highest there is."""
    m = frequency.size
    reach = next((r for r in range(64, 0, -1) if (2 * r + 1) ** m <= MAX_COMBINATIONS), 0)
    if reach:
        cells = np.array(list(product(range(-reach, reach + 1), repeat=m)), float)
    else:  # many periods: their differences
        eye = np.eye(m)
        cells = np.array([a - b for a in (*eye, np.zeros(m)) for b in (*eye, np.zeros(m))])
    g = cells @ frequency
    fine = (g > COMMENSURATE * frequency.max()) & (g <= frequency.max() * (1.0 + 1e-9))
    return cells[fine], g[fine]


def _widest_path(
    cells: NDArray[np.float64],
    g: NDArray[np.float64],
    error: NDArray[np.float64],
    starts: NDArray[np.bool_],
    room_of_start: NDArray[np.float64],
    frequency: NDArray[np.float64],
) -> NDArray[np.intp]:
    """Indices of the combinations of the best chain."""
    spread = np.sqrt((cells**2) @ error**2)
    # Only what no other combination beats in being both longer and nearer to the truth.
    kept: list[int] = []
    least = np.inf
    for k in np.lexsort((spread, g)):
        if spread[k] / g[k] < least * (1.0 - 1e-9):
            least = spread[k] / g[k]
            kept.append(int(k))
    nodes = np.array(kept)
    c, f, first = cells[nodes], g[nodes], starts[nodes]
    best = np.where(first, room_of_start[nodes] / spread[nodes], 0.0)
    before = np.full(nodes.size, -1)
    for j in range(1, nodes.size):  # by rising frequency: predecessors are done
        step = c[j] - (f[j] / f[:j])[:, None] * c[:j]
        with np.errstate(divide="ignore"):
            room = np.minimum(best[:j], 0.5 / np.sqrt((step**2) @ error**2))
        i = int(np.argmax(room))
        if room[i] > best[j]:
            best[j], before[j] = room[i], i
    final = np.empty(nodes.size)
    for j in range(nodes.size):
        step = np.eye(frequency.size) - (frequency / f[j])[:, None] * c[j]
        with np.errstate(divide="ignore"):
            final[j] = min(best[j], float(np.min(0.5 / np.sqrt((step**2) @ error**2))))
    path = [int(np.argmax(final))]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return nodes[path[::-1]]


def _roundings(
    cells: NDArray[np.float64],
    g: NDArray[np.float64],
    room_of_start: float,
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What each rounding of a chain makes of the phase errors, and how large it may become."""
    rows, room = [cells[0]], [room_of_start]
    for k in range(1, g.size):
        rows.append(cells[k] - (g[k] / g[k - 1]) * cells[k - 1])
        room.append(0.5)
    for m in range(frequency.size):
        rows.append(np.eye(frequency.size)[m] - (frequency[m] / g[-1]) * cells[-1])
        room.append(0.5)
    found = np.array(rows)
    found[np.abs(found) < 1e-9] = 0.0
    return found, np.array(room)


def separation(
    periods_px: Sequence[float], length_px: float, weights: Sequence[float] | None = None
) -> float:
    """Least distance between what two coordinates of a range make of the phases.

    Parameters
    ----------
    periods_px : (M,) floats > 0
    length_px : float
        Length of the range, px.
    weights : (M,) floats > 0, optional
        Inverse variances of the phases in turns; 1 where left out.

    Returns
    -------
    Distance in standard deviations (turns where weights are left out): orders are told apart by the
    most likely choice where half of it is several. The limit that no chain exceeds.
    """
    frequency = 1.0 / np.asarray(periods_px, float)
    weight = np.ones(frequency.size) if weights is None else np.asarray(weights, float)
    # Neighbouring lines of the lattice are nearest where some phase is a whole number of turns.
    at = np.concatenate(
        [p * np.arange(1, int(length_px / p * (1.0 - COMMENSURATE)) + 1) for p in periods_px]
    )
    if at.size == 0:
        return float("inf")
    turns = frequency[:, None] * at
    off = turns - np.rint(turns)
    along = (weight * frequency) @ off / np.sqrt(weight @ frequency**2)
    across = weight @ off**2 - along**2
    return float(np.sqrt(max(across.min(), 0.0)))
