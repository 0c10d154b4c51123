"""Several spheres in one cloud, and fits in the terms of VDI/VDE 2634."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fringeworks.surface.form import DISCARDED, MIN_POINTS, Form, fit_form
from fringeworks.types import FloatMap, InputError, unmasked, whole

MOST_SPHERES = 1000
"""Largest number of spheres that are looked for. Artefacts have up to some tens."""
SPHERE_REGION = 1.1
"""Radius of the ball around a sphere's centre that is its region, in radii of the sphere: all of
its dents, and bumps of up to a tenth of its radius."""


def find_spheres(
    points_mm: FloatMap,
    count: int,
    *,
    sigma_mm: FloatMap | None = None,
    common_mm: float = 0.0,
    seed: int = 0,
) -> list[Form]:
    """Fit several spheres to one cloud, one after the other.

    Parameters
    ----------
    points_mm : (n, 3) array, mm
    count : int
        Number of spheres.
    sigma_mm, common_mm, seed
        As for ``fit_form``.

    Returns
    -------
    list of Form, each with the distances of all points. The region of each is the ball of 1.1
    radii around its centre.

    Raises
    ------
    InputError where fewer spheres are found.
    """
    points = unmasked(points_mm, "points").astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"fit: expected points (n, 3), got shape {points.shape}")
    if sigma_mm is not None and np.shape(sigma_mm) != (len(points),):
        raise InputError(f"sigma_mm: expected ({len(points)},), got {np.shape(sigma_mm)}")
    if not whole(count, 1, MOST_SPHERES):
        raise InputError(f"count: expected 1 to {MOST_SPHERES}, got {count}")
    remaining = np.ones(len(points), bool)
    forms = []
    for k in range(count):
        if remaining.sum() < MIN_POINTS:
            raise InputError(f"fit: expected {count} spheres, found {k}")
        sigma = None if sigma_mm is None else sigma_mm[remaining]
        form = fit_form(points[remaining], "sphere", sigma_mm=sigma, common_mm=common_mm, seed=seed)
        used = np.zeros(len(points), bool)
        used[remaining] = form.used
        centre = np.asarray(form.parameters["centre_mm"])
        radius = float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        distance = np.linalg.norm(points - centre, axis=1) - radius
        region = distance <= (SPHERE_REGION - 1.0) * radius
        forms.append(
            replace(form, distance_mm=distance, used=used, region=region, far=region & ~used)
        )
        remaining &= ~(used | region)
    return forms


def report(form: Form, *, diameter_mm: float | None = None) -> dict[str, Any]:
    """Return the numerical results of a fit in the terms of VDI/VDE 2634 part 2, ready for JSON.

    Parameters
    ----------
    form : Form
    diameter_mm : float > 0, optional
        Calibrated diameter of the sphere or cylinder, mm, for the probing error of size.

    Returns
    -------
    dict, lengths in mm. ``probing_error_form_PF_mm``: range of the radial distances.
    ``probing_error_size_PS_mm``: measured minus calibrated diameter. ``flatness_error_F_mm``: range
    of the distances from the plane. Ranges are over all points of the region but
    ``discarded_share``, at most 0.3 %. ``far_share``: points that lie more than six robust standard
    deviations off the body that the others lie on; they count.

    Raises
    ------
    InputError for a diameter of a plane, or one that is not above 0.

    Notes
    -----
    The guideline asks for many positions of calibrated artefacts. This is one position.
    """
    n = int(form.region.sum())
    kept = max(int(np.ceil((1.0 - DISCARDED) * n)), 1)
    content: dict[str, Any] = {
        "fit": form.body,
        "points": n,
        "discarded_share": (n - kept) / n,
        "far_share": float(form.far.sum()) / n,
        **form.parameters,
        "standard_deviation_mm": form.deviation_mm,
        "range_mm": form.spread_mm(),
        "range_95_mm": form.spread_mm(0.95),
    }
    if form.body == "plane":
        if diameter_mm is not None:
            raise InputError(
                f"diameter_mm: expected none for a plane, got {diameter_mm}; only spheres and "
                "cylinders have one"
            )
        content["flatness_error_F_mm"] = content["range_mm"]
        return content
    content["radius_sigma_mm"] = form.sigma_mm
    content["probing_error_form_PF_mm"] = content["range_mm"]
    if diameter_mm is not None:
        if not 0 < diameter_mm < np.inf:
            raise InputError(f"diameter_mm: expected > 0 mm, got {diameter_mm}")
        measured = 2.0 * float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        content["probing_error_size_PS_mm"] = measured - diameter_mm
    return content
