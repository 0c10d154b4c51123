"""Views brought together by their shape alone: the poses that no view contradicts."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from fringeworks.rig.pinhole import inverse
from fringeworks.types import Finding, FloatMap, InputError
from fringeworks.views.features import (
    MOST_POSES,
    Described,
    candidates,
    described,
    fewest_slides,
    refined,
)
from fringeworks.views.model_target import REFINED_POINTS, rough_poses
from fringeworks.views.poses import ViewPose, distinct, folded_deg, turn_deg, twist
from fringeworks.views.registration import SAMPLES, Registration
from fringeworks.views.sight import beyond_chance, contradictions
from fringeworks.views.surface_points import SurfacePoints, together

MOST_AGAINST = 0.05
"""Share of a view's points that may contradict another view in a pose that is compared further: a
part that looks alike after a rotation differs in small places only."""
MOST_TOGETHER = 24
"""Largest number of combinations of poses that are followed from view to view."""
MIN_FITS = 0.5
"""Share of the pairs of neighbours that must fit after the same step. The others share too little
of the part; their poses follow from the step."""
STEP_OFF_DEG = 5.0
"""Largest difference of a rotation from the stated step of the table, degrees: tables that are
turned by hand stand within 2°."""


@dataclass(frozen=True)
class Together:
    """Poses of views by their shape."""

    poses: list[FloatMap]
    """T_first_view of each view, (4, 4), mm."""
    others: list[list[FloatMap]]
    """Other poses of each view that fit equally well."""


def align_by_shape(views: Sequence[SurfacePoints], *, step_deg: float | None = None) -> Together:
    """Find the poses of views from their shape, without poses to start from.

    Parameters
    ----------
    views : sequence of SurfacePoints
        In camera coordinates; neighbours overlap.
    step_deg : float, optional
        Angle between neighbouring views, degrees; chooses among poses that fit.

    Returns
    -------
    Together

    Raises
    ------
    InputError where two neighbours cannot be aligned, or are not turned by the step.

    Notes
    -----
    Neighbours may fit in several poses, as views of a hexagonal part do. All combinations are
    followed from view to view, and every view is compared with all before it: the combination with
    the fewest contradictions (``contradictions``) is taken.
    """
    known = [described(view) for view in views]
    found = _pairs(known)
    chi = max(1.0, float(np.median([min(f.chi for f in pair) for pair in found])))
    search = _Search(known, found, chi)
    chains = search.equal_steps(step_deg)
    if step_deg is None:
        # A table turns by equal steps; other combinations are followed where none of these fits.
        free = [] if chains and not search.total(chains[0]) else search.chains()
        several = sorted((*chains, *free), key=search.total)
        least = search.total(several[0])
        chains = [c for c in chains if not beyond_chance(search.total(c), least)] or free
    others = [
        distinct([c[k] for c in chains], d.middle_mm, d.other_pose, MOST_TOGETHER)[1:]
        for k, d in enumerate(known)
    ]
    return Together(chains[0], others)


def ambiguous(found: Together) -> tuple[Finding, ...]:
    """Name the views that fit in several poses."""
    several = [k for k, others in enumerate(found.others, 1) if others]
    if not several:
        return ()
    turns = {
        round(turn_deg(other @ inverse(T)))
        for T, others in zip(found.poses, found.others, strict=True)
        for other in others
    }
    most = 1 + max(map(len, found.others))
    return (
        Finding(
            "views",
            f"{len(several)} of {len(found.poses)} views fit the others in up to {most} poses "
            f"equally well, {', '.join(f'{t}°' for t in sorted(turns))} apart; one was taken, and "
            "the poses' σ contains the others. The points' σ holds for a part that is symmetric",
            ("a part that looks alike after a rotation", "views that overlap too little"),
            "give the angle between two views (step_deg), use a board, or stick marks of relief "
            "on the part",
            figures={"views": float(len(several)), "poses": float(most)},
        ),
    )


def with_others(pose: ViewPose, T: FloatMap, others: Sequence[FloatMap]) -> ViewPose:
    """A pose whose covariance contains other poses that are equally likely."""
    if not others:
        return pose
    off = np.stack([twist(other @ inverse(T)) for other in others])
    return replace(pose, noise=pose.noise + off.T @ off / (1 + len(others)))


def _pairs(known: Sequence[Described]) -> list[list[Registration]]:
    """Poses of each view but the first in the one before it, those that fit best first."""
    found = []
    for k in range(1, len(known)):
        try:
            found.append(_neighbour(known[k], known[k - 1]))
        except InputError as error:
            raise error.at(f"views {k} and {k + 1}") from error
    turns = _turns(known, found)
    if len(turns) > 1:
        for k, pair in enumerate(found, 1):
            to_first, one = _chain(found[:k]), pair[0].T_target_source
            starts = [one @ inverse(to_first) @ S @ to_first for S in turns]
            found[k - 1] = _plausible(known[k], known[k - 1], starts)
    return found


def _neighbour(source: Described, target: Described) -> list[Registration]:
    """Poses of a view in the one before it, by features; where these find none that fits, by
    rotations all around."""
    found: list[Registration] = []
    with suppress(InputError):
        found = _plausible(source, target, candidates(source, target))
    if found and _between(source, target, found[0]) <= _most_against(source, target):
        return found
    model = target.nodes.xyz_mm, target.nodes.normals
    rng = np.random.default_rng(0)
    starts = rough_poses(
        source.view, model, source.size_mm, one_view=True, most=MOST_POSES, rng=rng
    )
    known = [f.T_target_source for f in found]
    return _plausible(source, target, [*known, *starts])


def _most_against(source: Described, target: Described) -> float:
    return MOST_AGAINST * min(len(d.view.xyz_mm) for d in (source, target))


def _plausible(
    source: Described, target: Described, starts: Sequence[FloatMap]
) -> list[Registration]:
    """Poses from several starts that contradict each other in small places at most."""
    rough = refined(source, target.view, starts, REFINED_POINTS)
    least = _most_against(source, target)
    count = [_between(source, target, f) for f in rough]
    good = [f.T_target_source for f, n in zip(rough, count, strict=True) if n <= least]
    if rough and not good:
        good = [rough[int(np.argmin(count))].T_target_source]
    found = refined(source, target.view, good, SAMPLES)
    if not found:
        slides = fewest_slides(source, target.view, starts)
        if slides:
            raise InputError(
                f"the shape slides on itself in {slides} of 6 directions, so that it does not tell "
                "the pose; use a board, or a turntable with a known axis"
            )
        raise InputError(
            "expected a pose in which the views overlap, found none; take more views, or use a "
            "board"
        )
    return found


def _between(source: Described, target: Described, f: Registration) -> int:
    return contradictions(source.sight, target.sight, f.T_target_source, max(f.chi, 1.0))


def _chain(found: Sequence[Sequence[Registration]]) -> FloatMap:
    """Pose of the last view in the first one by the first poses of all pairs."""
    return reduce(np.matmul, [pair[0].T_target_source for pair in found], np.eye(4))


def _turns(known: Sequence[Described], found: Sequence[Sequence[Registration]]) -> list[FloatMap]:
    """Transforms that map the part nearly to itself, in the first view's coordinates; the identity
    first. The first view is searched in all views together, from rotations all around."""
    first = known[0]
    to_first = [_chain(found[:k]) for k in range(len(known))]
    parts = [d.nodes.moved(T) for d, T in zip(known, to_first, strict=True)]
    nodes = together(parts)
    model = nodes.xyz_mm, nodes.normals
    rng = np.random.default_rng(0)
    starts = rough_poses(first.view, model, first.size_mm, one_view=True, most=MOST_POSES, rng=rng)
    whole = together([d.view.moved(T) for d, T in zip(known, to_first, strict=True)])
    several: list[FloatMap] = [np.eye(4)]
    for f in refined(first, whole, starts, REFINED_POINTS):
        several += [f.T_target_source, inverse(f.T_target_source)]
    several += [a @ b for a in several[1:] for b in several[1:]]
    several = distinct(several, first.middle_mm, first.other_pose, MOST_POSES**2)
    least = MOST_AGAINST * len(first.view.xyz_mm)
    one = first.sight
    return [T for T in several if contradictions(one, one, T, most=least) <= least]


class _Search:
    """Combinations of the poses of pairs, and how many places contradict them."""

    def __init__(
        self, known: Sequence[Described], found: Sequence[Sequence[Registration]], chi: float
    ) -> None:
        self._known, self._found, self._chi = known, found, chi
        self._counts: dict[tuple[int, int, bytes], int] = {}

    def _against(self, i: int, j: int, T: FloatMap) -> int:
        """Contradictions of views i and j, for T_i_j; equal poses are compared once."""
        turn, way = self._known[j].other_pose
        place = T[:3, :3] @ self._known[j].middle_mm + T[:3, 3]
        cell = np.append(np.degrees(twist(T)[:3]) / turn, place / way)
        key = i, j, np.rint(cell).astype(np.int64).tobytes()
        if key not in self._counts:
            one, other = self._known[j].sight, self._known[i].sight
            self._counts[key] = contradictions(one, other, T, self._chi)
        return self._counts[key]

    def _added(self, poses: Sequence[FloatMap], T: FloatMap) -> int:
        """Contradictions of the next view in a pose with those before it."""
        k = len(poses)
        return sum(self._against(i, k, inverse(one) @ T) for i, one in enumerate(poses))

    def total(self, poses: Sequence[FloatMap]) -> int:
        """Contradictions of all views with each other."""
        return sum(self._added(poses[:k], poses[k]) for k in range(1, len(poses)))

    def equal_steps(self, step_deg: float | None) -> list[list[FloatMap]]:
        """Poses by equal steps about one axis, of the stated angle where there is one; those with
        the fewest contradictions, and those that fit as well."""
        chains: list[list[FloatMap]] = []
        for first in self._found[0]:
            turn = twist(first.T_target_source)[:3]
            if step_deg is not None and _off_step(turn, step_deg) > STEP_OFF_DEG:
                continue
            chain: list[FloatMap] = [np.eye(4)]
            fits = 0
            for pair in self._found:
                off = [np.linalg.norm(twist(f.T_target_source)[:3] - turn) for f in pair]
                near = np.degrees(min(off)) <= STEP_OFF_DEG
                fits += near
                step = pair[int(np.argmin(off))] if near else first
                chain.append(chain[-1] @ step.T_target_source)
            if fits >= MIN_FITS * len(self._found):
                chains.append(chain)
        if step_deg is not None and not chains:
            turns = sorted({round(turn_deg(f.T_target_source)) for f in self._found[0]})
            raise InputError(
                f"views: expected turns by the step of {step_deg:g}° about one axis, but the shape "
                f"of views 1 and 2 fits after {' or '.join(f'{t}°' for t in turns)}; check the "
                "step and the order of the views, or leave the step out"
            )
        chains.sort(key=self.total)
        return [c for c in chains if not beyond_chance(self.total(c), self.total(chains[0]))]

    def chains(self) -> list[list[FloatMap]]:
        """Poses by any steps, with the fewest contradictions, and those that fit as well."""
        chains: list[tuple[int, float, list[FloatMap]]] = [(0, 0.0, [np.eye(4)])]
        for pair in self._found:
            longer = []
            for cost, gain, poses in chains:
                for f in pair:
                    T = poses[-1] @ f.T_target_source
                    longer.append((cost + self._added(poses, T), gain - f.overlap, [*poses, T]))
            longer.sort(key=lambda item: item[:2])
            chains = [c for c in longer if not beyond_chance(c[0], longer[0][0])][:MOST_TOGETHER]
        return [poses for _, _, poses in chains]


def _off_step(turn: FloatMap, step_deg: float) -> float:
    """Difference of a rotation vector's angle from a step, degrees."""
    return abs(float(np.degrees(np.linalg.norm(turn))) - folded_deg(step_deg))
