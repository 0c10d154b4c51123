"""A board in a live picture: where it is, and what a pose taken there would add."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.corners import find_board
from fringeworks.scan.poses import (
    COUNTED_TILT_DEG,
    REGIONS,
    SIDES,
    USUAL_FOCAL,
    PoseJudgement,
    cells_of,
    region_cells,
    rough_pose,
    tilts_deg,
)
from fringeworks.types import BoardNotFound, Frozen


@dataclass(frozen=True, eq=False, repr=False)
class Glance(Frozen):
    """What one picture shows of a board."""

    view: BoardView
    """The corners that were found, camera px."""
    tilts_deg: tuple[float, float, float, float]
    """Tilt of the top, bottom, left and right side of the board towards the camera, degrees; 0 for
    sides that are turned away."""
    adds: tuple[str, ...]
    """What is missing so far that a pose taken here would bring."""

    def __str__(self) -> str:
        tilts = [
            f"{side} tilted {tilt:.0f}° towards the camera"
            for side, tilt in zip(SIDES, self.tilts_deg, strict=True)
            if tilt >= 1
        ]
        seen = f"{len(self.view.index)} corners, {', '.join(tilts) or 'level'}"
        new = f"new: {', '.join(self.adds)}" if self.adds else "a pose here adds nothing"
        return f"{seen}; {new}"


def glance(image: NDArray[Any], board: Board, judgement: PoseJudgement) -> Glance | None:
    """Find a board in one picture, and tell what a pose taken there would add.

    Parameters
    ----------
    image : (h, w) array
        Grey picture under even light, counts.
    board : Board
    judgement : PoseJudgement
        Of the poses so far, in the same camera's pixels.

    Returns
    -------
    Glance, or None where the board is not found. Tilts are as rough as those of ``judge_poses``;
    before the first pose they assume a focal length of 1.5 times the longer side of the image.
    """
    try:
        view = find_board(image, board)
    except BoardNotFound:
        return None
    height, width = image.shape
    size = (width, height)
    focal_px = judgement.focal_px or USUAL_FOCAL * max(size)
    tilts = tilts_deg(rough_pose(view, board, focal_px, size)[None, :, 2])
    adds = [
        f"tilt of the {SIDES[k]}" for k in judgement.missing_sides if tilts[k] >= COUNTED_TILT_DEG
    ]
    if judgement.poses:
        seen = cells_of(view.pixels, judgement.box_px)
        for place in judgement.missing_regions:
            cells = region_cells(place)
            if np.any(seen[cells] & ~judgement.covered[cells] & judgement.field[cells]):
                adds.append(REGIONS[place[0]][place[1]])
    return Glance(view, tilts, tuple(adds))
