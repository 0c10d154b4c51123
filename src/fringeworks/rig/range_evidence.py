"""What a measured scene itself says about whole periods that a range of depths has resolved.

A surface that lies a whole period off has other depths, but the same repeating coordinates. Four
things can contradict it: the frame of the projector, which lights nothing beyond; a second axis;
light that would have to pass through one surface to reach another; and the border of the light.
Where none does, only the stated range tells the periods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.rig.depth_range import ROOM_SIGMAS, DepthRange
from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.rig.ray_depth import axis_length, inverse_depth
from fringeworks.types import (
    Axis,
    BoolMap,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    Pixels,
    PointCloud,
    Reason,
    Rig,
)
from fringeworks.types.computed import cached_property

SAMPLES = 2_000
"""Pixels for which other periods are tried, at most: a share of 1 % of them is twenty."""
ALL_LIT = 0.99
"""Share of the pixels that other periods must lead into the projector's frame: the rest may be
noise and flying pixels at edges, which take less than 1 %."""
APART_PX = 1.0
"""Epipolar error up to which a point counts as one of both axes, projector px, where the rig states
less: calibrations by other programs leave as much."""
BOTH_SHARE = 0.5
"""Share of the pixels that must be points of both axes, for other periods to be possible."""
CELLS = 100_000
"""Pixels of the camera whose light is compared in the projector's frame, and cells of that frame,
at most."""
CELL_PITCHES = 1.5
"""Side of the cells of the projector's frame, in distances between those pixels there: with less,
cells of a surface that is seen from the side stay empty."""
HIDDEN_PERIODS = 0.1
"""Difference of depth from which one of two points in a cell hides the other, in periods: a steep
surface changes by less within a cell."""
SQUARE = np.ones((3, 3), bool)
"""The smallest square of such cells that counts: at an edge of depth, single cells hold both sides.
Also the neighbours of a pixel."""
MIN_CELLS = 20
"""Fewest such cells that are reported."""
BORDER_PX = (1.5, 4.0)
"""Distances from the border of the projector's frame, camera px: up to the first, pixels at the end
of the light lie at the border, which crosses some of them; from there to the second, they do not,
and objects that end near it by chance have as many there."""
MIN_BORDER = 40
"""Fewest pixels at the border, beyond those beside it, that tell the period."""
BORDER_SHARE = 0.4
"""Share of the pixels at the end of the light that must lie at the border: one straight edge of an
object lies there by chance, but not most of its outline."""
BORDER_RATIO = 4.0
"""How many times as many there must be as with another period, and as beside the border."""

Places = NDArray[np.intp]
"""Rows or columns of the camera's frame, (n,)."""


class _Other(NamedTuple):
    """Depths that a whole number of periods more leads to."""

    periods: int
    z_mm: FloatMap
    """Depths of the sampled pixels, mm."""
    away_mm: float
    """Median distance along z from the measured points, mm."""


def range_findings(
    points: PointCloud, decoded: Decoded, before: Decoded, depth: DepthRange | None
) -> tuple[Finding, ...]:
    """Findings about the whole periods that a range of depths has told.

    Parameters
    ----------
    points : PointCloud
    decoded : Decoded
        What they come from, absolute.
    before : Decoded
        The same before the range was used.
    depth : DepthRange or None
        None for no findings.
    """
    told: list[Finding] = []
    if depth is None:
        return ()
    for axis in decoded.maps:
        period = before.maps[axis].repeats_px
        if period is None:
            continue
        scene = _Scene(points, decoded, before, depth.rig, axis, period)
        if scene.pitch_px == 0.0:
            continue
        told += scene.hidden()
        if any(f.kind == "depth range" and f.axis == axis and f.rank for f in decoded.findings):
            continue  # periods differ from place to place: no other number fits the whole scene
        others = scene.others()
        by_border = _by_border(scene, others)
        told += _ambiguity(scene, others) if by_border is None else by_border
    return tuple(told)


