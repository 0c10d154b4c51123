"""Methods and kinds of devices from outside the package."""

from __future__ import annotations

import os
from functools import cache

from fringeworks.devices.registry import BOTH_KINDS, CAMERA_KINDS, PROJECTOR_KINDS
from fringeworks.pair.plugins import load_entry_points, run_plugin
from fringeworks.pair.registry import REGISTERED

ENTRY_POINTS = "fringeworks.devices"
"""Group of entry points. Each names a module, or a function in one, that registers kinds."""


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
    """
    # The package's own register first, so that nobody takes their names.
    import fringeworks.devices.kinds
    import fringeworks.pair.methods  # noqa: F401

    return run_plugin(
        path,
        [REGISTERED, CAMERA_KINDS, PROJECTOR_KINDS, BOTH_KINDS],
        "fringeworks.method, camera_kind, projector_kind or scanner_kind",
    )
