"""From fringes to lengths."""

from fringeworks.geometry.reference_plane import (
    displacement_from_height,
    height_from_displacement,
    to_surface,
)

__all__ = ["displacement_from_height", "height_from_displacement", "to_surface"]
