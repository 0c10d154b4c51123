"""Summaries, tables and figures of results."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
