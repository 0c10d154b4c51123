"""Two frames, or one: from fringes to displacements and heights over a reference plane."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
