"""Accessors of xarray: ``import fringeworks.xarray`` adds ``.fringe`` to its arrays and data sets.

Frames and phases are measured where they lie, and results are data sets that keep the coordinates
of the frames, such as a time. The package also reads result files for
``xarray.open_dataset(path, engine="fringeworks")``, which needs no import.
"""

from fringeworks.xarray.arrays import FringeArray
from fringeworks.xarray.datasets import FringeDataset

__all__ = ["FringeArray", "FringeDataset"]
