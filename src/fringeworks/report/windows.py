"""The part of a frame that holds what was measured: pictures of parts are cropped to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types import ByteMap, Reason

MARGIN = 0.04
"""Room about what was measured, share of its longer side."""


@dataclass(frozen=True)
class Window:
    """A box of pixels: its first and last column and row."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.right - self.left + 1

    @property
    def height(self) -> int:
        """Number of rows."""
        return self.bottom - self.top + 1


def window_of(reason: ByteMap) -> Window:
    """Return the box about all measured pixels, with some room; the frame where there are none."""
    rows, columns = reason.shape
    ok = reason == Reason.OK
    across, down = np.flatnonzero(ok.any(axis=0)), np.flatnonzero(ok.any(axis=1))
    if not across.size:
        return Window(0, 0, columns - 1, rows - 1)
    room = 1 + int(MARGIN * max(np.ptp(across), np.ptp(down)))
    return Window(
        max(int(across[0]) - room, 0),
        max(int(down[0]) - room, 0),
        min(int(across[-1]) + room, columns - 1),
        min(int(down[-1]) + room, rows - 1),
    )
