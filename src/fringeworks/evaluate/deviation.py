"""A measured part against its model: signed distances with their standard deviation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.evaluate.measured_part import MeasuredPart, measured_part, named_model, named_part
from fringeworks.evaluate.other_models import other_models
from fringeworks.files.atomic import StrPath
from fringeworks.files.formats import main_part
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.merging import MergedPart
from fringeworks.pipeline.stacks import Measurement
from fringeworks.rig.pinhole import transform
from fringeworks.surface.closest import MeshDistance, Nearest
from fringeworks.types import (
    AlignBy,
    Alignment,
    BestFit,
    BoolMap,
    ByteMap,
    DatumPlanes,
    DatumPoints,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    KnownPose,
    NominalFace,
    Noted,
    Plotted,
    PointCloud,
    Points,
    Provenance,
    Reason,
    Rig,
    TriangleMesh,
    as_notes,
    found_before,
    made_by,
    sealed,
)
from fringeworks.types.nominal import face_named
from fringeworks.types.numbers import number, percent
from fringeworks.views.alignment import (
    REACH_SHARE,
    align_by_fit,
    align_planes,
    align_points,
    patches,
)
from fringeworks.views.model_target import ModelTarget

CHUNK = 50_000
"""Number of points whose errors are computed together; with 24 parameters they take 30 MB."""
EDGE_SPACINGS = 1.5
"""Distance from a sharp edge, in distances of neighbouring points, up to which a point is a mixture
of the two sides of the edge. On the virtual rig, errors exceed σ up to this distance."""
EDGE_SIGMA_SPACINGS = 0.25
"""Standard deviation of such mixtures, in distances of neighbouring points: a quarter of a pixel.
Measured on the virtual rig: 0.09 mm beside the edge and 0.05 mm farther on, at 0.31 mm per
pixel."""
FITTED_EDGE_SPACINGS = 2.0
"""Distance from a sharp edge up to which points are not fitted to the model."""
MOST_BESIDE = 0.5
"""Share of points beside sharp edges above which the edges are those of a rough mesh, not of the
part."""
DATUM_POINTS = 30
"""Smallest number of points of a datum plane: ten for each of the directions that it may hold."""
MOST_CHORD = 0.1
"""Largest distance of a free-form face from its triangles, in σ of the distances: its square then
adds 1 % to the variance."""
PERCENTILES = (1.0, 5.0, 50.0, 95.0, 99.0)
"""Percentiles of the distances that are stated."""


@dataclass(frozen=True, eq=False, repr=False)
class Deviation(Noted, Plotted, Frozen):
    """Distances of a measured part from its model.

    Maps have the shape of the part: (h, w) for a cloud of a camera, (n,) for other points.
    """

    distance_mm: FloatMap
    """Signed distance of every point from the model, positive outside, mm; NaN without one."""
    sigma_mm: FloatMap
    """Standard deviation of the distance: noise, calibration and alignment, mm; NaN where the
    points have none."""
    noise_mm: FloatMap
    """The part of σ that is independent from point to point, mm."""
    reason: ByteMap
    """``Reason`` of every point; ``OUTSIDE`` for points that lie beyond the reach of the model."""
    points_mm: FloatMap
    """(…, 3), the points in the model's coordinates, mm."""
    normals: FloatMap
    """(…, 3), directions out of the model at the nearest points, in the model's coordinates."""
    alignment: Alignment
    """Pose of the part in the model's coordinates."""
    part: PointCloud | Points
    """What was measured, in its own coordinates."""
    model: TriangleMesh
    """The model."""
    mean_sigma_mm: float | None
    """Standard deviation of the mean distance, mm; None where the points have no σ."""
    findings: tuple[Finding, ...] = ()
    """What was found about the alignment, the points and the model, and what to do about it."""
    provenance: Provenance | None = None
    """How it was made."""
    tolerance_mm: float | None = None
    """Largest distance that is allowed on either side, mm; None where nothing is judged."""
    face: NDArray[np.int32] | None = None
    """Number of the drawing's face nearest to every point, from 1; 0 for points without one and
    for those beside its sharp edges, which mix two faces. None where the model has no faces."""
    only: tuple[str, ...] = ()
    """Names of the faces whose points have distances; empty for all of the model."""

    @property
    def measured(self) -> FloatMap:
        """The distances that are known, (n,), mm."""
        return np.asarray(self.distance_mm[self.reason == Reason.OK], np.float64)

    def figures(self, tolerance_mm: float | None = None) -> dict[str, Any]:
        """Return the numerical results.

        Parameters
        ----------
        tolerance_mm : float > 0, optional
            Largest distance that is allowed on either side, mm; by default the deviation's own.

        Returns
        -------
        dict of JSON values, lengths in mm: ``points``, ``mean_mm`` with ``mean_sigma_mm``,
        ``rms_mm``, percentiles, extremes, ``within_1_sigma`` and ``within_2_sigma``; with a
        tolerance also ``outside_share``, and ``surely_outside_share`` of points that are outside by
        more than 2 σ; ``faces``, a row for each face of a drawing that has points; ``only``, the
        names of the faces that were asked for.

        Raises
        ------
        InputError for a tolerance that is not above 0.
        """
        tolerance_mm = self.tolerance_mm if tolerance_mm is None else tolerance_mm
        found = self.measured
        sigma = np.asarray(self.sigma_mm[self.reason == Reason.OK], np.float64)
        known = bool(np.isfinite(sigma).all())
        size = np.abs(found)
        figures: dict[str, Any] = {
            "points": int(found.size),
            "share_of_points": float(found.size / max(self._possible, 1)),
            "mean_mm": float(found.mean()),
            "mean_sigma_mm": self.mean_sigma_mm,
            "rms_mm": float(np.sqrt(np.mean(found**2))),
            "median_sigma_mm": float(np.median(sigma)) if known else None,
            "smallest_mm": float(found.min()),
            "largest_mm": float(found.max()),
            "percentiles_mm": dict(
                zip(
                    (f"{p:g}" for p in PERCENTILES),
                    map(float, np.percentile(found, PERCENTILES)),
                    strict=True,
                )
            ),
            "within_1_sigma": float(np.mean(size <= sigma)) if known else None,
            "within_2_sigma": float(np.mean(size <= 2.0 * sigma)) if known else None,
        }
        if tolerance_mm is not None:
            if not 0 < tolerance_mm < np.inf:
                raise InputError(f"tolerance_mm: expected > 0 mm, got {tolerance_mm}")
            figures["tolerance_mm"] = tolerance_mm
            figures["outside_share"] = float(np.mean(size > tolerance_mm))
            sure = float(np.mean(size - 2.0 * sigma > tolerance_mm)) if known else None
            figures["surely_outside_share"] = sure
        if self.face is not None:
            figures["faces"] = self._by_face(self.face)
        if self.only:
            figures["only"] = list(self.only)
        return figures

    def _by_face(self, face: NDArray[np.int32]) -> list[dict[str, Any]]:
        """Figures of every face of the drawing with points, without those beside sharp edges."""
        rows = []
        ok = self.reason == Reason.OK
        for one in self.model.nominal:
            found = np.asarray(self.distance_mm[ok & (face == one.number)], np.float64)
            if found.size:
                rows.append(
                    {
                        "number": one.number,
                        "name": one.name,
                        "kind": one.kind,
                        "points": int(found.size),
                        "mean_mm": float(found.mean()),
                        "rms_mm": float(np.sqrt(np.mean(found**2))),
                        "smallest_mm": float(found.min()),
                        "largest_mm": float(found.max()),
                    }
                )
        return rows

    @property
    def _possible(self) -> int:
        """Points that were measured, on the faces or not, near the model or not."""
        return int(np.count_nonzero(np.isfinite(self.points_mm[..., 0])))


