"""Groups of values that are similar in another quantity, such as the stated standard deviation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.types import FloatMap


def similar_groups(
    quantity: FloatMap, values: FloatMap, count: int, least: int
) -> list[tuple[FloatMap, FloatMap]]:
    """Divide values into groups of similar quantity, without a full sort.

    Parameters
    ----------
    quantity, values : (n,) float arrays
    count : int
        Number of groups, of equal size.
    least : int
        Smallest size of a group; smaller ones are left out.

    Returns
    -------
    list of (quantity, values), in rising order of the quantity.
    """
    parts = (np.array_split(part, count) for part in _core.similar_groups(quantity, values, count))
    return [group for group in zip(*parts, strict=True) if group[0].size >= least]


def ordered_groups(quantity: FloatMap, count: int, least: int) -> list[NDArray[np.intp]]:
    """Indices of groups of equal size in rising order of a quantity.

    There are at most ``count`` groups, of at least ``least`` values each; none where there are
    fewer values.
    """
    groups = min(count, quantity.size // least)
    return np.array_split(np.argsort(quantity), groups) if groups else []


def equal_groups(values: NDArray[np.integer]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Group equal values: the place of the first of every group, and the group of every value.

    Groups are numbered from the smallest value on. ``numpy.unique`` returns the same, but loads
    the package of masked arrays, which takes as long as decoding a frame.

    Parameters
    ----------
    values : (n,) array of whole numbers

    Returns
    -------
    first : (groups,) array
    group : (n,) array

    Examples
    --------
    >>> first, group = equal_groups(np.array([5, 2, 5, 9]))
    >>> first.tolist(), group.tolist()
    ([1, 0, 3], [1, 0, 1, 2])
    """
    order = np.argsort(values, kind="stable")
    rising = values[order]
    starts = np.ones(len(values), bool)
    np.not_equal(rising[1:], rising[:-1], out=starts[1:])
    group = np.empty(len(values), np.intp)
    group[order] = np.cumsum(starts) - 1
    return order[starts], group
