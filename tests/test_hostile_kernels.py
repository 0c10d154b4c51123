"""Kernels with spoiled arrays: a result or ``ValueError``, never a panic, in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.kernels import EVERY_KERNEL

pytestmark = pytest.mark.system

CALLS = int(os.environ.get("FRINGEWORKS_KERNEL_CALLS", "6"))
"""Calls of every kernel; ``make fuzz`` makes more."""
SPOIL = """
import copy, faulthandler, random, sys
from tests.hostile_calls import arrays_in

records = {}

def recorded(name, kernel):
    def call(*arguments, **options):
        kept = records.setdefault(name, [])
        if len(kept) < 6:
            kept.append((tuple(map(kept_copy, arguments)), {k: kept_copy(v) for k, v in options.items()}))
        return kernel(*arguments, **options)
    return call

def kept_copy(value):
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, (list, tuple)):
        return type(value)(kept_copy(item) for item in value)
    if isinstance(value, dict):
        return {name: kept_copy(item) for name, item in value.items()}
    return value

originals = {name: getattr(_core, name) for name in kernels}
for name in kernels:
    setattr(_core, name, recorded(name, originals[name]))
results()

VALUES = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e30, -1e30, 3.4e38, 1e-42)

def spoiled(array, rng):
    out = array.copy()
    where = np.random.default_rng(rng.getrandbits(32)).random(out.shape) < rng.choice((0.02, 0.5, 1.0))
    kind = rng.randrange(8)
    if kind == 0 and out.ndim:
        return np.ascontiguousarray(out[: rng.randrange(len(out) + 1)])
    if kind == 1 and out.ndim > 1:
        return np.ascontiguousarray(out[:, : rng.randrange(out.shape[1] + 1)])
    if kind == 2:
        return np.asfortranarray(out) if out.ndim > 1 else out[::-1]
    if out.dtype.kind == "f":
        out[where] = rng.choice(VALUES)
    elif out.dtype.kind == "c":
        out[where] = complex(rng.choice(VALUES), rng.choice(VALUES))
    elif out.dtype.kind in "ui":
        out[where] = rng.choice((0, 1, np.iinfo(out.dtype).max))
    else:
        out[where] = ~out[where]
    return out

def replaced(value, target, rng):
    if value is target:
        return spoiled(value, rng)
    if isinstance(value, (list, tuple)):
        return type(value)(replaced(item, target, rng) for item in value)
    if isinstance(value, dict):
        return {name: replaced(item, target, rng) for name, item in value.items()}
    return value

tried = refused = 0
for name in sorted(records):
    for number in range(COUNT):
        rng = random.Random(f"{name} {number}")
        arguments, options = rng.choice(records[name])
        arguments, options = tuple(map(kept_copy, arguments)), {k: kept_copy(v) for k, v in options.items()}
        arrays = [a for a in arrays_in((arguments, options)) if a.size]
        if not arrays:
            continue
        target = rng.choice(arrays)
        arguments = replaced(arguments, target, rng)
        options = replaced(options, target, rng)
        faulthandler.dump_traceback_later(60, exit=True)
        tried += 1
        try:
            originals[name](*arguments, **options)
        except (ValueError, TypeError):
            refused += 1
        except BaseException as error:
            print("FAULT", name, number, type(error).__name__, str(error)[:200])
        faulthandler.cancel_dump_traceback_later()
print(tried, refused, len(records))
"""


def test_kernels_do_not_panic():
    script = EVERY_KERNEL.split("first = results()")[0] + SPOIL.replace("COUNT", str(CALLS))
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        timeout=200 if CALLS < 100 else 3600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "FAULT" not in done.stdout, done.stdout
    tried, refused, kernels = map(int, done.stdout.split())
    assert kernels > 25
    assert tried > 0.8 * CALLS * kernels
    assert 0 < refused < tried
