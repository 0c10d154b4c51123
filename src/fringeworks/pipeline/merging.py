"""Views of one part → the part: poses, the loop they close, fused points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from fringeworks.files.atomic import StrPath
from fringeworks.files.formats import main_part
from fringeworks.files.points import read_cloud
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.stacks import Measurement
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.pinhole import inverse, transform
from fringeworks.surface.camera_blur import remove_blur
from fringeworks.types import (
    BoardNotFound,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    Noted,
    PointCloud,
    Points,
    Provenance,
    Rig,
    Source,
    fingerprint,
    found_before,
    made_by,
    need_camera_frame,
    numbered,
)
from fringeworks.types.packages import need_opencv
from fringeworks.views.board_views import board_pose
from fringeworks.views.by_shape import Together, align_by_shape, ambiguous, with_others
from fringeworks.views.fusion import Fused, fuse_points
from fringeworks.views.pose_graph import Closure, closure, solve_poses
from fringeworks.views.poses import (
    TurntableAxis,
    ViewPose,
    mean_pose,
    turned_pose,
    turntable_axis,
)
from fringeworks.views.registration import Registration, register
from fringeworks.views.surface_points import SurfacePoints, surface_points
from fringeworks.views.table_turns import (
    refuse_other_shape,
    refuse_other_turn,
    shape_findings,
    step_of_boards,
)

PosesFrom = Literal["board", "turntable", "shape"]
ABOVE_MM = 1.0
"""Points less than this above the board are left out, mm: they are of the board and its table."""
REACH_SIGMAS = 5.0
"""How far matched points may be apart at the start, in standard deviations of the known poses."""
LEAST_REACH_MM = 0.5
"""Lower bound on that distance, mm."""
MAX_CLOSURE_SIGMAS = 3.0
"""Closure error, in standard deviations, from which on it is a finding."""
MAX_DISAGREEMENT = 2.0
"""Scatter of views about the fused points, over what σ says, from which on it is a finding."""


@dataclass(frozen=True, eq=False, repr=False)
class MergedPart(Noted, Frozen):
    """A part from several views."""

    poses: tuple[ViewPose, ...]
    """Of every view. The part's coordinates are those of the board in the first view, or the first
    view's camera coordinates without a board."""
    closure: Closure | None
    """What is left when the pairs of neighbouring views are put together; None where they do not
    close a loop."""
    fused: Fused
    """The points of all views, with how many views saw each."""
    pairs: dict[tuple[int, int], Registration]
    """Neighbouring views by their shape, by (target, source)."""
    blur_px: float | None = None
    """Standard deviation of the camera's blur that was removed from the views, px; None where it
    was that of the rig, or none was removed here."""
    findings: tuple[Finding, ...] = ()
    """What is likely wrong, and what to do about it."""
    provenance: Provenance | None = None
    """How it was made."""

    @property
    def points(self) -> Points:
        """The fused points, with σ, noise, normals and brightness."""
        return self.fused.points


def merge(
    views: Sequence[PointCloud | Measurement | StrPath],
    *,
    poses: PosesFrom = "board",
    board: Board | str | None = None,
    step_deg: float | None = None,
    axis: TurntableAxis | None = None,
    rig: Rig | StrPath | None = None,
    blur_px: float | None = None,
    voxel_mm: float | None = None,
    above_mm: float = ABOVE_MM,
    progress: Callable[[str], None] = lambda _: None,
) -> MergedPart:
    """Merge point clouds of one part, each from another side.

    Parameters
    ----------
    views : sequence of PointCloud, Measurement or path
        Two or more, in the order in which they were taken; ``.npz`` files of ``write_points``.
    poses : "board", "turntable" or "shape"
        Where the poses come from: a board that turns with the part and is seen in every view; the
        angle of a turntable; or the overlap of neighbouring views alone. In all three cases
        neighbouring views are then fitted to each other by their shape.
    board : Board or str, optional
        For "board", and for "turntable" where ``axis`` is not given. Points of the board are left
        out.
    step_deg : float, optional
        For "turntable": angle between two views, degrees, by the right-hand rule about the axis.
        For "shape" it chooses among the poses of a part that looks alike after a rotation.
    axis : TurntableAxis, optional
        For "turntable", in camera coordinates; by default from the board in the views that show it.
    rig : Rig or path, optional
        The one that the views were measured with. The error of the camera's blur is then removed
        (``remove_blur``) from views that still have it.
    blur_px : float, optional
        Standard deviation of that blur, px; by default that of the rig, or from the board's corners
        in the first view.
    voxel_mm : float > 0, optional
        Side of the voxels in which points are fused; by default the distance of neighbours.
    above_mm : float
        Points less than this above the board are left out, mm.
    progress : callable
        Called with what is done next.

    Returns
    -------
    MergedPart

    Raises
    ------
    InputError for fewer than two views, options that do not belong together, a board that is not
    found, views that do not overlap, and shapes that do not determine a pose, such as a sphere,
    where nothing else does.

    Notes
    -----
    Poses minimise the errors of known poses and of pairs, weighted by their covariances
    (``solve_poses``). Points are fused by their σ (``fuse_points``).
    """
    if board is not None:
        need_opencv("a board among the views")
    parts = map(main_part, views)
    clouds = [v if isinstance(v, PointCloud) else read_cloud(v) for v in parts]
    board = parse_board(board) if isinstance(board, str) else board
    for cloud in clouds:
        need_camera_frame(cloud, "merging")
    _check(len(clouds), poses, board, step_deg, axis)
    progress("poses …")
    with found_before(numbered("view", clouds)):
        sharp, blur_px = _without_blur(clouds, rig, blur_px, board)
        known, table = _known(sharp, poses, board, step_deg, axis)
        points = [surface_points(cloud) for cloud in sharp]
        if board is not None and known:
            points = [_above(v, known[k], above_mm) for k, v in enumerate(points)]
        by_shape = None
        if not known:
            progress("alignment by shape …")
            by_shape = align_by_shape(points, step_deg=step_deg)
        solved, pairs, loop = _solved(points, known, by_shape, progress)
        if poses == "turntable":
            refuse_other_shape(points, known, registered=(0, 1) in pairs)
        progress("fusion …")
        fused = fuse_points(points, solved, voxel_mm=voxel_mm or _spacing(points))
    origin = made_by(
        "merge",
        options={"poses": poses, "board": board, "step_deg": step_deg, "axis": axis}
        | {"voxel_mm": voxel_mm, "above_mm": above_mm, "blur_px": blur_px},
        inputs=tuple(
            Source("view" if isinstance(v, PointCloud) else str(v), fingerprint(c))
            for v, c in zip(views, clouds, strict=True)
        ),
    )
    found = table + _findings(loop, fused, pairs)
    if poses == "turntable":
        found += shape_findings(pairs, known)
    if by_shape is not None:
        found += ambiguous(by_shape)
        solved = tuple(map(with_others, solved, by_shape.poses, by_shape.others))
    return MergedPart(solved, loop, fused, pairs, blur_px, found, origin)


