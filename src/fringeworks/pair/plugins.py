"""What comes from outside the package: installed plug-ins, and single Python files."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence
from functools import cache
from importlib import metadata
from typing import Any

from fringeworks.pair import registry
from fringeworks.pair.registry import Analysis
from fringeworks.types import FileProblem, InputError

ENTRY_POINTS = "fringeworks.methods"
"""Group of entry points. Each names a module, or a function in one, that registers methods."""
_LOADED: dict[str, list[str]] = {}
"""What the files registered that were loaded already, by the name of their module."""


def method(name: str) -> Callable[[Analysis], Analysis]:
    """Register a fringe analysis of two frames under a name.

    The function takes a ``PreparedPair`` and keyword options, each with a default, and returns a
    ``Solution``. The first line of its docstring describes it to users.

    Parameters
    ----------
    name : str
        A name that no other method has.

    Raises
    ------
    InputError for a name that is taken, and for options without a default.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> @fw.method("still")
    ... def still(pair: fw.pair.PreparedPair, *, sigma: float = 0.5) -> fw.pair.Solution:
    ...     "Finds no displacement anywhere."
    ...     zero = np.zeros(pair.object.shape)
    ...     return fw.pair.Solution(zero, zero + sigma, zero + 1, np.zeros(zero.shape, np.uint8))
    >>> fw.pair.get_method("still").options
    {'sigma': 0.5}
    """
    _load_own()
    return registry.method(name)


def _load_own() -> None:
    """Load the package's own methods first, so that nobody takes their names."""
    import fringeworks.pair.methods  # noqa: F401


@cache
def load_installed() -> None:
    """Load the methods of installed plug-ins, once.

    Raises
    ------
    InputError that names the plug-in that cannot be loaded.
    """
    load_entry_points(ENTRY_POINTS)


def load_entry_points(group: str) -> None:
    """Load what installed plug-ins register.

    Parameters
    ----------
    group : str
        Name of the group of entry points.

    Raises
    ------
    InputError that names the plug-in that cannot be loaded.
    """
    for entry in metadata.entry_points(group=group):
        try:
            entry.load()
        except InputError:
            raise
        except Exception as error:  # a plug-in may raise anything
            raise InputError(
                f"plug-in {entry.name} ({entry.value}): could not be loaded: {_told(error)}"
            ) from error


def run_plugin(
    path: str | os.PathLike[str], registries: Sequence[dict[str, Any]], decorators: str
) -> list[str]:
    """Run a Python file that registers something, once.

    Parameters
    ----------
    path : path of a ``.py`` file
    registries : dicts
        To which it may add, by name. What it added is removed if it fails.
    decorators : str
        What adds to them, for the message where nothing was added.

    Returns
    -------
    Names that were added.

    Raises
    ------
    InputError where there is no such file, it fails, it registers nothing, or a name is taken.
    """
    path = os.fspath(path)
    if not os.path.isfile(path):
        raise FileProblem(f"{path}: expected a Python file, got no such file")
    digest = hashlib.sha256(os.path.abspath(path).encode()).hexdigest()[:12]
    name = f"fringeworks_plugin_{digest}"
    if name in _LOADED:
        return _LOADED[name]
    before = [set(registry) for registry in registries]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FileProblem(f"{path}: expected a Python file (.py), got {os.path.basename(path)}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # a plug-in may raise anything
        del sys.modules[name]
        for registry, had in zip(registries, before, strict=True):
            for half_done in set(registry) - had:
                del registry[half_done]
        raise InputError(f"{path}: could not be loaded: {_told(error)}") from error
    added = sorted(
        name
        for registry, had in zip(registries, before, strict=True)
        for name in set(registry) - had
    )
    if not added:
        del sys.modules[name]
        raise InputError(f"{path}: expected a function with the decorator {decorators}, got none")
    _LOADED[name] = added
    return added


def loaded_plugins() -> list[str]:
    """Paths of the files that were loaded, for processes that are started later."""
    return [str(sys.modules[name].__file__) for name in _LOADED]


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
