"""Positions of artefacts in the measuring volume: planned, and compared with what was scanned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fringeworks.rig.pinhole import project, rotation, transform
from fringeworks.types import FloatMap, Frozen, InputError, Rig
from fringeworks.types.certificate import AcceptanceTest, Artefact, BallBar, PlaneArtefact
from fringeworks.types.numbers import limit, number

LEAST_BAR_SHARE = 0.3
"""Smallest length of a ball bar, over the diagonal L₀ of the volume. VDI/VDE 2634 part 2, from
memory: check it against the guideline."""
BALL_SHARE = (0.02, 0.2)
"""Smallest and largest diameter of balls, over L₀. From memory, as above."""
LEAST_PLANE_SHARE = 0.3
"""Smallest length of a plane, over L₀. From memory, as above."""
BAR_TILTS = {
    "across, top front": ((1, 0, 0), (0, -1, -1)),
    "upright, left back": ((0, 1, 0), (-1, 0, 1)),
    "diagonal, top right": ((1, 1, 0), (1, -1, 0)),
    "other diagonal, bottom left": ((1, -1, 0), (-1, 1, 0)),
    "through the depth, bottom": ((1, 0, 1), (0, 1, 0)),
    "through the depth, right": ((0, 1, 1), (1, 0, 0)),
    "space diagonal, middle": ((1, 1, -1), (0, 0, 0)),
}
"""Seven positions of a ball bar: its direction, as shares of the sides of the volume, and where its
middle is pushed to. Seven positions are those of VDI/VDE 2634 part 2, from memory; which seven is
chosen here: along and across, and through the depth."""
PLANE_TILTS = {
    "front": ((0.0, 0.0), -1),
    "back": ((0.0, 0.0), 1),
    "tilted left": ((0.0, 25.0), 0),
    "tilted right": ((0.0, -25.0), 0),
    "tilted up": ((25.0, 0.0), 0),
    "tilted down": ((-25.0, 0.0), 0),
}
"""Six positions of a plane: its rotation about x and y, degrees, and its place in the depth. Six
positions are those of VDI/VDE 2634 part 2, from memory; which six is chosen here."""
PUSHED = 0.8
"""Share of the room to a side of the volume that a position is moved by: a hand places an artefact
to some millimetres, and it must stay inside."""
LEAST_DEPTH_DEG = 10.0
"""Smallest tilt of the positions through the volume."""
MOST_DEPTH_DEG = 45.0
"""Largest tilt of a bar out of the image plane: beyond, one ball hides the other's rim."""
NEAR_SHARE = 0.1
"""Distance of the places of an artefact from a planned position, over L₀, up to which a scan is in
it: a hand places it to 20 mm in a volume of 200 mm, and no other planned position is as near."""
SAME_SHARE = 0.05
"""Distance of two scans, over L₀, below which they show the same position."""


@dataclass(frozen=True, eq=False, repr=False)
class ArtefactPlace(Frozen):
    """An artefact somewhere in the volume, in camera coordinates."""

    artefact: Artefact
    name: str
    marks_mm: FloatMap
    """Centres of the balls, (2, 3); of a plane its centre, and points on its normal and along its
    length at L₀ / 4 from it, (3, 3); mm."""
    seen: bool = True
    """Whether camera and projector of the rig reach all of it."""

    @property
    def centre_mm(self) -> FloatMap:
        """The middle of the artefact, (3,), mm."""
        marks = self.marks_mm if self.artefact == "ball bar" else self.marks_mm[:1]
        return np.asarray(marks.mean(axis=0))

    @property
    def direction(self) -> FloatMap:
        """Direction of the bar, or of the plane's normal, of length 1, (3,)."""
        way = self.marks_mm[1] - self.marks_mm[0]
        return np.asarray(way / np.linalg.norm(way))


@dataclass(frozen=True, eq=False, repr=False)
class PositionCheck(Frozen):
    """Which planned positions were scanned."""

    planned: tuple[ArtefactPlace, ...]
    taken: tuple[int | None, ...]
    """Which scan is in each planned position; None where it is missing."""
    outside: tuple[int, ...]
    """Scans whose artefact reaches out of the volume."""
    same: tuple[tuple[int, int], ...]
    """Pairs of scans in the same position."""

    @property
    def missing(self) -> tuple[ArtefactPlace, ...]:
        """Planned positions without a scan."""
        return tuple(
            one for one, scan in zip(self.planned, self.taken, strict=True) if scan is None
        )


