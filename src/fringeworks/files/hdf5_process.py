"""Reads one variable of an HDF5 file and writes it to standard output; run by ``mat``.

A program of its own, with limits: the HDF5 library can crash on damaged files. It imports nothing
of the package. Exit code 2: one line on standard error says what is wrong.
"""

from __future__ import annotations

import io
import sys

MARGIN_BYTES = 2 << 30
"""Memory beyond the variable itself: Python, NumPy and HDF5 reserve about 1 GB of addresses."""
COPIES = 3
"""Copies of a variable that reading and turning it takes."""
CPU_SECONDS = 60
"""Processor time that reading may take."""


def main(path: str, name: str, limit: int) -> None:
    """Write the variable as an ``.npy`` array."""
    try:
        import resource

        memory = MARGIN_BYTES + COPIES * limit
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, ValueError, OSError):
        pass  # no such limits on this system; the caller's time limit remains
    import h5py
    import numpy as np

    with h5py.File(path, "r") as file:
        if name not in file:
            sys.exit(_failed(f"no variable {name}"))
        item = file[name]
        if not isinstance(item, h5py.Dataset) or item.ndim != 2 or item.dtype.kind not in "uif":
            sys.exit(_failed(f"{name} is no real (h, w) array"))
        if item.is_virtual or item.external or item.size * 8 > limit:
            sys.exit(_failed(f"{name} lies in other files or is too large"))
        # HDF5 keeps MATLAB's order of columns: the axes are swapped.
        frame = np.ascontiguousarray(np.asarray(item).T)
    # NumPy itself writes arrays to files with a position only, which a pipe has not.
    written = io.BytesIO()
    np.save(written, frame, allow_pickle=False)
    sys.stdout.buffer.write(written.getbuffer())


def _failed(why: str) -> int:
    print(why, file=sys.stderr)
    return 2


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    except Exception as error:  # HDF5 raises many kinds for a damaged file
        sys.exit(_failed(f"{type(error).__name__}: {error}".replace("\n", " ")))
