"""What the ways of taking frames have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from fringeworks.devices.protocols import Grab
from fringeworks.scan.saturation import SaturationGuard


class Picture(NamedTuple):
    """A picture of a plan."""

    number: int
    """In the plan, from 0."""
    label: str
    """Name in messages and files."""
    counts: NDArray[Any]
    """(rows, columns), or (rows, columns, 3) in colours, in the size of the projector."""


class Taker(Protocol):
    """A way of taking frames."""

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Show pictures and take frames of each.

        Parameters
        ----------
        pictures : iterable of Picture
        average : int
            Number of frames of each picture.
        guard : SaturationGuard, optional
            Refuses frames with too many saturated pixels.

        Yields
        ------
        Number of the picture, and its frames.

        Raises
        ------
        DeviceProblem where frames do not come, or too many pixels are saturated.
        """
