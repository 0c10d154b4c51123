"""What arrays of xarray can do: frames are decoded and measured, phases are unwrapped."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from fringeworks.files.exchange import PIXELS
from fringeworks.pair.unwrap import unwrap
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.pipeline.stacks import Measurement
from fringeworks.pipeline.verbs import decode, measure
from fringeworks.stack.frames import Stack
from fringeworks.types import InputError, Pair


@xr.register_dataarray_accessor("fringe")  # type: ignore[no-untyped-call]
class FringeArray:
    """``.fringe`` of an array: frames (frame, row, column), one frame, or a phase (row, column).

    The axes may have any names: their order counts. Results have the axes ``row`` and ``column``,
    and the coordinates of the frames along these axes, or without any, where they have none of the
    same name.

    Examples
    --------
    >>> import fringeworks as fw, fringeworks.xarray, xarray as xr
    >>> pair = fw.simulate.standard_scene("parabola", size=100, fringes=8)
    >>> frames = xr.DataArray(pair.object, dims=("y", "x"), coords={"part": "A 7"})
    >>> found = frames.fringe.reconstruct(pair.reference, geometry=pair.geometry)
    >>> found.height.dims, found.part.item()
    (('row', 'column'), 'A 7')
    """

    def __init__(self, array: xr.DataArray) -> None:
        self._array = array

    def decode(self, plan: PatternPlan, **options: Any) -> xr.Dataset:
        """Decode frames as ``fringeworks.decode`` does: a data set of projector coordinates."""
        return self._with_coordinates(decode(self._frames(), plan, **options).to_xarray())

    def measure(self, plan: PatternPlan, rig: Any, **options: Any) -> xr.Dataset:
        """Measure frames as ``fringeworks.measure`` does: a data set of points."""
        found = measure(Stack(list(self._frames()), plan), rig, **options)
        assert isinstance(found, Measurement)
        return self._with_coordinates(found.points.to_xarray())

    def reconstruct(self, reference: Any, method: str = "windowed", **options: Any) -> xr.Dataset:
        """Measure one frame against that of the reference plane, as ``fringeworks.reconstruct``
        does: a data set of heights, or of displacements without a ``geometry``."""
        pair = Pair(_numbers(reference, 2), _numbers(self._array, 2))
        return self._with_coordinates(reconstruct(pair, method, **options).surface.to_xarray())

    def unwrap(self, **options: Any) -> xr.DataArray:
        """Unwrap a phase in rad as ``fringeworks.unwrap`` does: an array on the same axes."""
        found = unwrap(_numbers(self._array, 2), **options)
        about = {"units": "rad", "algorithm": found.algorithm, "residues": found.residues}
        return self._array.copy(data=found.phase).assign_attrs(about)

    def _frames(self) -> Any:
        return _numbers(self._array, 3)

    def _with_coordinates(self, found: xr.Dataset) -> xr.Dataset:
        """A result with what the frames have along their rows and columns, and without any axis."""
        names = dict(zip(self._array.dims[-2:], PIXELS, strict=True))
        taken = {
            name: (tuple(names[dim] for dim in one.dims), one.to_numpy(), one.attrs)
            for name, one in self._array.coords.items()
            if set(one.dims) <= set(names) and name not in {*found.variables, *found.dims}
        }
        return found.assign_coords(taken)


def _numbers(values: Any, axes: int) -> Any:
    """Values as an array of a number of axes."""
    found = np.asarray(values)
    if found.ndim != axes:
        expected = "(frame, row, column)" if axes == 3 else "(row, column)"
        raise InputError(f"array: expected {axes} axes {expected}, got {found.ndim}")
    return found
