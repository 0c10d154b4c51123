"""Results of the package in one form: points, σ, reasons and maps in the order of their pixels."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import Any

import numpy as np

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.viewer.placing import (
    Lattice,
    camera_lattice,
    fitted_camera,
    plane_lattice,
)
from fringeworks.types import (
    BoolMap,
    ByteMap,
    CoordinateMap,
    FloatMap,
    HeightMap,
    InputError,
    Pinhole,
    PointCloud,
    Points,
    Reason,
    Rig,
    RigMismatch,
)
from fringeworks.types.numbers import number
from fringeworks.types.placement import Placement

MAX_PIXELS = 8_000_000
"""Largest number of pixels that is packed. The page needs about 100 bytes for each, so that this is
near what a browser's page may take on an ordinary computer."""
MAX_BESIDE = 1.0
"""Largest mean distance of a cloud's points from the rays of the camera that is given for it, over
σ. A point has no error across its ray, so that a larger one belongs to another camera."""
SHOWN = "shown in camera coordinates; the points are in coordinates of "
"""What is said of points in other coordinates, such as those of a robot's base."""


@dataclass(frozen=True)
class Content:
    """What is packed; arrays in the order of the pixels."""

    kind: str
    """cloud, heights, displacements, coordinates or points."""
    points: FloatMap
    """(h, w, 3) float64; NaN where unmeasured."""
    sigma: FloatMap
    """(h, w), unit of z; NaN where unknown."""
    reason: ByteMap
    """(h, w)."""
    unit: str
    """Of z and σ."""
    lateral_unit: str
    """Of x and y."""
    lattice: Lattice | None = None
    """How points follow from z; None where unknown."""
    placement: Placement | None = None
    """Other coordinates of the points, which are shown in those of the camera; None for none."""
    raster: bool = True
    """Whether neighbours in the arrays are neighbours on the surface."""
    maps: dict[str, FloatMap] = field(default_factory=dict)
    """modulation, albedo, walls, texture, deviation: (h, w), texture also (h, w, 3)."""
    notes: tuple[str, ...] = ()
    """What to know about the surface."""
    title: str = ""
    """Its name."""

    @property
    def measured(self) -> BoolMap:
        """Pixels with a point, (h, w)."""
        return np.asarray(self.reason == Reason.OK)

    @property
    def metric(self) -> bool:
        """Whether distances in space have a meaning: all three coordinates are lengths."""
        return self.unit == "mm" and self.lateral_unit == "mm"


def content_of(result: object, camera: Rig | Pinhole | None, every: int) -> Content:
    """The content of a result; see ``pack_surface``."""
    check_every(every)
    if camera is not None and not isinstance(result, Measurement | PointCloud):
        raise InputError(
            f"camera: expected none for a {type(result).__name__}; only point clouds have one"
        )
    pinhole = camera.camera if isinstance(camera, Rig) else camera
    found = _content(result, pinhole, every)
    if found.points.shape[0] * found.points.shape[1] == 0:
        raise InputError("surface: expected one pixel or more, got none")
    finite = np.isfinite(found.points).all(axis=-1)
    # A point that is no number cannot be shown, whatever its reason says.
    reason = np.where((found.reason == Reason.OK) & ~finite, Reason.MASKED, found.reason)
    measured = reason == Reason.OK
    return replace(
        found,
        reason=np.minimum(reason, len(Reason) - 1).astype(np.uint8),
        points=np.where(measured[..., None], found.points, np.nan),
        sigma=np.where(measured & np.isfinite(found.sigma), found.sigma, np.nan),
    )


def check_every(every: int) -> None:
    """Refuse a number of columns and rows of which one is shown that is none."""
    if not isinstance(every, int) or every < 1:
        raise InputError(f"every: expected a whole number of 1 or more, got {every!r}")


def check_pixels(pixels: int, every: int) -> None:
    """Refuse frames that a page cannot hold, before anything is computed for them."""
    if pixels / every**2 > MAX_PIXELS:
        raise InputError(
            f"surface: expected {MAX_PIXELS:,} pixels or fewer for a page, got {pixels:,}; give a "
            f"part of the frame, or every = {enough_thinned(pixels)}"
        )


def enough_thinned(pixels: int, every: int = 1) -> int:
    """The thinning at which a page holds a frame, and at least the one that is given."""
    return max(every, int(np.ceil(np.sqrt(pixels / MAX_PIXELS))))


@singledispatch
def _content(result: Any, _camera: Pinhole | None, _every: int) -> Content:
    raise InputError(
        "surface: expected a Measurement, Reconstruction, PointCloud, HeightMap, CoordinateMap or "
        f"Points, got {type(result).__name__}"
    )


@_content.register
def _(result: Measurement, camera: Pinhole | None, every: int) -> Content:
    content = _content(result.points, camera, every)
    some = next(iter(result.decoded.maps.values()))
    maps = {"modulation": some.modulation[::every, ::every], **content.maps}
    return replace(content, maps=maps)


