"""Turns a STEP or IGES file into triangles (GLB) on standard output; run by ``apart``.

A damaged file may crash the geometry kernel, which is C++.
"""

from __future__ import annotations

import os
import sys
from typing import Literal


def main(path: str, kind: Literal["step", "iges"], chord: str, relative: str, angle: str) -> None:
    """Write the triangles of every face with the face's nominal form, as GLB."""
    import cascadio

    # The kernel prints to standard output: only the triangles may go there.
    out = os.dup(1)
    os.dup2(2, 1)
    with open(path, "rb") as file:
        content = file.read()
    found = cascadio.load(
        content,
        kind,
        tol_linear=float(chord),
        tol_angular=float(angle),
        tol_relative=relative == "relative",
        use_parallel=False,
        include_brep=True,
    )
    sys.stdout.flush()
    with os.fdopen(out, "wb") as target:
        target.write(found)
