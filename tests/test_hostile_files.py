"""Damaged and hostile files: every reader answers with one sentence, in bounded time and memory."""

from __future__ import annotations

import os
import resource
import time

import pytest

from fringeworks import InputError
from tests import hostile

MUTATIONS = int(os.environ.get("FRINGEWORKS_MUTATIONS", "2500"))
"""In all, over every reader; ``make fuzz`` takes more."""
SLOW_SHARE = 0.05
"""A reader that starts a process for each file gets this share of the others' number."""
SECONDS = 5.0
"""Longest time that a small damaged file may take; a usual one takes milliseconds."""
GROWTH_MB = 600
"""Largest growth of the peak memory by all readers together."""


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    return hostile.targets(tmp_path_factory.mktemp("good"))


def place(folder, target, content):
    folder = folder / target.name.replace("/", "-")  # plans beside files matter
    folder.mkdir(exist_ok=True)
    for name, data in {target.name: content, **target.beside}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    return folder / target.name


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def test_good_files_are_read(targets, tmp_path):
    for target in targets:
        assert target.read(place(tmp_path, target, target.content)) is not None, target.name


def test_mutations_raise_nothing_but_input_errors(targets, tmp_path, capfd):
    before, each = peak_mb(), MUTATIONS / (len(targets) - 1)
    refused = longest = 0
    for target in targets:
        count = max(int(each * (SLOW_SHARE if target.slow else 1.0)), 2) + 1
        for content in hostile.mutations(target, count, seed=13):
            path = place(tmp_path, target, content)
            started = time.perf_counter()
            try:
                target.read(path)
            except InputError as error:
                refused += 1
                longest = max(longest, len(str(error)))
            except Exception as error:
                pytest.fail(f"{target.name}: {type(error).__name__}: {error}")
            assert time.perf_counter() - started < SECONDS, target.name
    assert longest < 1500
    assert refused > 0.4 * MUTATIONS
    assert capfd.readouterr() == ("", "")
    assert peak_mb() - before < GROWTH_MB
