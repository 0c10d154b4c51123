"""Public names that load on first use, each from the module that defines it.

A package lists its public names and their modules in the ``__init__.pyi`` beside its
``__init__.py``. Type checkers and editors read the same file. ``import fringeworks`` therefore
imports nothing heavy.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import scipy
else:

    class _Later:
        """SciPy, imported when one of its parts is used: 8 ms that many calls need not pay."""

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module("scipy"), name)

    scipy = _Later()

__all__ = ["face", "scipy"]


def _listed(package: str) -> dict[str, tuple[str, str]]:
    """Module and name of every public name of a package; an empty name stands for a module."""
    import ast

    stub = Path(sys.modules[package].__file__ or "").with_suffix(".pyi")
    found: dict[str, tuple[str, str]] = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            module = resolve_name("." * node.level + (node.module or ""), package)
            for alias in node.names:
                place = (module, alias.name) if node.module else (f"{module}.{alias.name}", "")
                found[alias.asname or alias.name] = place
    return found


def face(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package whose stub lists its public names."""
    known: dict[str, tuple[str, str]] = {}

    def listed() -> dict[str, tuple[str, str]]:
        if not known:
            known.update(_listed(package))
        return known

    def get(name: str) -> Any:
        if name == "__all__":
            return list(listed())
        if name.startswith("__") or name not in listed():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, attribute = listed()[name]
        found = import_module(module)
        value = getattr(found, attribute) if attribute else found
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: list(listed())
