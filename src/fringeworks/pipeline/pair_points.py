"""Pair + rig → points."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fringeworks.files.archives import read_coordinates
from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.pair.object_coordinates import at_reference, object_coordinates
from fringeworks.pair.order_range import (
    moved_into_range,
    orders_in_range,
    projector_period,
    shadows_without_step,
)
from fringeworks.pair.plane_evidence import PLANE_SIGMA_MM, PlaneEvidence, plane_evidence
from fringeworks.pair.prepared import PreparedPair, prepare
from fringeworks.pair.registry import MethodOption
from fringeworks.pair.rim import of_pixels
from fringeworks.pipeline.inputs import pair_of
from fringeworks.pipeline.pairs import Asked, Reconstruction, Zero, reconstructed
from fringeworks.pipeline.plane_findings import (
    common_order_finding,
    order_findings,
    plane_findings,
)
from fringeworks.pipeline.stacks import Measurement
from fringeworks.rig.depth_range import DepthRange, depth_range_of
from fringeworks.rig.plane_coordinates import surface_coordinates
from fringeworks.rig.point_findings import point_findings
from fringeworks.rig.stated_plane import StatedPlane
from fringeworks.rig.triangulate import Triangulator
from fringeworks.signal.denoise import Denoiser
from fringeworks.signal.filters import smooth
from fringeworks.signal.response import Response
from fringeworks.types import (
    CameraNoise,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    InputError,
    Pair,
    PointCloud,
    Rig,
    finite,
    found_before,
    made_by,
    positive,
    sealed,
)


def measure_pair(
    pair: Pair | StrPath,
    rig: Rig | Triangulator | StrPath,
    *,
    reference: Decoded | CoordinateMap | StrPath | None = None,
    plane: Sequence[float] | None = None,
    plane_sigma_mm: float | None = None,
    period_px: float | None = None,
    bright_px: float | None = None,
    depth_mm: DepthRange | Sequence[float] | None = None,
    method: str = "windowed",
    response: Response | None = None,
    denoise: Denoiser | None = None,
    zero: Zero = "rim",
    **options: MethodOption,
) -> Measurement:
    """Measure the points of a pair of frames with a calibrated rig.

    Parameters
    ----------
    pair : Pair or path
        Reference and object frame, or the object frame alone before its plane; or a capture to
        read. A geometry is not used.
    rig : Rig, Triangulator or path
    reference : Decoded, CoordinateMap or path, optional
        Projector coordinates of the plane that the reference frame shows, decoded once.
    plane : (a, b, c, d), optional
        Instead: where the plane is, a x + b y + c z = d in camera coordinates, mm. The fringes of
        the reference frame correct it as far as they tell.
    plane_sigma_mm : float ≥ 0, optional
        Standard deviation of that plane, mm: of its distance in the middle of the frame, and of the
        edges of the frame by tilts and bows; 1 mm by default, as by a ruler. What the fringes do
        not tell of the plane is a part of σ that all points share.
    period_px, bright_px : float, optional
        Period of the fringes in the projector and the coordinate of one bright fringe, px. With the
        period, the fringes tell the plane's tilts; with both, its distance too.
    depth_mm : (near, far) or DepthRange, optional
        Smallest and largest z of what is lit, mm. Orders that lead out of it are corrected, or the
        pixel is NaN.
    method : str
        A name from ``fringeworks.methods()``.
    response, denoise, zero, **options
        As for ``reconstruct``.

    Returns
    -------
    Measurement: points with σ, lens distortion and calibration included, and the projector
    coordinates that they come from.

    Raises
    ------
    InputError for neither or both of ``reference`` and ``plane``, coordinates of another axis or
    shape, and as ``reconstruct``.

    Notes
    -----
    The displacement tells which point of the plane gets the same light, and the plane's projector
    coordinate there is that of the object (``object_coordinates``). Orders of fringes are those of
    the plane, which the frame's rim has to show.
    """
    pair = pair_of(pair)
    if not isinstance(rig, Triangulator):
        rig = Triangulator(rig if isinstance(rig, Rig) else read_rig(rig))
    given = _given(reference, plane, pair)
    depth = depth_range_of(depth_mm, rig.rig)
    pattern = _Pattern(plane_sigma_mm, period_px, bright_px, stated=plane is not None)
    started = time.perf_counter()
    chosen: dict[str, Any] = {"response": response, "denoise": denoise, "zero": zero, **options}
    asked = Asked(None, response, denoise, zero, shadows=depth is None)
    found = reconstructed(replace(pair, geometry=None), method, asked, options)
    with found_before(found.findings):
        moved, zero_px = of_pixels(found.displacement)
        found = replace(found, displacement=moved)
        scene = _Scene(pair, prepare(pair, response=response), found, rig.rig)
        known = _reference(given, plane, scene, pattern)
        decoded, checked, zero_px = _ordered(scene, known, pattern, depth, zero_px)
        colour = sealed(np.asarray(pair.object, np.float64))
        points = rig.triangulate(decoded, axis=known.map.axis, colour=colour)
    common_px, told = _common(known, decoded, scene, points, zero_px)
    points, decoded = _with_common(points, decoded, common_px)
    seconds = time.perf_counter() - started
    origin = made_by(
        "measure",
        options={
            "method": method,
            "plane": None if plane is None else [float(v) for v in plane],
            "plane_sigma_mm": plane_sigma_mm,
            "period_px": period_px,
            "bright_px": bright_px,
            "depth_mm": None if depth is None else list(depth.depth_mm),
            **chosen,
        },
        inputs=found.surface.provenance.inputs if found.surface.provenance else (),
        rig=rig.rig,
    )
    told = (*points.findings, *told, *checked)
    told = (*told, *point_findings(points, rig.rig, rig.rig.projector.height_px))
    points = replace(points, provenance=origin, findings=told)
    return Measurement(points, replace(decoded, provenance=origin), seconds)


@dataclass(frozen=True)
class _Pattern:
    """What is known of the stated plane's accuracy, and of the pattern."""

    sigma_mm: float | None
    period_px: float | None
    bright_px: float | None
    stated: bool
    """Whether a plane was stated."""

    def __post_init__(self) -> None:
        if self.sigma_mm is not None and not (0.0 <= self.sigma_mm < np.inf and self.stated):
            raise InputError(
                f"plane_sigma_mm: expected >= 0 mm together with a plane, got {self.sigma_mm}"
            )
        if self.period_px is not None and not positive(self.period_px):
            raise InputError(f"period_px: expected > 0 px, got {self.period_px}")
        if self.bright_px is not None and not (
            finite(self.bright_px) and self.stated and self.period_px is not None
        ):
            raise InputError(
                "bright_px: expected a coordinate in px together with period_px and a plane, got "
                f"{self.bright_px}"
            )