def plan_positions(test: AcceptanceTest, rig: Rig | None = None) -> tuple[ArtefactPlace, ...]:
    """Propose the positions of an acceptance test.

    Parameters
    ----------
    test : AcceptanceTest
    rig : Rig, optional
        With it, positions that camera or projector do not reach are marked.

    Returns
    -------
    tuple of ArtefactPlace: seven of the ball bar, six of the plane.

    Raises
    ------
    InputError for artefacts that do not fit into the volume.
    """
    found: list[ArtefactPlace] = []
    centre, size = np.array(test.volume.centre_mm), np.array(test.volume.size_mm)
    if test.ball_bar is not None:
        found += _bars(test.ball_bar, centre, size)
    if test.plane is not None:
        found += _planes(test.plane, centre, size, test.volume.diagonal_mm)
    if rig is None:
        return tuple(found)
    return tuple(replace(one, seen=reached(one, test, rig)) for one in found)


def artefact_faults(test: AcceptanceTest) -> list[str]:
    """Return what the artefacts lack of the sizes that the guideline asks for."""
    diagonal = test.volume.diagonal_mm
    faults = []
    bar, plane = test.ball_bar, test.plane
    if bar is not None and bar.length_mm < LEAST_BAR_SHARE * diagonal:
        least = number(LEAST_BAR_SHARE * diagonal, unit="mm")
        faults.append(f"the ball bar is {limit(bar.length_mm)} mm long, expected {least} or more")
    if bar is not None:
        low, high = (share * diagonal for share in BALL_SHARE)
        if min(bar.diameters_mm) < low or max(bar.diameters_mm) > high:
            faults.append(
                f"the balls have {' and '.join(limit(d) for d in bar.diameters_mm)} mm, expected "
                f"{number(low)} to {number(high)} mm"
            )
    if plane is not None and max(plane.size_mm) < LEAST_PLANE_SHARE * diagonal:
        least = number(LEAST_PLANE_SHARE * diagonal, unit="mm")
        faults.append(f"the plane is {limit(max(plane.size_mm))} mm long, expected {least} or more")
    return faults


def _bars(bar: BallBar, centre: FloatMap, size: FloatMap) -> list[ArtefactPlace]:
    radius = 0.5 * max(bar.diameters_mm)
    room = 0.5 * size - radius
    found = []
    for name, (shares, pushed) in BAR_TILTS.items():
        way = np.array(shares) * size
        flat = float(np.linalg.norm(way[:2]))
        if way[2]:
            tilt = np.clip(
                np.degrees(np.arctan2(abs(way[2]), flat)), LEAST_DEPTH_DEG, MOST_DEPTH_DEG
            )
            way[2] = np.sign(way[2]) * flat * np.tan(np.radians(tilt))
        half = 0.5 * bar.length_mm * way / np.linalg.norm(way)
        free = room - np.abs(half)
        if (free < 0).any():
            needed = number(float(np.max((np.abs(half) + radius) / (0.5 * size))), digits=2)
            raise InputError(
                f"ball bar: expected one that fits into the volume, got one {needed} times too "
                f"long for the position {name!r}; state a larger volume, or take a shorter bar"
            )
        middle = centre + PUSHED * np.array(pushed) * free
        found.append(ArtefactPlace("ball bar", name, np.array([middle - half, middle + half])))
    return found


def _planes(
    plane: PlaneArtefact, centre: FloatMap, size: FloatMap, diagonal: float
) -> list[ArtefactPlace]:
    found = []
    half = 0.5 * np.array([*plane.size_mm, 0.0])
    if plane.size_mm[0] < plane.size_mm[1]:
        half = half[[1, 0, 2]]
    for name, ((about_x, about_y), depth) in PLANE_TILTS.items():
        R = rotation(np.radians(np.array([about_x, about_y, 0.0])))
        corners = np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]]) * half @ R.T
        free = 0.5 * size - np.abs(corners).max(axis=0)
        if (free < 0).any():
            raise InputError(
                f"plane: expected one that fits into the volume, got one too large for the "
                f"position {name!r}; state a larger volume, or take a smaller plane"
            )
        middle = centre + np.array([0.0, 0.0, PUSHED * depth * free[2]])
        arm = 0.25 * diagonal
        marks = np.array([middle, middle - arm * R[:, 2], middle + arm * R[:, 0]])
        found.append(ArtefactPlace("plane", name, marks))
    return found


