"""Results of a bundle adjustment, and the weights with which it was made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.board_shape import BOW_SIZE, SHAPE_SIZE, BoardPrior, BoardShape
from fringeworks.rig.calibration.parameters import FurtherCamera, State
from fringeworks.rig.calibration.robust import root_weights
from fringeworks.types import BoolMap, FloatMap, Rig


@dataclass(frozen=True, eq=False)
class Weighting:
    """How the residuals and the board's deviations count in the least-squares sum."""

    scatter: FloatMap
    """Standard deviation per coordinate of every corner's residuals, (n, 2), px."""
    weights: FloatMap | None
    """Huber's weights, (n, 2), 0 for outliers; None for 1."""
    prior: BoardPrior

    @property
    def root(self) -> FloatMap:
        """Factor of every residual, (n, 4), 1/px."""
        return root_weights(self.scatter, self.weights)

    def of_rows(self, kept: BoolMap) -> Weighting:
        """The same for some of the corners."""
        weights = None if self.weights is None else self.weights[kept]
        return Weighting(self.scatter[kept], weights, self.prior)


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result of a bundle adjustment."""

    rig: Rig
    """The first camera and the projector, with the covariance of their 24 parameters and the root
    mean square residuals."""
    poses: tuple[FloatMap, ...]
    """T_camera_board of the board in every pose before the first camera, (4, 4), mm."""
    shape: BoardShape
    """By how much the board deviates from its description."""
    prior: BoardPrior
    """The standard deviations of these deviations, as estimated."""
    covariance: FloatMap
    """Covariance of the rig's 24 parameters, the 15 of every further camera, then of every pose's
    6 and those of smooth errors of the board, the bow's first, square; 0 for parameters that were
    held fixed."""
    camera_residual_px: tuple[FloatMap, ...]
    """Measured minus predicted camera pixels, (m, 2) per sighting, px."""
    projector_residual_px: tuple[FloatMap, ...]
    """Measured minus predicted projector pixels, (m, 2) per sighting, px."""
    used: tuple[BoolMap, ...]
    """False for corners that were left out as outliers, (m,) per sighting."""
    weighting: Weighting
    """Scatter and weights of all corners."""
    converged: bool
    """False where scatter and weights still changed in the last round."""
    further: tuple[FurtherCamera, ...] = ()
    """Cameras after the first."""
    further_rms_px: tuple[float, ...] = ()
    """Root mean square residual of each of them, px."""
    smooth: bool = False
    """Whether smooth errors of the board were estimated, beside its bow."""

    @property
    def devices_covariance(self) -> FloatMap:
        """Covariance of the parameters of all devices, (24 …, 24 …)."""
        size = State(self.rig, (), self.shape, self.further).devices_size
        return self.covariance[:size, :size]

    @property
    def bow_sigma_mm(self) -> FloatMap:
        """Standard deviations of the bow coefficients, (3,), mm."""
        return np.sqrt(np.diag(self.covariance)[-SHAPE_SIZE:][:BOW_SIZE])

    @property
    def scatter_px(self) -> tuple[tuple[float, float], ...]:
        """Per sighting: standard deviation of a corner in the camera, and of the projector
        coordinate read at the predicted camera pixel, per coordinate, px."""
        firsts = np.cumsum([0, *(len(u) for u in self.used[:-1])])
        return tuple((float(a), float(b)) for a, b in self.weighting.scatter[firsts])


@dataclass(frozen=True, eq=False)
class Without:
    """The result of an adjustment without one pose of the board."""

    rig: Rig
    """The first camera and the projector."""
    further: tuple[FurtherCamera, ...]
    covariance: FloatMap
    """Of the parameters of all devices."""
    places: FloatMap
    """The board's places at the corners of the pose that was left out, (m, 3), mm."""
    smooth_mm: FloatMap
    """Coefficients of smooth errors of the board, mm."""
