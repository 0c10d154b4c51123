"""What results become in other packages, by a room that is loaded on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray

EXCHANGE = "fringeworks.files.exchange"
"""Module that makes the objects. It is loaded by name, because a type may not import the rooms
behind its own."""


class _Exchange(Protocol):
    def dataset(self, result: object) -> xarray.Dataset: ...

    def open3d_cloud(self, cloud: object) -> Any: ...


def exchange() -> _Exchange:
    """That module."""
    return cast("_Exchange", import_module(EXCHANGE))


class Arrayed:
    """A result that NumPy takes as the array of its main quantity."""

    main: ClassVar[str] = "values"
    """Name of the field of that quantity."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the main quantity, NaN where nothing was measured; read-only unless copied.

        Examples
        --------
        >>> import numpy as np
        >>> import fringeworks as fw
        >>> scene = fw.simulate.standard_scene("parabola", size=100, fringes=8)
        >>> found = fw.reconstruct(scene, "fourier")
        >>> np.asarray(found.surface).shape
        (100, 100)
        """
        values: NDArray[Any] = getattr(self, self.main)
        if dtype is not None and values.dtype != dtype:
            if copy is False:
                raise ValueError(f"dtype: expected {values.dtype} without a copy, got {dtype}")
            return values.astype(dtype)
        return values.copy() if copy else values


class Labelled:
    """A result that becomes a data set with named axes, coordinates and units."""

    def to_xarray(self) -> xarray.Dataset:
        """Return the result as a data set of the package xarray.

        Returns
        -------
        xarray.Dataset with the axes ``row`` and ``column``, and for heights with a known pitch the
        places x and y on the plane, y upwards. Variables have ``units`` and ``long_name``; the
        numbers of reasons are named as the CF conventions want (``flag_values``,
        ``flag_meanings``). Attributes hold findings and provenance as JSON.

        Raises
        ------
        MissingPackage where the package ``xarray`` (the extra "xarray") is not installed.

        Examples
        --------
        >>> import fringeworks as fw
        >>> scene = fw.simulate.standard_scene("parabola", size=100, fringes=8)
        >>> found = fw.reconstruct(scene, "fourier").surface.to_xarray()
        >>> found.height.units, found.height.dims
        ('mm', ('row', 'column'))
        """
        return exchange().dataset(self)
