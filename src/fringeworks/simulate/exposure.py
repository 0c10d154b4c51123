"""Photographs of the virtual rig: from a plan's pictures to the counts of a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.patterns.encode import encode
from fringeworks.patterns.plan import PatternPlan
from fringeworks.simulate.bayer import demosaiced, mosaic
from fringeworks.simulate.jpeg import jpeg_compressed
from fringeworks.simulate.lens import ThinLens, blurred_by_map
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.projected_light import ProjectedLight
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, InputError

Transport = Callable[[FloatMap], FloatMap]
"""Light that arrives on the surface, (h, w), as a function of the light that comes straight from
the projector, (h, w); both relative to the projector's full light. Steps can be chained."""


def photograph(
    view: View,
    plan: PatternPlan,
    optics: Optics | None = None,
    *,
    transport: Sequence[Transport] = (),
) -> Iterator[NDArray[np.unsignedinteger]]:
    """Take the frames that the camera sees while the patterns of a plan are projected.

    Parameters
    ----------
    view : View
        From ``look``; the projector of its rig must have the plan's size.
    plan : PatternPlan
    optics : Optics, optional
    transport : sequence of Transport
        What light does in the scene before it leaves for the camera, in this order, such as
        ``subsurface`` and ``interreflection``.

    Yields
    ------
    (h, w) arrays, counts: uint8, or uint16 for more than 8 bits.

    Raises
    ------
    InputError for a plan that is smaller than the projector.

    Notes
    -----
    A projector pixel is a square of constant light, given by the response and blurred by a
    Gaussian. The camera blurs the reflected light by a Gaussian. Colour filters, noise of variance
    noise² + gain · I, clipping, rounding, demosaicing and compression follow.
    """
    optics = optics or Optics()
    rng = np.random.default_rng(optics.seed)
    blur = _blur(optics.projector_lens, view.projector_depth_mm, view.rig.projector.focal_px)
    defocus = optics.defocus_px if blur is None else np.hypot(optics.defocus_px, blur)
    projected = ProjectedLight(view.projector_px, view.lit, defocus, optics.fill)
    _check_size(projected, plan)
    reflected = optics.exposure * (2**optics.bits - 1) * view.albedo
    camera_blur = _blur(optics.camera_lens, view.points_mm[..., 2], view.rig.camera.focal_px)
    for picture in encode(plan):
        sent = picture / (2**plan.bits - 1)
        sent = sent**optics.gamma if optics.response is None else optics.response(sent)
        light = optics.black + (1.0 - optics.black) * projected(sent)
        arriving = view.shading * light
        for step in transport:
            arriving = step(arriving)
        counts = reflected * (arriving + optics.ambient)
        if camera_blur is not None:
            counts = blurred_by_map(counts, np.hypot(optics.blur_px, camera_blur))
        elif optics.blur_px:
            counts = ndimage.gaussian_filter(counts, optics.blur_px, mode="nearest")
        yield _stored(counts, optics, rng)


def _blur(
    lens: ThinLens | None, depth_mm: FloatMap, focal_px: tuple[float, float]
) -> FloatMap | None:
    """Blur by depth, px; 0 where the camera sees no surface."""
    if lens is None:
        return None
    return np.nan_to_num(lens.blur_px(depth_mm, float(np.mean(focal_px))), nan=0.0)


def _check_size(projected: ProjectedLight, plan: PatternPlan) -> None:
    """``InputError`` for a plan that is smaller than the projector."""
    for lit, size in zip(projected.coordinates, (plan.width_px, plan.height_px), strict=True):
        if lit.size and lit.max() > size:
            raise InputError(
                f"plan: expected one for the view's projector, got {plan.width_px} × "
                f"{plan.height_px} px, but the view is lit from coordinate {lit.max():.0f} px"
            )


def _stored(counts: FloatMap, optics: Optics, rng: np.random.Generator) -> NDArray[Any]:
    """Frame of a sensor under light in counts: noise, clipping, rounding, and what follows."""
    if optics.bayer is not None:
        counts = counts * mosaic((counts.shape[0], counts.shape[1]), optics.bayer)
    largest = 2**optics.bits - 1
    per_count_of_8_bit = largest / 255.0
    variance = (optics.noise * per_count_of_8_bit) ** 2
    sigma = np.sqrt(variance + optics.gain * per_count_of_8_bit * counts)
    counts = counts + sigma * rng.standard_normal(counts.shape, np.float32)
    # Clipping simulates the sensor, whose counts end at both limits.
    np.clip(np.rint(counts, out=counts), 0, largest, out=counts)
    frame: NDArray[Any] = counts.astype(np.uint8 if optics.bits == 8 else np.uint16)
    if optics.bayer is not None:
        frame = demosaiced(frame, optics.bayer, largest)
    return jpeg_compressed(frame, optics.jpeg) if optics.jpeg else frame