def _solved(
    points: Sequence[SurfacePoints],
    known: dict[int, ViewPose],
    by_shape: Together | None,
    progress: Callable[[str], None],
) -> tuple[tuple[ViewPose, ...], dict[tuple[int, int], Registration], Closure | None]:
    """The poses of all views, the pairs of neighbours that they come from, and the loop's error."""
    starts = {k: p.T_part_camera for k, p in known.items()}
    if by_shape is not None:
        starts = dict(enumerate(by_shape.poses))
    progress("pairs of views …")
    pairs = _pairs(points, starts, known)
    middle = np.mean(points[0].xyz_mm, axis=0)
    solved = solve_poses(
        len(points),
        pairs,
        known,
        [starts[k] for k in range(len(points))],
        middle_mm=transform(starts[0], middle),
    )
    return tuple(solved), pairs, closure(pairs, len(points), middle)


def _check(
    count: int,
    poses: PosesFrom,
    board: Board | None,
    step_deg: float | None,
    axis: TurntableAxis | None,
) -> None:
    if count < 2:
        raise InputError(f"views: expected 2 or more, got {count}")
    if poses not in ("board", "turntable", "shape"):
        raise InputError(f"poses: expected board, turntable or shape, got {poses!r}")
    if poses == "board" and board is None:
        raise InputError("board: expected the board that turns with the part, got none")
    if poses == "turntable" and (step_deg is None or (axis is None and board is None)):
        raise InputError(
            "turntable: expected the angle between two views, and its axis or a board to find it by"
        )
    if poses == "shape" and (board is not None or axis is not None):
        raise InputError("shape: board and axis cannot be combined with poses by shape alone")


def _without_blur(
    clouds: Sequence[PointCloud],
    rig: Rig | StrPath | None,
    blur_px: float | None,
    board: Board | None,
) -> tuple[list[PointCloud], float | None]:
    """The views without the error of blur, where the rig is known, and that blur where it was not
    the rig's."""
    if rig is None:
        if blur_px is not None:
            raise InputError("blur_px: expected the rig of the views to remove the blur with")
        return list(clouds), None
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    if blur_px is None and rig.blur is None and board is not None:
        blur_px = board_pose(clouds[0], board).blur_px
    if blur_px is None and rig.blur is None:
        raise InputError(
            "rig: it has no blur of the camera; blur_px (merge --blur-px) states it, or a board "
            "with squares measures it"
        )
    sharp = [
        c if c.blur_mm is not None else remove_blur(c, rig, blur_px, removed_px=_removed(c))
        for c in clouds
    ]
    return sharp, blur_px


def _removed(cloud: PointCloud) -> float:
    """Blur whose shift at edges of brightness was removed when a view was decoded, px."""
    options = {} if cloud.provenance is None else cloud.provenance.options
    return float(options.get("removed_blur_px", 0.0))