def deviation(
    part: PointCloud | Points | TriangleMesh | Measurement | MergedPart | StrPath,
    model: TriangleMesh | StrPath,
    *,
    align: AlignBy | None = None,
    rig: Rig | StrPath | None = None,
    reach_mm: float | None = None,
    tolerance_mm: float | None = None,
    faces: Sequence[str | int] = (),
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Deviation:
    """Measure how far a part lies from its model.

    Parameters
    ----------
    part : PointCloud, Points, TriangleMesh, Measurement, MergedPart or path
        What was measured; a path of a cloud (``.npz``) or of points (``.ply``, ``.xyz``). Filled
        vertices of a mesh were not measured and are left out.
    model : TriangleMesh or path
        The drawing, closed and in mm; a path of ``.stl``, ``.ply``, ``.obj``, ``.off``, ``.step``
        or ``.iges``.
    align : BestFit, DatumPoints, DatumPlanes or KnownPose
        How the part is brought to the model; by default a best fit whose start is searched for.
    rig : Rig or path, optional
        The rig that measured a cloud. Its covariance tells which errors of the calibration the
        alignment absorbs; without it, the errors of all points count in full.
    reach_mm : float > 0, optional
        Points farther from the model do not belong to it, mm; by default 5 % of its size.
    tolerance_mm : float > 0, optional
        Largest distance that is allowed on either side, mm: pictures and reports show it.
    faces : sequence of str or int
        Names or numbers of faces of a drawing. All points are aligned, but only points of these
        faces have distances; the others have the reason ``MASKED``. By default, all points count.
    seed : int
        Seed of the choice of points.
    progress : callable
        Called with what is done next.

    Returns
    -------
    Deviation

    Raises
    ------
    InputError for points that do not suit the way of alignment, points that cannot be aligned,
    faces that the model lacks, and where no point is within reach of the model or on the faces;
    FileProblem for files that cannot be read.

    Notes
    -----
    The distance d of a point is that to the nearest point of the model, with the sign of the side.
    σ² is the sum of four parts: the noise of the point along the model's normal n; the noise of
    the alignment, J C Jᵀ with J = (p × n, n); the errors of the calibration E after the alignment
    has followed them, |n·E + J ξ(E)|²; and, beside sharp edges of the model, the error of pixels
    that mix the two sides. A best fit absorbs most of E, so that σ is then much smaller than that
    of the points.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> corners = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0.0]])
    >>> plate = fw.TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> points = fw.surface.Points(np.array([[2.0, 3, 0.25], [5, 6, -0.5]]), None)
    >>> found = fw.deviation(points, plate, align=fw.evaluate.KnownPose(np.eye(4)), reach_mm=1.0)
    >>> found.distance_mm.tolist()
    [0.25, -0.5]
    """
    align = BestFit() if align is None else align
    known = rig if isinstance(rig, Rig) or rig is None else read_rig(rig)
    surface, source = named_part(main_part(part))
    drawn, drawn_source = named_model(model)
    wanted = _wanted(drawn, faces)
    mesh = MeshDistance(drawn)
    reach = REACH_SHARE * mesh.size_mm if reach_mm is None else float(reach_mm)
    if not 0 < reach < np.inf:
        raise InputError(f"reach_mm: expected > 0 mm, got {reach_mm}")
    if tolerance_mm is not None and not 0 < tolerance_mm < np.inf:
        raise InputError(f"tolerance_mm: expected > 0 mm, got {tolerance_mm}")
    with found_before((*surface.findings, *drawn.findings)):
        seen = measured_part(surface, known)
        progress("alignment …")
        alignment = _checked_alignment(seen, drawn, mesh, align, seed)
        progress("distances …")
        placed = transform(alignment.T_model_part, seen.xyz_mm)
        near = mesh.nearest(placed, reach)
        if not (near.face >= 0).any():
            raise InputError(
                f"model: expected points within {number(reach)} mm of it, got none; align the "
                "part, or check the unit of the model",
                findings=alignment.findings,
            )
    extrapolates = not (isinstance(align, BestFit) and align.within is None)
    edge = _edge_sigma(seen, mesh, near)
    number_of = None if mesh.face_index is None else np.where(edge > 0, 0, mesh.face_of(near))
    near, left_out = _kept(near, number_of, wanted, alignment)
    uncertain = _uncertainty(seen, alignment, placed, near, edge, extrapolates=extrapolates)
    only = tuple(face.title for face in wanted)
    options = {"align": align, "reach_mm": reach_mm, "tolerance_mm": tolerance_mm, "seed": seed}
    asked = options | ({"faces": only} if only else {})
    origin = made_by("deviation", options=asked, inputs=(source, drawn_source), rig=known)
    found = _assembled(seen, drawn, alignment, placed, near, uncertain, origin)
    reason = _masked(found.reason, seen.index[left_out])
    face = None if number_of is None else _spread_faces(seen, number_of)
    return replace(found, tolerance_mm=tolerance_mm, face=face, reason=reason, only=only)


def _wanted(model: TriangleMesh, faces: Sequence[str | int]) -> tuple[NominalFace, ...]:
    """The faces that are named, each once."""
    if isinstance(faces, str):
        raise InputError(f"faces: expected a sequence of names, got the text {faces!r}")
    found = {face.number: face for face in (face_named(model.nominal, one) for one in faces)}
    return tuple(found.values())


def _kept(
    near: Nearest,
    number_of: NDArray[np.int32] | None,
    wanted: tuple[NominalFace, ...],
    alignment: Alignment,
) -> tuple[Nearest, BoolMap]:
    """The nearest points without those of other faces, and which points these are."""
    if not wanted or number_of is None:
        return near, np.zeros(len(near.face), bool)
    left_out = (near.face >= 0) & ~np.isin(number_of, [face.number for face in wanted])
    face = np.where(left_out, -1, near.face)
    if not (face >= 0).any():
        names = ", ".join(face.title for face in wanted)
        raise InputError(
            f"faces: expected points on {names} away from sharp edges, got none; all measured "
            "points lie elsewhere on the part",
            findings=alignment.findings,
        )
    gone = left_out[:, None]
    return Nearest(
        np.where(left_out, np.nan, near.distance_mm),
        np.where(gone, np.nan, near.point_mm),
        np.where(gone, np.nan, near.direction),
        face,
    ), left_out


def _masked(reason: ByteMap, left_out: NDArray[np.intp]) -> ByteMap:
    """The reasons, with those points masked that belong to other faces."""
    found = reason.copy()
    found.ravel()[left_out] = Reason.MASKED
    return sealed(found)


def _spread_faces(seen: MeasuredPart, number_of: NDArray[np.int32]) -> NDArray[np.int32]:
    """Numbers of the faces of all points, in the shape of the part."""
    full = np.zeros(seen.reason.size, np.int32)
    full[seen.index] = number_of
    return full.reshape(seen.reason.shape)


def _checked_alignment(
    seen: MeasuredPart, model: TriangleMesh, mesh: MeshDistance, align: AlignBy, seed: int
) -> Alignment:
    """The alignment; where another model would fit far better, this is said."""
    try:
        found = aligned(seen, mesh, align, seed=seed)
    except InputError as problem:
        others = other_models(seen, model, None, seed=seed) if _searched(align) else ()
        if others:
            raise InputError(f"model: {others[0].text}", findings=others) from problem
        raise
    if not _searched(align):
        return found
    return replace(found, findings=(*other_models(seen, model, found, seed=seed), *found.findings))


def _searched(align: AlignBy) -> bool:
    """Whether the pose is searched for by the whole shape."""
    return isinstance(align, BestFit) and align.within is None


def aligned(seen: MeasuredPart, mesh: MeshDistance, align: AlignBy, *, seed: int = 0) -> Alignment:
    """Bring a part to its model; see ``deviation``."""
    if isinstance(align, KnownPose):
        none = np.zeros((6, 6))
        return Alignment(
            "known pose", align.T_model_part, none, none, np.eye(6), 0, 1.0, 0.0, converged=True
        )
    if isinstance(align, DatumPoints):
        return align_points(align, seen.errors_at(align.part_mm), seen.common_at(align.part_mm))
    if isinstance(align, DatumPlanes):
        parts = [seen.within(where, least=DATUM_POINTS).plain() for where in align.where]
        found = mesh.nearest(align.model_mm, REACH_SHARE * mesh.size_mm)
        if (found.face < 0).any():
            raise InputError(
                "datum planes: expected points on the model, got one that lies "
                f"{percent(REACH_SHARE)} of its size or more from it"
            )
        return align_planes(parts, found.point_mm, mesh.normals[found.face])
    start = align.start
    if isinstance(start, DatumPoints):
        start = align_points(start, None, None).T_model_part
    fitted = seen if align.within is None else seen.within(align.within)
    part = fitted.turned(seed)
    target = ModelTarget(mesh, FITTED_EDGE_SPACINGS * seen.spacing_mm)
    return align_by_fit(part, target, start, one_view=seen.one_view, seed=seed)


def _edge_sigma(seen: MeasuredPart, mesh: MeshDistance, near: Nearest) -> FloatMap:
    """σ that mixtures beside sharp edges add, (n,), mm; 0 elsewhere."""
    found = np.zeros(len(near.face))
    has = np.flatnonzero(near.face >= 0)
    spacing = seen.spacing_mm
    if not spacing > 0:
        return found
    beside = mesh.beside_edges(near.point_mm[has], EDGE_SPACINGS * spacing)
    if beside.mean() <= MOST_BESIDE:
        found[has[beside]] = EDGE_SIGMA_SPACINGS * spacing
    return found


def _uncertainty(
    seen: MeasuredPart,
    alignment: Alignment,
    placed: FloatMap,
    near: Nearest,
    edge: FloatMap,
    *,
    extrapolates: bool,
) -> tuple[FloatMap, FloatMap, float | None]:
    """σ and noise of every distance, and σ of their mean."""
    has = np.flatnonzero(near.face >= 0)
    sigma, noise = (np.full(len(placed), np.nan) for _ in range(2))
    if seen.sigma_mm is None or seen.noise_mm is None:
        return sigma, noise, None
    turn = alignment.T_model_part[:3, :3]
    errors = alignment.response is not None or alignment.by == "known pose"
    total, rows_total = 0.0, np.zeros(6)
    patch = patches(seen.xyz_mm)
    sums = np.zeros(patch.max() + 1)
    for k in range(0, len(has), CHUNK):
        at = has[k : k + CHUNK]
        n = near.direction[at]
        rows = np.column_stack((np.cross(placed[at], n), n))
        along = seen.along(at, n @ turn)
        noise[at] = along * seen.noise_mm[at]
        by_pose = _forms(rows, alignment.noise)
        moved = seen.errors_at(seen.xyz_mm[at]) if errors else None
        if moved is not None:
            parts = np.einsum("nc,nck->nk", n @ turn, moved)
            if alignment.response is not None:
                parts = parts + rows @ alignment.response
            calibration = np.sum(parts**2, axis=1)
            total = total + parts.sum(axis=0)
        else:
            shared = along * np.sqrt(np.maximum(seen.sigma_mm[at] ** 2 - seen.noise_mm[at] ** 2, 0))
            calibration = shared**2
            if extrapolates:
                calibration += _forms(rows, alignment.common)
            sums += np.bincount(patch[at], shared, len(sums))
        rows_total += rows.sum(axis=0)
        sigma[at] = np.sqrt(noise[at] ** 2 + by_pose + calibration + edge[at] ** 2)
    variance = np.sum(noise[has] ** 2) + rows_total @ alignment.noise @ rows_total
    variance += np.sum(np.square(total)) + np.sum(sums**2)
    return sigma, noise, float(np.sqrt(variance)) / len(has)


def _coarse(model: TriangleMesh, sigma: FloatMap) -> tuple[Finding, ...]:
    """What is said where the triangles of free-form faces are too coarse for σ."""
    free = any(face.kind == "free-form" for face in model.nominal)
    known = sigma[np.isfinite(sigma)]
    chord = model.chord_mm
    if not free or chord is None or not known.size or chord <= MOST_CHORD * np.median(known):
        return ()
    far, median = number(chord, unit="mm"), number(float(np.median(known)), unit="mm")
    seen = (
        f"the triangles of the free-form faces lie up to {far} from them, more than a tenth of the "
        f"median σ of {median}: read the model with a smaller chord_mm"
    )
    return (Finding("model", seen),)


def _forms(rows: FloatMap, matrix: FloatMap) -> FloatMap:
    """r M rᵀ of each row r, (n,)."""
    return np.asarray(np.einsum("ni,ni->n", rows @ matrix, rows))


def _assembled(
    seen: MeasuredPart,
    model: TriangleMesh,
    alignment: Alignment,
    placed: FloatMap,
    near: Nearest,
    uncertainty: tuple[FloatMap, FloatMap, float | None],
    origin: Provenance,
) -> Deviation:
    sigma, noise, mean = uncertainty

    def spread(values: FloatMap) -> FloatMap:
        full = np.full((seen.reason.size, *values.shape[1:]), np.nan, np.float32)
        full[seen.index] = values
        return sealed(full.reshape(*seen.reason.shape, *values.shape[1:]))

    reason = seen.reason.ravel().copy()
    reason[seen.index[near.face < 0]] = Reason.OUTSIDE
    findings = [*alignment.findings, *seen.surface.findings, *model.findings]
    findings += _coarse(model, sigma)
    if seen.rig is None and seen.sigma_mm is not None and isinstance(seen.surface, PointCloud):
        why = "no rig was given" if origin.rig_sha256 is None else "the rig has no covariance"
        no_rig = (
            f"{why}: errors of the calibration count in full, although the alignment "
            "takes up a part of them"
        )
        findings += as_notes([no_rig], "standard deviation")
    if seen.sigma_mm is None:
        no_sigma = "the points have no σ, so that the distances have none"
        findings += as_notes([no_sigma], "standard deviation")
    return Deviation(
        spread(near.distance_mm),
        spread(sigma),
        spread(noise),
        sealed(reason.reshape(seen.reason.shape)),
        spread(placed),
        spread(near.direction),
        alignment,
        seen.surface,
        model,
        mean,
        tuple(dict.fromkeys(findings)),
        origin,
    )
