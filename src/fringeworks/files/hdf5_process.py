"""Reads one variable of an HDF5 file and writes it to standard output; run by ``apart``.

The HDF5 library can crash on damaged files.
"""

from __future__ import annotations

import io
import sys


def main(path: str, name: str, most: str) -> None:
    """Write the variable as an ``.npy`` array."""
    import h5py
    import numpy as np

    with h5py.File(path, "r") as file:
        if name not in file:
            raise ValueError(f"no variable {name}")
        item = file[name]
        if not isinstance(item, h5py.Dataset) or item.ndim != 2 or item.dtype.kind not in "uif":
            raise ValueError(f"{name} is no real (h, w) array")
        if item.is_virtual or item.external or item.size * 8 > int(most):
            raise ValueError(f"{name} lies in other files or is too large")
        # HDF5 keeps MATLAB's order of columns: the axes are swapped.
        frame = np.ascontiguousarray(np.asarray(item).T)
    # NumPy itself writes arrays to files with a position only, which a pipe has not.
    written = io.BytesIO()
    np.save(written, frame, allow_pickle=False)
    sys.stdout.buffer.write(written.getbuffer())
