"""Everything that touches a disk, one file for each kind."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