def reached(one: ArtefactPlace, test: AcceptanceTest, rig: Rig) -> bool:
    """Return whether camera and projector reach all of an artefact, rims of balls included."""
    points = one.marks_mm[:1]
    reach = 0.0
    if one.artefact == "ball bar":
        points = one.marks_mm
        reach = 0.5 * max(test.ball_bar.diameters_mm) if test.ball_bar else 0.0
    around = np.concatenate([points + reach * way for way in (*np.eye(3)[:2], *-np.eye(3)[:2])])
    if one.artefact == "plane" and test.plane is not None:
        along = one.marks_mm[2] - one.marks_mm[0]
        along = along / np.linalg.norm(along)
        across = np.cross(one.direction, along)
        long, wide = 0.5 * max(test.plane.size_mm), 0.5 * min(test.plane.size_mm)
        around = np.array(
            [points[0] + a * long * along + b * wide * across for a in (-1, 1) for b in (-1, 1)]
        )
    lit = transform(rig.T_projector_camera, around)
    for device, placed in ((rig.camera, around), (rig.projector, lit)):
        if (placed[:, 2] <= 0).any():
            return False
        x, y = project(device, placed).T
        if x.min() < 0 or y.min() < 0 or x.max() > device.width_px - 1:
            return False
        if y.max() > device.height_px - 1:
            return False
    return True


def check_positions(
    test: AcceptanceTest, planned: Sequence[ArtefactPlace], scanned: Sequence[ArtefactPlace]
) -> PositionCheck:
    """Compare scans with the planned positions: each is in one of them at most.

    Notes
    -----
    The distance of two positions is that of their marks, root mean square; of bars, in the order of
    the balls that makes it smaller. Scans and positions are paired so that the sum of the distances
    is smallest.
    """
    diagonal = test.volume.diagonal_mm
    taken: list[int | None] = [None] * len(planned)
    far = np.array([[_apart(p, s) for s in scanned] for p in planned]).reshape(len(planned), -1)
    near = far <= NEAR_SHARE * diagonal
    cost = np.where(near, far, diagonal * len(planned) + 1.0)
    for row, column in zip(*scipy.optimize.linear_sum_assignment(cost), strict=True):
        if near[row, column]:
            taken[row] = int(column)
    same = [
        (i, j)
        for i in range(len(scanned))
        for j in range(i)
        if _apart(scanned[i], scanned[j]) < SAME_SHARE * diagonal
    ]
    outside = [k for k, one in enumerate(scanned) if not _inside(one, test)]
    return PositionCheck(tuple(planned), tuple(taken), tuple(outside), tuple(same))


def _apart(one: ArtefactPlace, other: ArtefactPlace) -> float:
    """Distance of two positions, mm; ∞ for different artefacts."""
    if one.artefact != other.artefact:
        return float(np.inf)
    if one.artefact == "plane":
        # A measured plane does not tell which way is its length.
        marks = (one.marks_mm[:2], other.marks_mm[:2])
        return float(np.sqrt(np.mean(np.sum((marks[0] - marks[1]) ** 2, axis=1))))
    ways = (other.marks_mm, other.marks_mm[::-1])
    return min(float(np.sqrt(np.mean(np.sum((one.marks_mm - w) ** 2, axis=1)))) for w in ways)


def _inside(one: ArtefactPlace, test: AcceptanceTest) -> bool:
    """Whether the centres of balls, or of a plane, lie in the volume."""
    points = one.marks_mm if one.artefact == "ball bar" else one.marks_mm[:1]
    away = np.abs(points - np.array(test.volume.centre_mm))
    return bool((away <= 0.5 * np.array(test.volume.size_mm)).all())
