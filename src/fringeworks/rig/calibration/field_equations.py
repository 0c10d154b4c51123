"""Normal equations of the devices' fields at the minimum of a bundle adjustment (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fringeworks.rig.calibration.adjusted import Adjusted, Weighting
from fringeworks.rig.calibration.board_shape import SMOOTH_SIZE
from fringeworks.rig.calibration.bundle import linearised
from fringeworks.rig.calibration.field_modes import Modes
from fringeworks.rig.calibration.normal_equations import shared_columns
from fringeworks.rig.calibration.parameters import DEVICE_SIZE, RIG_SIZE, State
from fringeworks.rig.calibration.residuals import Sighting, corners_of, residuals_of
from fringeworks.rig.calibration.robust import weights_of
from fringeworks.rig.lens_field import correction, correction_sigma
from fringeworks.rig.pinhole import project_with_derivatives, rays, skew
from fringeworks.types import BoolMap, FloatMap

RELATIVE_RANK = 1e-6
"""Singular value, over the largest, below which a direction of a device's parameters is left out
where they take up a field: turns and principal points act nearly alike."""
TINY = 1e-300
"""Lower bound on a length that is divided by: a parameter that is not estimated has 0."""
TURNS = slice(2 * DEVICE_SIZE, 2 * DEVICE_SIZE + 3)
"""Places of the rotation among the rig's parameters; the translation follows."""

Pair = tuple[Modes | None, Modes | None]
"""Modes of the fields of camera and projector; None for no field."""


@dataclass(frozen=True, eq=False)
class FieldEquations:
    """Normal equations of the modes of both devices, all other parameters eliminated."""

    matrix: FloatMap
    """(m, m)."""
    right: FloatMap
    """Right-hand side whose solution is the whole fields, (m,)."""
    moved: FloatMap
    """Change of the rig's 24 parameters with every mode, (24, m)."""
    camera_modes: int
    """How many of the modes are the camera's; they come first."""

    def part(self, device: int) -> slice:
        """Which modes are those of the camera (0) or of the projector (1)."""
        return slice(self.camera_modes, None) if device else slice(0, self.camera_modes)


