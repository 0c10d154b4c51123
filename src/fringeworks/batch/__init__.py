"""Many captures by one recipe, on the cores of this machine or on a Dask cluster."""

from fringeworks._lazy import face

__getattr__, __dir__ = face(__name__)
