"""What a scan of a part will see, before it is taken: a virtual scan of the part's model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.evaluate.model_faces import FaceSamples, face_samples, smooth_faces
from fringeworks.files.atomic import StrPath
from fringeworks.files.mesh import read_model
from fringeworks.files.rig import read_rig
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.pinhole import inverse, project, transform
from fringeworks.simulate.bodies import Body, Mesh
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.virtual_rig import SHADOW_SHARE, View, look
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    ByteMap,
    FloatMap,
    Frozen,
    InputError,
    PointCloud,
    Reason,
    Rig,
    RigMismatch,
    TriangleMesh,
)

ALBEDO = 0.6
"""Reflectance of the part where the caller states none: matt grey paint, between white paper (0.8)
and grey plastic (0.4)."""
CAUSES = (
    "",
    "outside the camera's frame",
    "hidden from the camera",
    "outside the projector's frame",
    "turned away from the projector",
    "in the projector's shadow",
    "saturated",
    "fringes too weak: grazing light or a dark surface",
    "not decoded",
)
"""Why a place of the surface is not seen, by number; the first is that of a place that is seen."""
_CAUSE_OF_REASON = {
    Reason.OK: 0,
    Reason.SATURATED: 6,
    Reason.SHADOW: 7,
    Reason.LOW_MODULATION: 7,
}
"""Number of the cause for a lit pixel's reason; those that are missing are "not decoded"."""


@dataclass(frozen=True, eq=False, repr=False)
class Foresight(Frozen):
    """What a scan of a model will see from one pose."""

    points: PointCloud
    """Predicted points in camera coordinates, with σ and the reasons of pixels without points."""
    face: NDArray[np.int32]
    """Number of the face that each pixel sees, (h, w); −1 for none."""
    names: tuple[str, ...]
    """Names of the faces, in the order of their numbers."""
    samples: FaceSamples
    """Places spread evenly over the faces."""
    cause: NDArray[np.intp]
    """Place in ``CAUSES`` for every sample, (n,); 0 where it is seen."""
    sigma_mm: FloatMap
    """σ at every sample, (n,), mm; NaN where it is not seen."""


def foresee(
    model: TriangleMesh | StrPath,
    rig: Rig | StrPath,
    plan: PatternPlan,
    T_camera_model: FloatMap,
    *,
    albedo: float = ALBEDO,
    optics: Optics | None = None,
    faces: Mapping[str, NDArray[Any]] | None = None,
) -> Foresight:
    """Predict what a scan of a model will see: which pixels, with which σ, and which faces.

    Parameters
    ----------
    model : TriangleMesh or path
        STL, PLY or another file of triangles, mm.
    rig : Rig or path
    plan : PatternPlan
    T_camera_model : (4, 4) array
        Pose: maps model coordinates to camera coordinates, mm.
    albedo : float, 0…1
        Guess of the part's reflectance.
    optics : Optics, optional
        Exposure, room light, blur and noise of the devices.
    faces : mapping of names to (k,) int arrays, optional
        Triangles of each face; by default smooth regions, as ``smooth_faces`` finds them.

    Returns
    -------
    Foresight

    Raises
    ------
    RigMismatch for a plan of another projector; InputError for a pose that is none, an albedo out
    of range, and faces that the model lacks.

    Notes
    -----
    The rig's geometry casts rays at the model, the virtual devices take the plan's frames, and
    ``measure`` decodes them. Visibility, saturation and σ (noise and calibration) are therefore
    those of a real scan's own functions. The model's light is Lambert's: gloss and light between
    faces are not predicted.

    Examples
    --------
    >>> from fringeworks.simulate import fringe_plan, height_field, standard_rig
    >>> rig = standard_rig(scale=0.1)
    >>> flat = height_field(np.zeros((3, 3)), 20.0)
    >>> plate = TriangleMesh(flat.vertices_mm, flat.faces.astype(np.uint32))
    >>> pose = np.eye(4)
    >>> pose[:3, 3] = -20.0, -20.0, 500.0
    >>> seen = foresee(plate, rig, fringe_plan(rig), pose)
    >>> seen.names, bool(np.mean(seen.cause == 0) > 0.9)
    (('face 1',), True)
    """
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    model = model if isinstance(model, TriangleMesh) else read_model(model)
    pose = checked_pose(T_camera_model)
    if not 0.0 < albedo <= 1.0:
        raise InputError(f"albedo: expected above 0, up to 1, got {albedo!r}")
    groups = smooth_faces(model) if faces is None else dict(faces)
    size = rig.projector.width_px, rig.projector.height_px
    if (plan.width_px, plan.height_px) != size:
        raise RigMismatch(
            f"plan: expected one for the rig's projector of {size[0]} × {size[1]} px, got "
            f"{plan.width_px} × {plan.height_px} px"
        )
    samples = face_samples(model, groups)
    bodies = [
        Body(Mesh(model.vertices_mm, model.faces[np.asarray(triangles)]), pose, albedo)
        for triangles in groups.values()
    ]
    view = look(rig, bodies)
    points = _measured(view, plan, optics or Optics())
    cause, sigma = _judged(view, bodies, points, transform(pose, samples.points_mm))
    return Foresight(points, view.body, tuple(groups), samples, cause, sigma)


