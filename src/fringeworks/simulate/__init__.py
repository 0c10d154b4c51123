"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
