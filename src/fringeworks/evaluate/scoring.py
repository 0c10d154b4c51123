"""Scores: the errors of anyone's results on a named scene, in one table for all methods."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from fringeworks.evaluate.scored_scenes import BenchmarkScene, benchmark_scene
from fringeworks.pair.reference_plane import displacement_from_height
from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.types import (
    NUMBERS,
    BoolMap,
    CoordinateMap,
    Decoded,
    DisplacementMap,
    FloatMap,
    HeightMap,
    InputError,
    Pair,
    PointCloud,
    Reason,
    Rig,
)

Quantity = Literal["coordinate", "phase", "depth", "displacement", "height"]
"""What a map holds. A phase is 2π times the coordinate, or the displacement, over the period."""
UNITS: dict[str, str] = {
    "coordinate": "px",
    "phase": "rad",
    "depth": "mm",
    "displacement": "px",
    "height": "mm",
}
"""Units of the quantities."""
MILLION = 1e6
"""Wrong orders are stated per million of measured pixels."""
TAIL = 95.0
"""Percentile of the absolute errors that is stated: two standard deviations of normal errors."""


@dataclass(frozen=True)
class Score:
    """Errors of one result on one scene, over the pixels that have a value."""

    scene: str
    quantity: str
    unit: str
    measured: float
    """Share of the measurable pixels that have a value, 0…1."""
    unfounded: float
    """Share of the pixels without light that have a value, 0…1; NaN where all have light."""
    mean: float
    """Mean error, with its sign."""
    mean_abs: float
    rms: float
    """Root mean square error, wrong orders included."""
    rms_right_order: float
    """Root mean square error of the pixels on the right fringe."""
    p95: float
    """95th percentile of the absolute errors."""
    wrong_orders_ppm: float
    """Measured pixels whose coordinate is off by more than half a period, per million; NaN where
    the scene has no fringes."""
    within_1_sigma: float | None = None
    """Share of errors no larger than the stated σ; 0.683 where σ is right. None without σ."""
    within_2_sigma: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """The figures by name."""
        return asdict(self)


Scored = (
    Measurement
    | Reconstruction
    | PointCloud
    | Decoded
    | CoordinateMap
    | HeightMap
    | DisplacementMap
    | FloatMap
)
"""What can be scored: a result of this package, or a map (h, w) of another program."""


def score(
    result: Scored,
    scene: str | BenchmarkScene,
    *,
    quantity: Quantity | None = None,
    sigma: FloatMap | None = None,
) -> Score:
    """Score a result on a named scene of the benchmark.

    Parameters
    ----------
    result : result of this package, or (h, w) array
        NaN where nothing was measured. Depths of 0 or less count as not measured, because other
        programs mark such pixels by 0.
    scene : str or BenchmarkScene
        From ``benchmark_scenes``.
    quantity : str, optional
        What an array holds: "coordinate" (projector column, px, the middle of the first column is
        0), "phase" (absolute phase of the finest fringes, 2π times the coordinate or displacement
        over the period, rad), "depth" (z in camera coordinates, mm), "displacement" (px) or
        "height" (mm). Results of this package know it.
    sigma : (h, w) array, optional
        Standard deviation of an array's values, in their unit.

    Returns
    -------
    Score

    Raises
    ------
    InputError for an unknown scene, a quantity that the scene does not have, wrong shapes, and a
    result without a single value.

    Notes
    -----
    The fringe order of a depth is judged by the projector column that a point of that depth on
    the pixel's ray would have.

    Examples
    --------
    >>> import fringeworks as fw
    >>> scene = fw.evaluate.benchmark_scene("pair-smooth")
    >>> found = fw.evaluate.score(fw.reconstruct(scene.capture), scene)
    >>> found.unit, found.measured > 0.99, found.wrong_orders_ppm
    ('mm', True, 0.0)
    """
    known = benchmark_scene(scene) if isinstance(scene, str) else scene
    values, spread, what = _map_of(result, quantity, sigma)
    truth = _true_values(known, what)
    if values.shape != truth.shape:
        raise InputError(f"result: expected shape {truth.shape}, got {values.shape}")
    if spread is not None and spread.shape != truth.shape:
        raise InputError(f"sigma: expected shape {truth.shape}, got {spread.shape}")
    there = np.isfinite(values) if what != "depth" else np.isfinite(values) & (values > 0.0)
    judged = there & known.measurable & np.isfinite(truth)
    if not judged.any():
        raise InputError(f"result: expected values where {known.name} has light, got none")
    wrong = _wrong_order(known, what, values, truth)
    return errors_of(values, truth, judged, wrong, spread).named(known.name, what, there, known)


@dataclass(frozen=True)
class _Figures:
    """The figures of a score that need no scene."""

    mean: float
    mean_abs: float
    rms: float
    rms_right_order: float
    p95: float
    wrong_orders_ppm: float
    within_1_sigma: float | None
    within_2_sigma: float | None

    def named(self, name: str, what: str, there: BoolMap, scene: BenchmarkScene) -> Score:
        """The score of a scene."""
        dark = ~scene.measurable
        return Score(
            scene=name,
            quantity=what,
            unit=UNITS[what],
            measured=float(np.mean(there[scene.measurable])),
            unfounded=float(np.mean(there[dark])) if dark.any() else float("nan"),
            **asdict(self),
        )


def errors_of(
    values: FloatMap,
    truth: FloatMap,
    judged: BoolMap,
    wrong: BoolMap | None,
    sigma: FloatMap | None,
) -> _Figures:
    """Condense the errors of the judged pixels; ``wrong`` marks those on a wrong fringe."""
    e = (values - truth)[judged]
    right = e if wrong is None else e[~wrong[judged]]
    within: list[float | None] = [None, None]
    if sigma is not None:
        with np.errstate(all="ignore"):
            ratio = np.abs(e) / sigma[judged]
        within = [float(np.mean(ratio <= k)) for k in (1.0, 2.0)]
    return _Figures(
        mean=float(e.mean()),
        mean_abs=float(np.abs(e).mean()),
        rms=float(np.sqrt(np.mean(e**2))),
        rms_right_order=float(np.sqrt(np.mean(right**2))) if right.size else float("nan"),
        p95=float(np.percentile(np.abs(e), TAIL)),
        wrong_orders_ppm=float("nan") if wrong is None else MILLION * float(wrong[judged].mean()),
        within_1_sigma=within[0],
        within_2_sigma=within[1],
    )


def _map_of(
    result: Scored, quantity: Quantity | None, sigma: FloatMap | None
) -> tuple[FloatMap, FloatMap | None, Quantity]:
    """Values, σ and quantity of a result."""
    found = _known_map(result)
    if found is not None:
        values, spread, what = found
        if quantity is not None and quantity != what:
            raise InputError(f"quantity: expected {what} for this result, got {quantity!r}")
        if sigma is not None:
            raise InputError("sigma: the result has its own; expected none")
        return np.asarray(values, np.float64), np.asarray(spread, np.float64), what
    array = np.asarray(result)
    if array.ndim != 2 or array.dtype.kind not in NUMBERS:
        got = type(result).__name__ if array.dtype == object else f"{array.dtype} {array.shape}"
        raise InputError(f"result: expected a value for every pixel, a map (h, w), got {got}")
    if quantity not in UNITS:
        raise InputError(f"quantity: expected one of {', '.join(UNITS)}, got {quantity!r}")
    given = None if sigma is None else np.asarray(sigma)
    if given is not None and given.dtype.kind not in NUMBERS:
        raise InputError(f"sigma: expected real numbers, got {given.dtype}")
    return array.astype(np.float64), None if given is None else given.astype(float), quantity


def _known_map(result: object) -> tuple[FloatMap, FloatMap, Quantity] | None:
    """Values, σ and quantity of a result of this package; None for others."""
    if isinstance(result, Measurement):
        result = result.points
    if isinstance(result, Reconstruction):
        result = result.surface
    if isinstance(result, Decoded):
        if result.x is None:
            raise InputError("result: expected coordinates along x, got those along y only")
        result = result.x
    if isinstance(result, PointCloud):
        cloud = result.in_camera()
        z = np.where(cloud.reason == Reason.OK, cloud.xyz_mm[..., 2], np.nan)
        with np.errstate(all="ignore"):
            # σ is along the ray; the depth is its share along z.
            share = z / np.linalg.norm(cloud.xyz_mm, axis=-1)
        return z, cloud.sigma_mm * share, "depth"
    if isinstance(result, CoordinateMap):
        return result.coordinate_px, result.sigma_px, "coordinate"
    if isinstance(result, DisplacementMap):
        return result.displacement_px, result.sigma_px, "displacement"
    if isinstance(result, HeightMap):
        return result.values, result.sigma, result.quantity
    return None


def _true_values(scene: BenchmarkScene, what: str) -> FloatMap:
    """The truth of a quantity."""
    if what == "phase":
        base = "displacement" if scene.is_pair else "coordinate"
        return np.asarray(scene.truth[base] * (2.0 * np.pi / scene.period_px))
    if what not in scene.truth:
        known = ", ".join([*scene.truth, "phase"])
        raise InputError(f"quantity: expected one of {known} for {scene.name}, got {what!r}")
    return np.asarray(scene.truth[what], np.float64)


def _wrong_order(scene: BenchmarkScene, what: str, values: FloatMap, truth: FloatMap) -> BoolMap:
    """True where the coordinate or displacement is off by more than half a period."""
    half = 0.5 * scene.period_px
    with np.errstate(all="ignore"):
        if what == "phase":
            return np.asarray(np.abs(values - truth) > np.pi)
        if what in ("coordinate", "displacement"):
            return np.asarray(np.abs(values - truth) > half)
        if what == "depth" and scene.rig is not None:
            off = columns_of_depths(values, scene.rig) - scene.truth["coordinate"]
            return np.asarray(~(np.abs(off) <= half))
        assert isinstance(scene.capture, Pair)
        assert scene.capture.geometry is not None
        geometry = scene.capture.geometry
        below = np.where(values < geometry.distance_mm, values, np.nan)
        off = displacement_from_height(below, geometry) - scene.truth["displacement"]
        return np.asarray(~(np.abs(off) <= half))


def columns_of_depths(depth_mm: FloatMap, rig: Rig) -> FloatMap:
    """Return the projector column of the point that each pixel sees at a depth, (h, w), px.

    Parameters
    ----------
    depth_mm : (h, w) array
        z in camera coordinates, mm.
    rig : Rig

    Returns
    -------
    (h, w) array; NaN where the depth is.
    """
    h, w = depth_mm.shape
    v, u = np.mgrid[:h, :w].astype(np.float64)
    points = rays(rig.camera, np.stack((u, v), axis=-1)) * depth_mm[..., None]
    return np.asarray(project(rig.projector, transform(rig.T_projector_camera, points))[..., 0])
