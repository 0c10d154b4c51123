"""Highlights of glossy surfaces, for the virtual rig."""

from __future__ import annotations

import numpy as np

from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, InputError


def highlight(view: View, *, strength: float = 10.0, shininess: float = 200.0) -> FloatMap:
    """Compute the projector's light that a glossy surface mirrors into the camera.

    Parameters
    ----------
    view : View
    strength : float ≥ 0
        Brightness at the middle of a highlight, relative to a white diffuse surface that faces the
        projector.
    shininess : float > 0
        Exponent of the lobe; a highlight is narrower for larger values. Satin paint has 50 to 200.

    Returns
    -------
    (h, w) array, relative to a white diffuse surface; 0 in shadow.

    Raises
    ------
    InputError for values out of their range.

    Notes
    -----
    The lobe is strength · (n · h)^shininess, with the normal n and the direction h halfway between
    camera and projector (Blinn, SIGGRAPH 1977).

    Examples
    --------
    >>> from fringeworks.simulate import bust, look, standard_rig
    >>> lobe = highlight(look(standard_rig(scale=0.1), bust()), strength=5.0)
    >>> lobe.shape, bool(lobe.max() > 4)
    ((102, 128), True)
    """
    if not strength >= 0:
        raise InputError(f"strength: expected >= 0, got {strength}")
    if not shininess > 0:
        raise InputError(f"shininess: expected > 0, got {shininess}")
    to_camera = -view.points_mm
    to_projector = view.rig.projector_centre_mm - view.points_mm
    halfway = sum(v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (to_camera, to_projector))
    halfway = halfway / np.linalg.norm(halfway, axis=-1, keepdims=True)
    cosine = np.clip(np.sum(view.normals * halfway, axis=-1), 0.0, 1.0)
    return np.asarray(np.where(view.lit, strength * cosine**shininess, 0.0))
