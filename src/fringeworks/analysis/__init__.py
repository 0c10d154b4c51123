"""Fringe analyses: from two frames to the displacement of the fringes, one file per family."""

# Importing a family registers its methods.
from fringeworks.analysis import fourier, inverse_function, windowed  # noqa: F401
from fringeworks.analysis.pair import FringePair, prepare
from fringeworks.analysis.registry import Method, Solution, analyse, get_method, method, methods

__all__ = [
    "FringePair",
    "Method",
    "Solution",
    "analyse",
    "get_method",
    "method",
    "methods",
    "prepare",
]