@dataclass(frozen=True, eq=False)
class _Scene:
    """A measured scene, and the axis whose periods are asked about."""

    points: PointCloud
    decoded: Decoded
    before: Decoded
    rig: Rig
    axis: Axis
    period_px: float

    @cached_property
    def measured(self) -> BoolMap:
        """Where there is a point, (h, w)."""
        return np.isfinite(self.points.xyz_mm[..., 2])

    @property
    def map(self) -> CoordinateMap:
        return self.decoded.maps[self.axis]

    def sampled(self, where: BoolMap, most: int = SAMPLES) -> tuple[FloatMap, FloatMap]:
        """Camera pixels (n, 2) and their coordinates, (n,), px."""
        v, u = np.nonzero(where & np.isfinite(self.map.coordinate_px))
        every = len(v) // most + 1
        v, u = v[::every], u[::every]
        pixels = np.stack((u, v), axis=-1).astype(np.float64)
        return pixels, self.map.coordinate_px[v, u].astype(np.float64)

    def moved(self, pixels: FloatMap, goal_px: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Inverse depths at other coordinates, and where the projector sees these points, px; NaN
        for those that are not in front of both devices."""
        with np.errstate(all="ignore"):
            w = inverse_depth(self.rig, pixels, goal_px, self.axis)
            w = np.where(w > 0.0, w, np.nan)
            seen = rays(self.rig.camera, pixels) / w[:, None]
            there = transform(self.rig.T_projector_camera, seen)
            there[~(there[:, 2] > 0.0)] = np.nan
            return w, project(self.rig.projector, there)

    def lit(self, place_px: FloatMap) -> BoolMap:
        """Places within the projector's frame, or at its border, (n,)."""
        inside = self._inside(place_px)
        with np.errstate(invalid="ignore"):
            return np.asarray(inside > -BORDER_PX[0] * self.pitch_px)

    def _inside(self, place_px: FloatMap) -> FloatMap:
        """How far places lie within the projector's frame, (n,), px."""
        size = np.array([axis_length(self.rig, "x"), axis_length(self.rig, "y")])
        return np.asarray(np.minimum(place_px + 0.5, size - 0.5 - place_px).min(axis=1))

    def others(self) -> list[_Other]:
        """Other periods that lead nearly all points into the projector's light."""
        pixels, x = self.sampled(self.measured)
        v, u = pixels[:, 1].astype(np.intp), pixels[:, 0].astype(np.intp)
        z = self.points.xyz_mm[v, u, 2]
        found = []
        for sign in (-1, 1):
            most = int(axis_length(self.rig, self.axis) / self.period_px)
            for k in range(sign, sign * (most + 1), sign):
                w, place = self.moved(pixels, x + k * self.period_px)
                if np.mean(self.lit(place)) < ALL_LIT:
                    break
                if self._fits_other_axis(place, v, u):
                    away = float(np.nanmedian(1.0 / w - z))
                    found.append(_Other(k, 1.0 / w, away))
        return found

    def _fits_other_axis(self, place_px: FloatMap, v: Places, u: Places) -> bool:
        """Whether the coordinates along the other axis, where there are any, agree with places."""
        other: Axis = "y" if self.axis == "x" else "x"
        known = self.decoded.maps.get(other)
        if known is None:
            return True
        off = place_px[:, 0 if other == "x" else 1] - known.coordinate_px[v, u]
        repeats = self.before.maps[other].repeats_px
        if repeats is not None:
            off = off - repeats * np.rint(off / repeats)
        with np.errstate(invalid="ignore"):
            near = np.abs(off) < np.hypot(APART_PX, ROOM_SIGMAS * known.sigma_px[v, u])
        return bool(np.mean(near) > BOTH_SHARE)

    def hidden(self) -> list[Finding]:
        """Find points whose light would have to pass through another surface."""
        step = self.step
        known = self.measured[::step, ::step]
        xyz = self.points.xyz_mm[::step, ::step][known].astype(np.float64)
        room = ROOM_SIGMAS * self.points.sigma_mm[::step, ::step][known]
        there = transform(self.rig.T_projector_camera, xyz)
        place = project(self.rig.projector, there)
        size = axis_length(self.rig, "x") * axis_length(self.rig, "y")
        side = max(CELL_PITCHES * step * self.pitch_px, np.sqrt(size / CELLS))
        cell = np.floor(place / side).astype(np.intp)
        cell -= cell.min(axis=0, initial=0)
        shape = tuple(int(n) for n in cell.max(axis=0, initial=0) + 1)
        flat = np.ravel_multi_index((cell[:, 0], cell[:, 1]), shape)
        near, far = np.full(np.prod(shape), np.inf), np.full(np.prod(shape), -np.inf)
        np.minimum.at(near, flat, there[:, 2] + room)
        np.maximum.at(far, flat, there[:, 2] - room)
        if not self._many(far > near, shape):
            return []
        both = far - near > HIDDEN_PERIODS * self._period_mm()
        count = self._many(both, shape)
        if not count:
            return []
        lit = int(np.count_nonzero(np.isfinite(near)))
        share = f"{count / lit:.1%} of the projector's light that was measured meets two surfaces"
        return [
            Finding(
                "whole periods",
                f"{share}, one behind the other along {self.axis}: one of them is a whole period "
                "off",
                causes=("a surface lies outside the depth range",),
                advice="give a range that holds all that is lit, or a plan with a longer period",
                axis=self.axis,
                figures={"hidden_share": count / lit},
                pixels=Pixels(count, lit),
            )
        ]

    @staticmethod
    def _many(both: BoolMap, shape: tuple[int, ...]) -> int:
        """Number of marked cells in squares of them; 0 for too few."""
        if np.count_nonzero(both) < MIN_CELLS:
            return 0
        count = int(np.count_nonzero(scipy.ndimage.binary_opening(both.reshape(shape), SQUARE)))
        return count if count >= MIN_CELLS else 0

    @cached_property
    def pitch_px(self) -> float:
        """Median distance between neighbours of the camera's pixels at the projector, px; 0 without
        neighbours."""
        x, step = self.map.coordinate_px, self.step
        sampled = np.diff(x[:, ::step], axis=0), np.diff(x[::step], axis=1)
        return max(_median(np.abs(change)) for change in sampled)

    @property
    def step(self) -> int:
        """Distance between rows, and columns, of which there are ``CELLS`` in the frame, px."""
        h, w = self.rig.camera.shape
        return int(np.ceil(np.sqrt(h * w / CELLS)))

    def _period_mm(self) -> float:
        """Depth of a period, mm: the median of the scene; 0 where no other period leads to one."""
        pixels, x = self.sampled(self.measured)
        with np.errstate(all="ignore"):
            ends = [1.0 / self.moved(pixels, x + k * self.period_px)[0] for k in (-1.0, 0.0, 1.0)]
        return _median(np.fmin(*np.abs(np.diff(ends, axis=0))))

    def ends(self) -> tuple[FloatMap, FloatMap]:
        """Measured pixels beside some without light, and their coordinates."""
        reason = self.map.reason
        dark = (reason == Reason.SHADOW) | (reason == Reason.LOW_MODULATION)
        dark[1:] |= dark[:-1].copy()
        dark[:-1] |= dark[1:].copy()
        dark[:, 1:] |= dark[:, :-1].copy()
        dark[:, :-1] |= dark[:, 1:].copy()
        return self.sampled(dark & self.measured)

    def at_border(self, pixels: FloatMap, goal_px: FloatMap) -> int:
        """Number of pixels that lie at the border of the projector's frame, if most do and few
        lie beside it; 0 otherwise."""
        off = np.abs(self._inside(self.moved(pixels, goal_px)[1]))
        with np.errstate(invalid="ignore"):
            at, near = (np.count_nonzero(off < px * self.pitch_px) for px in BORDER_PX)
        beside = near - at
        is_border = at > max(BORDER_RATIO * beside, BORDER_SHARE * len(pixels))
        return int(at - beside) if is_border else 0


def _median(values: FloatMap) -> float:
    """Median of the finite values; 0 without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else 0.0


def _by_border(scene: _Scene, others: list[_Other]) -> list[Finding] | None:
    """What the border of the light says: another period, or, as an empty list, the present one;
    None where it says nothing."""
    pixels, x = scene.ends()
    here = scene.at_border(pixels, x)
    counts = [scene.at_border(pixels, x + other.periods * scene.period_px) for other in others]
    if not counts:
        return None
    best = int(np.argmax(counts))
    if here >= max(MIN_BORDER, BORDER_RATIO * counts[best]):
        return []
    if counts[best] < max(MIN_BORDER, BORDER_RATIO * here):
        return None
    other = others[best]
    return [
        Finding(
            "whole periods",
            f"{counts[best]} pixels at the end of the light lie at the border of the projector's "
            f"frame if the coordinates along {scene.axis} are {other.periods:+d} periods off, and "
            f"{here} as they are: the surfaces lie {_told(other)}",
            causes=("the surfaces lie outside the depth range",),
            advice="give a range that holds all that is lit",
            axis=scene.axis,
            figures={"periods": float(other.periods), "away_mm": other.away_mm},
            severity="error",
        )
    ]


def _ambiguity(scene: _Scene, others: list[_Other]) -> list[Finding]:
    """Say which other depths fit the coordinates as well."""
    nearer = [o for o in others if o.away_mm < 0.0]
    farther = [o for o in others if o.away_mm > 0.0]
    nearest = [max(nearer, key=lambda o: o.away_mm, default=None)]
    nearest += [min(farther, key=lambda o: o.away_mm, default=None)]
    named = [o for o in nearest if o is not None]
    if not named:
        return []
    figures = {"candidates": float(len(others))}
    for name, other in zip(("nearer_mm", "farther_mm"), nearest, strict=True):
        if other is not None:
            figures[name] = abs(other.away_mm)
    return [
        Finding(
            "whole periods",
            f"nothing but the depth range tells the whole periods along {scene.axis}: the "
            f"coordinates of the whole scene fit surfaces {' and '.join(map(_told, named))} as "
            "well",
            advice="compare one depth with a ruler, or measure along both axes, or with a plan "
            "that does not repeat",
            axis=scene.axis,
            figures=figures,
            severity="note",
        )
    ]


def _told(other: _Other) -> str:
    """Where other periods lead, in words."""
    first, last = np.nanmin(other.z_mm), np.nanmax(other.z_mm)
    way = "nearer" if other.away_mm < 0.0 else "farther"
    return f"{abs(other.away_mm):.0f} mm {way}, at {first:.0f} to {last:.0f} mm,"
