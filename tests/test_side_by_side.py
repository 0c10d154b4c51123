"""Work on several captures at a time: results in order, and errors in the place of their items."""

import threading
import time

import pytest

from fringeworks.pipeline import side_by_side as module
from fringeworks.pipeline.side_by_side import side_by_side


def test_results_come_in_order():
    def work(n):
        time.sleep(0.01 * (3 - n % 4))
        return n * n

    assert list(side_by_side(range(12), work)) == [n * n for n in range(12)]


def test_items_are_taken_as_they_are_needed(monkeypatch):
    monkeypatch.setattr(module.os, "cpu_count", lambda: 2)
    taken, done = [], []

    def items():
        for n in range(20):
            taken.append(n)
            yield n

    for found in side_by_side(items(), lambda n: n):
        done.append(found)
        assert len(taken) - len(done) <= 3


def test_several_work_at_a_time(monkeypatch):
    monkeypatch.setattr(module.os, "cpu_count", lambda: 2)
    both = threading.Barrier(2, timeout=20)
    assert list(side_by_side("ab", lambda _: both.wait() >= 0)) == [True, True]


def test_errors_come_in_the_place_of_their_items():
    def items():
        yield from (0, 1, 2)
        raise KeyError("of the items")

    def work(n):
        if n == 1:
            raise ValueError("of the work")
        return n

    found = []
    with pytest.raises(ValueError, match="of the work"):
        for one in side_by_side(items(), work):
            found.append(one)
    assert found == [0]
    with pytest.raises(KeyError, match="of the items"):
        list(side_by_side(items(), lambda n: n))
