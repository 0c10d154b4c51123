"""Several views of one part: their poses, how they fit together, and the part that they show."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
