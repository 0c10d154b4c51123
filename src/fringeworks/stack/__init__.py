"""Shifted frames and Gray code: from a stack of frames to projector coordinates."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
