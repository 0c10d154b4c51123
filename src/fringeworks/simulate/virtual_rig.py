"""The virtual rig: what a camera sees of bodies that a projector lights, with the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from fringeworks.patterns.encode import encode
from fringeworks.patterns.plan import DEPTHS, PatternPlan
from fringeworks.rig.pinhole import inverse, project, rays, transform
from fringeworks.simulate.bodies import Body
from fringeworks.types import BoolMap, FloatMap, InputError, Rig, check_fields

COARSE, DENSE = 8, 144
"""Points of a pixel at which a varying albedo is looked at: in all, and where those differ."""
FINE = 16
"""Samples per projector pixel of a pattern's profile."""
SHADOW_START = 1e-4
"""Share of the way to the projector within which a surface does not shade itself."""


@dataclass(frozen=True)
class Optics:
    """How the virtual devices form light and images."""

    gamma: float = 1.0
    """Exponent of the projector's response; > 0."""
    defocus_px: float = 0.6
    """Standard deviation of the projector's blur, projector px; ≥ 0."""
    blur_px: float = 0.5
    """Standard deviation of the camera's blur, camera px; ≥ 0."""
    exposure: float = 1.0
    """Share of the camera's range that a white, head-on surface in the middle of the field fills
    under full light; > 0."""
    ambient: float = 0.02
    """Light that is always there, share of that."""
    black: float = 0.01
    """Light that the projector sends where it should send none, share of full light."""
    noise: float = 2.0
    """Standard deviation of the read noise, counts of 8 bit."""
    shot: float = 0.0
    """Variance per count, counts of 8 bit."""
    bits: int = 8
    """Depth of the frames, 8, 10, 12 or 16."""
    seed: int = 0
    """Of the noise; equal seeds give equal frames."""

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
            shot=(self.shot >= 0, ">= 0"),
            bits=(self.bits in DEPTHS, f"one of {DEPTHS}"),
        )


@dataclass(frozen=True, eq=False)
class View:
    """What the camera's pixels look at, exactly; maps are (h, w)."""

    points_mm: FloatMap
    """(h, w, 3) in camera coordinates; NaN where nothing is hit."""
    normals: FloatMap
    """(h, w, 3), towards the camera."""
    projector_px: FloatMap
    """(h, w, 2) column and row on the projector; NaN where nothing is hit."""
    body: NDArray[np.int32]
    """Number of the body; −1 for none."""
    albedo: FloatMap
    """Reflectance, mean over the pixel; 0 where nothing is hit."""
    shading: FloatMap
    """Projector's light that reaches the surface, 1 for head-on in the middle of the field; 0 in
    shadow, off the projector's frame, and on sides that face away."""

    @property
    def truth(self) -> dict[str, NDArray[Any]]:
        """What a virtual capture is written with: points, coordinates and masks."""
        return {
            "points_mm": self.points_mm,
            "projector_px": self.projector_px,
            "body": self.body,
            "lit": self.lit,
            "albedo": self.albedo,
        }

    @property
    def lit(self) -> BoolMap:
        """Where the projector's light reaches."""
        return self.shading > 0


def look(rig: Rig, bodies: Sequence[Body], *, T_camera_world: FloatMap | None = None) -> View:
    """Cast the camera's rays at bodies, and look from there to the projector.

    Parameters
    ----------
    rig : Rig
    bodies : sequence of Body
        In world coordinates.
    T_camera_world : (4, 4), optional
        World to camera coordinates; by default they are the same.

    Returns
    -------
    View
    """
    camera = rig.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    directions = rays(camera, np.stack((u, v), axis=-1)).reshape(-1, 3)
    T_world_camera = np.eye(4) if T_camera_world is None else inverse(T_camera_world)
    R = T_world_camera[:3, :3]
    eye, ways = T_world_camera[:3, 3], directions @ R.T
    distance, body = _nearest(bodies, eye, ways)
    found = np.flatnonzero(body >= 0)
    t = distance[found, None]
    points = t * directions[found]
    # Distances count from the camera in lengths of its rays.
    world, sight = eye + t * ways[found], t * ways[found]
    normals = np.empty_like(world)
    for k, item in enumerate(bodies):
        own = body[found] == k
        normals[own] = item.normal(world[own], sight[own])
    normals *= -np.sign(np.sum(normals * sight, axis=1, keepdims=True))
    shading = _shading(rig, bodies, points, normals @ R, (T_world_camera, world))
    shape = camera.shape

    def spread(values: FloatMap, empty: float) -> FloatMap:
        whole = np.full((len(body), *values.shape[1:]), empty)
        whole[found] = values
        return whole.reshape(*shape, *values.shape[1:])

    seen = project(rig.projector, transform(rig.T_projector_camera, points))
    bodies_seen = body.reshape(shape)
    return View(
        points_mm=spread(points, np.nan),
        normals=spread(normals @ R, np.nan),
        projector_px=spread(seen, np.nan),
        body=bodies_seen,
        albedo=_albedo(bodies, spread(world, np.nan), bodies_seen),
        shading=spread(shading, 0.0),
    )


