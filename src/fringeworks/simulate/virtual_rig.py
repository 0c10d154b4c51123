"""The virtual rig: what a camera sees of bodies that a projector lights, with the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.patterns.encode import encode
from fringeworks.patterns.plan import DEPTHS, PatternPlan
from fringeworks.rig.pinhole import inverse, project, rays, transform
from fringeworks.simulate.bodies import Body
from fringeworks.simulate.pixel_albedo import pixel_albedo
from fringeworks.simulate.projected_light import ProjectedLight
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, Rig, check_fields

SHADOW_SHARE = 1e-4
"""A surface does not shade a point if it is nearer to the point than this, over the distance from
the projector: 0.05 mm at 500 mm. Rounding would otherwise let a surface shade itself."""


@dataclass(frozen=True)
class Optics:
    """How the virtual devices form light and images.

    Raises
    ------
    InputError for a value out of its range.
    """

    gamma: float = 1.0
    """Exponent of the projector's response; > 0."""
    defocus_px: float = 0.6
    """Standard deviation of the projector's blur, projector px; ≥ 0."""
    blur_px: float = 0.5
    """Standard deviation of the camera's blur, camera px; ≥ 0."""
    exposure: float = 1.0
    """Brightness of a white surface under full light, as a share of the camera's range; > 0. The
    surface is at the median distance of what is lit, and faces the projector."""
    ambient: float = 0.02
    """Light that does not come from the projector, relative to its full light; ≥ 0."""
    black: float = 0.01
    """Light of the projector's black, relative to its full light; 0…1."""
    noise: float = 2.0
    """Standard deviation of the read noise, counts of 8 bit; ≥ 0."""
    gain: float = 0.0
    """Shot noise: variance per count, counts of 8 bit; ≥ 0."""
    bits: int = 8
    """Depth of the frames: 8, 10, 12 or 16."""
    seed: int = 0
    """Seed of the noise; equal seeds give equal frames."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            gamma=(self.gamma > 0, "> 0"),
            defocus_px=(self.defocus_px >= 0, ">= 0"),
            blur_px=(self.blur_px >= 0, ">= 0"),
            exposure=(self.exposure > 0, "> 0"),
            ambient=(self.ambient >= 0, ">= 0"),
            black=(0 <= self.black < 1, "0 to 1"),
            noise=(self.noise >= 0, ">= 0"),
            gain=(self.gain >= 0, ">= 0"),
            bits=(self.bits in DEPTHS, f"one of {DEPTHS}"),
        )


@dataclass(frozen=True, eq=False, repr=False)
class View(Frozen):
    """What the camera's pixels look at, exactly; maps are (h, w)."""

    points_mm: FloatMap
    """(h, w, 3), camera coordinates, mm; NaN where no body is hit."""
    normals: FloatMap
    """(h, w, 3), unit normals towards the camera; NaN where no body is hit."""
    projector_px: FloatMap
    """(h, w, 2), column and row on the projector, px; NaN where no body is hit."""
    body: NDArray[np.int32]
    """Number of the body, in the order given to ``look``; −1 for none."""
    albedo: FloatMap
    """Reflectance, mean over the pixel, 0…1; 0 where no body is hit."""
    shading: FloatMap
    """The projector's light on the surface: cosine of incidence over the squared distance, 1 for
    head-on incidence at the median distance; 0 in shadow, outside the projector's frame, and where
    the surface faces away."""

    @property
    def truth(self) -> dict[str, NDArray[Any]]:
        """The maps that are stored as the truth of a virtual capture, by name."""
        return {
            "points_mm": self.points_mm,
            "projector_px": self.projector_px,
            "body": self.body,
            "lit": self.lit,
            "albedo": self.albedo,
        }

    @property
    def lit(self) -> BoolMap:
        """True where the projector's light arrives."""
        return self.shading > 0


def look(rig: Rig, bodies: Sequence[Body], *, T_camera_world: FloatMap | None = None) -> View:
    """Cast a ray through every camera pixel at bodies, and from there one to the projector.

    Parameters
    ----------
    rig : Rig
    bodies : sequence of Body
        In world coordinates.
    T_camera_world : (4, 4) array, optional
        Maps world to camera coordinates, mm; by default they are the same.

    Returns
    -------
    View

    Examples
    --------
    >>> from fringeworks.simulate import Plane, Sphere, standard_rig
    >>> from fringeworks.rig.pinhole import pose
    >>> ball = Body(Sphere(25.0), pose(np.eye(3), np.array([0.0, 0.0, 500.0])))
    >>> view = look(standard_rig(scale=0.1), [ball])
    >>> view.points_mm.shape, round(float(np.nanmin(view.points_mm[..., 2])))
    ((102, 128, 3), 475)
    """
    camera = rig.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    directions = rays(camera, np.stack((u, v), axis=-1)).reshape(-1, 3)
    T_world_camera = np.eye(4) if T_camera_world is None else inverse(T_camera_world)
    R = T_world_camera[:3, :3]
    eye, world_directions = T_world_camera[:3, 3], directions @ R.T
    distance, body = _nearest(bodies, eye, world_directions)
    hit = np.flatnonzero(body >= 0)
    # Distances count in lengths of the camera's rays, which have z = 1.
    t = distance[hit, None]
    points = t * directions[hit]
    sight = t * world_directions[hit]
    world = eye + sight
    normals = _normals_towards_camera(bodies, body[hit], world, sight)
    shading = _shading(rig, bodies, points, normals @ R, (T_world_camera, world))
    projector_px = project(rig.projector, transform(rig.T_projector_camera, points))

    def as_map(values: FloatMap, empty: float) -> FloatMap:
        whole = np.full((len(body), *values.shape[1:]), empty)
        whole[hit] = values
        return whole.reshape(*camera.shape, *values.shape[1:])

    body_map = body.reshape(camera.shape)
    return View(
        points_mm=as_map(points, np.nan),
        normals=as_map(normals @ R, np.nan),
        projector_px=as_map(projector_px, np.nan),
        body=body_map,
        albedo=pixel_albedo(bodies, as_map(world, np.nan), body_map),
        shading=as_map(shading, 0.0),
    )


