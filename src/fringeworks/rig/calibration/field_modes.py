"""Independent parts of a smooth error over a device's frame, as control points of a spline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from fringeworks.rig.lens_field import basis
from fringeworks.types import FloatMap, LensField, Pinhole

INTERVALS = 24
"""Intervals between control points over the width of a frame. Six periods of a sine then have four
each, which a cubic spline follows to 1 %."""
BORDER = 3
"""Control points along an axis beyond the number of its intervals: a cubic spline's degree."""
KEPT_VARIANCE = 1e-3
"""Variance of a mode, over that of the largest, below which it is left out: the corners of a board
do not show it."""
ROUNDING = 1e-9
"""Excess of a ratio over a whole number that is rounding."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Independent parts of one component of a device's field, of variance 1 before a calibration.

    A field has two components, for columns and rows; m modes are those of the first component, then
    those of the second.
    """

    first_px: tuple[float, float]
    """Place of the first control point, px."""
    step_px: tuple[float, float]
    """Distance of control points, px."""
    across: FloatMap
    """Control points along the columns, (columns, m / 2)."""
    down: FloatMap
    """The same along the rows, (rows, m / 2); a mode is the product of both."""

    @classmethod
    def of(cls, device: Pinhole, length: float) -> Self:
        """Modes of a surface with squared-exponential covariance.

        Parameters
        ----------
        device : Pinhole
        length : float > 0
            Of the covariance, in widths of the frame.
        """
        parts, steps = [], []
        for pixels in (device.width_px, device.height_px):
            intervals = int(np.ceil(pixels * INTERVALS / device.width_px - ROUNDING))
            steps.append(pixels / intervals)
            at = steps[-1] * np.arange(intervals + BORDER)
            apart = (at[:, None] - at) / (length * device.width_px)
            values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
            parts.append((np.maximum(values, 0.0), vectors))
        (of_x, x), (of_y, y) = parts
        variance = np.outer(of_y, of_x)
        j, i = np.nonzero(variance > KEPT_VARIANCE * variance.max())
        first = (-0.5 - steps[0], -0.5 - steps[1])
        across, down = x[:, i] * np.sqrt(of_x[i]), y[:, j] * np.sqrt(of_y[j])
        return cls(first, (steps[0], steps[1]), across, down)

    @property
    def count(self) -> int:
        """Number of modes of both components."""
        return 2 * int(self.across.shape[1])

    def at(self, places_px: FloatMap) -> FloatMap:
        """Both components of all modes at places (n, 2), (n, 2, m)."""
        on_x, on_y = (
            basis(self.first_px[k], self.step_px[k], len(part), places_px[:, k]) @ part
            for k, part in enumerate((self.across, self.down))
        )
        values = on_x * on_y
        none = np.zeros_like(values)
        components = (np.concatenate(pair, axis=1) for pair in ((values, none), (none, values)))
        return np.stack(list(components), axis=1)

    def places(self) -> FloatMap:
        """Places of the control points, (rows × columns, 2), px."""
        x, y = (
            self.first_px[k] + self.step_px[k] * np.arange(len(part))
            for k, part in enumerate((self.across, self.down))
        )
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def field(self, amplitudes: FloatMap, sigma_px: FloatMap) -> LensField:
        """A field of amplitudes (m,), with σ at its control points, (rows × columns, 2), px."""
        parts = amplitudes.reshape(2, -1)
        control = np.stack([(self.down * part) @ self.across.T for part in parts], axis=-1)
        sigma = sigma_px.reshape(control.shape)
        return LensField(self.first_px, self.step_px, control, sigma)
