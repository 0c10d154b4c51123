"""Whether a table turns as stated: its angles against boards and shapes that views show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from fringeworks.rig.pinhole import inverse
from fringeworks.types import Finding, FloatMap, InputError
from fringeworks.views.by_shape import MOST_AGAINST, STEP_OFF_DEG
from fringeworks.views.poses import (
    MIN_AXIS_POSES,
    ViewPose,
    carried,
    folded_deg,
    turn_deg,
    turntable_axis,
    twist,
)
from fringeworks.views.registration import Registration
from fringeworks.views.sight import Sight, contradictions
from fringeworks.views.surface_points import SurfacePoints

SURE_SIGMAS = 3.0
"""Difference of the table from boards or shapes, in standard deviations, that is named."""


def refuse_other_turn(boards: Mapping[int, ViewPose], step_deg: float) -> None:
    """Refuse a table whose boards turn otherwise than by the step, from two views on.

    Raises
    ------
    InputError with the angle that the boards show.
    """
    for (i, one), (j, other) in pairwise(boards.items()):
        seen = turn_deg(inverse(one.T_part_camera) @ other.T_part_camera)
        stated = folded_deg((j - i) * step_deg)
        if abs(seen - stated) > STEP_OFF_DEG:
            raise InputError(
                f"views {i + 1} and {j + 1}: expected the table to turn by {stated:g}°, but the "
                f"board turned by {seen:.1f}°; check the step, that the table turns, and that the "
                "board turns with it"
            )


def step_of_boards(
    boards: Mapping[int, ViewPose], step_deg: float
) -> tuple[float, tuple[Finding, ...]]:
    """The table's step, corrected by what the boards show, and a finding where it differs.

    Parameters
    ----------
    boards : ViewPose by view
    step_deg : float
        As stated, degrees.

    Returns
    -------
    Step, degrees, and findings. The step is the slope of the boards' angles over the views, where
    it differs from the stated one by 3 σ of their scatter and of the boards' poses; else the stated
    one.
    """
    if len(boards) < MIN_AXIS_POSES:
        return step_deg, ()
    backs = [inverse(p.T_part_camera) for p in boards.values()]
    number = np.array(list(boards), np.float64)
    axis = turntable_axis(backs, [k * step_deg for k in boards])
    # Angles beyond those that are stated, so that none is wrapped.
    off = np.array([_turn(T @ inverse(backs[0]), axis.direction) for T in backs])
    off = (off - np.radians((number - number[0]) * step_deg) + np.pi) % (2.0 * np.pi) - np.pi
    known = np.array(
        [
            np.sqrt(axis.direction @ T[:3, :3] @ p.noise[:3, :3] @ T[:3, :3].T @ axis.direction)
            for T, p in zip(backs, boards.values(), strict=True)
        ]
    )
    centred = number - number.mean()
    slope = float(centred @ off / (centred @ centred))
    left = off - off.mean() - slope * centred
    scatter = float(np.sqrt(left @ left / (len(off) - 2)))
    sigma = max(scatter, float(np.sqrt(np.mean(known**2)))) / float(np.linalg.norm(centred))
    if abs(slope) <= SURE_SIGMAS * sigma:
        return step_deg, ()
    found, sure = step_deg + float(np.degrees(slope)), float(np.degrees(sigma))
    seen = (
        f"the boards turn by {found:.3f}° ± {sure:.3f}° from view to view, not by {step_deg:g}° as "
        "stated; their angle was used"
    )
    figures = {"step_deg": found, "step_sigma_deg": sure, "stated_deg": step_deg}
    causes = ("a step that was stated wrongly", "a table that slips")
    return found, (Finding("turntable", seen, causes, "check the table's step", figures=figures),)


def _turn(T: FloatMap, direction: FloatMap) -> float:
    return float(twist(T)[:3] @ direction)


def refuse_other_shape(
    points: Sequence[SurfacePoints], known: Mapping[int, ViewPose], *, registered: bool
) -> None:
    """Refuse a table by whose angle the first two views contradict each other, where they fit
    without a turn or could not be ``registered``.

    Raises
    ------
    InputError, which says whether the views fit without a turn.
    """
    one, other = Sight(points[0]), Sight(points[1])
    T = inverse(known[0].T_part_camera) @ known[1].T_part_camera
    least = MOST_AGAINST * min(len(p.xyz_mm) for p in points[:2])
    if contradictions(other, one, T) <= least:
        return
    still = contradictions(other, one, np.eye(4)) <= least
    if registered and not still:
        return
    seen = "they fit where the table does not turn" if still else "one sees through the other"
    raise InputError(
        f"views 1 and 2: expected views that fit by the table's angle, but {seen}; check the step, "
        "the axis, and that the table turns with the part"
    )


def shape_findings(
    pairs: Mapping[tuple[int, int], Registration], known: Mapping[int, ViewPose]
) -> tuple[Finding, ...]:
    """Name a table that differs from what the shape of neighbouring views shows."""
    squares, directions, turns = 0.0, 0, []
    for (i, j), pair in pairs.items():
        if pair.slides:
            continue
        stated = inverse(known[i].T_part_camera) @ known[j].T_part_camera
        off = twist(pair.T_target_source @ inverse(stated))
        to_i = inverse(known[i].T_part_camera)
        covariance = pair.noise + pair.common
        covariance = covariance + sum(carried(to_i, known[k].covariance) for k in (i, j))
        squares += float(off @ np.linalg.solve(covariance, off))
        directions += 6
        turns.append(np.degrees(np.linalg.norm(off[:3])))
    if not directions or squares <= SURE_SIGMAS**2 * directions:
        return ()
    times = float(np.sqrt(squares / directions))
    seen = (
        "the shape of neighbouring views differs from the table's poses by "
        f"{np.median(turns):.2g}°, {times:.1f} times its standard deviation"
    )
    return (
        Finding(
            "turntable",
            seen,
            ("a step or an axis that is stated wrongly", "a part that moved on the table"),
            "check the step and the axis, or let a board give the poses",
            figures={"sigmas": times, "turn_deg": float(np.median(turns))},
        ),
    )