def _known(
    clouds: Sequence[PointCloud],
    poses: PosesFrom,
    board: Board | None,
    step_deg: float | None,
    axis: TurntableAxis | None,
) -> tuple[dict[int, ViewPose], tuple[Finding, ...]]:
    """Poses that a board or a turntable gives, by view, and what was found about the table."""
    shown: dict[int, ViewPose] = {}
    table: tuple[Finding, ...] = ()
    for k, cloud in enumerate(clouds if board is not None else ()):
        assert board is not None
        try:
            shown[k] = board_pose(cloud, board).pose
        except BoardNotFound as error:
            if poses == "board":
                raise error.at(f"view {k + 1}") from error
            continue
        if poses == "turntable" and step_deg is not None:
            refuse_other_turn(shown, step_deg)
    if poses != "turntable" or step_deg is None:
        return shown, table
    if shown:
        step_deg, table = step_of_boards(shown, step_deg)
    if axis is None:
        backs = [inverse(p.T_part_camera) for p in shown.values()]
        axis = turntable_axis(backs, [k * step_deg for k in shown])
    to_part: FloatMap = np.eye(4)
    if shown:
        turns = {k: turned_pose(axis, k * step_deg).T_part_camera for k in shown}
        to_part = mean_pose([p.T_part_camera @ inverse(turns[k]) for k, p in shown.items()])
    turned = {k: turned_pose(axis, k * step_deg).carried(to_part) for k in range(len(clouds))}
    return turned, table


def _above(points: SurfacePoints, pose: ViewPose, above_mm: float) -> SurfacePoints:
    """The points that stand above the board, whose z axis points into it."""
    height = -transform(pose.T_part_camera, points.xyz_mm)[:, 2]
    kept = points.at(height > above_mm)
    if not len(kept.xyz_mm):
        raise InputError(
            f"view: expected points more than {above_mm:g} mm above the board, got none"
        )
    return kept


def _pairs(
    points: Sequence[SurfacePoints], starts: dict[int, FloatMap], known: dict[int, ViewPose]
) -> dict[tuple[int, int], Registration]:
    """Neighbouring views fitted to each other; without a pair where known poses do not need it."""
    n = len(points)
    steps = [(k, (k + 1) % n) for k in range(n if n > 2 else 1)]
    found = {}
    for i, j in steps:
        start = inverse(starts[i]) @ starts[j]
        try:
            found[i, j] = register(points[j], points[i], start, reach_mm=_reach(known, i, j))
        except InputError as error:
            if not known and j != 0:
                raise error.at(f"views {i + 1} and {j + 1}") from error
    sliding = [pair for pair in found if found[pair].slides]
    # The other pairs of a closed loop determine a single one.
    if known or not sliding or (len(sliding) == 1 and n > 2 and len(found) == n):
        return found
    if n > 2 and sliding == [steps[-1]]:
        return {pair: one for pair, one in found.items() if pair != steps[-1]}
    i, j = sliding[0]
    raise InputError(
        f"views {i + 1} and {j + 1}: the shape slides on itself in {found[i, j].slides} of 6 "
        "directions, as a plane, sphere or cylinder does, or a part of which they share one face; "
        "use a board or a turntable"
    )


def _reach(known: dict[int, ViewPose], i: int, j: int) -> float:
    """How far apart matched points may be at the start, mm."""
    if not known:
        return 2.0
    place = [np.sqrt(np.trace(known[k].covariance[3:, 3:])) for k in (i, j)]
    return max(LEAST_REACH_MM, REACH_SIGMAS * float(np.hypot(*place)))


def _spacing(points: Sequence[SurfacePoints]) -> float:
    """Typical distance of neighbouring points of a view, mm: a pixel on the surface."""
    some = points[0].xyz_mm
    near = scipy.spatial.cKDTree(some).query(some[:: max(1, len(some) // 2000)], k=2)[0]
    return float(np.median(near[:, 1]))


def _findings(
    loop: Closure | None, fused: Fused, pairs: dict[tuple[int, int], Registration]
) -> tuple[Finding, ...]:
    found = []
    if loop is not None and loop.sigmas > MAX_CLOSURE_SIGMAS:
        found.append(
            Finding(
                "views",
                f"the loop of views misses itself by {loop.translation_mm:.3g} mm and "
                f"{loop.rotation_deg:.2g}°, {loop.sigmas:.1f} times its standard deviation",
                ("a part that moved on the table", "a view aligned wrongly"),
                "look at the views with the largest disagreement",
                figures={"closure_sigmas": loop.sigmas, "closure_mm": loop.translation_mm},
            )
        )
    if fused.disagreement > MAX_DISAGREEMENT:
        found.append(
            Finding(
                "views",
                f"views differ where they overlap by {fused.disagreement:.1f} times their σ",
                ("a part that moved on the table", "a rig that has changed since its calibration"),
                "clamp the part, or calibrate again",
                figures={"disagreement": fused.disagreement},
            )
        )
    sliding = [pair for pair in pairs.values() if pair.slides]
    if sliding:
        found.append(
            Finding(
                "views",
                f"the shape slides on itself in {len(sliding)} of {len(pairs)} pairs of views, so "
                "their poses come from the board or the turntable in those directions",
                figures={"sliding_pairs": float(len(sliding))},
                severity="note",
            )
        )
    return tuple(found)
