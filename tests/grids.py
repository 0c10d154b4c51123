"""Grids of cases: some of them run always, the others with the long tests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from itertools import combinations, product
from typing import Any

import pytest


def _parts(case: tuple[int, ...], strength: int) -> set[tuple[tuple[int, int], ...]]:
    """What a case shows: its values, or their pairs, each value with the number of its axis."""
    return set(combinations(enumerate(case), strength))


def cover(sizes: Collection[int], strength: int = 2) -> set[tuple[int, ...]]:
    """Few cases of a grid in which any ``strength`` axes take all their values together.

    The cases are chosen one by one: each is the first of those that show most of what is missing.
    With a ``strength`` of 1, the values that were chosen least before go first.
    """
    left = {case: _parts(case, strength) for case in product(*map(range, sizes))}
    missing = set().union(*left.values())
    chosen, used = set(), Counter()
    while missing:
        best = max(
            left, key=lambda c: (len(left[c] & missing), -sum(used[v] for v in enumerate(c)))
        )
        missing -= left.pop(best)
        chosen.add(best)
        if strength == 1:
            used.update(enumerate(best))
    return chosen


def _name(value: Any) -> str:
    return str(getattr(value, "__name__", value))


def thinned(
    *, strength: int = 2, thorough: int = 0, **axes: Mapping[str, Any] | Collection[Any]
) -> Any:
    """Parameters of a test over the whole grid; cases that the cover does without are long.

    A test of two axes with a ``strength`` of 1 takes every value of each at least once. Where each
    case costs half a second, the cases that a cover with the larger strength of ``thorough`` needs
    in addition are thorough. The values of an axis are named by its keys, or by themselves.
    """
    names = [list(a) if isinstance(a, Mapping) else [_name(v) for v in a] for a in axes.values()]
    values = [list(a.values()) if isinstance(a, Mapping) else list(a) for a in axes.values()]
    sizes = [len(v) for v in values]
    quick = cover(sizes, strength)
    more = cover(sizes, thorough) if thorough else set()

    def marks(case: tuple[int, ...]) -> Any:
        if case in quick:
            return ()
        return pytest.mark.thorough if case in more else pytest.mark.long

    cases = [
        pytest.param(
            *(v[k] for v, k in zip(values, case, strict=True)),
            id="-".join(n[k] for n, k in zip(names, case, strict=True)),
            marks=marks(case),
        )
        for case in product(*map(range, sizes))
    ]
    return pytest.mark.parametrize(tuple(axes), cases)


def quick(values: Collection[Any], *chosen: Any) -> list[Any]:
    """Parameters of one axis in their order; those that are not chosen are long."""
    unknown = [value for value in chosen if value not in values]
    assert not unknown, f"no values of the test: {unknown}"
    return [
        pytest.param(
            *(v if isinstance(v, tuple) else (v,)), marks=() if v in chosen else pytest.mark.long
        )
        for v in values
    ]
