"""Thinned grids hold every pair of values, and lose no case."""

from __future__ import annotations

from collections import Counter
from itertools import combinations, product

import pytest

from tests.grids import cover, thinned

SIZES = [(2, 4, 2, 5), (3, 3, 3), (5, 4), (1, 2, 6), (8,)]


@pytest.mark.parametrize(
    ("sizes", "strength"), [(s, k) for s in SIZES for k in (1, 2) if k <= len(s)]
)
def test_every_choice_of_values_occurs(sizes, strength):
    cases = cover(sizes, strength)
    for axes in combinations(range(len(sizes)), strength):
        seen = {tuple(case[axis] for axis in axes) for case in cases}
        assert seen == set(product(*(range(sizes[axis]) for axis in axes)))


def test_few_cases_are_enough_and_always_the_same():
    assert len(cover((2, 4, 2, 5))) <= 22
    assert len(cover((8, 4), 1)) == 8
    # No value stands for the others more often than it must.
    assert Counter(second for _, second in cover((8, 4), 1)) == dict.fromkeys(range(4), 2)
    assert cover((3, 3, 3)) == cover((3, 3, 3))


def test_cases_that_are_left_out_are_long():
    mark = thinned(kind={"a": 1, "b": 2}, order="<>", layout=[min, max]).mark
    names, cases = mark.args
    assert names == ("kind", "order", "layout")
    assert [c.id for c in cases[:2]] == ["a-<-min", "a-<-max"]
    assert {c.values for c in cases} == set(product((1, 2), "<>", (min, max)))
    assert sum(not c.marks for c in cases) == 4


def test_a_stronger_cover_is_thorough():
    axes = {"kind": "abc", "order": "<>", "layout": [1, 2, 3, 4]}
    _, cases = thinned(strength=1, thorough=2, **axes).mark.args
    names = [c.marks[0].name if c.marks else "" for c in cases]
    assert names.count("") == len(cover((3, 2, 4), 1))
    run = {tuple(c.values) for c, name in zip(cases, names, strict=True) if name != "long"}
    for some in combinations(range(3), 2):
        assert len({tuple(values[k] for k in some) for values in run}) == len(
            set(product(*(list(axes.values())[k] for k in some)))
        )
