"""Many captures by one recipe, on the cores of this machine or on a Dask cluster."""
