"""A robot and its camera: how poses are written, and where the camera is."""
