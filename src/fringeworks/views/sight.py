"""Whether two views contradict each other: a camera looks through what the other one measured."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import inverse
from fringeworks.types import FloatMap
from fringeworks.views.surface_points import SurfacePoints

SIGMAS = 5.0
"""Distance in front of a surface, in standard deviations, from which on a point contradicts it.
Normal errors exceed five in one of two million points."""
MOST_CELLS = 4096
"""Largest number of cells along a side of the grid: no camera has more pixels on a part."""
ALIKE = 5
"""Contradicting pixels among the nine of a square of 3 × 3 that make a contradiction: the majority.
Single pixels beside edges err by more than their σ, squares do not: on the virtual rig the median
of nine stays below 3 σ in true poses, and a mark of 1 mm on a wrong face has 20 σ."""

AROUND = np.array([(0, 0), *((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)])
"""Steps to the cells of a square of 3 × 3; its middle first, which settles most points."""
CHANCE_SIGMAS = 2.0
"""Difference of two numbers of contradictions, in standard deviations, that is no chance."""


class Sight:
    """What a view's camera sees: its points by their direction.

    Parameters
    ----------
    view : SurfacePoints
        In camera coordinates.
    """

    def __init__(self, view: SurfacePoints) -> None:
        self.view = view
        at = view.xyz_mm[:, :2] / view.xyz_mm[:, 2:]
        some = at[:: max(1, len(at) // 2000)]
        self._side = float(np.median(scipy.spatial.cKDTree(at).query(some, k=2)[0][:, 1]))
        self._side = max(self._side, float(np.ptp(at, axis=0).max()) / MOST_CELLS)
        self._low = at.min(axis=0)
        cell = np.rint((at - self._low) / self._side).astype(np.intp) + 1
        shape = cell.max(axis=0) + 2
        self._shape = int(shape[0]), int(shape[1])
        self._cell = cell @ (self._shape[1], 1)
        self._cells = np.full(self._shape[0] * self._shape[1], -1, np.intp)
        self._cells[self._cell] = np.arange(len(at))
        self._variance = view.sigma_mm**2

    def in_front(
        self, moved: SurfacePoints, *, sigmas: float, reach_mm: float = 0.0
    ) -> tuple[NDArray[np.intp], int]:
        """Find points that lie in front of what the view sees in their direction.

        Parameters
        ----------
        moved : SurfacePoints
            In this view's camera coordinates.
        sigmas, reach_mm : float ≥ 0
            Least distance: a number of standard deviations, and a length on top, mm.

        Returns
        -------
        Numbers of these points, and how many points the view sees something behind or before. The
        points lie in front of the planes through all nine points around the same direction, so
        that creases do not count.
        """
        xyz, normals = moved.xyz_mm, moved.normals
        index = np.flatnonzero(
            (xyz[:, 2] > 0.0) & (np.einsum("ij,ij->i", normals, xyz, optimize=False) < 0.0)
        )
        xyz = xyz[index]
        cell = np.rint((xyz[:, :2] / xyz[:, 2:] - self._low) / self._side).astype(np.intp) + 1
        inside = ((cell > 0) & (cell < np.array(self._shape) - 1)).all(axis=1)
        index, xyz, at = index[inside], xyz[inside], cell[inside] @ (self._shape[1], 1)
        known = self._cells[at] >= 0
        index, xyz, at = index[known], xyz[known], at[known]
        variance = moved.sigma_mm[index] ** 2
        seen = len(index)
        for step in AROUND @ (self._shape[1], 1):
            there = self._cells[at + step]
            off = np.einsum(
                "ij,ij->i", xyz - self.view.xyz_mm[there], self.view.normals[there], optimize=False
            )
            sigma = np.sqrt(variance + self._variance[there])
            kept = (there < 0) | (off > reach_mm + sigmas * sigma)
            index, xyz, at, variance = index[kept], xyz[kept], at[kept], variance[kept]
        return index, seen

    def contradicted(self, other: Sight, T_other_view: FloatMap, chi: float) -> int:
        """Count the pixels of this view that lie, with most of their neighbours, in front of what
        the other one sees."""
        index, _ = other.in_front(self.view.moved(T_other_view), sigmas=SIGMAS * chi)
        against = np.zeros(self._shape, np.uint8)
        against.flat[self._cell[index]] = 1
        around = scipy.ndimage.convolve(against, np.ones((3, 3), np.uint8), mode="constant")
        return int(np.count_nonzero(against & (around >= ALIKE)))


def contradictions(
    one: Sight, other: Sight, T_other_one: FloatMap, chi: float = 1.0, *, most: float = np.inf
) -> int:
    """Count the places where two views contradict each other.

    Parameters
    ----------
    one, other : Sight
    T_other_one : (4, 4) array
        Maps the camera coordinates of ``one`` to those of ``other``, mm.
    chi : float ≥ 1
        Factor by which the views differ more than their σ.
    most : float
        Number beyond which they need not be counted to the end.

    Returns
    -------
    int, pixels of both views. A point that lies between the other camera and the surface that this
    camera has measured would hide that surface, so that no true pose has such points.
    """
    count = one.contradicted(other, T_other_one, chi)
    if count > most:
        return count
    return count + other.contradicted(one, inverse(T_other_one), chi)


def beyond_chance(count: int, least: int) -> bool:
    """Whether a number of contradictions is larger than another one by more than chance: numbers
    of places scatter by their square roots (Poisson)."""
    return count - least > CHANCE_SIGMAS * float(np.sqrt(count + least))
