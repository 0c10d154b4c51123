"""Points of a sequence on disk: one Zarr group that grows while the sequence is measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.batch.store import create_maps, open_group
from fringeworks.types import FileProblem, FloatMap, PointCloud

MAPS = {
    "xyz_mm": ("mm", "Points in camera coordinates"),
    "sigma_mm": ("mm", "Standard deviation of the points"),
    "reason": ("", "Why a pixel has no point; 0 where it has one"),
}
"""Arrays (time, y, x, …) of the points, with their units and what they are."""
COMPLETE = "complete"
"""Attribute that is true when the sequence has ended and all of it is there."""
CHUNK_TIMES = 1024
"""Times in a chunk."""
MOMENTS = "moments"
"""Attribute: number of moments that are whole."""


class SequenceStore:
    """A Zarr group (format 3) of the moments of a sequence, that xarray reads.

    A moment is one shard of each array. The attribute ``moments`` counts those that are whole, so
    that the group can be read while it grows.

    Parameters
    ----------
    folder : path
        A new one.
    about : mapping
        Attributes of the group.
    time_unit : "s" or "frames"
    maps : bool
        Whether points are stored; otherwise ``time`` alone.

    Raises
    ------
    FileProblem for a folder that is there or cannot be written to; MissingPackage without zarr.
    """

    def __init__(
        self, folder: Path, about: Mapping[str, Any], *, time_unit: str = "s", maps: bool = True
    ) -> None:
        if folder.exists():
            raise FileProblem(f"{folder}: expected a new folder, got one that is there")
        try:
            self._group = open_group(folder, "w")
        except OSError as error:
            raise FileProblem(f"{folder}: could not be written: {error.strerror}") from error
        self._group.attrs.update({**about, MOMENTS: 0, COMPLETE: False})
        self.folder = folder
        self._maps, self._time_unit = maps, time_unit
        self._count = 0

    def add(self, time: float, points: PointCloud) -> None:
        """Write a moment.

        Raises
        ------
        FileProblem where that is not possible, as on a full disk.
        """
        arrays: dict[str, Any] = {"time": np.asarray(time)}
        if self._maps:
            arrays |= {name: np.asarray(getattr(points, name)) for name in MAPS}
        try:
            for name, values in arrays.items():
                array = self._group[name] if self._count else self._create(name, values)
                array.resize((self._count + 1, *values.shape))
                array[self._count] = values
            self._count += 1
            self._group.attrs[MOMENTS] = self._count
        except OSError as error:
            raise FileProblem(f"{self.folder}: could not be written: {error.strerror}") from error

    def end(self) -> None:
        """Say that the sequence is complete."""
        self._group.attrs[COMPLETE] = True

    def _create(self, name: str, values: FloatMap) -> Any:
        if name in MAPS:
            unit, what = MAPS[name]
            attributes = {"long_name": what} | ({"units": unit} if unit else {})
            return create_maps(self._group, name, values, attributes, along_time=True)
        attributes = {"long_name": "Middle of the frames of each moment", "units": self._time_unit}
        return self._group.create_array(
            name,
            shape=(0,),
            dtype=values.dtype,
            chunks=(CHUNK_TIMES,),
            dimension_names=("time",),
            fill_value=np.nan,
            attributes=attributes,
        )
