"""Projector coordinates, as decoded from a stack of frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fringeworks.types.arrays import Axis, ByteMap, FloatMap, Reason
from fringeworks.types.camera import CameraNoise
from fringeworks.types.displayed import Plotted, Sectioned
from fringeworks.types.errors import InputError
from fringeworks.types.exchanged import Labelled
from fringeworks.types.finding import Finding, Noted
from fringeworks.types.frozen import Frozen
from fringeworks.types.profile import Line, Profile
from fringeworks.types.provenance import Provenance


@dataclass(frozen=True, eq=False, repr=False)
class CoordinateMap(Sectioned, Frozen):
    """The projector coordinate that lights every camera pixel, along one axis."""

    layout = {  # noqa: RUF012
        "coordinate_px": "fiu hw",
        "sigma_px": "fiu hw",
        "modulation": "fiu hw",
        "background": "fiu hw",
        "reason": "ui hw",
        "phase_rad": "?fiu nhw",
        "modulations": "?fiu nhw",
    }

    coordinate_px: FloatMap
    """Projector coordinate, (h, w), px, centres on integers; NaN where it cannot be measured."""
    sigma_px: FloatMap
    """Standard deviation of the coordinate, (h, w), px; NaN where the coordinate is."""
    modulation: FloatMap
    """B of the fringes with the shortest period, (h, w), counts; NaN where undetermined."""
    background: FloatMap
    """A, mean of the phase frames, (h, w), counts."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    axis: Axis
    """x: projector columns, y: projector rows."""
    periods_px: tuple[float, ...]
    """Periods of the M sets of fringes, projector px, in the plan's order."""
    phase_rad: FloatMap | None = None
    """Wrapped phase of every set, (M, h, w), −π…π rad, where asked for."""
    modulations: FloatMap | None = None
    """B of every set, (M, h, w), counts, where asked for."""
    repeats_px: float | None = None
    """Distance after which coordinates repeat; None where they are absolute."""

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a coordinate, 0…1."""
        return float(np.mean(self.reason != Reason.OK))


@dataclass(frozen=True, eq=False, repr=False)
class Decoded(Noted, Plotted, Labelled, Frozen):
    """Projector coordinates along one axis or both, decoded from a stack of frames."""

    x: CoordinateMap | None
    """Along projector columns, where the plan has fringes or Gray code along x."""
    y: CoordinateMap | None
    """Along projector rows."""
    noise: CameraNoise
    """Noise of the camera, from which the standard deviations come."""
    findings: tuple[Finding, ...] = ()
    """What was found in the frames, with its likely causes, and what was decided because of it."""
    details: dict[str, Any] = field(default_factory=dict)
    """Figures per axis: ``disagreement`` of the sets, estimated ``shifts_deg``, and
    ``removed_blur_px``, the camera's blur whose shift at edges of brightness was removed, px."""
    provenance: Provenance | None = None
    """How it was made; None where the caller decoded arrays."""

    def profile(self, line: Line, *, axis: Axis | None = None) -> Profile:
        """Sample the coordinates of one axis along a straight line of camera pixels.

        Parameters
        ----------
        line : ((x0, y0), (x1, y1))
            Column and row of the first and the last camera pixel, whole numbers.
        axis : "x" or "y", optional
            The projector's axis; to be given where both were decoded.

        Returns
        -------
        Profile, as that of ``CoordinateMap``.

        Raises
        ------
        InputError for pixels outside the frame, and for an axis that is missing or not given.
        """
        maps = self.maps
        if axis is None and len(maps) == 1:
            (axis,) = maps
        if axis is None or axis not in maps:
            raise InputError(f"axis: expected {' or '.join(map(repr, maps))}, got {axis!r}")
        return maps[axis].profile(line)

    @property
    def maps(self) -> dict[Axis, CoordinateMap]:
        """The maps by axis, without those that are None."""
        both: dict[Axis, CoordinateMap | None] = {"x": self.x, "y": self.y}
        return {axis: found for axis, found in both.items() if found is not None}
