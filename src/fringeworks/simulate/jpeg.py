"""The loss of JPEG compression, without the file: quantised cosine transforms of 8 × 8 pixels."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

BLOCK = 8
"""Side of a block, px (ITU-T T.81)."""
LUMINANCE = np.array(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ]
)
"""Quantisation steps of luminance at quality 50, by frequency (ITU-T T.81, table K.1)."""
MIDDLE = 128.0
"""Brightness that is subtracted before the transform, counts."""


def quantisation(quality: int) -> NDArray[np.float64]:
    """Steps of an (8, 8) block at a quality of 1…100, as the IJG library scales them."""
    percent = 5000 // quality if quality < 50 else 200 - 2 * quality
    steps = (LUMINANCE * percent + 50) // 100
    # The file format holds steps of 1 to 255.
    return np.asarray(np.clip(steps, 1, 255), dtype=np.float64)


def jpeg_compressed(frame: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Return a frame as it comes back from a JPEG file.

    Parameters
    ----------
    frame : (h, w) uint8 array
    quality : int, 1 … 100

    Returns
    -------
    (h, w) uint8 array

    Examples
    --------
    >>> frame = np.full((10, 12), 77, np.uint8)
    >>> bool((jpeg_compressed(frame, 50) == jpeg_compressed(frame, 50)[0, 0]).all())
    True
    """
    h, w = frame.shape
    padded = np.pad(frame, ((0, -h % BLOCK), (0, -w % BLOCK)), mode="edge").astype(np.float64)
    rows, columns = padded.shape[0] // BLOCK, padded.shape[1] // BLOCK
    blocks = padded.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2) - MIDDLE
    steps = quantisation(quality)
    coefficients = np.rint(scipy.fft.dctn(blocks, axes=(2, 3), norm="ortho") / steps) * steps
    decoded = scipy.fft.idctn(coefficients, axes=(2, 3), norm="ortho") + MIDDLE
    # Decoders limit the result to the range of 8 bit.
    whole = np.clip(np.rint(decoded), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(whole.swapaxes(1, 2).reshape(padded.shape)[:h, :w])