def _nearest(
    bodies: Sequence[Body], origin: FloatMap, directions: FloatMap
) -> tuple[FloatMap, NDArray[np.int32]]:
    distance = np.full(len(directions), np.inf)
    body = np.full(len(directions), -1, np.int32)
    for k, item in enumerate(bodies):
        t = item.hit(origin, directions)
        nearer = t < distance
        distance[nearer], body[nearer] = t[nearer], k
    return distance, body


def _shading(
    rig: Rig,
    bodies: Sequence[Body],
    points: FloatMap,
    normals: FloatMap,
    world: tuple[FloatMap, FloatMap],
) -> FloatMap:
    """Lambert's cosine over the distance squared, where light arrives at all."""
    centre = rig.projector_centre_mm
    way = centre - points
    length = np.linalg.norm(way, axis=1)
    cosine = np.einsum("nk,nk->n", normals, way) / length
    pixel = project(rig.projector, transform(rig.T_projector_camera, points))
    size = np.array([rig.projector.width_px, rig.projector.height_px])
    with np.errstate(invalid="ignore"):
        inside = ((pixel >= -0.5) & (pixel <= size - 0.5)).all(axis=1)
    light = np.where(inside & (cosine > 0), cosine, 0.0)
    lit = np.flatnonzero(light)
    T_world_camera, places = world
    lamp = transform(T_world_camera, centre)
    # From the lamp to the point: shaded where something is hit well before it.
    towards = places[lit] - lamp
    for item in bodies:
        light[lit[item.hit(lamp, towards) < 1.0 - SHADOW_START]] = 0.0
    usual = np.median(length[light > 0]) if (light > 0).any() else 1.0
    return np.asarray(light * (usual / length) ** 2)


def _albedo(bodies: Sequence[Body], world: FloatMap, body: NDArray[np.int32]) -> FloatMap:
    """Mean reflectance over every pixel: paint may change within one."""
    albedo = np.zeros(body.shape)
    for k, item in enumerate(bodies):
        own = body == k
        if not callable(item.albedo):
            albedo[own] = item.albedo
        elif own.any():
            rows, columns = (slice(c.min(), c.max() + 1) for c in np.nonzero(own))
            part = own[rows, columns]
            surface = np.zeros((*part.shape, 2))
            surface[part] = item.local(world[rows, columns][part])[:, :2]
            albedo[rows, columns][part] = _mean_paint(item.albedo, surface)[part]
    return albedo


def _mean_paint(paint: Any, surface: FloatMap) -> FloatMap:
    down, across = _steps(surface, 0), _steps(surface, 1)
    looks = [paint(*_shifted(surface, across, down, a, b)) for a, b in _lattice(COARSE)]
    total = np.mean(looks, axis=0)
    # Where neighbours differ may be an edge that a few points do not see: more of them.
    mixed = ndimage.maximum_filter(np.max(looks, axis=0), 3) > ndimage.minimum_filter(
        np.min(looks, axis=0), 3
    )
    here = (surface[mixed], across[mixed], down[mixed])
    # A lattice errs alike for all pixels that an edge crosses alike: turned about within each
    # pixel by an amount of its own, its errors average out along the edge.
    turn_a, turn_b = np.random.default_rng(0).random((2, int(mixed.sum())))
    dense = np.zeros(turn_a.size)
    for a, b in _lattice(DENSE):
        dense += paint(
            *_shifted(*here, (a + turn_a + 0.5) % 1.0 - 0.5, (b + turn_b + 0.5) % 1.0 - 0.5)
        )
    total[mixed] = dense / DENSE
    return np.asarray(total)


def _lattice(n: int) -> Iterator[tuple[float, float]]:
    """n points of a unit square about 0, one in each of n rows and columns (golden section)."""
    step = next(m for m in range(round(0.618 * n), n + 1) if math.gcd(m, n) == 1)
    for k in range(n):
        yield (k + 0.5) / n - 0.5, (k * step % n + 0.5) / n - 0.5


def _shifted(
    surface: FloatMap, across: FloatMap, down: FloatMap, a: Any, b: Any
) -> tuple[FloatMap, FloatMap]:
    """Coordinates at a part (a, b) of a pixel away from its middle."""
    x, y = (surface[..., k] + a * across[..., k] + b * down[..., k] for k in (0, 1))
    return x, y


def _steps(surface: FloatMap, axis: int) -> FloatMap:
    """Change of the surface's coordinates from pixel to pixel."""
    if surface.shape[axis] < 2:
        return np.zeros_like(surface)
    return np.asarray(np.gradient(surface, axis=axis))


