"""The same bits from every kernel: on one thread or many, and for several callers at once."""

from __future__ import annotations

import pytest

from tests.kernels import EVERY_KERNEL, run

pytestmark = pytest.mark.system

PRINTED = EVERY_KERNEL.split("first = results()")[0] + "print(fingerprint(tuple(results())))\n"
AT_ONCE = (
    EVERY_KERNEL.split("first = results()")[0]
    + """
from concurrent.futures import ThreadPoolExecutor

with ThreadPoolExecutor(2) as pool:
    one, other = pool.map(lambda _: results(), range(2))
assert one == other
print(fingerprint(tuple(one)))
"""
)
SPAWNED = """
import multiprocessing
import fringeworks as fw
from fringeworks.types import fingerprint
from tests.stacks import multi, take

plan = multi((1, 8), 4, (300, 40))

def decoded(seed):
    return fingerprint(fw.decode(take(plan, seed=seed), plan))

if __name__ == "__main__":
    import tests.kernels as module

    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.map(module.spawned, range(4))
    assert found == [decoded(seed) for seed in range(4)]
    print("equal")
"""


@pytest.fixture(scope="module")
def on_one_thread():
    return run(PRINTED, RAYON_NUM_THREADS="1")


@pytest.mark.parametrize("threads", ["2", pytest.param("7", marks=pytest.mark.long)])
def test_threads_give_the_same_bits(threads, on_one_thread):
    """Threads of the kernels, and two of Python that call them at once."""
    assert run(AT_ONCE, RAYON_NUM_THREADS=threads) == on_one_thread


def test_spawned_children_give_the_same_bits():
    assert run(SPAWNED).strip() == "equal"
