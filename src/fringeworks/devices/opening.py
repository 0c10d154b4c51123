"""Cameras and projectors from the words of a command line, such as ``webcam:0``."""

from __future__ import annotations

from collections.abc import Callable

import fringeworks.devices.kinds  # noqa: F401, registers first, so that nobody takes its names
from fringeworks.devices.plugins import load_installed
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.devices.registry import (
    CAMERA_KINDS,
    PROJECTOR_KINDS,
    Device,
    Finder,
    Kind,
    registering,
)
from fringeworks.types import DeviceProblem

VIRTUAL = "virtual"
"""Kind of the devices that exist in memory only; a projector and a camera go together."""


def camera_kind(
    name: str, *, find: Finder | None = None
) -> Callable[[Callable[[str], Camera]], Callable[[str], Camera]]:
    """Register a function that opens cameras of a kind.

    The function takes the words after ``name:``, empty where there are none, and returns a
    ``Camera``. The first line of its docstring describes it to users.

    Parameters
    ----------
    name : str
        A name that no other kind of camera has.
    find : callable, optional
        Returns the cameras that are there, for ``list_devices``.

    Raises
    ------
    InputError for a name that is taken.
    """
    return registering(CAMERA_KINDS, "camera", name, find)


def projector_kind(
    name: str, *, find: Finder | None = None
) -> Callable[[Callable[[str], Projector]], Callable[[str], Projector]]:
    """Register a function that opens projectors of a kind; see ``camera_kind``."""
    return registering(PROJECTOR_KINDS, "projector", name, find)


def camera_kinds() -> dict[str, Kind[Camera]]:
    """Return all kinds of cameras by name, those of installed plug-ins included."""
    load_installed()
    return dict(CAMERA_KINDS)


def projector_kinds() -> dict[str, Kind[Projector]]:
    """Return all kinds of projectors by name, those of installed plug-ins included."""
    load_installed()
    return dict(PROJECTOR_KINDS)


def open_camera(words: str) -> Camera:
    """Open a camera.

    Parameters
    ----------
    words : str
        A kind, and which one: ``webcam:0``, ``genicam``, ``genicam:IDENTIFIER``, ``folder:PATH``,
        or a kind that was registered with ``camera_kind``.

    Raises
    ------
    DeviceProblem for an unknown kind, listing those there are, and where the camera does not open;
    MissingPackage where a library is missing.
    """
    return _opened(camera_kinds(), "camera", words)


def open_projector(words: str) -> Projector:
    """Open a projector.

    Parameters
    ----------
    words : str
        A kind, and which one: ``screen``, ``screen:NAME``, ``screen:NUMBER``, ``memory:FOLDER``, or
        a kind that was registered with ``projector_kind``.

    Raises
    ------
    As ``open_camera``.
    """
    return _opened(projector_kinds(), "projector", words)


def _opened(kinds: dict[str, Kind[Device]], role: str, words: str) -> Device:
    name, _, which = words.partition(":")
    if name not in kinds:
        raise DeviceProblem(
            f"{role} {words!r}: expected a kind of {', '.join(sorted(kinds))}, alone or with a "
            f"colon and which one, got {name!r}"
        )
    return kinds[name].open(which)


def open_devices(projector: str, camera: str) -> tuple[Projector, Camera]:
    """Open a projector and a camera.

    Parameters
    ----------
    projector, camera : str
        As for ``open_projector`` and ``open_camera``. ``virtual`` or ``virtual:SCENE`` for both
        opens devices that exist in memory only, before a scene of ``SCENES``.

    Raises
    ------
    As ``open_camera``, and DeviceProblem where only one of them is virtual.
    """
    kinds = [words.partition(":")[0] for words in (projector, camera)]
    if VIRTUAL in kinds:
        if kinds[0] != kinds[1]:
            raise DeviceProblem(
                "virtual devices: expected projector and camera to be virtual, got "
                f"{projector} and {camera}"
            )
        from fringeworks.devices.clock import SimulatedClock
        from fringeworks.devices.virtual_bench import virtual_bench

        # Virtual devices make nobody wait.
        return virtual_bench(
            camera.partition(":")[2] or projector.partition(":")[2], clock=SimulatedClock()
        )
    opened = open_projector(projector)
    try:
        return opened, open_camera(camera)
    except BaseException:
        opened.close()
        raise
