"""Poses of a calibration board, judged while they are taken: what is there, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.calibrate import Observation, unmoved
from fringeworks.types import BoolMap, Finding, FloatMap, Frozen, InputError
from fringeworks.types.packages import cv2, need_opencv

CELLS = 6
"""Cells along each side of the field in which corners are counted; every region has 2 × 2 cells."""
REGIONS = (
    ("upper left corner", "upper edge", "upper right corner"),
    ("left edge", "middle", "right edge"),
    ("lower left corner", "lower edge", "lower right corner"),
)
"""Names of the regions of the camera's image, row by row."""
REGION_SHARE = 0.5
"""Share of a region's cells that must have corners, 0…1: the board cannot fill the outermost cells
without leaving the image. Of 30 simulated sets of 12 random poses in the middle of the field, 26
have that much in every region; the others miss a corner."""
ADVISED_TILT_DEG = 20.0
"""Tilt that is asked for, degrees: in the middle of what the documentation advises, 15° to 35°."""
COUNTED_TILT_DEG = 12.0
"""Tilt from which on a side counts as seen, degrees. Hands hold a board to some degrees, and rough
poses have errors of about 10 %. Opposite tilts of 12° differ by 24°, which is above the 20° from
which on focal lengths are determined (``USUAL_TILT_DEG`` of the diagnosis)."""
ENOUGH_POSES = 12
"""Number of different poses that are asked for: as many as reach the accuracy in the documentation.
Of all parameters the projector's principal point needs most poses: on the virtual rig its standard
deviation is 0.35 px with 8 poses, 0.31 px with 10 and 0.29 px with 12."""
TILTED_POSES = 9
"""Number of poses that must be tilted, to whichever side: level poses hardly determine focal
lengths and principal points. The others may be level, such as the nearest and the farthest one."""
TILTED_DEG = 15.0
"""Tilt from which on a pose counts as tilted, degrees: the least that the documentation advises."""
ADVISED_STEP = 0.10
"""Change of the distance that is asked for, relative."""
COUNTED_STEP = 0.06
"""Change of the distance, relative to the median of all poses, from which on it counts as nearer or
further: hands move by 10 % roughly."""
USUAL_FOCAL = 1.5
"""Focal length that is assumed until tilted poses determine it, over the longer side of the image:
between a webcam's (0.8) and that of the standard rig (2.5)."""
FOCAL_WEIGHT = 3e-4
"""Weight of the assumed focal length against a pose, whose weight is about sin⁴ of its tilt. Lens
distortion of 0.5 % looks like a tilt of 6°, with a weight of 1e-4; a tilt of 20° has 1e-2."""
FOCAL_RANGE = (0.4, 10.0)
"""Smallest and largest focal length that is believed, over the longer side of the image: wider than
a field of 100°, and narrower than one of 6°."""
SIDES = ("top", "bottom", "left side", "right side")
"""Sides of the board, as the camera's image shows it, that are tilted towards the camera."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseJudgement(Frozen):
    """What the poses of a board so far are good for, and what is missing."""

    poses: int
    """Number of different poses."""
    tilted: int
    """Number of poses that are tilted by 15° or more, to whichever side."""
    field: BoolMap
    """Cells of the camera's image that the projector lights, (6, 6)."""
    box_px: tuple[float, float, float, float]
    """The part of the camera's image that the cells divide: left, top, right and bottom, px."""
    covered: BoolMap
    """Cells with corners in any pose, (6, 6)."""
    tilts_deg: tuple[float, float, float, float]
    """Largest tilt of the top, bottom, left and right side of the board towards the camera, as the
    camera's image shows them; ≥ 0, degrees."""
    distances_mm: tuple[float, float]
    """Smallest and largest distance of the board's middle from the camera, mm. Their ratio is known
    better than the distances, which scale with the focal length."""
    focal_px: float
    """Focal length with which tilts and distances were computed, px."""
    findings: tuple[Finding, ...]
    """What is missing, and what to do next, the most important first; empty if the poses are
    enough."""

    @property
    def missing(self) -> tuple[str, ...]:
        """What to do next, one sentence each: the advice of the findings."""
        return tuple(finding.advice for finding in self.findings)

    @property
    def coverage(self) -> float:
        """Share of the lit cells that have corners, 0…1."""
        lit = int(self.field.sum())
        return float((self.covered & self.field).sum() / lit) if lit else 0.0

    @property
    def enough(self) -> bool:
        """Whether nothing is missing."""
        return not self.findings

    @property
    def missing_sides(self) -> tuple[int, ...]:
        """Which of ``SIDES`` have not been tilted towards the camera by enough."""
        return tuple(k for k, tilt in enumerate(self.tilts_deg) if tilt < COUNTED_TILT_DEG)

    @property
    def missing_regions(self) -> tuple[tuple[int, int], ...]:
        """Regions of the camera's image with too few corners: row and column, 0…2."""
        return tuple(
            place
            for place in np.ndindex(3, 3)
            if (lit := self.field[region_cells(place)]).any()
            and self.covered[region_cells(place)][lit].mean() < REGION_SHARE
        )

    def __str__(self) -> str:
        near, far = self.distances_mm
        tilts = ", ".join(
            f"{side.removesuffix(' side')} {tilt:.0f}°"
            for side, tilt in zip(SIDES, self.tilts_deg, strict=True)
        )
        seen = (
            f"{self.poses} pose{'s' * (self.poses != 1)}, {self.tilted} tilted: "
            f"{self.coverage:.0%} of the field; tilts {tilts}; distances {near:.0f}…{far:.0f} mm"
        )
        return f"{seen}; next: {self.missing[0]}" if self.missing else f"{seen}; enough"


