"""Parts of the camera's image: boxes, polygons, masks, and faces of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import BoolMap
from fringeworks.types.checks import MOST_PX, finite, whole
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen

KINDS = ("box", "polygon", "mask", "face")
"""Fields of an area; exactly one of them is given."""


@dataclass(frozen=True, eq=False, repr=False)
class Area(Frozen):
    """A part of the camera's image; exactly one of its fields is given.

    Raises
    ------
    InputError for none or several of them, and for a box or a polygon without pixels.
    """

    box: tuple[int, int, int, int] | None = None
    """First column, first row, last column and last row; the last ones belong to it."""
    polygon: tuple[tuple[float, float], ...] | None = None
    """Corners (column, row), px; pixels whose centre lies inside belong to it."""
    mask: BoolMap | None = None
    """True for its pixels, (h, w)."""
    face: str | None = None
    """Name or number of a face of the recipe's model: the pixels that lie on it once the part is
    aligned, without those beside its sharp edges."""

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [name for name in KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                "area: expected a box, a polygon, a mask or a face, got "
                f"{' and '.join(given) or 'none'}"
            )
        if self.box is not None and not (
            len(self.box) == 4
            and all(whole(v, -MOST_PX, MOST_PX) for v in self.box)
            and self.box[2] >= self.box[0]
            and self.box[3] >= self.box[1]
        ):
            raise InputError(
                "area: expected a box as first column, first row, last column, last row, got "
                f"{self.box}"
            )
        if self.polygon is not None and not (
            len(self.polygon) >= 3 and all(len(c) == 2 and finite(*c) for c in self.polygon)
        ):
            raise InputError(
                "area: expected a polygon of 3 corners (column, row) or more, got "
                f"{len(self.polygon)}: {str(self.polygon)[:100]}"
            )
        if self.mask is not None and (self.mask.ndim != 2 or self.mask.dtype != bool):
            raise InputError(
                f"area: expected a mask (h, w) of bool, got {self.mask.dtype} {self.mask.shape}"
            )

    def pixels(self, shape: tuple[int, int]) -> BoolMap:
        """Return which pixels of a frame belong to it.

        Parameters
        ----------
        shape : (rows, columns)

        Returns
        -------
        (h, w) bool array

        Raises
        ------
        InputError where it has no pixel in the frame, for a mask of another shape, and for a face,
        whose pixels follow from the alignment.
        """
        if self.face is not None:
            raise InputError(
                f"area: expected a box, a polygon or a mask, got the face {self.face!r}, whose "
                "pixels are not known before the part is aligned to its model"
            )
        if self.mask is not None:
            if self.mask.shape != shape:
                raise InputError(f"area: expected a mask of shape {shape}, got {self.mask.shape}")
            found = np.asarray(self.mask)
        elif self.box is not None:
            left, top, right, bottom = self.box
            found = np.zeros(shape, bool)
            found[max(top, 0) : max(bottom + 1, 0), max(left, 0) : max(right + 1, 0)] = True
        else:
            found = self._inside_polygon(shape)
        if not found.any():
            rows, columns = shape
            raise InputError(f"area: expected pixels of a frame of {columns} × {rows}, got none")
        return found

    def _inside_polygon(self, shape: tuple[int, int]) -> BoolMap:
        """Pixels from whose centre a ray to the right crosses an odd number of edges."""
        corners = np.asarray(self.polygon, np.float64)
        y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
        inside = np.zeros(shape, bool)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if y0 == y1:
                continue
            crosses = (y0 > y) != (y1 > y)
            inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return inside
