"""Kernels in forked processes: every one works there, after it has worked in the parent."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from tests.kernels import EVERY_KERNEL, run

BINDINGS = Path(__file__).parents[1] / "crates/bindings/src"

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork"),
]


def test_every_kernel_works_in_a_forked_process():
    assert run(EVERY_KERNEL).strip() == "equal"


POOL = """
import multiprocessing
import fringeworks as fw
from tests.stacks import multi, take

plan = multi((1, 8), 4, (300, 40))
stacks = [take(plan, seed=k) for k in range(4)]

def coordinates(frames):
    return fw.decode(frames, plan).x.coordinate_px.tobytes()

expected = [coordinates(frames) for frames in stacks]
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert pool.map(coordinates, stacks) == expected
print("equal")
"""


def test_a_pool_of_forked_workers():
    assert run(POOL).strip() == "equal"


BUSY = """
import os, threading
import fringeworks as fw
from tests.stacks import multi, take

plan = multi((1, 8), 4, (300, 40))
frames = take(plan)
expected = fw.decode(frames, plan)
stop = threading.Event()

def work():
    while not stop.is_set():
        fw.decode(frames, plan)

workers = [threading.Thread(target=work) for _ in range(3)]
for worker in workers:
    worker.start()
for _ in range(20):
    child = os.fork()
    if child == 0:
        os._exit(0 if fw.decode(frames, plan) == expected else 3)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
stop.set()
for worker in workers:
    worker.join()
print("equal")
"""


def test_forks_while_other_threads_decode():
    assert run(BUSY).strip() == "equal"


THREADS = """
import time
from pathlib import Path
import fringeworks as fw
from tests.stacks import multi, take
plan = multi((1, 8), 4, (300, 200))
fw.decode(take(plan), plan)
# The last thread of a busy machine may still be starting.
end = time.monotonic() + 5.0
found = 0
while found < 3 and time.monotonic() < end:
    names = [(task / "comm").read_text() for task in Path("/proc/self/task").iterdir()]
    found = sum(name.startswith("fringeworks") for name in names)
print(found)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="the system lists no threads")
def test_the_number_of_threads_is_that_of_the_environment():
    assert run(THREADS, RAYON_NUM_THREADS="3").strip() == "3"


def test_bindings_share_their_threads_and_guards():
    for path in BINDINGS.glob("*.rs"):
        text = path.read_text()
        if path.name != "threads.rs":
            assert not re.search(r"\.detach\(|rayon", text), path.name
        if path.name != "rows.rs":
            assert not re.search(r"\.as_slice(_mut)?\(|\.as_array", text), path.name
