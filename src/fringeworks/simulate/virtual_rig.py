"""The virtual rig: what a camera's pixels look at, and where a projector lights it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import inverse, project, rays, transform
from fringeworks.simulate.bodies import Body
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, Rig

COARSE_SAMPLES = 8
"""Number of points of a pixel at which a varying albedo is sampled everywhere: enough to notice an
edge in the pixel or its neighbours."""
DENSE_SAMPLES = 144
"""Number of points of a pixel at which the albedo is sampled near edges. The positions of edges are
then true to 0.004 px, as the tests require: calibration finds corners to about that."""
GOLDEN_SECTION = 0.618
"""Step of the sample lattice over the number of samples: near the golden section, points spread
evenly over the pixel."""
SHADOW_SHARE = 1e-4
"""A surface does not shade a point if it is nearer to the point than this, over the distance from
the projector: 0.05 mm at 500 mm. Rounding would otherwise let a surface shade itself."""


def pixel_albedo(bodies: Sequence[Body], world: FloatMap, body: NDArray[np.int32]) -> FloatMap:
    """Compute the mean reflectance over every pixel.

    Parameters
    ----------
    bodies : sequence of Body
    world : (h, w, 3) array
        What the pixels' centres see, in world coordinates, mm.
    body : (h, w) int array
        Number of the body that each pixel sees; −1 for none.

    Returns
    -------
    (h, w) array, 0…1; 0 where no body is seen.
    """
    albedo = np.zeros(body.shape)
    for k, item in enumerate(bodies):
        seen = body == k
        if not callable(item.albedo):
            albedo[seen] = item.albedo
        elif seen.any():
            rows, columns = (slice(c.min(), c.max() + 1) for c in np.nonzero(seen))
            part = seen[rows, columns]
            surface = np.zeros((*part.shape, 2))
            surface[part] = item.local(world[rows, columns][part])[:, :2]
            albedo[rows, columns][part] = _mean_albedo(item.albedo, surface)[part]
    return albedo


def _mean_albedo(
    albedo_at: Callable[[FloatMap, FloatMap], FloatMap], surface: FloatMap
) -> FloatMap:
    """Mean over every pixel of an albedo that depends on the surface's x and y, (h, w)."""
    down, across = _change_per_pixel(surface, 0), _change_per_pixel(surface, 1)
    whole = _planes(surface), _planes(across), _planes(down)
    samples = [albedo_at(*_at(*whole, a, b)) for a, b in _lattice(COARSE_SAMPLES)]
    mean = np.mean(samples, axis=0)
    # An edge may lie between the few points, so pixels beside a varying one count as well.
    near_edge = scipy.ndimage.maximum_filter(
        np.max(samples, axis=0), 3
    ) > scipy.ndimage.minimum_filter(np.min(samples, axis=0), 3)
    here = [_planes(vectors[near_edge]) for vectors in (surface, across, down)]
    # The same lattice would err alike in all pixels along an edge. Shifted at random in every
    # pixel, its errors average out.
    shift_a, shift_b = np.random.default_rng(0).random((2, int(near_edge.sum())))
    total = np.zeros(shift_a.size)
    for a, b in _lattice(DENSE_SAMPLES):
        place = (a + shift_a + 0.5) % 1.0 - 0.5, (b + shift_b + 0.5) % 1.0 - 0.5
        total += albedo_at(*_at(here[0], here[1], here[2], *place))
    mean[near_edge] = total / DENSE_SAMPLES
    return np.asarray(mean)


def _lattice(n: int) -> Iterator[tuple[float, float]]:
    """n points of a unit square about 0, one in each of n rows and n columns."""
    step = next(m for m in range(round(GOLDEN_SECTION * n), n + 1) if math.gcd(m, n) == 1)
    for k in range(n):
        yield (k + 0.5) / n - 0.5, (k * step % n + 0.5) / n - 0.5


def _planes(vectors: FloatMap) -> FloatMap:
    """x and y of a map of vectors (…, 2) as planes of their own, (2, …): they are read often."""
    return np.ascontiguousarray(np.moveaxis(vectors, -1, 0))


def _at(
    surface: FloatMap, across: FloatMap, down: FloatMap, a: Any, b: Any
) -> tuple[FloatMap, FloatMap]:
    """x and y on the surface at the fractions (a, b) of a pixel from its centre."""
    x, y = (surface[k] + a * across[k] + b * down[k] for k in (0, 1))
    return x, y


def _change_per_pixel(surface: FloatMap, axis: int) -> FloatMap:
    """Change of the surface's x and y from pixel to pixel along an axis."""
    if surface.shape[axis] < 2:
        return np.zeros_like(surface)
    return np.asarray(np.gradient(surface, axis=axis))


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
    rig: Rig
    """Camera and projector."""

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
    def projector_depth_mm(self) -> FloatMap:
        """Depth of the points along the projector's axis, (h, w), mm; NaN where no body is hit."""
        return np.asarray(transform(self.rig.T_projector_camera, self.points_mm)[..., 2])

    @property
    def area_mm2(self) -> FloatMap:
        """Area of the surface that each pixel sees, (h, w), mm²; 0 where no body is hit.

        A pixel whose ray (a, b, 1) covers da db sees z² da db / |n · (a, b, 1)|.
        """
        h, w = self.body.shape
        v, u = np.mgrid[:h, :w].astype(np.float64)
        ray = rays(self.rig.camera, np.stack((u, v), axis=-1))
        down, across = (np.asarray(np.gradient(ray[..., :2], axis=k)) for k in (0, 1))
        solid = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
        facing = np.abs(np.sum(self.normals * ray, axis=-1))
        area = self.points_mm[..., 2] ** 2 * solid / facing
        return np.asarray(np.nan_to_num(area, nan=0.0))

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
        rig=rig,
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
