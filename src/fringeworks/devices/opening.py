"""Cameras and projectors: their list, and one from the words of a command line, ``webcam:0``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import fringeworks.devices.kinds  # noqa: F401, registers first, so that nobody takes its names
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.devices.registry import (
    BOTH_KINDS,
    CAMERA_KINDS,
    PROJECTOR_KINDS,
    Both,
    Device,
    Finder,
    Kind,
    ListedDevice,
    load_installed,
    registering,
)
from fringeworks.types import DeviceProblem, InputError


def list_devices() -> tuple[list[ListedDevice], list[ListedDevice]]:
    """Look for projectors and cameras, and open each camera to read its limits.

    Returns
    -------
    projectors, cameras : lists of ListedDevice
        For each kind that can be listed, those that were found, or one line that says that there
        are none or what is missing.
    """
    return list(_found(projector_kinds())), list(_found(camera_kinds()))


def _found(kinds: Mapping[str, Kind[Any]]) -> Iterator[ListedDevice]:
    for kind in kinds.values():
        if kind.find is None:
            continue
        count = 0
        try:
            for count, found in enumerate(kind.find(), 1):  # noqa: B007, used after the loop
                yield found
        except InputError as problem:
            said = str(problem).removeprefix(f"{kind.name}: ")
            yield ListedDevice(kind.name, said, usable=False)
        else:
            if count == 0:
                yield ListedDevice(kind.name, "none found", usable=False)


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


def scanner_kind(name: str) -> Callable[[Callable[[str], Both]], Callable[[str], Both]]:
    """Register a function that opens a projector and a camera that belong together.

    Such as a scan head with one plug, or ``virtual``. The name must be free among projectors and
    cameras as well. See ``camera_kind``.
    """
    return registering(BOTH_KINDS, "scanner", name, None)


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
        A kind, and which one: ``webcam:0``, ``genicam``, ``genicam:IDENTIFIER``, ``gentl``,
        ``folder:PATH``,
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
    return _kind(kinds, role, words).open(words.partition(":")[2])


def _kind(kinds: dict[str, Kind[Device]], role: str, words: str) -> Kind[Device]:
    """The kind that words name."""
    name = words.partition(":")[0]
    if name in BOTH_KINDS:
        raise DeviceProblem(
            f"{role} {words!r}: {name} opens a projector and a camera together; expected "
            f"it for both, as in open_devices({name!r}, {name!r})"
        )
    if name not in kinds:
        raise DeviceProblem(
            f"{role} {words!r}: expected a kind of {', '.join(sorted(kinds))}, alone or with a "
            f"colon and which one, got {name!r}"
        )
    return kinds[name]


def open_devices(projector: str, camera: str) -> tuple[Projector, Camera]:
    """Open a projector and a camera.

    Parameters
    ----------
    projector, camera : str
        As for ``open_projector`` and ``open_camera``, such as ``screen:1`` and ``webcam:0``; or a
        kind of ``scanner_kind`` for both, with which one at either. ``virtual`` opens devices that
        exist in memory only, before the bust; ``virtual:SCENE`` before a scene of
        ``virtual_bench``. Their rig is ``fringeworks.devices.virtual_rig()``. ``list_devices``
        says what is there.

    Returns
    -------
    projector, camera
        Both close with ``with``, or by ``close()``.

    Raises
    ------
    As ``open_camera``, and DeviceProblem where two devices that belong together are not named both.

    Examples
    --------
    >>> projector, camera = open_devices("virtual:sphere", "virtual:sphere")
    >>> projector.size_px
    (576, 360)
    >>> projector.close(), camera.close()
    (None, None)
    """
    load_installed()
    (shows, _, one), (films, _, other) = (w.partition(":") for w in (projector, camera))
    both = BOTH_KINDS.get(films) or BOTH_KINDS.get(shows)
    if both is not None:
        if shows != films or (one and other and one != other):
            raise DeviceProblem(
                f"{both.name}: opens a projector and a camera together; expected {both.name} for "
                f"both of them, got {projector} and {camera}"
            )
        return both.open(other or one)
    # Words that name no camera are refused before a projector turns black.
    _kind(camera_kinds(), "camera", camera)
    opened = open_projector(projector)
    try:
        return opened, open_camera(camera)
    except BaseException:
        opened.close()
        raise
