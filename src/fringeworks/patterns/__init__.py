"""What the projector shows: plans of shifted fringes and Gray code, and their pictures."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