def photograph(
    view: View, plan: PatternPlan, optics: Optics | None = None
) -> Iterator[NDArray[np.unsignedinteger]]:
    """The frames that the camera takes while a plan is projected.

    Parameters
    ----------
    view : View
        Of ``look``; its rig's projector must be of the plan's size.
    plan : PatternPlan
    optics : Optics, optional

    Yields
    ------
    (h, w) arrays, uint8, or uint16 for more than 8 bits.

    Raises
    ------
    InputError for a plan that is smaller than the projector.

    Notes
    -----
    A projector pixel is a square of constant light v^γ; the lens blurs it by a Gaussian. The
    camera integrates reflected light under a Gaussian blur; noise σ² = noise² + shot · I,
    clipping and rounding follow.
    """
    optics = optics or Optics()
    rng = np.random.default_rng(optics.seed)
    top = 2**optics.bits - 1
    scale = top / 255.0
    reflected = optics.exposure * top * view.albedo
    sampler = _Projected(view, optics.defocus_px)
    for lit, size in zip(sampler.places, (plan.width_px, plan.height_px), strict=True):
        if lit.size and lit.max() > size:
            raise InputError(
                f"plan: expected one for the view's projector, got {plan.width_px} × "
                f"{plan.height_px} px where light comes from beyond"
            )
    bright = 2**plan.bits - 1
    for picture in encode(plan):
        sent = (picture / bright) ** optics.gamma
        light = optics.black + (1.0 - optics.black) * sampler(sent)
        counts = reflected * (view.shading * light + optics.ambient)
        if optics.blur_px:
            counts = ndimage.gaussian_filter(counts, optics.blur_px, mode="nearest")
        spread = np.sqrt((optics.noise * scale) ** 2 + optics.shot * scale * counts)
        counts += spread * rng.standard_normal(counts.shape, np.float32)
        # A sensor clips at both ends; that is what is simulated, not a repair of bad numbers.
        np.clip(np.rint(counts, out=counts), 0, top, out=counts)
        yield counts.astype(np.uint8 if optics.bits == 8 else np.uint16)


class _Projected:
    """Light at the pixels of a view for pictures of the projector."""

    def __init__(self, view: View, defocus_px: float) -> None:
        self.shape = view.body.shape
        self.lit = np.flatnonzero(view.lit)
        self.defocus = defocus_px
        self.places = [view.projector_px[..., k].reshape(-1)[self.lit] for k in (0, 1)]
        self.lines: dict[int, tuple[NDArray[np.int32], NDArray[np.float32]]] = {}

    def __call__(self, picture: FloatMap) -> FloatMap:
        light = np.zeros(self.shape)
        if (picture == picture[:1]).all():
            light.reshape(-1)[self.lit] = self._along(0, picture[0])
        elif (picture == picture[:, :1]).all():
            light.reshape(-1)[self.lit] = self._along(1, picture[:, 0])
        else:
            light.reshape(-1)[self.lit] = self._everywhere(picture)
        return light

    def _along(self, axis: int, values: FloatMap) -> FloatMap:
        """Most patterns vary along one axis: their profile, exact, and linear between samples."""
        fine = _profile(values, self.defocus)
        if axis not in self.lines:
            place = (self.places[axis] + 0.5) * FINE
            whole = np.clip(place.astype(np.int32), 0, fine.size - 2)
            self.lines[axis] = whole, (place - whole).astype(np.float32)
        index, part = self.lines[axis]
        return np.asarray(fine[index] + part * np.diff(fine)[index])

    def _everywhere(self, picture: FloatMap) -> FloatMap:
        """Any picture: blurred at the pixels' centres, linear between them."""
        # Interpolation spreads a pixel by 1/6 px² where its square has 1/12.
        sigma = np.sqrt(max(self.defocus**2 - 1.0 / 12.0, 0.0))
        blurred = ndimage.gaussian_filter(picture, sigma, mode="nearest")
        return np.asarray(
            ndimage.map_coordinates(blurred, self.places[::-1], order=1, mode="nearest")
        )


def _profile(values: FloatMap, defocus_px: float) -> FloatMap:
    """Light at −½, −½ + 1/16 … of pixels in a line, each a square blurred by a Gaussian."""
    n = values.size
    place = np.arange(n * FINE + 1) / FINE - 0.5
    if defocus_px == 0:
        return np.asarray(values[np.clip(np.floor(place + 0.5).astype(int), 0, n - 1)])
    reach = int(np.ceil(5.0 * defocus_px)) + 1
    near = np.clip(np.floor(place + 0.5).astype(int), 0, n - 1)
    light = np.zeros(place.size)
    for k in range(-reach, reach + 1):
        pixel = near + k
        edges = (pixel + 0.5 - place, pixel - 0.5 - place)
        share = special.ndtr(edges[0] / defocus_px) - special.ndtr(edges[1] / defocus_px)
        inside = (pixel >= 0) & (pixel < n)
        light += np.where(inside, share * values[np.clip(pixel, 0, n - 1)], 0.0)
    return light
