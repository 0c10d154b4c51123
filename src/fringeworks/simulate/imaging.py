"""From the projector's light to the light on the camera's sensor: both lenses and the surface."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.simulate.lens import ThinLens, blurred_by_map
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.projected_light import ProjectedLight
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap


class Imaging:
    """How light travels from the projector to the camera's sensor, before noise and rounding.

    Parameters
    ----------
    view : View
    optics : Optics
        Blur, fill and exposure are used; response, black level, ambient light and noise are not.
    full : float
        Value of the camera's full scale in the result: 1 for shares, 255 for counts of 8 bit.
    """

    def __init__(self, view: View, optics: Optics, *, full: float = 1.0) -> None:
        blur = _blur(optics.projector_lens, view.projector_depth_mm, view.rig.projector.focal_px)
        defocus = optics.defocus_px if blur is None else np.hypot(optics.defocus_px, blur)
        self.projected = ProjectedLight(view.projector_px, view.lit, defocus, optics.fill)
        """Light of a picture (rows, columns) on the surface, (h, w), before shading."""
        self._reflected = optics.exposure * full * view.albedo
        self._blur_px = optics.blur_px
        self._pixel_px = optics.pixel_px
        self._lens_px = _blur(optics.camera_lens, view.points_mm[..., 2], view.rig.camera.focal_px)

    def seen(self, arriving: FloatMap, mirrored: FloatMap | float = 0.0) -> FloatMap:
        """Return the light on the sensor, (h, w), in units of ``full``.

        Parameters
        ----------
        arriving : (h, w) array
            Light on the surface, relative to the projector's full light.
        mirrored : (h, w) array or float
            Light of highlights, in units of ``full``, which is added before the camera's blur.
        """
        light = self._reflected * self._collected(arriving) + mirrored
        if self._lens_px is not None:
            return blurred_by_map(light, np.hypot(self._blur_px, self._lens_px))
        if self._blur_px:
            return np.asarray(scipy.ndimage.gaussian_filter(light, self._blur_px, mode="nearest"))
        return np.asarray(light)

    def _collected(self, arriving: FloatMap) -> FloatMap:
        """Light over a pixel's area, by a parabola through neighbouring centres (Simpson)."""
        if not self._pixel_px:
            return arriving
        side = self._pixel_px**2 / 24.0
        for axis in (0, 1):
            arriving = scipy.ndimage.correlate1d(
                arriving, [side, 1.0 - 2.0 * side, side], axis=axis, mode="nearest"
            )
        return arriving


def _blur(
    lens: ThinLens | None, depth_mm: FloatMap, focal_px: tuple[float, float]
) -> FloatMap | None:
    """Blur by depth, px; 0 where the camera sees no surface."""
    if lens is None:
        return None
    return np.nan_to_num(lens.blur_px(depth_mm, float(np.mean(focal_px))), nan=0.0)
