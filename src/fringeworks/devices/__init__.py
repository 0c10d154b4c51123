"""Devices: projectors that show pictures and cameras that grab frames, real and virtual."""
