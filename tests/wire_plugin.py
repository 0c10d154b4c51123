"""A plug-in for the command line: ``--plugin tests/wire_plugin.py --projector wire:FOLDER``."""

from __future__ import annotations

from fringeworks.devices.opening import projector_kind
from tests.wire_rig import Screen


@projector_kind("wire")
def open_wire(folder):
    """``wire:FOLDER``: a projector whose pictures reach a fake camera through files."""
    return Screen(folder)
