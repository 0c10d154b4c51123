"""A plug-in of napari: results as layers, and a widget that measures two frames."""