class Linearised:
    """A bundle adjustment at its minimum, linear in everything.

    A corner at which a field is hardly known is no outlier for what it deviates there: its weight
    is that of its residual over the scatter and the field's σ.
    """

    def __init__(self, sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap) -> None:
        self.rig = adjusted.rig
        self.corners = corners_of(sightings)
        weighting = self._reweighted(adjusted)
        self.root = weighting.root
        at = replace(adjusted, weighting=weighting)
        self.residuals, self.equations = linearised(self.corners, at, free=free)
        self.points = len(adjusted.shape.offset_mm)
        smooth = np.full(SMOOTH_SIZE, adjusted.smooth)
        always = len(self.equations.shared) - int(free.sum()) - int(smooth.sum())
        self.free = np.concatenate((free, np.ones(always, bool), smooth))

    def places(self, device: int) -> FloatMap:
        """Measured corners in the frame of the camera (0) or the projector (1), (n, 2), px."""
        return self.corners.projector_px if device else self.corners.camera_px

    def _reweighted(self, adjusted: Adjusted) -> Weighting:
        weighting = adjusted.weighting
        variance = weighting.scatter**2
        for k, device in enumerate((self.rig.camera, self.rig.projector)):
            if device.field is not None:
                sigma = correction_sigma(device.field, self.places(k))
                variance[:, k] += np.mean(sigma**2, axis=1)
        state = State(adjusted.rig, adjusted.poses, adjusted.shape, adjusted.further)
        independent = residuals_of(self.corners, state).independent
        return replace(weighting, weights=weights_of(independent, np.sqrt(variance)))

    def fields(self, of: Pair) -> FieldEquations:
        """Normal equations of the fields of these modes."""
        corners, size = self.corners, self.free.size
        m = sum(modes.count for modes in of if modes is not None)
        # Two more columns: what the present fields do, and the residuals.
        own = np.zeros((m + 2, m + 2))
        shared, points = np.zeros((size, m + 2)), np.zeros((self.points, 3, m + 2))
        present = self._present()
        for k, rows in enumerate(corners.rows):
            root = self.root[rows, :, None]
            further = np.stack((present[rows], self.residuals.independent[rows]), axis=2)
            by = np.concatenate((self._by_modes(of, rows), further), axis=2) * root
            J = self.residuals.jacobian[rows] * root
            columns, index = shared_columns(corners, k, size), corners.index[rows]
            flat = by.reshape(-1, m + 2)
            own += flat.T @ flat
            shared[columns] += J[:, :, : columns.size].reshape(-1, columns.size).T @ flat
            points[index] += J[:, :, columns.size :].transpose(0, 2, 1) @ by
        shared = shared[self.free]
        # The gradient holds the board's prior as well.
        shared[:, -1], points[:, :, -1] = self.equations.gradient
        of_shared, of_points = self.equations.solved(shared, points)
        own -= shared.T @ of_shared + np.einsum("pcm,pcn->mn", points, of_points, optimize=True)
        moved = np.zeros((size, m))
        moved[self.free] = -of_shared[:, :m]
        right = own[:m, m] + own[:m, m + 1]
        first = 0 if of[0] is None else of[0].count
        return FieldEquations(own[:m, :m], right, moved[:RIG_SIZE], first)

    def _by_modes(self, of: Pair, rows: slice) -> FloatMap:
        """Derivative of the model behind the residuals of some corners, (n, 4, m)."""
        none = np.zeros((rows.stop - rows.start, 2, 0))
        camera, projector = (
            none if modes is None else modes.at(self.places(k)[rows]) for k, modes in enumerate(of)
        )
        seen = np.concatenate((camera, np.zeros_like(projector)), axis=2)
        read = np.concatenate((-self.corners.by_pixel[rows] @ camera, projector), axis=2)
        return np.concatenate((seen, read), axis=1)

    def _present(self) -> FloatMap:
        """What the present fields add to the model behind the residuals, (n, 4)."""
        found = np.zeros((len(self.corners.index), 4))
        if self.rig.camera.field is not None:
            found[:, :2] = correction(self.rig.camera.field, self.places(0))
            found[:, 2:] -= np.einsum("nij,nj->ni", self.corners.by_pixel, found[:, :2])
        if self.rig.projector.field is not None:
            found[:, 2:] += correction(self.rig.projector.field, self.places(1))
        return found

    def tangent(self, device: int, places_px: FloatMap) -> FloatMap:
        """Derivative of pixels by a device's parameters and its turns about its pupil, (n, 2, 12).

        These act by the place in the frame alone, as a field does.
        """
        pinhole = replace((self.rig.camera, self.rig.projector)[device], field=None)
        ray = rays(pinhole, places_px)
        _, by_point, by_device = project_with_derivatives(pinhole, ray)
        return np.concatenate((by_device, by_point @ -skew(ray)), axis=2)

    def turned(self, modes: Modes) -> FloatMap:
        """Directions of the camera's modes that turns of the camera do not do, (m, m − 3).

        Poses and rig make up for a turn exactly, so that nothing could tell it from none.
        """
        turns = self.tangent(0, self.places(0))[:, :, DEVICE_SIZE:]
        held = np.einsum("nci,ncm->im", turns, modes.at(self.places(0)))
        return np.asarray(scipy.linalg.null_space(held))

    def taken(self, device: int, modes: Modes) -> FloatMap:
        """What a device's parameters and turns take up of each mode at the corners, (12, m)."""
        by = self.tangent(device, self.places(device)).reshape(-1, DEVICE_SIZE + 3)
        first = DEVICE_SIZE * device
        by[:, :DEVICE_SIZE] *= self.free[first : first + DEVICE_SIZE]
        if device == 0:
            by[:, DEVICE_SIZE:] = 0.0
        scale = np.maximum(np.linalg.norm(by, axis=0), TINY)
        wanted = modes.at(self.places(device)).reshape(-1, modes.count)
        found = np.linalg.lstsq(by / scale, wanted, rcond=RELATIVE_RANK)[0]
        return np.asarray(found / scale[:, None])

    def as_parameters(self, device: int, taken: FloatMap) -> FloatMap:
        """The same as changes of the rig's 24 parameters, (24, m)."""
        found = np.zeros((RIG_SIZE, taken.shape[1]))
        first = DEVICE_SIZE * device
        found[first : first + DEVICE_SIZE] = taken[:DEVICE_SIZE]
        if device:
            # A turn of the projector about its pupil turns the translation as well.
            found[TURNS] = taken[DEVICE_SIZE:]
            found[TURNS.stop :] = -skew(self.rig.T_projector_camera[:3, 3]) @ taken[DEVICE_SIZE:]
        return found
