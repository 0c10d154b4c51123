"""Scans: showing patterns and grabbing frames, with the right timing and exposure."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
