"""Producers of GenTL, which the makers of cameras install, and the cameras that they find."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from fringeworks.devices.genicam_names import Found
from fringeworks.types import DeviceProblem, MissingPackage

PATHS = "GENICAM_GENTL64_PATH" if sys.maxsize > 2**32 else "GENICAM_GENTL32_PATH"
"""Environment variable with the folders of the producers (GenTL standard, Installation)."""
SEARCH_MS = 500
"""Time that a producer gets to find its cameras, ms: those of GigE Vision answer within 200 ms
(GigE Vision, discovery), and producers ask at all network interfaces."""


def gentl() -> tuple[Any, Any]:
    """Return the modules ``genicam.gentl`` and ``genicam.genapi``.

    Raises
    ------
    MissingPackage where they are not installed.
    """
    try:
        return import_module("genicam.gentl"), import_module("genicam.genapi")
    except ImportError as error:
        raise MissingPackage(
            "GenTL cameras: expected the package genicam, got none; "
            "pip install 'fringeworks[gentl]'"
        ) from error


def producer_files() -> list[Path]:
    """Return the producers that are installed, in the order of the search path."""
    folders = [Path(word) for word in os.environ.get(PATHS, "").split(os.pathsep) if word]
    return [file for folder in folders for file in sorted(folder.glob("*.cti"))]


@cache
def _system(path: Path) -> Any:
    """A producer's system, which a process may open once only; it stays open until the end."""
    module, _ = gentl()
    producer = module.GenTLProducer.create_producer()
    producer.open(str(path))
    system = producer.create_system()
    system.open()
    return system


_interfaces: dict[tuple[Path, str], Any] = {}
"""Open interfaces by producer and identifier; they stay open like their systems."""


def _interfaces_of(path: Path) -> Iterator[Any]:
    system = _system(path)
    system.update_interface_info_list(SEARCH_MS)
    for info in system.interface_info_list:
        key = path, info.id_
        if key not in _interfaces:
            interface = info.create_interface()
            interface.open()
            _interfaces[key] = interface
        yield _interfaces[key]


def device_infos() -> list[Any]:
    """Return what all producers say about the cameras that are connected.

    A producer that does not load, or has no access to its interfaces, is left out if another one
    finds cameras.

    Raises
    ------
    MissingPackage without genicam; DeviceProblem where no producer is installed, or no camera is
    found and a producer fails.
    """
    module, _ = gentl()
    files = producer_files()
    if not files:
        raise DeviceProblem(
            f"GenTL cameras: expected a producer, a file .cti in a folder of {PATHS}, got none; "
            "install the package of your camera's maker"
        )
    found, problems = [], []
    for path in files:
        try:
            interfaces = list(_interfaces_of(path))
        except module.GenericException as error:
            problems.append(f"{path.name}: {said(error)}")
            continue
        for interface in interfaces:
            try:
                interface.update_device_info_list(SEARCH_MS)
                found += list(interface.device_info_list)
            except module.GenericException as error:
                problems.append(f"{path.name}: {said(error)}")
    # A producer that fails may be that of the camera which nobody else has found.
    if not found and problems:
        raise DeviceProblem(
            f"GenTL cameras: expected a producer that loads, got {'; '.join(problems)}"
        )
    return found


def gentl_cameras() -> list[Found]:
    """Search for cameras with all installed producers.

    Raises
    ------
    As ``device_infos``.
    """
    return [found_of(info) for info in device_infos()]


def found_of(info: Any) -> Found:
    """Return a camera as it is listed."""
    return Found(info.id_, *(_word(info, what) for what in ("vendor", "model", "serial_number")))


def named(identifier: str | None) -> Any:
    """Return the camera with an identifier, a serial number or a user's name; None: the first.

    Raises
    ------
    DeviceProblem that lists the cameras there are.
    """
    infos = device_infos()
    for info in infos:
        names = info.id_, _word(info, "serial_number"), _word(info, "user_defined_name")
        if identifier is None or identifier in names:
            return info
    listed = "; ".join(str(found_of(info)) for info in infos) or "none"
    raise DeviceProblem(
        f"camera {identifier or ''}".rstrip() + ": expected one that is connected and not in use; "
        f"cameras found: {listed}"
    )


def _word(info: Any, what: str) -> str:
    """A word about a camera; empty where the producer has none."""
    module, _ = gentl()
    try:
        return str(getattr(info, what))
    except module.GenericException:
        return ""


def said(error: BaseException) -> str:
    """Return a message of the library without its prefix and the place in its source."""
    text = str(error).removeprefix("GenTL exception: ")
    return text.partition(" (Message from")[0].partition(" : ")[0].rstrip(" .")
