"""The public names of the package: those of the top, and those of its submodules with the submodule before the dot."""

from __future__ import annotations

import inspect
from types import ModuleType
from typing import Any

import fringeworks as fw


def public_names() -> list[str]:
    """Every public name as users write it after ``fw.``, submodules themselves left out."""
    top = {name: getattr(fw, name) for name in fw.__all__}
    found = [name for name, value in top.items() if not inspect.ismodule(value)]
    for name, value in top.items():
        if inspect.ismodule(value):
            found += [f"{name}.{inner}" for inner in value.__all__]
    return found


def submodules() -> dict[str, ModuleType]:
    """The public submodules by name."""
    return {n: getattr(fw, n) for n in fw.__all__ if inspect.ismodule(getattr(fw, n))}


def public(name: str) -> Any:
    """The value of a public name, such as ``rig.observe``."""
    value: Any = fw
    for part in name.split("."):
        value = getattr(value, part)
    return value


def by_last(name: str) -> Any:
    """The value of the public name that ends with a name: no two end alike."""
    (found,) = [full for full in public_names() if full.rpartition(".")[2] == name]
    return public(found)
