"""Fringe analyses, one file per family: two frames to displacements, stacks to coordinates."""

# Importing a family registers its methods.
from fringeworks.analysis import (  # noqa: F401
    fourier,
    inverse_function,
    wavelet,
    windowed,
    windowed_fourier,
)
from fringeworks.analysis.pair import FringePair, prepare
from fringeworks.analysis.phase_shift import StreamingDecoder, decode
from fringeworks.analysis.registry import Method, Solution, analyse, get_method, method, methods
from fringeworks.analysis.steps import estimate_shifts
from fringeworks.analysis.texture import texture
from fringeworks.analysis.wavelet import wavelet_frequencies, wavelet_ridge
from fringeworks.analysis.windowed_fourier import (
    Ridge,
    windowed_fourier_filter,
    windowed_fourier_ridge,
)

__all__ = [
    "FringePair",
    "Method",
    "Ridge",
    "Solution",
    "StreamingDecoder",
    "analyse",
    "decode",
    "estimate_shifts",
    "get_method",
    "method",
    "methods",
    "prepare",
    "texture",
    "wavelet_frequencies",
    "wavelet_ridge",
    "windowed_fourier_filter",
    "windowed_fourier_ridge",
]
