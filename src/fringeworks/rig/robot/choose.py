"""Which reading of the robot's poses the board views support."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.robot.board_views import SeenBoards
from fringeworks.rig.robot.estimate import CONTRADICT, Data, solved
from fringeworks.rig.robot.fit import MOST_MM, Fit, fitted, started
from fringeworks.rig.robot.motion import (
    FLOOR_DEG,
    MIN_POSES,
    check_motion,
    is_determined,
    turns_deg,
)
from fringeworks.rig.robot.readings import (
    SHAPES,
    Reading,
    RobotPoses,
    distinct,
    inverses,
    readings_of,
)
from fringeworks.rig.robot.size import size_words
from fringeworks.types import FloatMap, InputError, Mount, RobotNoise

UNLIKELY = 0.01
"""Likelihood over that of the best reading below which another reading is excluded, as for causes
of a drift."""
HOPELESS = 30.0
"""Median distance of the start over that of the best reading from which on a reading is not fitted.
Starts are within a factor of five of the fit."""
HOPELESS_MM = 6.0 * MOST_MM
"""A median distance that no robot has, mm: with more, a reading is not fitted."""
MOST_TOLD = 2
"""Largest number of readings that a message lists."""
LARGE_MM = 1.0
"""Robot noise from which on a warning is given, mm, and no reading counts as found: beyond it,
robots of industry are not well calibrated, or poses are written otherwise."""
LARGE_DEG = 0.3
"""The same for rotations, degrees."""
OPTION = "poses_as (--poses-as)"
"""Where the caller says how poses are written."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """The reading that was found, with its fit."""

    reading: Reading | None
    """None where the poses were given as transforms."""
    fit: Fit
    tried: int
    """Number of readings that were compared."""
    next_best: Reading | None
    """The likeliest of the others that could be fitted."""
    next_chi2: float
    """By how much its weighted squares are larger."""


def chosen(poses: RobotPoses, seen: SeenBoards, mount: Mount, stated: RobotNoise | None) -> Chosen:
    """Fit all readings that are open, and return the one that the views support.

    Raises
    ------
    InputError where two readings fit equally, naming both and what decides; where none fits, with
    the readings that would if something else had been stated; as ``fitted``.
    """
    open_readings = distinct(poses)
    noise = FLOOR_DEG if stated is None else stated.rotation_deg
    T = _as_large(open_readings, seen)
    certain = sum(not reading.inverse for reading, _ in open_readings) <= 1
    try:
        check_motion(Data(T, seen, mount).motions, noise, mount, certain=certain)
    except InputError as error:
        # The board turned, so that the reading is wrong and not the motion.
        if is_determined(seen.T_camera_board, noise):
            _refuse(poses, seen, mount, stated, error)
        raise
    fits, last = _fits(open_readings, seen, mount, stated)
    if not fits:
        _refuse(poses, seen, mount, stated, last)
    fits.sort(key=lambda f: (-np.count_nonzero(f[1].used), _median(f[1])))
    best, fit = fits[0]
    compared = sorted(
        ((_chi2(other, fit) - _chi2(fit, fit), reading) for reading, other in fits[1:]),
        key=lambda pair: pair[0],
    )
    rivals = [reading for more, reading in compared if more < -2.0 * math.log(UNLIKELY)]
    if rivals:
        names = " or ".join(reading.text for reading in (best, *rivals))
        raise InputError(
            f"hand-eye: the board views cannot tell whether the robot's poses are {names}; say how "
            f"they are written: {OPTION} {' or '.join(r.spec for r in (best, *rivals))}; or turn "
            "the robot more between the poses"
        )
    if len(open_readings) > 1:
        _check_found(best, fit)
    if best.inverse and not all(reading.inverse for reading in poses.readings):
        _refuse_inverse(best, mount)
    more, second = compared[0] if compared else (math.inf, None)
    return Chosen(best, fit, len(open_readings), second, more)


def _as_large(readings: Sequence[tuple[Reading, FloatMap]], seen: SeenBoards) -> FloatMap:
    """The poses of the reading by which the robot turned as far as the board did.

    Radians that are read as degrees would look like no rotation at all.
    """
    if len(seen) < MIN_POSES:
        return readings[0][1]
    board = turns_deg(seen.T_camera_board)
    # Inverse poses turn as far, but their axis is that of the other side.
    direct = [T for reading, T in readings if not reading.inverse]
    return min(
        direct or [T for _, T in readings],
        key=lambda T: float(np.median(np.abs(turns_deg(T) - board))),
    )


def _check_found(best: Reading, fit: Fit) -> None:
    """Refuse the best of several readings where it leaves more than robots deviate by."""
    noise = fit.noise
    large = noise.translation_mm > LARGE_MM or noise.rotation_deg > LARGE_DEG
    if not (fit.contradicted or large):
        return
    known = f"the stated noise of {fit.stated}" if fit.contradicted else "what robots deviate by"
    raise InputError(
        f"hand-eye: no reading of the robot's poses explains the board views within {known}; the "
        f"best, {best.text}, leaves {noise}; say how they are written ({OPTION}), or state a "
        "larger noise"
    )


def chosen_of_transforms(
    T_base_flange: FloatMap, seen: SeenBoards, mount: Mount, stated: RobotNoise | None
) -> Chosen:
    """The fit of poses that were given as transforms (n, 4, 4), mm."""
    try:
        fit = fitted(Data(T_base_flange, seen, mount), stated)
    except InputError:
        try:
            fitted(Data(inverses(T_base_flange), seen, mount), stated)
        except InputError:
            said = size_words([T_base_flange], seen, mount, stated)
        else:
            _refuse_inverse(Reading("rows", inverse=True), mount)
        if said is not None:
            raise InputError(said) from None
        raise
    return Chosen(None, fit, 1, None, math.inf)


def _median(fit: Fit) -> float:
    return float(np.median(fit.others.distance_mm))


def _fits(
    readings: Sequence[tuple[Reading, FloatMap]],
    seen: SeenBoards,
    mount: Mount,
    stated: RobotNoise | None,
) -> tuple[list[tuple[Reading, Fit]], InputError | None]:
    """Fits of the readings that have one, and why the last of the others has none."""
    scores = []
    for _, T in readings:
        scores.append(float(np.median(started(Data(T, seen, mount))[2])))
    limit = min(HOPELESS * max(min(scores), 0.1), HOPELESS_MM)
    fits, last = [], None
    for (reading, T), score in zip(readings, scores, strict=True):
        if score <= limit or len(readings) == 1:
            try:
                fits.append((reading, fitted(Data(T, seen, mount), stated)))
            except InputError as error:
                last = error
    return fits, last


def _chi2(other: Fit, best: Fit) -> float:
    """Weighted squares of a reading with the noise and the poses of the best one."""
    data, variances = other.data.at(best.used), best.solution.variances
    return solved(data, other.solution.X, other.solution.Y, variances).chi2


def _refuse_inverse(reading: Reading, mount: Mount) -> None:
    otherwise: Mount = "base" if mount == "hand" else "hand"
    raise InputError(
        f"hand-eye: the poses fit the board views only if they map base coordinates to the flange "
        f"({reading.spec}), or if the camera is not where it was said to be (mount {otherwise} "
        f"instead of {mount}): the views cannot tell these two apart; give {OPTION} inverse, or "
        f"mount (--mount) {otherwise}"
    )


def _refuse(
    poses: RobotPoses,
    seen: SeenBoards,
    mount: Mount,
    stated: RobotNoise | None,
    last: InputError | None,
) -> None:
    """Say that no reading fits, and which other one would."""
    kinds = SHAPES[poses.values.shape[1]]
    every = RobotPoses(poses.values, poses.names, readings_of("", kinds))
    known = {reading.spec for reading in poses.readings}
    others = [pair for pair in distinct(every) if pair[0].spec not in known]
    fits = _fits(others, seen, mount, stated)[0] if others else []
    direct = [reading.text for reading in poses.readings if not reading.inverse]
    tried = " or ".join(direct or [reading.text for reading in poses.readings])
    tried = tried if len(direct) <= MOST_TOLD else f"any of {len(known)} ways"
    if not fits:
        # Wrong readings leave so much that rotations seem to drown in it: no cause to name.
        if last is not None and len(direct) <= 1 and not str(last).startswith(CONTRADICT):
            raise last
        said = size_words((T for _, T in distinct(poses)), seen, mount, stated)
        raise InputError(
            said
            or f"{CONTRADICT}, read as {tried} and as all others: are they in the same order as "
            "the views, of the same moments, and is the board's size right?"
        )
    if all(reading.inverse for reading, _ in fits):
        _refuse_inverse(fits[0][0], mount)
    names = " or ".join(reading.text for reading, _ in fits)
    raise InputError(
        f"hand-eye: the robot's poses contradict the board views, read as {tried}; they fit as "
        f"{names}: give {OPTION} {fits[0][0].spec} if that is right"
    )