class _Scene(NamedTuple):
    """A pair, and what was measured in its frames."""

    pair: Pair
    prepared: PreparedPair
    found: Reconstruction
    rig: Rig


class _Known(NamedTuple):
    """Coordinates of the reference plane; for a stated one, what the fringes tell of it."""

    map: CoordinateMap
    stated: StatedPlane | None = None
    evidence: PlaneEvidence | None = None


def _decoded(scene: _Scene, known: _Known) -> Decoded:
    """Projector coordinates of the object, without what a stated plane adds to their σ."""
    moved, pair = scene.found.displacement, scene.pair
    frame = np.nan_to_num(np.asarray(pair.object, np.float64))
    base = frame if pair.reference is None else np.nan_to_num(pair.reference)
    plane = known.map
    if known.stated is not None:
        plane = replace(plane, sigma_px=sealed(0.0 * plane.sigma_px))
    coordinates = object_coordinates(
        moved,
        plane,
        modulation=float(np.sqrt(2.0) * base.std()),
        level=smooth(frame, (moved.period_px, moved.period_px)),
    )
    return Decoded(
        x=coordinates if plane.axis == "x" else None,
        y=coordinates if plane.axis == "y" else None,
        noise=CameraNoise(float(moved.details.get("noise_counts", 0.0))),
        findings=scene.found.warnings,
    )


def _only(decoded: Decoded) -> CoordinateMap:
    """The map of the one axis."""
    return next(iter(decoded.maps.values()))


def _with_map(decoded: Decoded, found: CoordinateMap) -> Decoded:
    """The coordinates with another map of their axis."""
    return replace(decoded, x=found) if found.axis == "x" else replace(decoded, y=found)


