"""The kinds of devices by name, also of plug-ins. A new kind is one function with a decorator."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Generic, TypeVar

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.pair.plugins import load_entry_points, run_plugin
from fringeworks.pair.registry import REGISTERED
from fringeworks.types import InputError

ENTRY_POINTS = "fringeworks.devices"
"""Group of entry points. Each names a module, or a function in one, that registers kinds."""
Both = tuple[Projector, Camera]
"""A projector and a camera that belong together."""
Device = TypeVar("Device", bound=Camera | Projector | Both)
NAME = re.compile(r"[a-z][a-z0-9_-]*")
"""Names of kinds: words of a command line, without the colon that ends them."""


@cache
def load_installed() -> None:
    """Load the kinds of devices of installed plug-ins, once.

    Raises
    ------
    InputError that names the plug-in that cannot be loaded.
    """
    load_entry_points(ENTRY_POINTS)


def load_plugin(path: str | os.PathLike[str]) -> list[str]:
    """Run a Python file that registers methods, or kinds of cameras or projectors.

    Parameters
    ----------
    path : path of a ``.py`` file
        It runs with all rights of the caller: load only files that you trust.

    Returns
    -------
    Names of the methods and kinds that it registered.

    Raises
    ------
    InputError where there is no such file, it fails, it registers nothing, or a name is taken.

    Notes
    -----
    ``fringeworks.method``, ``devices.camera_kind``, ``projector_kind`` and ``scanner_kind``
    register. ``examples/own_method.py`` and ``examples/vendor_camera.py`` are such files.
    """
    # The package's own register first, so that nobody takes their names.
    import fringeworks.devices.kinds
    import fringeworks.pair.methods  # noqa: F401

    return run_plugin(
        path,
        [REGISTERED, CAMERA_KINDS, PROJECTOR_KINDS, BOTH_KINDS],
        "fringeworks.method, camera_kind, projector_kind or scanner_kind",
    )


@dataclass(frozen=True)
class ListedDevice:
    """A device that was found, or one line that says why none was."""

    words: str
    """What ``open_camera`` or ``open_projector`` takes, such as ``webcam:0``; the kind alone where
    none was found."""
    description: str
    """Its name and limits, or what is missing."""
    usable: bool = True
    """Whether it can be opened."""

    def __str__(self) -> str:
        return f"{self.words}: {self.description}"


Finder = Callable[[], Iterable[ListedDevice]]
"""Finds the devices of a kind. Where that needs something that is missing, it raises an
InputError."""


@dataclass(frozen=True)
class Kind(Generic[Device]):
    """A kind of camera, of projector, or of both together."""

    name: str
    summary: str
    """First line of the function's docstring."""
    open: Callable[[str], Device]
    """Opens a device from the words after the colon; empty where there are none."""
    find: Finder | None = None
    """Finds the devices of this kind; None where they cannot be listed."""


CAMERA_KINDS: dict[str, Kind[Camera]] = {}
"""The kinds of cameras that were registered so far."""
PROJECTOR_KINDS: dict[str, Kind[Projector]] = {}
"""The kinds of projectors that were registered so far."""
BOTH_KINDS: dict[str, Kind[Both]] = {}
"""The kinds of projector and camera in one device that were registered so far."""


def registering(
    kinds: dict[str, Kind[Device]], role: str, name: str, find: Finder | None
) -> Callable[[Callable[[str], Device]], Callable[[str], Device]]:
    """Return a decorator that registers a kind; see ``camera_kind``."""

    def register(function: Callable[[str], Device]) -> Callable[[str], Device]:
        if not NAME.fullmatch(name):
            raise InputError(
                f"{role} kind {name!r}: expected small letters, digits, - and _, a letter first"
            )
        # A scanner is named in the place of a projector and of a camera.
        tables = (CAMERA_KINDS, PROJECTOR_KINDS) if role == "scanner" else (BOTH_KINDS,)
        taken = next((table[name] for table in (kinds, *tables) if name in table), None)
        if taken is not None and _place(taken.open) != _place(function):
            raise InputError(
                f"{role} kind {name!r}: expected a name that is free, got that of "
                f"{taken.open.__module__}.{taken.open.__qualname__}"
            )
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        kinds[name] = Kind(name, summary, function, find)
        return function

    return register


def _place(function: Callable[..., object]) -> tuple[str, str, str | None]:
    """Where a function is defined: equal where its file was loaded twice."""
    return function.__module__, function.__qualname__, inspect.getsourcefile(function)
