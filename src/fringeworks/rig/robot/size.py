"""Which size of the board would make poses and views agree: a wrong unit, or a wrong board."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fringeworks.rig.robot.board_views import SeenBoards
from fringeworks.rig.robot.estimate import Data
from fringeworks.rig.robot.fit import fitted, size_text, started
from fringeworks.types import FloatMap, InputError, Mount, RobotNoise


def size_words(
    poses: Iterable[FloatMap], seen: SeenBoards, mount: Mount, stated: RobotNoise | None
) -> str | None:
    """Say with which size of the board one of several readings of the poses would agree.

    Parameters
    ----------
    poses : iterable of (n, 4, 4) arrays
        T_base_flange by each reading, mm.
    seen : SeenBoards
        By the stated size of the board.
    mount : "hand" or "base"
    stated : RobotNoise or None

    Returns
    -------
    A sentence, with the size that is nearest to the stated one; None where none helps.
    """
    found = []
    for T in poses:
        scale = _scale(Data(T, seen, mount))
        if not (np.isfinite(scale) and scale > 0.0):
            continue
        try:
            left = fitted(Data(T, _scaled(seen, scale), mount), stated).scale
        except InputError:
            continue
        found.append((scale * left.value, scale * left.sigma))
    if not found:
        return None
    return size_text(*min(found, key=lambda one: abs(np.log(one[0]))))


def _scale(data: Data) -> float:
    """Size of the board over its stated one, by all motions.

    With A X = X B for the motions A of the robot and B of the board: the rotation of X does not
    depend on lengths, and (R_A − 1) t_X − s R_X t_B = −t_A is linear in t_X and the size s.
    """
    R = started(data)[0][:3, :3]
    one, two = np.triu_indices(len(data.seen), 1)
    G, M = data.motions, data.seen.T_camera_board
    A, B = G[two] @ np.linalg.inv(G[one]), M[two] @ np.linalg.inv(M[one])
    left = np.concatenate((A[:, :3, :3] - np.eye(3), -(B[:, :3, 3] @ R.T)[:, :, None]), axis=2)
    found = np.linalg.lstsq(left.reshape(-1, 4), -A[:, :3, 3].ravel(), rcond=None)[0]
    return float(found[3])


def _scaled(seen: SeenBoards, scale: float) -> SeenBoards:
    """The views of a board of another size."""
    T = seen.T_camera_board.copy()
    T[:, :3, 3] *= scale
    by = np.repeat([1.0, scale], 3)
    return replace(
        seen,
        T_camera_board=T,
        covariance=seen.covariance * by[:, None] * by,
        by_camera=seen.by_camera * by[:, None],
        middle_mm=seen.middle_mm * scale,
        radius_mm=seen.radius_mm * scale,
    )
