"""The registered methods, one file for each family. Importing this package registers them."""

from fringeworks.pair.methods import (  # noqa: F401
    fourier,
    inverse_function,
    wavelet,
    windowed,
    windowed_fourier,
)
