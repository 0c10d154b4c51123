"""Normal equations of a bundle adjustment, solved with the board's points eliminated.

A corner depends on the parameters that all corners share (rig, poses, smooth errors of the board)
and on the three offsets of its own point of the board. The points' part of the normal matrix
therefore consists of 3 × 3 blocks. Eliminating them leaves a system of the shared parameters only
(Schur complement; Triggs et al., LNCS 1883, 2000, §6): for 200 points and eight poses 75 unknowns
instead of 675, and 33 more of each where smooth errors beside the bow are estimated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from fringeworks.rig.calibration.board_shape import OFFSET_SIZE, SHAPE_SIZE
from fringeworks.rig.calibration.parameters import POSE_SIZE
from fringeworks.rig.calibration.residuals import Corners
from fringeworks.types import BoolMap, FloatMap

TINY_DIAGONAL = 1e-300
"""Lower bound on a diagonal element that scales its parameter: a parameter that no corner depends
on has 0 there."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """A normal matrix of s shared parameters and p board points, and its right-hand side.

    All are scaled so that the matrix has ones on its diagonal.
    """

    shared: FloatMap
    """Block of the shared parameters, (s, s)."""
    across: FloatMap
    """Blocks of shared parameters and points, (p, s, 3)."""
    points: FloatMap
    """Blocks of the points, (p, 3, 3)."""
    right_shared: FloatMap
    """(s,)."""
    right_points: FloatMap
    """(p, 3)."""
    scale_shared: FloatMap
    """Roots of the diagonal before scaling, (s,)."""
    scale_points: FloatMap
    """The same of the points, (p, 3)."""

    @classmethod
    def of(
        cls,
        corners: Corners,
        jacobian: FloatMap,
        residual: FloatMap,
        prior: tuple[FloatMap, FloatMap],
        free: BoolMap,
        known: tuple[FloatMap, FloatMap] | None = None,
    ) -> Self:
        """Sum the equations of all corners and of the prior.

        Parameters
        ----------
        corners : Corners
            n corners; every point at most once in a sighting.
        jacobian : (n, 4, …) array
            As in ``Residuals``, weighted.
        residual : (n, 4) array
            Weighted.
        prior : two (k + 3 p,) arrays
            1/σ² of the smooth errors and of all offsets, and their values.
        free : (s₀,) bool array
            Which of the s₀ shared parameters are estimated; s of them are.
        known : two arrays (k, k) and (k,), optional
            Precision of a prior of the first k shared parameters, and their differences from it.
        """
        precision, value = prior
        p = (precision.size - SHAPE_SIZE) // OFFSET_SIZE
        shared, right_shared = np.diag(np.zeros(free.size)), np.zeros(free.size)
        across, points = np.zeros((p, free.size, OFFSET_SIZE)), np.zeros((p, 3, 3))
        right_points = np.zeros((p, OFFSET_SIZE))
        for k, rows in enumerate(corners.rows):
            columns, index = shared_columns(corners, k, free.size), corners.index[rows]
            of_shared = jacobian[rows, :, : columns.size]
            of_point = jacobian[rows, :, columns.size :]
            flat, r = of_shared.reshape(-1, columns.size), residual[rows]
            shared[np.ix_(columns, columns)] += flat.T @ flat
            right_shared[columns] += flat.T @ r.ravel()
            across[index[:, None], columns] += of_shared.transpose(0, 2, 1) @ of_point
            points[index] += of_point.transpose(0, 2, 1) @ of_point
            right_points[index] += np.einsum("nri,nr->ni", of_point, r)
        shape, offset = slice(free.size - SHAPE_SIZE, free.size), np.arange(OFFSET_SIZE)
        shared[shape, shape] += np.diag(precision[:SHAPE_SIZE])
        right_shared[shape] -= (precision * value)[:SHAPE_SIZE]
        points[:, offset, offset] += precision[SHAPE_SIZE:].reshape(p, OFFSET_SIZE)
        right_points -= (precision * value)[SHAPE_SIZE:].reshape(p, OFFSET_SIZE)
        if known is not None:
            first = slice(0, len(known[1]))
            shared[first, first] += known[0]
            right_shared[first] -= known[0] @ known[1]
        shared, across = shared[np.ix_(free, free)], across[:, free]
        right_shared = right_shared[free]
        s = np.sqrt(np.maximum(np.diag(shared), TINY_DIAGONAL))
        q = np.sqrt(points[:, offset, offset])
        return cls(
            shared / np.outer(s, s),
            across / (s[:, None] * q[:, None, :]),
            points / (q[:, :, None] * q[:, None, :]),
            right_shared / s,
            right_points / q,
            s,
            q,
        )

    def _eliminated(self, damping: float = 0.0) -> tuple[FloatMap, FloatMap, FloatMap]:
        """The shared block without the points (s, s), the factors that eliminate the points
        (p, s, 3), and the inverses of the points' blocks (p, 3, 3)."""
        inverse = np.linalg.inv(self.points + damping * np.eye(OFFSET_SIZE))
        factor = self.across @ inverse
        s = len(self.shared)
        flat = [a.transpose(1, 0, 2).reshape(s, -1) for a in (factor, self.across)]
        return self.shared + damping * np.eye(s) - flat[0] @ flat[1].T, factor, inverse

    def step(self, damping: float) -> tuple[FloatMap, FloatMap]:
        """Return a damped Gauss–Newton step of the shared parameters (s,) and the points (p, 3).

        The damping is relative to the diagonal of the normal matrix (Marquardt).
        """
        matrix, factor, inverse = self._eliminated(damping)
        right = self.right_shared - np.einsum("psc,pc->s", factor, self.right_points)
        of_shared = scipy.linalg.solve(matrix, right, assume_a="sym")
        rest = self.right_points - np.einsum("psc,s->pc", self.across, of_shared)
        of_points = np.einsum("pcd,pd->pc", inverse, rest)
        return of_shared / self.scale_shared, of_points / self.scale_points

    @property
    def gradient(self) -> tuple[FloatMap, FloatMap]:
        """The right-hand side of the shared parameters (s,) and the points (p, 3), not scaled."""
        return self.right_shared * self.scale_shared, self.right_points * self.scale_points

    def solved(self, right_shared: FloatMap, right_points: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Solve for other right-hand sides.

        Parameters
        ----------
        right_shared : (s, m) array
        right_points : (p, 3, m) array

        Returns
        -------
        The shared parameters (s, m) and the points (p, 3, m).
        """
        matrix, factor, inverse = self._eliminated()
        of_points = right_points / self.scale_points[:, :, None]
        right = right_shared / self.scale_shared[:, None] - _over_points(factor, of_points)
        shared = scipy.linalg.solve(matrix, right, assume_a="sym")
        rest = of_points - self.across.transpose(0, 2, 1) @ shared
        points = inverse @ rest
        return shared / self.scale_shared[:, None], points / self.scale_points[:, :, None]

    def information(self, first: int) -> FloatMap:
        """Information about the first shared parameters where nothing is known about all others
        beside the equations; (first, first)."""
        matrix, rest = self._eliminated()[0], slice(first, None)
        others = np.linalg.solve(matrix[rest, rest], matrix[rest, :first])
        left = matrix[:first, :first] - matrix[:first, rest] @ others
        return np.asarray(left * np.outer(self.scale_shared[:first], self.scale_shared[:first]))

    def covariance(self) -> Covariance:
        """Invert the normal matrix.

        Raises
        ------
        LinAlgError where it is singular.
        """
        matrix, factor, inverse = self._eliminated()
        scaled = np.linalg.inv(matrix)
        moved = scaled @ factor
        of_points = inverse + factor.transpose(0, 2, 1) @ moved
        s, q = self.scale_shared, self.scale_points
        return Covariance(
            scaled / np.outer(s, s),
            -moved / (s[:, None] * q[:, None, :]),
            of_points / (q[:, :, None] * q[:, None, :]),
        )


def _over_points(factor: FloatMap, values: FloatMap) -> FloatMap:
    """Sum of factors (p, s, 3) times values (p, 3, m) over all points, (s, m)."""
    flat = factor.transpose(1, 0, 2).reshape(factor.shape[1], -1)
    return np.asarray(flat @ values.reshape(flat.shape[1], -1))


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of the estimated parameters, as far as corners need it."""

    shared: FloatMap
    """Of the shared parameters, (s, s)."""
    across: FloatMap
    """Of the shared parameters with every point, (p, s, 3)."""
    points: FloatMap
    """Of every point with itself, (p, 3, 3), mm²."""

    def with_fixed(self, free: BoolMap) -> Covariance:
        """Return the same with zeros for the shared parameters that were not estimated."""
        shared = np.zeros((free.size, free.size))
        shared[np.ix_(free, free)] = self.shared
        across = np.zeros((len(self.points), free.size, OFFSET_SIZE))
        across[:, free] = self.across
        return Covariance(shared, across, self.points)

    def of_residuals(self, corners: Corners, jacobian: FloatMap) -> FloatMap:
        """Variances that the parameters give to linear forms of every corner, (n, 4).

        Parameters
        ----------
        corners : Corners
        jacobian : (n, 4, …) array
            The forms, as in ``Residuals``.
        """
        variance = np.empty(jacobian.shape[:2])
        for k, rows in enumerate(corners.rows):
            columns, index = shared_columns(corners, k, len(self.shared)), corners.index[rows]
            of_shared = jacobian[rows, :, : columns.size]
            of_point = jacobian[rows, :, columns.size :]
            forms = of_shared @ self.shared[np.ix_(columns, columns)]
            mixed = of_shared @ self.across[index[:, None], columns]
            own = of_point @ self.points[index]
            variance[rows] = np.sum(forms * of_shared, axis=2)
            variance[rows] += np.sum((2.0 * mixed + own) * of_point, axis=2)
        return variance


def shared_columns(
    corners: Corners, k: int, shared: int
) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return which of the shared parameters the corners of the k-th sighting depend on.

    They are those of all devices, the 6 of its pose and those of smooth errors.
    """
    shape = shared - SHAPE_SIZE
    devices = shape - POSE_SIZE * corners.poses
    return np.concatenate(
        (
            np.arange(devices),
            devices + POSE_SIZE * int(corners.pose_of[k]) + np.arange(POSE_SIZE),
            shape + np.arange(SHAPE_SIZE),
        )
    )
