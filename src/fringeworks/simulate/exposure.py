"""Photographs of the virtual rig: from a plan's pictures to the counts of a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.encode import refuse_colours, thrown
from fringeworks.patterns.plan import COLOURS, PatternPlan
from fringeworks.simulate.bayer import demosaiced, mosaic
from fringeworks.simulate.imaging import Imaging
from fringeworks.simulate.jpeg import jpeg_compressed
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
    paint: FloatMap | None = None,
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
    paint : (h, w, 3) array, optional
        Reflectance for the projector's red, green and blue, relative to the view's albedo; 1 by
        default. For plans with ``colours``.

    Yields
    ------
    (h, w) arrays, counts: uint8, or uint16 for more than 8 bits. Photographs (h, w, 3) for a plan
    with ``colours``, by a camera of three sensors behind the ``filters`` of the optics.

    Raises
    ------
    InputError for a plan that is smaller than the projector, for paint of another shape or with a
    plan of grey pictures, and for ``bayer`` with a plan in colours.

    Notes
    -----
    A projector pixel is a square of constant light, given by the response and blurred by a
    Gaussian. The camera blurs the reflected light by a Gaussian. Colour filters, noise of variance
    noise² + gain · I, clipping, rounding, demosaicing and compression follow.
    """
    optics = optics or Optics()
    rng = np.random.default_rng(optics.seed)
    imaging = _imaging(view, plan, optics)
    _check_colours(view, plan, optics, paint)

    def arrived(picture: NDArray[Any]) -> FloatMap:
        arriving: FloatMap = view.shading * _light(imaging, picture, plan, optics)
        for step in transport:
            arriving = step(arriving)
        return arriving

    for picture in thrown(plan):
        if not plan.colours:
            light = arrived(np.ascontiguousarray(plan.seen(picture)))
            yield _stored(imaging.seen(light + optics.ambient), optics, rng)
            continue
        lights = [arrived(np.ascontiguousarray(picture[..., d])) for d in range(COLOURS)]
        channels = _channels(lights, optics, 1.0 if paint is None else paint)
        yield _stored(np.stack([imaging.seen(c) for c in channels], axis=-1), optics, rng)


def _channels(
    lights: Sequence[FloatMap], optics: Optics, paint: FloatMap | float
) -> Iterator[FloatMap]:
    """Light for each channel of a camera, from that of each colour of the projector.

    Ambient light is white.
    """
    reflected = (np.stack(lights, axis=-1) + optics.ambient) * paint
    for shares in optics.filters:
        yield reflected @ np.array(shares)


def _check_colours(view: View, plan: PatternPlan, optics: Optics, paint: FloatMap | None) -> None:
    """Refuse paint, and filters of pixels, that do not belong to the colours of a plan."""
    if plan.colours and optics.bayer is not None:
        raise InputError("bayer: expected None for a plan with colours, whose camera has 3 sensors")
    if paint is None:
        return
    if not plan.colours:
        raise InputError("paint: expected a plan with colours, got one of grey pictures")
    if np.shape(paint) != (*view.albedo.shape, COLOURS):
        raise InputError(
            f"paint: expected shape {(*view.albedo.shape, COLOURS)}, got {np.shape(paint)}"
        )


def photograph_moving(
    views: Iterable[View], plan: PatternPlan, optics: Optics | None = None
) -> Iterator[NDArray[np.unsignedinteger]]:
    """Take frames of a scene that moves, while the patterns of a plan are projected over and over.

    Parameters
    ----------
    views : iterable of View
        What the camera sees in each frame, from ``look``. Nothing moves during an exposure.
    plan : PatternPlan
    optics : Optics, optional

    Yields
    ------
    (h, w) arrays, counts, one for each view: uint8, or uint16 for more than 8 bits. Frame k shows
    pattern k modulo the plan's number of frames.

    Raises
    ------
    InputError for a plan that is smaller than the projector, or that has colours.
    """
    refuse_colours(plan)
    optics = optics or Optics()
    rng = np.random.default_rng(optics.seed)
    for view, picture in zip(views, cycle(thrown(plan)), strict=False):
        imaging = _imaging(view, plan, optics)
        seen = np.ascontiguousarray(plan.seen(picture))
        arriving = view.shading * _light(imaging, seen, plan, optics)
        yield _stored(imaging.seen(arriving + optics.ambient), optics, rng)


def _imaging(view: View, plan: PatternPlan, optics: Optics) -> Imaging:
    imaging = Imaging(view, optics, full=float(2**optics.bits - 1))
    _check_size(imaging.projected, plan)
    return imaging


def _light(imaging: Imaging, picture: NDArray[Any], plan: PatternPlan, optics: Optics) -> FloatMap:
    """Light of a plan's picture at the pixels of a view, relative to the projector's full light."""
    sent = picture / (2**plan.bits - 1)
    sent = sent**optics.gamma if optics.response is None else optics.response(sent)
    return np.asarray(optics.black + (1.0 - optics.black) * imaging.projected(sent))


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
    if not optics.jpeg:
        return frame
    planes = np.moveaxis(np.atleast_3d(frame), 2, 0)
    stored = [jpeg_compressed(np.ascontiguousarray(plane), optics.jpeg) for plane in planes]
    return np.stack(stored, axis=-1).reshape(frame.shape)
