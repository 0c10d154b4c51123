"""What results become in other packages, by a room that is loaded on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, cast

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