def _ordered(
    scene: _Scene, known: _Known, pattern: _Pattern, depth: DepthRange | None, zero_px: float
) -> tuple[Decoded, tuple[Finding, ...], float]:
    """The object's coordinates with the orders that a depth range allows, the findings, and the
    part of σ by whole periods of the zero that stay unknown, px."""
    decoded = _decoded(scene, known)
    period = pattern.period_px or projector_period(scene.prepared, known.map)
    checked = None
    told: tuple[Finding, ...] = ()
    if depth is not None:
        if period is None:
            raise InputError("depth_mm: expected clear fringes in the reference, or period_px")
        if zero_px > 0.0:
            found, order, spread = moved_into_range(_only(decoded), depth, period)
            decoded = _with_map(decoded, found)
            if spread is not None:
                zero_px = spread * scene.found.displacement.period_px
                decoded, told = common_order_finding(decoded, order, spread)
        found = _only(decoded)
        sigma = np.hypot(found.sigma_px, _carried(scene, known.map))
        corrected, checked = orders_in_range(replace(found, sigma_px=sigma), depth, period)
        lost = np.where(np.isfinite(corrected.sigma_px), found.sigma_px, np.nan)
        corrected = replace(corrected, sigma_px=sealed(lost))
        decoded = _with_map(decoded, corrected)
    shadows = shadows_without_step(scene.prepared, scene.found.displacement)
    told = (*told, *order_findings(scene.rig, known.map, period, shadows, checked))
    return decoded, told, zero_px


def _carried(scene: _Scene, plane: CoordinateMap) -> FloatMap:
    """σ of the plane's coordinates where the object's light meets it, (h, w), px."""
    return np.maximum(*at_reference(scene.found.displacement, plane.sigma_px)[0])


def _common(
    known: _Known, decoded: Decoded, scene: _Scene, points: PointCloud, zero_px: float
) -> tuple[FloatMap | None, tuple[Finding, ...]]:
    """The part of the coordinates' σ that all share, (h, w), px, by a stated plane and by whole
    periods of the zero; None without either. And the findings about the plane."""
    told: tuple[Finding, ...] = ()
    common: FloatMap = np.zeros(_only(decoded).sigma_px.shape)
    if known.stated is not None and known.evidence is not None:
        common = _carried(scene, known.map)
        with np.errstate(all="ignore"):
            common_mm = np.asarray(points.noise_mm / _only(decoded).sigma_px * common)
        told = plane_findings(known.stated, known.evidence, common_mm, points)
    if zero_px > 0.0:
        (first, second), _ = at_reference(scene.found.displacement, known.map.coordinate_px)
        common = np.hypot(common, zero_px * np.abs(second - first))
    elif known.stated is None:
        return None, told
    return common, told


def _with_common(
    points: PointCloud, decoded: Decoded, common_px: FloatMap | None
) -> tuple[PointCloud, Decoded]:
    """Points and coordinates with that part in their σ, but not in the points' noise."""
    if common_px is None:
        return points, decoded
    found = _only(decoded)
    with np.errstate(all="ignore"):
        common_mm = np.asarray(points.noise_mm / found.sigma_px * common_px)
    sigma = np.hypot(points.sigma_mm, common_mm).astype(np.float32)
    wide = np.hypot(found.sigma_px, common_px)
    decoded = _with_map(decoded, replace(found, sigma_px=sealed(wide)))
    return replace(points, sigma_mm=sealed(sigma)), decoded


def _given(
    reference: Decoded | CoordinateMap | StrPath | None,
    plane: Sequence[float] | None,
    pair: Pair,
) -> Decoded | CoordinateMap | None:
    """The coordinates of the reference plane, checked before anything is computed."""
    if (reference is None) == (plane is None):
        got = "none" if plane is None else "both"
        raise InputError(f"expected coordinates of the reference plane or a plane, got {got}")
    if reference is None or isinstance(reference, Decoded | CoordinateMap):
        given = reference
    else:
        given = read_coordinates(reference)
    maps = tuple(given.maps.values()) if isinstance(given, Decoded) else (given,)
    for known in maps:
        if known is not None and known.coordinate_px.shape != pair.object.shape:
            raise InputError(
                f"reference coordinates: expected shape {pair.object.shape} of the frames, "
                f"got {known.coordinate_px.shape}"
            )
    return given


def _reference(
    given: Decoded | CoordinateMap | None,
    plane: Sequence[float] | None,
    scene: _Scene,
    pattern: _Pattern,
) -> _Known:
    """The plane's coordinates along the projector's axis that the fringes change along."""
    axis = scene.found.displacement.axis
    if given is None:
        assert plane is not None
        stated = StatedPlane.of(scene.rig, plane, axis)
        sigma = PLANE_SIGMA_MM if pattern.sigma_mm is None else pattern.sigma_mm
        evidence = plane_evidence(
            scene.prepared,
            stated,
            sigma,
            period_px=pattern.period_px,
            bright_px=pattern.bright_px,
        )
        known = surface_coordinates(stated, evidence.modes_mm, evidence.covariance)
        return _Known(known, stated, evidence)
    decoded = given.maps.get(axis) if isinstance(given, Decoded) else given
    if decoded is None or decoded.axis != axis:
        raise InputError(
            f"reference coordinates: expected those along {axis}, as the fringes, got others"
        )
    return _Known(decoded)
