"""The usual errors of a watched rig, learnt from its first scans, and a change beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fringeworks.rig.scan_evidence import EpipolarEvidence, drift_units
from fringeworks.types import FloatMap, Rig

WITHIN = 3
"""Scans within which a knock is to be found."""
SEEN_SIGMA = 0.25
"""Standard deviation of a mode in three scans, in its units, up to which it is watched. A change by
one unit is then four standard deviations."""
UNIT_PRIOR = 40.0
"""Standard deviation of each mode before the first scan, in its units, beside the rig's covariance:
2° and 4 mm. What a rig has drifted before the watch began is learnt, not reported."""
SCATTER_PRIOR = 0.1
"""Standard deviation of a mode from scan to scan before the first scan, in its units: 0.005° and
0.01 mm. It counts as one scan."""
STEPS = 60
"""Steps of expectation and maximisation. They begin at a large scatter; stopping early leaves it
too large, which raises limits and no alarms."""
LARGE_FOCUS, LARGE_PLACE, LARGE_SHAPE, LARGE_DEG, LARGE_MM = 0.02, 0.02, 0.1, 1.0, 2.0
"""Standard deviations of a rig that states no covariance: share of focal lengths, of the frame for
principal points, distortion coefficients, rotation and translation. Larger than the errors of
calibrations by other programs."""
ROUNDING = 1e-12
"""Smallest variance of a direction of a covariance, over its diagonal, that is no rounding."""


class Said(NamedTuple):
    """Information and score of some scans on a deviation in ``Learnt.root``'s coordinates."""

    information: FloatMap
    """(r, r)"""
    score: FloatMap
    """(r,)"""


class Effect(NamedTuple):
    """A change of the watched modes, in their units."""

    change: FloatMap
    precision: FloatMap
    square: float
    """Square of the change over its covariance."""
    said: Said
    """Evidence on a change of all parameters beside what was learnt."""


@dataclass(frozen=True, eq=False)
class Learnt:
    """A rig's usual errors, from the first scans.

    A deviation of the 24 parameters is the root times a vector with the covariance 1 before the
    first scan: parameters of different units and of nearly singular covariances stay exact.
    """

    root: FloatMap
    """(24, r)"""
    mean: FloatMap
    """(r,) Most likely deviation from the rig's parameters."""
    covariance: FloatMap
    """(r, r)"""
    units: FloatMap
    """(r, k) Changes by the watched modes."""
    modes: FloatMap
    """(7, k) The watched modes, in units of ``drift_units``."""
    scatter: FloatMap
    """(k, k) Covariance of the modes from scan to scan."""
    freedom: int
    """Degrees of freedom of that covariance."""

    def said(self, one: EpipolarEvidence) -> Said:
        """What a scan says, after its own random change was eliminated."""
        return _reduced(_rooted(one, self.root), self.units, self.scatter)

    def of(self, change: FloatMap) -> FloatMap:
        """A change of the 24 parameters in the root's coordinates."""
        return _in_root(self.root, change)


def learn(rig: Rig, evidence: Sequence[EpipolarEvidence]) -> Learnt:
    """Learn the mean deviation and what differs from scan to scan, by expectation–maximisation."""
    whole = drift_units(rig)
    root = _root(rig, whole)
    scans = [_rooted(one, root) for one in evidence]
    all_units = _in_root(root, whole)
    modes = _watched(all_units, scans)
    units = all_units @ modes
    count, size = modes.shape[1], root.shape[1]
    known = SCATTER_PRIOR**2 * np.eye(count)
    scatter: FloatMap = np.eye(count)
    mean: FloatMap = np.zeros(size)
    covariance: FloatMap = np.eye(size)
    for _ in range(STEPS):
        parts = together([_reduced(one, units, scatter) for one in scans])
        covariance = np.linalg.inv(np.eye(size) + parts.information)
        mean = covariance @ parts.score
        total = known.copy()
        for one in scans:
            seen = units.T @ one.information
            of_scan = np.linalg.inv(np.linalg.inv(scatter) + seen @ units)
            change = of_scan @ (units.T @ one.score - seen @ mean)
            of_mean = of_scan @ seen
            total += np.outer(change, change) + of_scan + of_mean @ covariance @ of_mean.T
        scatter = total / len(scans)
    return Learnt(root, mean, covariance, units, modes, scatter, len(scans) - 1)


def together(parts: Sequence[Said]) -> Said:
    """What some scans say together."""
    return Said(
        np.sum([part.information for part in parts], axis=0),
        np.sum([part.score for part in parts], axis=0),
    )


def effect(parts: Sequence[Said], learnt: Learnt) -> Effect:
    """The change that some scans have in common, beside what was learnt."""
    information, score = together(parts)
    both = np.column_stack((information, score - information @ learnt.mean))
    solved = np.linalg.solve(np.eye(len(score)) + information @ learnt.covariance, both)
    beside = Said(0.5 * (solved[:, :-1] + solved[:, :-1].T), solved[:, -1])
    precision = learnt.units.T @ beside.information @ learnt.units
    push = learnt.units.T @ beside.score
    change = np.linalg.solve(precision, push)
    return Effect(change, precision, float(push @ change), beside)


def _rooted(one: EpipolarEvidence, root: FloatMap) -> Said:
    """What a scan says, in the root's coordinates."""
    return Said(root.T @ one.information @ root, root.T @ one.score)


def _in_root(root: FloatMap, change: FloatMap) -> FloatMap:
    """Changes of the 24 parameters in the root's coordinates; its columns are orthogonal after
    scaling, so that least squares in units of each parameter are exact."""
    scale = np.maximum(np.linalg.norm(root, axis=1), np.finfo(float).tiny)
    shape = (-1,) + (1,) * (change.ndim - 1)
    return np.asarray(
        np.linalg.lstsq(root / scale[:, None], change / scale.reshape(shape), rcond=None)[0]
    )


def _root(rig: Rig, units: FloatMap) -> FloatMap:
    """A root of the covariance of the deviation before the first scan, (24, r)."""
    known = rig.covariance
    if known is None or not known.any():
        size = []
        for device in (rig.camera, rig.projector):
            size += [LARGE_FOCUS * f for f in device.focal_px]
            size += [LARGE_PLACE * n for n in (device.width_px, device.height_px)]
            size += [LARGE_SHAPE] * 5
        size += [np.radians(LARGE_DEG)] * 3 + [LARGE_MM] * 3
        known = np.diag(np.square(size))
    whole = known + UNIT_PRIOR**2 * units @ units.T
    scale = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    kept = values > ROUNDING * values.max()
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def _watched(units: FloatMap, scans: Sequence[Said]) -> FloatMap:
    """The modes that three average scans see, (7, k), by falling certainty."""
    all_said = together(scans).information
    size = len(all_said)
    of_learnt = np.linalg.inv(np.eye(size) + all_said)
    three = WITHIN / len(scans) * all_said
    seen = units.T @ np.linalg.solve(np.eye(size) + three @ of_learnt, three) @ units
    values, vectors = np.linalg.eigh(0.5 * (seen + seen.T))
    return np.asarray(vectors[:, values > SEEN_SIGMA**-2][:, ::-1])


def _reduced(one: Said, units: FloatMap, scatter: FloatMap) -> Said:
    """A scan after its random change of the modes was eliminated."""
    seen = units.T @ one.information
    left = np.linalg.solve(np.linalg.inv(scatter) + seen @ units, seen)
    return Said(one.information - seen.T @ left, one.score - left.T @ (units.T @ one.score))
