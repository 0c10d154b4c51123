"""The registered methods, one file per family; importing this package registers them."""

from fringeworks.pair.methods import (  # noqa: F401
    fourier,
    inverse_function,
    wavelet,
    windowed,
    windowed_fourier,
)