@_content.register
def _(result: Reconstruction, camera: Pinhole | None, every: int) -> Content:
    found = {"albedo": result.displacement.albedo, "walls": result.displacement.walls}
    maps: dict[str, FloatMap] = {
        name: values[::every, ::every].astype(np.float64)
        for name, values in found.items()
        if values is not None
    }
    return replace(_content(result.surface, camera, every), maps=maps)


@_content.register
def _(cloud: PointCloud, camera: Pinhole | None, every: int) -> Content:
    check_pixels(cloud.reason.size, every)
    if camera is not None and camera.shape != cloud.shape:
        raise RigMismatch(
            f"camera: it is for frames of {camera.width_px} × {camera.height_px} px, got a cloud "
            f"of {cloud.shape[1]} × {cloud.shape[0]}"
        )
    # Rays, edges and normals start at the camera.
    shown = cloud.in_camera()
    reason = cloud.reason[::every, ::every]
    measured = (reason == Reason.OK)[..., None]
    points = np.where(measured, shown.xyz_mm[::every, ::every].astype(np.float64), np.nan)
    sigma = cloud.sigma_mm[::every, ::every].astype(np.float64)
    lattice = None
    if camera is None:
        fitted, step = fitted_camera(points), 1
        lattice = None if fitted is None else camera_lattice(points.shape[:2], fitted, step)
    else:
        lattice = camera_lattice(points.shape[:2], camera, every)
        _check_camera(lattice, points, sigma)
    maps = {} if cloud.colour is None else {"texture": cloud.colour[::every, ::every]}
    return Content(
        *("cloud", points, sigma, reason, "mm", "mm", lattice),
        placement=cloud.placement,
        maps=maps,
        notes=cloud.notes if cloud.placement is None else (*cloud.notes, SHOWN + cloud.frame),
    )


def _check_camera(lattice: Lattice, points: FloatMap, sigma: FloatMap) -> None:
    """Refuse a camera that has not seen the cloud."""
    if lattice.directions is None:
        return
    beside = np.linalg.norm(points - lattice.directions * points[..., 2:], axis=-1)
    ratio = beside / sigma
    ratio = ratio[np.isfinite(ratio)]
    if ratio.size and np.median(ratio) > MAX_BESIDE:
        raise RigMismatch(
            "camera: expected the camera that the cloud was taken with, got one whose rays pass "
            f"the points at {number(float(np.nanmedian(beside)))} mm"
        )


@_content.register
def _(surface: HeightMap, _camera: Pinhole | None, every: int) -> Content:
    check_pixels(surface.values.size, every)
    values = surface.values[::every, ::every].astype(np.float64)
    lateral = "mm" if surface.unit == "mm" and surface.pitch is not None else "px"
    pitch = every * float(surface.pitch or 1.0)
    pupil = surface.pupil
    if pupil is not None:
        pupil = (pupil[0] / every, pupil[1] / every, pupil[2])
    kind = "heights" if surface.quantity == "height" else "displacements"
    return _over_plane(
        kind,
        values,
        surface.sigma[::every, ::every],
        surface.reason[::every, ::every],
        plane_lattice(values.shape, pitch, pupil),
        (surface.unit, lateral),
        notes=surface.notes,
    )


@_content.register
def _(result: CoordinateMap, _camera: Pinhole | None, every: int) -> Content:
    check_pixels(result.reason.size, every)
    part = (slice(None, None, every), slice(None, None, every))
    values = result.coordinate_px[part].astype(np.float64)
    lattice = plane_lattice(values.shape, float(every), None)
    maps = {"modulation": result.modulation[part], "texture": result.background[part]}
    found = _over_plane(
        "coordinates",
        values,
        result.sigma_px[part],
        result.reason[part],
        lattice,
        ("px", "px"),
    )
    return replace(found, maps=maps)


def _over_plane(
    kind: str,
    values: FloatMap,
    sigma: FloatMap,
    reason: ByteMap,
    lattice: Lattice,
    units: tuple[str, str],
    notes: tuple[str, ...] = (),
) -> Content:
    assert lattice.directions is not None
    points = lattice.directions * values[..., None] + lattice.offsets
    return Content(kind, points, sigma, reason, *units, lattice, notes=notes)


@_content.register
def _(cloud: Points, _camera: Pinhole | None, every: int) -> Content:
    xyz = np.asarray(cloud.xyz_mm, np.float64)[:: every**2]
    check_pixels(len(xyz), 1)
    unknown = np.full(len(xyz), np.nan)
    sigma = unknown if cloud.sigma_mm is None else cloud.sigma_mm[:: every**2]
    return Content(
        "points",
        xyz[None],
        np.asarray(sigma, np.float64)[None],
        np.zeros((1, len(xyz)), np.uint8),
        "mm",
        "mm",
        raster=False,
        notes=cloud.notes,
    )
