"""Work on several captures at a time, whose results come in order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

MOST_WORKERS = 4
"""Largest number of captures in work at a time: each has its frames and maps in memory, 100 MB per
megapixel, and kernels use all processors anyway."""

Item = TypeVar("Item")
Found = TypeVar("Found")


def side_by_side(items: Iterable[Item], work: Callable[[Item], Found]) -> Iterator[Found]:
    """Yield what work makes of each item, in the order of the items.

    Items are taken one by one, a few ahead of the results. An error comes in the place of its item,
    also where a later item had another one before.

    Examples
    --------
    >>> list(side_by_side("abc", str.upper))
    ['A', 'B', 'C']
    """
    workers = min(MOST_WORKERS, os.cpu_count() or 1)
    source, trouble = iter(items), None
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[Found]] = deque()
        while True:
            try:
                waiting.append(pool.submit(work, next(source)))
            except StopIteration:
                break
            except Exception as error:
                trouble = error
                break
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    if trouble is not None:
        raise trouble
