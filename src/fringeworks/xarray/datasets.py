"""What data sets of results can do, and how xarray opens result files."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from xarray.backends import BackendEntrypoint

from fringeworks.files.csv_table import REASONS
from fringeworks.files.from_xarray import result_of
from fringeworks.files.read_write import read
from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.types import Decoded, HeightMap, InputError, PointCloud, Reason


@xr.register_dataset_accessor("fringe")  # type: ignore[no-untyped-call]
class FringeDataset:
    """``.fringe`` of a data set that ``.to_xarray()`` made, or of a part of one.

    Examples
    --------
    >>> import fringeworks as fw, fringeworks.xarray
    >>> pair = fw.simulate.standard_scene("parabola", size=100, fringes=8)
    >>> found = fw.reconstruct(pair, "fourier").surface.to_xarray()
    >>> half = found.isel(column=slice(50, None)).fringe.result()
    >>> half.shape, found.fringe.reasons()["ok"]
    ((100, 50), 1.0)
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def result(self) -> HeightMap | PointCloud | Decoded:
        """The data set as a result, for everything that takes one: ``fw.fit``, ``fw.write`` …

        Raises
        ------
        InputError where variables are missing, rows or columns are left out unevenly, or a step
        differs between rows and columns.
        """
        return result_of(self._dataset)

    def measured(self, axis: str = "") -> xr.DataArray:
        """Where there is a value: True and False along ``row`` and ``column``.

        Parameters
        ----------
        axis : "x" or "y", optional
            Axis of the projector, for coordinates.
        """
        return self._reason(axis) == int(Reason.OK)

    def reasons(self, axis: str = "") -> dict[str, float]:
        """Share of the pixels with each reason, 0…1; ``ok`` are those with a value."""
        numbers, counts = np.unique(self._reason(axis), return_counts=True)
        return {
            str(REASONS[int(number)]): float(count) / float(counts.sum())
            for number, count in zip(numbers, counts, strict=True)
        }

    def _reason(self, axis: str) -> xr.DataArray:
        name = f"{axis}_reason" if axis else "reason"
        if name not in self._dataset:
            held = [str(n) for n in self._dataset.data_vars if str(n).endswith("reason")]
            raise InputError(f"data set: expected {name}, got {', '.join(held) or 'no reasons'}")
        return self._dataset[name]


class FringeBackend(BackendEntrypoint):
    """Opens files of results, such as NPZ, for ``xarray.open_dataset(…, engine="fringeworks")``."""

    description: ClassVar[str] = "Heights, points and projector coordinates with σ and reasons"
    url: ClassVar[str] = "https://github.com/fringeworks/fringeworks"
    open_dataset_parameters: ClassVar[tuple[str, ...]] = ("filename_or_obj", "drop_variables")

    def open_dataset(
        self, filename_or_obj: Any, *, drop_variables: str | Iterable[str] | None = None
    ) -> xr.Dataset:
        """Read a file of a result.

        Raises
        ------
        InputError for files that hold no heights, points of pixels or coordinates.
        """
        if not isinstance(filename_or_obj, str | PathLike):
            raise InputError(f"expected a path, got {type(filename_or_obj).__name__}")
        found: Any = read(filename_or_obj)
        if isinstance(found, Reconstruction):
            found = found.surface
        elif isinstance(found, Measurement):
            found = found.points
        if not isinstance(found, HeightMap | PointCloud | Decoded):
            raise InputError(
                f"{filename_or_obj}: expected heights, points of pixels or coordinates, got "
                f"{type(found).__name__}"
            )
        named = [drop_variables] if isinstance(drop_variables, str) else drop_variables or []
        opened: xr.Dataset = found.to_xarray().drop_vars(list(named), errors="ignore")
        return opened

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Never: many programs write files with these suffixes, so that the engine is named."""
        del filename_or_obj
        return False
