"""Memory that calls of the library need beside their inputs and results."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

MOST_MB = 32.0
"""Frames of 1920 × 1200 and waves of 1024 × 1024 are to be measured with no more."""

MORE_MB = {
    "decompose_frame": 49.0,
    "decompose_rows": 52.0,
    "windowed_fourier_filter": 43.0,
    "unwrap, noisy": 128.0,
    "analyse, fourier": 57.0,
    "analyse, ifa": 79.0,
    "analyse, sifa": 79.0,
    "analyse, gsifa": 38.0,
    "analyse, exact": 38.0,
    "analyse, wavelet": 59.0,
    "analyse, windowed": 146.0,
    "analyse, windowed_fourier": 75.0,
}
"""Calls that need more, which is a fault, and what they must not exceed: a quarter more than they
needed at most in ten runs (their threads meet by chance). docs/performance.md names them."""

AT_ONCE = {"MALLOC_MMAP_THRESHOLD_": "131072", "MALLOC_ARENA_MAX": "1"}
"""Settings of the GNU allocator: arrays go back to the system as soon as they are freed. Otherwise
the allocator learns to keep tens of megabytes, which a call finds there or not by chance."""


@pytest.fixture(scope="module")
def extra_mb() -> dict[str, float]:
    if not Path("/proc/self/clear_refs").exists():
        pytest.skip("the peak of a call is known on Linux only")
    done = subprocess.run(
        [sys.executable, "-m", "tests.memory_probe"],
        cwd=Path(__file__).parent.parent,
        env=os.environ | AT_ONCE,
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def test_calls_need_little_memory(extra_mb):
    few = {name: mb for name, mb in extra_mb.items() if name not in MORE_MB}
    assert len(few) >= 9
    assert {name: mb for name, mb in few.items() if mb > MOST_MB} == {}


def test_the_others_do_not_need_more_than_they_did(extra_mb):
    assert {name: mb for name, mb in extra_mb.items() if mb > MORE_MB.get(name, MOST_MB)} == {}
    assert set(MORE_MB) <= set(extra_mb)
