"""Which projectors and cameras are there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fringeworks.devices.opening import camera_kinds, projector_kinds
from fringeworks.devices.registry import Kind, ListedDevice
from fringeworks.types import InputError


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
