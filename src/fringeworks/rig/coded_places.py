"""Where another camera sees what a camera sees, by the projector's codes alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.rig.pinhole import project_with_derivatives, rays
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.types import Axis, BoolMap, Decoded, FloatMap, Rig

START_PX = 3.0
"""Largest distance of a start from the place that is looked for, px of the other camera: a match is
away from edges and gaps, so that the pixel next to it is decoded."""
CELL_PX = 2.0
"""Side of the cells in which pixels of equal codes are gathered, px: twice the distance of
neighbouring pixels, so that they share a cell in one of the shifted grids."""
GAP_PX = 6.0
"""Distance along the epipolar line from which on pixels of one cell are different places, px. On
one surface pixels of a cell follow each other; a gap of six pixels is a step in depth."""
TRIANGULATION_STEPS = 3
"""Newton steps to the inverse depth that is nearest to a start; two reach rounding."""


@dataclass(frozen=True, eq=False)
class _Epipolar:
    """The epipolar planes of two cameras, in the coordinates of the first."""

    baseline: FloatMap
    """Unit vector to the second camera, (3,)."""
    forward: FloatMap
    """Unit vector across the baseline, forward, (3,)."""
    up: FloatMap
    """Unit vector across both, (3,)."""

    @classmethod
    def of(cls, pair: Rig) -> _Epipolar:
        b = pair.projector_centre_mm / np.linalg.norm(pair.projector_centre_mm)
        # Cameras one behind the other look along the baseline: any direction across it serves.
        middle = np.array([0.0, 0.0, 1.0]) if abs(b[2]) < 1.0 else np.array([1.0, 0.0, 0.0])
        forward = middle - (middle @ b) * b
        forward /= np.linalg.norm(forward)
        return cls(b, forward, np.cross(b, forward))

    def angles(self, ways: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Angle of the plane about the baseline, and angle from the baseline in it, rad."""
        height, ahead = ways @ self.up, ways @ self.forward
        return np.arctan2(height, ahead), np.arctan2(np.hypot(height, ahead), ways @ self.baseline)


@dataclass(frozen=True, eq=False)
class CodedPixels:
    """Pixels of a camera with their codes: what tells that another camera sees the same place."""

    pixels: FloatMap
    """(n, 2), px."""
    keys: FloatMap
    """(n, 2): both coordinates of the projector; or the one, and the epipolar plane's angle."""
    along: FloatMap | None
    """Angle from the baseline, (n,), rad, for one coordinate."""

    @classmethod
    def of(
        cls,
        decoded: Decoded,
        chosen: BoolMap,
        axes: Sequence[Axis],
        ways: FloatMap,
        planes: _Epipolar,
    ) -> CodedPixels:
        """Codes of the chosen pixels, (h, w); ``ways`` are their rays in the first camera's
        coordinates."""
        v, u = np.nonzero(chosen)
        coordinates: list[FloatMap] = [
            decoded.maps[a].coordinate_px[v, u].astype(np.float64) for a in axes
        ]
        along = None
        if len(axes) == 1:
            plane, along = planes.angles(ways)
            coordinates.append(plane)
        pixels = np.stack((u, v), axis=-1).astype(np.float64)
        return cls(pixels, np.stack(coordinates, axis=-1), along)


def inverse_depths_by_code(
    pair: Rig, here: Decoded, there: Decoded, field: CoordinateField, axes: Sequence[Axis]
) -> FloatMap:
    """Inverse depths near which another camera decodes the same codes, to start a match from.

    Parameters
    ----------
    pair : Rig
        The camera, and the other one in the projector's place.
    here, there : Decoded
        Coordinates of both.
    field : CoordinateField
        That of ``there``.
    axes : sequence of "x" and "y"
        One or both. With one, the pixels of an epipolar plane that share the coordinate see the
        same place; where several places of a plane share it, nothing tells which, and none is
        taken.

    Returns
    -------
    (h, w) array, 1/mm; NaN where there is none.
    """
    planes = _Epipolar.of(pair)
    known, seen = (
        np.logical_and.reduce([np.isfinite(d.maps[a].coordinate_px) for a in axes])
        for d in (here, there)
    )
    seen &= field.usable
    turned = rays(pair.projector, _pixels(seen)) @ pair.T_projector_camera[:3, :3]
    own = CodedPixels.of(here, known, axes, rays(pair.camera, _pixels(known)), planes)
    other = CodedPixels.of(there, seen, axes, turned, planes)
    found = np.full(known.shape, np.nan)
    if not len(other.pixels) or not len(own.pixels):
        return found
    scale, along = _per_pixel(other, seen)
    place = _nearest(own.keys / scale, other.keys / scale, other.pixels)
    if own.along is not None and other.along is not None:
        several = _several(other.keys / scale, other.along / along, own.keys / scale)
        several |= _several(own.keys / scale, own.along / along, own.keys / scale)
        place[several] = np.nan
    found[known] = _inverse_depth(pair, own.pixels, place)
    return found


