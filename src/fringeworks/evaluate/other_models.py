"""Whether a part would fit a mirrored model, or one in another unit, far better."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fringeworks.evaluate.measured_part import MeasuredPart
from fringeworks.rig.pinhole import transform
from fringeworks.surface.closest import MeshDistance
from fringeworks.types import Alignment, Finding, FloatMap, InputError, TriangleMesh
from fringeworks.types.numbers import number
from fringeworks.views.model_target import ModelTarget, search_pose

FAR_BETTER = 2.0
"""Smallest ratio of the misfits by which a mirrored or scaled model is named. Wrong poses raise the
misfit of parts without symmetry twofold; noise changes it by far less (``EQUALLY_GOOD``)."""
GOOD_SIGMAS = 3.0
"""Root mean square distance, in σ of the points, up to which a model explains them. No other one is
tried then. Another one is named only if it explains the points: of a part that deviates from every
model, a robust fit may lie on a few faces alone, and its misfit says nothing about the model."""
JUDGED_POINTS = 3000
"""Approximate number of points by which fits are compared."""
REACH_SHARE = 0.05
"""Largest distance that a point counts with, in sizes of the measured surface: points of a table
count alike for every model."""
UNITS = {
    "the inch": 25.4,
    "the centimetre": 10.0,
    "the metre": 1000.0,
    "mm, read as inches": 1 / 25.4,
}
"""Units that drawings are written in by mistake, mm."""
SMALLEST_SIZE, LARGEST_SIZE = 0.9, 8.0
"""Size of a model in another unit, in sizes of the measured surface, for which the unit is tried.
The model is not smaller than what was measured of it, and a view shows an eighth of it or more."""


def other_models(
    seen: MeasuredPart, model: TriangleMesh, found: Alignment | None, *, seed: int = 0
) -> tuple[Finding, ...]:
    """Return a finding where a mirrored model or another unit fits far better.

    Parameters
    ----------
    seen : MeasuredPart
    model : TriangleMesh
        As it was read.
    found : Alignment, optional
        The best fit to it; None where there is none.
    seed : int
        Seed of the choice of points.
    """
    if seen.sigma_mm is None:
        return ()
    good = GOOD_SIGMAS * float(np.median(seen.sigma_mm))
    points = seen.xyz_mm[:: max(1, len(seen.xyz_mm) // JUDGED_POINTS)]
    reach = REACH_SHARE * float(np.linalg.norm(np.ptp(points, axis=0)))
    misfit = reach
    if found is not None:
        misfit = _misfit(MeshDistance(model), found.T_model_part, points, reach)
        if misfit <= good:
            return ()
    part = seen.turned(seed)
    tried = []
    for what, advice, other in _others(seen, model):
        mesh = MeshDistance(other)
        try:
            fit = search_pose(part, ModelTarget(mesh), one_view=seen.one_view, seed=seed).found
        except InputError:
            continue
        tried.append((_misfit(mesh, fit.T_target_source, points, reach), what, advice))
    if not tried:
        return ()
    best, what, advice = min(tried)
    if best > good or best * FAR_BETTER > misfit:
        return ()
    before = "the part does not fit the model as it was read"
    if found is not None:
        before = f"the part fits the model as it was read to {number(misfit, unit='mm')} rms"
    seen_so = f"{before}; changed, it fits to {number(best, unit='mm')} rms"
    return (Finding("model", seen_so, (what,), advice, severity="error"),)


def _others(seen: MeasuredPart, model: TriangleMesh) -> Iterator[tuple[str, str, TriangleMesh]]:
    """Models that the part may really have: cause, advice, mesh."""
    bare = replace(model, face_index=None, nominal=(), chord_mm=None)
    vertices = np.asarray(model.vertices_mm, np.float64)
    extent = float(np.linalg.norm(np.ptp(seen.xyz_mm, axis=0)))
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if SMALLEST_SIZE * extent <= size:
        yield (
            "the model is mirrored",
            "export the model of the other hand, or measure the right part",
            replace(bare, vertices_mm=vertices * (-1.0, 1.0, 1.0), faces=model.faces[:, ::-1]),
        )
    for unit, scale in UNITS.items():
        if SMALLEST_SIZE * extent <= scale * size <= LARGEST_SIZE * extent:
            yield (
                f"the unit of the model is {unit}",
                f"read the model with the scale {number(scale, digits=4)}",
                replace(bare, vertices_mm=scale * vertices),
            )


def _misfit(mesh: MeshDistance, T: FloatMap, points_mm: FloatMap, reach_mm: float) -> float:
    """Root mean square distance of points from a model in a pose, mm; none is above the reach."""
    away = mesh.nearest(transform(T, points_mm), reach_mm).distance_mm
    return float(np.sqrt(np.mean(np.where(np.isfinite(away), away, reach_mm) ** 2)))
