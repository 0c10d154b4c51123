"""Devices: projectors that show pictures and cameras that grab frames, real and virtual."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
