"""What holds for tests and for the examples of docstrings alike."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _methods_of_the_package():
    """Methods that a test or an example brings go with it: the next one must not find them."""
    yield
    registry = sys.modules.get("fringeworks.pair.registry")
    if registry is None:
        return
    package = Path(registry.__file__).parents[1]
    for name, found in list(registry.REGISTERED.items()):
        if not Path(found.function.__code__.co_filename).is_relative_to(package):
            del registry.REGISTERED[name]
