"""What is shown of the modes of a frame."""

from __future__ import annotations

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.sheets import Panel, Sheet, titled
from fringeworks.signal.denoise import Decomposition

COLUMNS = 4
"""Modes beside each other."""


def picture(found: Decomposition, name: str | None) -> Sheet:
    """The modes from fast to slow, each on a scale of its own, and the residue."""
    # Modes of rows are (h, k, w), those of a frame (k, h, w).
    by_rows = len(found.counts) == len(found.residue) and found.imfs.shape[0] == len(found.counts)
    modes = np.moveaxis(found.imfs, 1, 0) if by_rows else found.imfs
    panels = [
        *(Panel(f"mode {k}", mode, "signed", "counts") for k, mode in enumerate(modes, 1)),
        Panel("residue", found.residue, "grey", "counts"),
    ]
    rows, columns = found.residue.shape
    kind = "of every row" if by_rows else "of the frame"
    facts = f"{len(modes)} modes {kind}, fast first, {columns} × {rows} px"
    return Sheet(titled(name, "Modes of a frame"), facts, panels, columns=COLUMNS)


describe(Decomposition, Kind(picture=picture))
