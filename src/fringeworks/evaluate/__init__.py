"""Errors against a known truth, and comparison of methods."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
