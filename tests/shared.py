"""What is costly to compute is computed by one worker of a run; the others read what it has found."""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from collections.abc import Callable
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

FOLDER: Path | None = None
"""Folder that the workers of this run share; None where one process runs all tests."""
WAIT_S = 150.0
"""A worker that waits longer for another computes the value itself."""
POLL_S = 0.05


def _read(path: Path) -> Any:
    """The value that another worker has stored, as soon as it is there."""
    start = time.monotonic()
    while not path.exists():
        if time.monotonic() - start > WAIT_S:
            raise TimeoutError
        time.sleep(POLL_S)
    return pickle.loads(path.read_bytes())


def _stored(path: Path, make: Callable[[], Any]) -> Any:
    """Compute and store a value; the mark keeps other workers from doing the same."""
    mark = path.with_suffix(".begun")
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        try:
            return _read(path)
        except TimeoutError:
            return make()
    try:
        value = make()
    except BaseException:
        mark.unlink()
        raise
    part = path.with_suffix(f".{os.getpid()}")
    part.write_bytes(pickle.dumps(value))
    part.replace(path)
    return value


def shared(function: Callable[..., Any]) -> Callable[..., Any]:
    """``lru_cache`` for all workers of a run; the arguments have a plain ``repr``."""

    @lru_cache
    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        if FOLDER is None:
            return function(*arguments, **options)
        key = f"{function.__module__}.{function.__qualname__} {arguments!r} {options!r}"
        path = FOLDER / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.pickle"
        return _stored(path, lambda: function(*arguments, **options))

    return call