def _pixels(chosen: BoolMap) -> FloatMap:
    """Columns and rows of the chosen pixels, (n, 2)."""
    v, u = np.nonzero(chosen)
    return np.stack((u, v), axis=-1).astype(np.float64)


def _per_pixel(codes: CodedPixels, chosen: BoolMap) -> tuple[FloatMap, float]:
    """Usual change of the keys (2,), and of the angle along the line, from pixel to pixel."""
    values = np.full((3, *chosen.shape), np.nan)
    values[:2, chosen] = codes.keys.T
    if codes.along is not None:
        values[2, chosen] = codes.along
    across = values[:, :-1, 1:] - values[:, :-1, :-1]
    down = values[:, 1:, :-1] - values[:, :-1, :-1]
    length = np.hypot(across, down).reshape(3, -1)
    known = np.isfinite(length[:2]).all(axis=0)
    if not known.any():
        return np.ones(2), 1.0
    usual = np.median(length[:, known], axis=1)
    return np.maximum(usual[:2], np.finfo(float).tiny), float(usual[2])


def _nearest(wanted: FloatMap, keys: FloatMap, pixels: FloatMap) -> FloatMap:
    """The pixels (n, 2) whose keys are nearest; NaN where none is near."""
    tree = scipy.spatial.cKDTree(keys, balanced_tree=False, compact_nodes=False)
    _, number = tree.query(wanted, distance_upper_bound=START_PX)
    padded = np.concatenate((pixels, np.full((1, 2), np.nan)))
    return np.asarray(padded[number])


def _several(keys: FloatMap, along: FloatMap, wanted: FloatMap) -> BoolMap:
    """Whether pixels with nearly the wanted keys lie at several places of the epipolar line.

    Two pixels whose keys differ by less than half a cell share a cell in one of four grids that are
    shifted by half a cell.
    """
    found = np.zeros(len(wanted), bool)
    for shift in np.ndindex(2, 2):
        off = 0.5 * np.array(shift)
        cells, asked = (np.floor(k / CELL_PX + off).astype(np.int64) for k in (keys, wanted))
        low = np.minimum(cells.min(axis=0), asked.min(axis=0))
        width = int(max(cells[:, 1].max(), asked[:, 1].max()) - low[1]) + 1
        number, question = ((c - low) @ np.array([width, 1]) for c in (cells, asked))
        order = np.lexsort((along, number))
        same = number[order[1:]] == number[order[:-1]]
        gap = same & (np.diff(along[order]) > GAP_PX)
        found |= np.isin(question, number[order[1:]][gap])
    return found


def _inverse_depth(pair: Rig, pixels: FloatMap, place: FloatMap) -> FloatMap:
    """1/z at which the camera's rays pass nearest to places in the other frame, (n,); NaN where
    that is not in front of both."""
    R, t = pair.T_projector_camera[:3, :3], pair.T_projector_camera[:3, 3]
    ray = rays(pair.camera, pixels)
    turned = ray @ R.T
    seen = rays(pair.projector, place)
    with np.errstate(all="ignore"):
        by_w = seen[:, :2] * t[2] - t[:2]
        off = turned[:, :2] - seen[:, :2] * turned[:, 2:]
        w = np.sum(by_w * off, axis=1) / np.sum(by_w**2, axis=1)
        for _ in range(TRIANGULATION_STEPS):
            at = turned + w[:, None] * t
            at = np.where((at[:, 2:] > 0) & (w[:, None] > 0), at, np.nan)
            pixel, by_point, _ = project_with_derivatives(pair.projector, at)
            slope = by_point @ t
            w = w + np.sum(slope * (place - pixel), axis=1) / np.sum(slope**2, axis=1)
        return np.asarray(np.where(w > 0, w, np.nan))