def judge_poses(observations: Sequence[Observation], board: Board) -> PoseJudgement:
    """Judge the poses of a board that have been taken so far.

    Parameters
    ----------
    observations : sequence of Observation
        The poses so far; it may be empty.
    board : Board

    Returns
    -------
    PoseJudgement. It asks for twelve different poses, of which nine are tilted, a tilt to each of
    the four sides, poses that are nearer and further away, and corners in every region of the field
    that both devices see.

    Raises
    ------
    InputError for observations of cameras or projectors of different sizes.

    Notes
    -----
    Poses before calibration are rough. The camera is assumed to have square pixels, its principal
    point in the middle of the image and no distortion. Its focal length follows from the poses'
    homographies (Zhang, IEEE PAMI 22, 2000, doi:10.1109/34.888718), or is 1.5 times the longer side
    of the image while no pose is tilted. On the virtual rig, tilts are exact to 1° from two tilted
    poses on. Where the projector lights the camera's image is estimated by one homography through
    all corners, as if the boards were one plane.
    """
    need_opencv("judging poses")
    _check_sizes(observations)
    if not observations:
        nothing = np.zeros((CELLS, CELLS), bool)
        advice = "hold the board into the projector's light, where the camera sees all of it"
        hint = (Finding("poses", "no pose was taken", advice=advice, severity="note"),)
        return PoseJudgement(0, 0, nothing, (0.0,) * 4, nothing, (0.0,) * 4, (0.0, 0.0), 0.0, hint)
    observations = _moved(observations, board)
    corners = [_lit(o) for o in observations]
    field, low, high = _field(observations, corners)
    box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    covered = np.any([cells_of(pixels, box) for pixels, _ in corners], axis=0)
    focal = rough_focal_px(observations, board)
    poses = [rough_pose(o.view, board, focal, o.camera_size) for o in observations]
    normals = np.stack([T[:, 2] for T in poses])
    tilts = tilts_deg(normals)
    tilted = int(np.sum(normals[:, 2] <= np.cos(np.radians(TILTED_DEG))))
    distances = _distances_mm(poses, board)
    count = len(observations)
    ends = (min(distances), max(distances))
    found = PoseJudgement(count, tilted, field, box, covered, tilts, ends, focal, ())
    findings = (
        *(_tilt_asked(side, tilts[side]) for side in found.missing_sides),
        *(_region_asked(place) for place in found.missing_regions),
        *_missing_distances(distances),
        *_missing_poses(count, tilted),
    )
    return replace(found, findings=findings)