def checked_pose(pose: FloatMap) -> FloatMap:
    """Return a pose as float64; ``InputError`` for an array that is no rigid motion."""
    found = np.asarray(pose)
    real = found.shape == (4, 4) and found.dtype.kind in "fiu"
    rigid = real and bool(np.isfinite(found).all())
    if rigid:
        R = found[:3, :3].astype(np.float64)
        rigid = np.allclose(R @ R.T, np.eye(3), atol=1e-6) and bool(np.linalg.det(R) > 0)
        rigid = rigid and np.array_equal(found[3], [0, 0, 0, 1])
    if not rigid:
        raise InputError("pose: expected a rotation and a translation, (4, 4)")
    return found.astype(np.float64)


def _measured(view: View, plan: PatternPlan, optics: Optics) -> PointCloud:
    """Points of a virtual scan, NaN with a reason where the model is not seen or not lit."""
    if not view.lit.any():
        return _nothing(np.full(view.rig.camera.shape, Reason.SHADOW, np.uint8))
    frames = list(photograph(view, plan, optics))
    try:
        points = measure(Stack(frames, plan), view.rig).points
    except InputError:
        # ``measure`` refuses a scan without any point: the frames tell why pixels have none.
        full = (np.stack(frames) >= 2**optics.bits - 1).any(axis=0)
        return _nothing(np.where(full, Reason.SATURATED, Reason.LOW_MODULATION).astype(np.uint8))
    dark = ~view.lit
    reason = points.reason.copy()
    reason[dark & (reason == Reason.OK)] = Reason.SHADOW
    xyz, sigma, noise = (
        None
        if found is None
        else np.where(dark[..., None] if found.ndim == 3 else dark, np.nan, found)
        for found in (points.xyz_mm, points.sigma_mm, points.noise_mm)
    )
    return replace(points, xyz_mm=xyz, sigma_mm=sigma, noise_mm=noise, reason=reason)


def _nothing(reason: ByteMap) -> PointCloud:
    """A scan without any point."""
    none = np.full(reason.shape, np.nan, np.float32)
    xyz = np.full((*reason.shape, 3), np.nan, np.float32)
    return PointCloud(xyz_mm=xyz, sigma_mm=none, noise_mm=none, reason=reason)


def _judged(
    view: View, bodies: list[Body], points: PointCloud, places: FloatMap
) -> tuple[NDArray[np.intp], FloatMap]:
    """Cause and σ of places of the surface, (n, 3), in camera coordinates."""
    rig = view.rig
    cause = np.zeros(len(places), np.intp)
    h, w = rig.camera.shape
    with np.errstate(invalid="ignore", divide="ignore"):
        column, row = np.nan_to_num(project(rig.camera, places), nan=-9.0).T
    inside = (column > -0.5) & (column < w - 0.5) & (row > -0.5) & (row < h - 0.5)
    inside &= places[:, 2] > 0
    cause[~inside] = 1
    hidden = np.zeros(len(places), bool)
    for body in bodies:
        hidden |= body.hit(np.zeros(3), places) < 1.0 - SHADOW_SHARE
    cause[inside & hidden] = 2
    open_ = np.flatnonzero(cause == 0)
    u, v = np.rint(column[open_]).astype(int), np.rint(row[open_]).astype(int)
    cause[open_] = _pixel_causes(view, points)[v, u]
    sigma = np.full(len(places), np.nan)
    sigma[open_] = np.where(cause[open_] == 0, points.sigma_mm[v, u], np.nan)
    return cause, sigma


def _pixel_causes(view: View, points: PointCloud) -> NDArray[np.intp]:
    """Cause of each pixel, (h, w); pixels beside the model are "not decoded"."""
    cause = np.full(view.body.shape, CAUSES.index("not decoded"))
    for reason, number in _CAUSE_OF_REASON.items():
        cause[view.lit & (points.reason == reason)] = number
    rig = view.rig
    size = np.array([rig.projector.width_px, rig.projector.height_px])
    with np.errstate(invalid="ignore"):
        within = ((view.projector_px >= -0.5) & (view.projector_px <= size - 0.5)).all(axis=-1)
        centre = inverse(rig.T_projector_camera)[:3, 3]
        faces_lamp = np.sum(view.normals * (centre - view.points_mm), axis=-1) > 0
    dark = ~view.lit & (view.body >= 0)
    cause[dark] = 3
    cause[dark & within & ~faces_lamp] = 4
    cause[dark & within & faces_lamp] = 5
    return cause