def _nearest(
    bodies: Sequence[Body], origin: FloatMap, directions: FloatMap
) -> tuple[FloatMap, NDArray[np.int32]]:
    """Distance to the first body that each ray hits, and its number; ∞ and −1 for none."""
    distance = np.full(len(directions), np.inf)
    body = np.full(len(directions), -1, np.int32)
    for k, item in enumerate(bodies):
        t = item.hit(origin, directions)
        nearer = t < distance
        distance[nearer], body[nearer] = t[nearer], k
    return distance, body


def _normals_towards_camera(
    bodies: Sequence[Body], body: NDArray[np.int32], world: FloatMap, sight: FloatMap
) -> FloatMap:
    """Unit normals at points that rays have hit, (n, 3), in world coordinates."""
    normals = np.empty_like(world)
    for k, item in enumerate(bodies):
        of_body = body == k
        normals[of_body] = item.normal(world[of_body], sight[of_body])
    normals *= -np.sign(np.sum(normals * sight, axis=1, keepdims=True))
    return normals


def _shading(
    rig: Rig,
    bodies: Sequence[Body],
    points: FloatMap,
    normals: FloatMap,
    world: tuple[FloatMap, FloatMap],
) -> FloatMap:
    """The projector's light at points, (n,): Lambert's cosine over the squared distance.

    ``points`` and ``normals`` are in camera coordinates; ``world`` is T_world_camera and the points
    in world coordinates.
    """
    centre = rig.projector_centre_mm
    to_projector = centre - points
    length = np.linalg.norm(to_projector, axis=1)
    cosine = np.einsum("nk,nk->n", normals, to_projector) / length
    pixel = project(rig.projector, transform(rig.T_projector_camera, points))
    size = np.array([rig.projector.width_px, rig.projector.height_px])
    with np.errstate(invalid="ignore"):
        inside = ((pixel >= -0.5) & (pixel <= size - 0.5)).all(axis=1)
    light = np.where(inside & (cosine > 0), cosine, 0.0)
    lit = np.flatnonzero(light)
    T_world_camera, world_points = world
    pupil = transform(T_world_camera, centre)
    # Rays from the projector's pupil to the points: a body that is hit well before shades.
    from_pupil = world_points[lit] - pupil
    for item in bodies:
        light[lit[item.hit(pupil, from_pupil) < 1.0 - SHADOW_SHARE]] = 0.0
    median_length = np.median(length[light > 0]) if (light > 0).any() else 1.0
    return np.asarray(light * (median_length / length) ** 2)


def photograph(
    view: View, plan: PatternPlan, optics: Optics | None = None
) -> Iterator[NDArray[np.unsignedinteger]]:
    """Take the frames that the camera sees while the patterns of a plan are projected.

    Parameters
    ----------
    view : View
        From ``look``; the projector of its rig must have the plan's size.
    plan : PatternPlan
    optics : Optics, optional

    Yields
    ------
    (h, w) arrays, counts: uint8, or uint16 for more than 8 bits.

    Raises
    ------
    InputError for a plan that is smaller than the projector.

    Notes
    -----
    A projector pixel is a square of constant light v^γ, blurred by a Gaussian. The camera blurs
    the reflected light by a Gaussian; noise of variance noise² + gain · I, clipping and rounding
    follow.
    """
    optics = optics or Optics()
    rng = np.random.default_rng(optics.seed)
    largest = 2**optics.bits - 1
    per_count_of_8_bit = largest / 255.0
    reflected = optics.exposure * largest * view.albedo
    projected = ProjectedLight(view.projector_px, view.lit, optics.defocus_px)
    for lit, size in zip(projected.coordinates, (plan.width_px, plan.height_px), strict=True):
        if lit.size and lit.max() > size:
            raise InputError(
                f"plan: expected one for the view's projector, got {plan.width_px} × "
                f"{plan.height_px} px, but the view is lit from coordinate {lit.max():.0f} px"
            )
    for picture in encode(plan):
        sent = (picture / (2**plan.bits - 1)) ** optics.gamma
        light = optics.black + (1.0 - optics.black) * projected(sent)
        counts = reflected * (view.shading * light + optics.ambient)
        if optics.blur_px:
            counts = ndimage.gaussian_filter(counts, optics.blur_px, mode="nearest")
        variance = (optics.noise * per_count_of_8_bit) ** 2
        sigma = np.sqrt(variance + optics.gain * per_count_of_8_bit * counts)
        counts += sigma * rng.standard_normal(counts.shape, np.float32)
        # Clipping simulates the sensor, whose counts end at both limits.
        np.clip(np.rint(counts, out=counts), 0, largest, out=counts)
        yield counts.astype(np.uint8 if optics.bits == 8 else np.uint16)