def region_cells(place: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the cells of a region by its row and column, 0…2."""
    step = CELLS // len(REGIONS)
    row, column = place
    return np.s_[row * step : (row + 1) * step, column * step : (column + 1) * step]


def rough_focal_px(observations: Sequence[Observation], board: Board) -> float:
    """Estimate the camera's focal length from poses, px; see ``judge_poses`` for what is assumed.

    Each homography H from the board to the image, with its origin in the middle, gives
    h₁ᵀωh₂ = 0 and h₁ᵀωh₁ = h₂ᵀωh₂ with ω = diag(1/f², 1/f², 1): linear in 1/f².
    """
    need_opencv("judging poses")
    side = max(observations[0].camera_size)
    above, below = FOCAL_WEIGHT / USUAL_FOCAL**2, FOCAL_WEIGHT
    for o in observations:
        H = _homography(o, board)
        if H is None:
            continue
        first, second = H[:, 0], H[:, 1]
        by_focal = np.array(
            [first[:2] @ second[:2], first[:2] @ first[:2] - second[:2] @ second[:2]]
        )
        rest = np.array([first[2] * second[2], first[2] ** 2 - second[2] ** 2])
        scale = first[:2] @ first[:2] + second[:2] @ second[:2]
        above -= by_focal @ rest / scale**2
        below += by_focal @ by_focal / scale**2
    low, high = FOCAL_RANGE
    return float(side / np.sqrt(np.clip(above / below, high**-2, low**-2)))


def _check_sizes(observations: Sequence[Observation]) -> None:
    for name in ("camera_size", "projector_size"):
        sizes = sorted({getattr(o, name) for o in observations})
        if len(sizes) > 1:
            raise InputError(
                f"observations: expected one {name.replace('_', ' ')}, got "
                + ", ".join(f"{w} × {h}" for w, h in sizes)
            )


def _moved(observations: Sequence[Observation], board: Board) -> list[Observation]:
    """The observations without those in which the board did not move since an earlier one."""
    numbered = [replace(o, name=str(k)) for k, o in enumerate(observations)]
    repeated = {int(name) for names in unmoved(numbered, board) for name in names[1:]}
    return [o for k, o in enumerate(observations) if k not in repeated]


def _lit(o: Observation) -> tuple[FloatMap, FloatMap]:
    """Corners that have projector coordinates: in the camera and in the projector, px."""
    lit = np.isfinite(o.found.projector_px).all(axis=1)
    return o.view.pixels[lit], o.found.projector_px[lit]


def _field(
    observations: Sequence[Observation], corners: list[tuple[FloatMap, FloatMap]]
) -> tuple[BoolMap, FloatMap, FloatMap]:
    """Cells of the camera's image that the projector lights, and the box that they divide, px."""
    frame_low, frame_high = np.full(2, -0.5), np.array(observations[0].camera_size) - 0.5
    pixels, projector = (np.concatenate(parts) for parts in zip(*corners, strict=True))
    H = cv2.findHomography(projector, pixels)[0]
    w, h = np.array(observations[0].projector_size) - 0.5
    border = np.array([[-0.5, -0.5, 1], [w, -0.5, 1], [w, h, 1], [-0.5, h, 1]])
    lit = None if H is None else border @ np.asarray(H, np.float64).T
    if lit is None or lit[:, 2].min() <= 0:
        # Too few corners, or all on a line: nothing is known about the projector's light.
        return np.ones((CELLS, CELLS), bool), frame_low, frame_high
    polygon = lit[:, :2] / lit[:, 2:]
    low = np.maximum(polygon.min(axis=0), frame_low)
    high = np.minimum(polygon.max(axis=0), frame_high)
    contour = polygon.astype(np.float32)
    middles = low + (high - low) * (np.arange(CELLS)[:, None] + 0.5) / CELLS
    field = [
        [cv2.pointPolygonTest(contour, (float(x), float(y)), False) >= 0 for x in middles[:, 0]]
        for y in middles[:, 1]
    ]
    return np.array(field), low, high


def cells_of(pixels: FloatMap, box_px: tuple[float, float, float, float]) -> BoolMap:
    """Return the cells of a box that have corners, (6, 6)."""
    found = np.zeros((CELLS, CELLS), bool)
    low, high = np.reshape(box_px, (2, 2))
    place = np.floor((pixels - low) / (high - low) * CELLS).astype(int)
    column, row = place[((place >= 0) & (place < CELLS)).all(axis=1)].T
    found[row, column] = True
    return found


def _homography(o: Observation, board: Board) -> FloatMap | None:
    """From the board, over its pitch, to the image from its middle, over its longer side."""
    size = np.array(o.camera_size, np.float64)
    places = board.points_mm[o.view.index, :2] / board.pitch_mm
    image = (o.view.pixels - 0.5 * (size - 1.0)) / size.max()
    H = cv2.findHomography(places - places.mean(axis=0), image)[0]
    return None if H is None else np.asarray(H, np.float64)


def rough_pose(
    view: BoardView, board: Board, focal_px: float, camera_size: tuple[int, int]
) -> FloatMap:
    """Return R and t of a board before the camera, (3, 4), mm, for an assumed focal length."""
    width, height = camera_size
    K = np.array(
        [[focal_px, 0.0, 0.5 * (width - 1)], [0.0, focal_px, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
    )
    points = board.points_mm[view.index]
    _, turn, shift = cv2.solvePnP(points, view.pixels, K, None, flags=cv2.SOLVEPNP_IPPE)
    return np.column_stack((np.asarray(cv2.Rodrigues(turn)[0]), np.ravel(shift)))


def tilts_deg(normals: FloatMap) -> tuple[float, float, float, float]:
    """Return the largest tilt of each of ``SIDES`` towards the camera, degrees."""
    # The normal points away from the camera: downwards where the bottom is the nearer side.
    down = np.degrees(np.arctan2(normals[:, 1], normals[:, 2]))
    right = np.degrees(np.arctan2(normals[:, 0], normals[:, 2]))
    top, bottom, left, right_side = (max(0.0, float(v.max())) for v in (-down, down, -right, right))
    return top, bottom, left, right_side


def _distances_mm(poses: list[FloatMap], board: Board) -> list[float]:
    """Distance of the board's middle from the camera in every pose, mm."""
    middle = board.points_mm.mean(axis=0)
    return [float(np.linalg.norm(T[:, :3] @ middle + T[:, 3])) for T in poses]


def _tilt_asked(side: int, tilt_deg: float) -> Finding:
    return _asked(
        "tilt",
        f"the {SIDES[side]} of the board was tilted towards the camera by {tilt_deg:.0f}° at most",
        f"tilt the {SIDES[side]} of the board towards the camera by {ADVISED_TILT_DEG:.0f}° or "
        "more",
        tilt_deg=tilt_deg,
    )


def _region_asked(place: tuple[int, int]) -> Finding:
    name = REGIONS[place[0]][place[1]]
    to = "to" if "edge" in name else "into"
    return _asked(
        "coverage",
        f"the {name} of the camera's image has too few corners",
        f"move the tilted board {to} the {name} of the camera's image",
    )


def _missing_distances(distances: list[float]) -> list[Finding]:
    usual = float(np.median(distances))
    share = f"by {100 * COUNTED_STEP:.0f} % or more than the usual distance"
    missing = []
    if min(distances) > (1.0 - COUNTED_STEP) * usual:
        advice = f"hold the board {100 * ADVISED_STEP:.0f} % nearer"
        missing.append(_asked("distances", f"no pose is nearer {share}", advice))
    if max(distances) < (1.0 + COUNTED_STEP) * usual:
        advice = f"hold the board {100 * ADVISED_STEP:.0f} % further away"
        missing.append(_asked("distances", f"no pose is further away {share}", advice))
    return missing


def _missing_poses(count: int, tilted: int) -> list[Finding]:
    more, more_tilted = ENOUGH_POSES - count, TILTED_POSES - tilted
    if more_tilted > 0:
        poses = f"{more_tilted} more pose{'s' * (more_tilted != 1)}"
        advice = f"take {poses} with the board tilted by {ADVISED_TILT_DEG:.0f}° or more"
        seen = f"{tilted} of {TILTED_POSES} poses are tilted by {TILTED_DEG:.0f}° or more"
        return [_asked("poses", seen, advice, tilted=float(tilted))]
    if more <= 0:
        return []
    advice = f"take {more} more pose{'s' * (more != 1)}"
    return [_asked("poses", f"{count} of {ENOUGH_POSES} poses were taken", advice)]


def _asked(kind: str, seen: str, advice: str, **figures: float) -> Finding:
    """What is missing while poses are taken: nothing is wrong yet."""
    return Finding(kind, seen, advice=advice, figures=figures, severity="note")
