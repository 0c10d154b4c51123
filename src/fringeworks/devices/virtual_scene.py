"""The virtual rig's view as the scene of a virtual camera."""

from __future__ import annotations

import numpy as np

from fringeworks.patterns.plan import COLOURS
from fringeworks.simulate.imaging import Imaging
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, InputError

OF_DEVICES = (
    *("gamma", "response", "black", "noise", "gain", "bits", "bayer", "jpeg", "seed", "filters"),
)
"""Fields of ``Optics`` that the models of virtual projector and camera have in their own way."""


class RigScene:
    """What a virtual camera sees of bodies before the virtual rig.

    Parameters
    ----------
    view : View
        From ``look``. Its projector must have the size of the virtual projector.
    optics : Optics
        Both blurs, fill, exposure and ambient light are used. The other fields, such as the
        response, black level and noise, belong to ``ProjectorModel`` and ``CameraModel``; they must
        keep their defaults, which are not used.
    highlight : (h, w) array, optional
        Light of highlights from ``fringeworks.simulate.virtual_rig``, relative to a white surface.
    paint : (h, w, 3) array, optional
        Reflectance for the projector's red, green and blue, relative to the view's albedo; 1 by
        default.

    Raises
    ------
    InputError for other values of fields that belong to the models of the devices, and for
    highlights or paint of another shape.

    Examples
    --------
    >>> import numpy as np
    >>> from fringeworks.simulate import bust, look, standard_rig
    >>> scene = RigScene(look(standard_rig(scale=0.1), bust()))
    >>> scene.shape, scene.projected(np.ones((120, 192))).shape
    ((102, 128), (102, 128))
    """

    def __init__(
        self,
        view: View,
        optics: Optics | None = None,
        *,
        highlight: FloatMap | None = None,
        paint: FloatMap | None = None,
    ) -> None:
        optics = optics or Optics()
        usual = Optics()
        for name in OF_DEVICES:
            if getattr(optics, name) != getattr(usual, name):
                raise InputError(
                    f"optics: expected the default of {name}, which belongs to the model of the "
                    f"virtual projector or camera, got {getattr(optics, name)}"
                )
        if highlight is not None and highlight.shape != view.albedo.shape:
            raise InputError(
                f"highlight: expected shape {view.albedo.shape}, got {highlight.shape}"
            )
        if paint is not None and paint.shape != (*view.albedo.shape, COLOURS):
            raise InputError(
                f"paint: expected shape {(*view.albedo.shape, COLOURS)}, got {paint.shape}"
            )
        self._paint = paint
        projector = view.rig.projector
        self._picture_shape = projector.height_px, projector.width_px
        self._shading = view.shading
        self._imaging = Imaging(view, optics)
        self._mirrored = None if highlight is None else optics.exposure * highlight
        self.shape = (view.albedo.shape[0], view.albedo.shape[1])
        """Rows and columns of the camera."""
        self.ambient = self._imaging.seen(optics.ambient * (view.body >= 0))
        """Light that does not come from the projector, (h, w), shares of the camera's full scale.
        """

    def projected(self, light: FloatMap) -> FloatMap:
        """Return the projector's light at the camera's pixels.

        Parameters
        ----------
        light : (rows, columns) or (rows, columns, 3) array
            Light of the projector's pixels, 0…1; of each colour.

        Returns
        -------
        (h, w) array, shares of the camera's full scale; above 1 where a highlight saturates it. For
        light in colours, and for a painted scene, (h, w, 3): the light of each colour.

        Raises
        ------
        InputError for a projector of another size than the view's.
        """
        if light.shape not in (self._picture_shape, (*self._picture_shape, COLOURS)):
            raise InputError(
                f"light: expected the size of the view's projector, {self._picture_shape}, "
                f"got {light.shape}"
            )
        if light.ndim == len(self._picture_shape):
            direct = self._imaging.projected(light)
            if self._paint is None:
                return self._reflected(direct)
            return np.stack([self._reflected(direct, p) for p in self._paints()], axis=-1)
        sent = (np.ascontiguousarray(light[..., d]) for d in range(COLOURS))
        parts = zip(sent, self._paints(), strict=True)
        return np.stack([self._reflected(self._imaging.projected(s), p) for s, p in parts], axis=-1)

    def _paints(self) -> list[FloatMap | float]:
        """Reflectance for each colour."""
        if self._paint is None:
            return [1.0] * COLOURS
        return [self._paint[..., d] for d in range(COLOURS)]

    def _reflected(self, direct: FloatMap, paint: FloatMap | float = 1.0) -> FloatMap:
        """Light on the sensor of light that comes straight from the projector."""
        mirrored = 0.0 if self._mirrored is None else self._mirrored * direct
        return self._imaging.seen(self._shading * direct * paint, mirrored)
