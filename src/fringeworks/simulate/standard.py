"""The standard rig, on which calibration and measurement are tested, and scenes for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.pinhole import look_at, pose, rotation
from fringeworks.simulate.bodies import Body, Box, Cylinder, Paraboloid, Plane, Sphere
from fringeworks.types import FloatMap, InputError, MultiRig, Pinhole, Rig

DISTANCE_MM = 500.0
"""Distance from the camera to the middle of the field, mm: usual for a field of 200 mm."""
TILT_DEG = (15.0, 35.0)
"""Smallest and largest tilt of a board, degrees: less determines focal lengths weakly, with more
the squares become too short in one direction."""
PERIODS_ACROSS_X = (59, 64, 70)
"""Numbers of periods of the three sets of fringes across the projector's columns. Their beats have
5 and 6 periods, and 6 − 5 = 1, which resolves the fringe order everywhere. On 1920 px the periods
are about 30 px, short enough for small noise."""
PERIODS_ACROSS_Y = (37, 40, 44)
"""The same across the projector's rows: beats of 3, 4 and 1, and about 30 px on 1200 px."""
CAMERA_ANGLE_DEG = 20.0
"""Angle between the projector's axis and that of each camera of ``standard_cameras``, degrees. Two
cameras on both sides are 40° apart, so that both see boards tilted by 35°."""
CAMERA_PLACES = ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Places of the cameras of ``standard_cameras``, in these angles from the projector."""
WALL_ALBEDO = 0.35
"""Reflectance of the wall behind the bust, 0…1: darker than the bust, as a laboratory's wall."""


def standard_rig(*, scale: float = 1.0, baseline_mm: float = 280.0) -> Rig:
    """Build the standard rig: a field of 200 mm at 500 mm, with lens distortion in both devices.

    Parameters
    ----------
    scale : float > 0
        Frame sizes over those of a camera of 1280 × 1024 px and a projector of 1920 × 1200 px; 0.5
        has a quarter of the pixels and the same field.
    baseline_mm : float > 0
        Distance of the two pupils, mm.

    Returns
    -------
    Rig without a covariance.

    Examples
    --------
    >>> rig = standard_rig(scale=0.5)
    >>> rig.camera.shape, round(rig.baseline_mm)
    ((512, 640), 280)
    """
    camera = Pinhole(
        round(1280 * scale),
        round(1024 * scale),
        (3150.0 * scale, 3152.0 * scale),
        (648.0 * scale, 509.0 * scale),
        (-0.12, 0.15, 4e-4, -3e-4, 0.0),
    )
    projector = Pinhole(
        round(1920 * scale),
        round(1200 * scale),
        (4100.0 * scale, 4096.0 * scale),
        (968.0 * scale, 610.0 * scale),
        (-0.05, 0.04, -3e-4, 5e-4, 0.0),
    )
    middle = np.array([0.0, 0.0, DISTANCE_MM])
    return Rig(camera, projector, look_at(np.array([baseline_mm, 8.0, 0.0]), middle))


def standard_cameras(*, scale: float = 1.0, cameras: int = 2) -> MultiRig:
    """Build a rig of several standard cameras around a standard projector.

    Parameters
    ----------
    scale : float > 0
        As for ``standard_rig``.
    cameras : int, 1…4
        The second camera is on the projector's other side. The third and fourth stand above and
        below the projector.

    Returns
    -------
    MultiRig without a covariance. All devices look at the middle of the field, which is at the same
    distance from all of them; neighbours are ``CAMERA_ANGLE_DEG`` apart.

    Raises
    ------
    InputError for another number of cameras.

    Examples
    --------
    >>> rig = standard_cameras(scale=0.5)
    >>> len(rig.cameras), rig.cameras[1].shape
    (2, (512, 640))
    """
    if not 1 <= cameras <= len(CAMERA_PLACES):
        raise InputError(f"cameras: expected 1 to {len(CAMERA_PLACES)}, got {cameras}")
    one = standard_rig(scale=scale)
    middle = np.array([0.0, 0.0, DISTANCE_MM])

    def seen_from(across: float, up: float) -> FloatMap:
        """Pose of a device at two angles from the projector."""
        a, b = np.radians(CAMERA_ANGLE_DEG * (across + 1.0)), np.radians(CAMERA_ANGLE_DEG * up)
        eye = DISTANCE_MM * np.array([np.sin(a) * np.cos(b), -np.sin(b), -np.cos(a) * np.cos(b)])
        return look_at(middle + eye, middle)

    poses = np.stack([np.eye(4), *(seen_from(*place) for place in CAMERA_PLACES[1:cameras])])
    # The further cameras differ a little from the first, as cameras of one type do.
    devices = [one.camera]
    for k in range(1, cameras):
        x, y = one.camera.principal_px
        moved = (x - 9.0 * k * scale, y + 7.0 * k * scale)
        fx, fy = (f * (1.0 + 0.004 * k) for f in one.camera.focal_px)
        devices.append(replace(one.camera, principal_px=moved, focal_px=(fx, fy)))
    return MultiRig(tuple(devices), one.projector, seen_from(0.0, 0.0), poses)


def cropped_field(
    rig: Rig, columns: tuple[int, int] | None = None, rows: tuple[int, int] | None = None
) -> Rig:
    """Make the projector's field smaller, so that its edge falls on a board or an object.

    Parameters
    ----------
    rig : Rig
    columns, rows : (int, int), optional
        First pixel that remains and the one after the last; all by default.

    Returns
    -------
    Rig with a smaller projector, whose pixels shine where they did before; without a covariance.

    Raises
    ------
    InputError for pixels that the projector does not have.

    Examples
    --------
    >>> rig = standard_rig(scale=0.5)
    >>> cropped_field(rig, columns=(0, 600)).projector.width_px
    600
    """
    old = rig.projector
    (left, right), (top, bottom) = columns or (0, old.width_px), rows or (0, old.height_px)
    for name, first, stop, size in (
        ("columns", left, right, old.width_px),
        ("rows", top, bottom, old.height_px),
    ):
        if not 0 <= first < stop <= size:
            raise InputError(f"{name}: expected 0 <= first < stop <= {size}, got {first}, {stop}")
    x, y = old.principal_px
    smaller = replace(
        old,
        width_px=right - left,
        height_px=bottom - top,
        principal_px=(x - left, y - top),
    )
    return Rig(rig.camera, smaller, rig.T_projector_camera)


def widened_frame(rig: Rig, margin_px: int) -> Rig:
    """Make the camera's frame larger on all sides, for blurs that reach over its border.

    Parameters
    ----------
    rig : Rig
    margin_px : int ≥ 0
        By how much; even, so that a mosaic of filters stays where it is.

    Returns
    -------
    Rig without a covariance. A blur takes the border's pixels to go on outside of the frame. With a
    margin that is cut off the frames afterwards, it gets the light that is really there.

    Examples
    --------
    >>> rig = standard_rig(scale=0.1)
    >>> widened_frame(rig, 8).camera.shape, rig.camera.shape
    ((118, 144), (102, 128))
    """
    old = rig.camera
    wider = replace(
        old,
        width_px=old.width_px + 2 * margin_px,
        height_px=old.height_px + 2 * margin_px,
        principal_px=(old.principal_px[0] + margin_px, old.principal_px[1] + margin_px),
    )
    return Rig(wider, rig.projector, rig.T_projector_camera)


def fringe_plan(rig: Rig, *, both: bool = True, steps: int = 4) -> PatternPlan:
    """Plan three sets of fringes along x, and along y as well.

    Parameters
    ----------
    rig : Rig
    both : bool
        Whether to plan fringes along y; calibration needs them.
    steps : int
        Number of phase steps of each set.
    """
    width, height = rig.projector.width_px, rig.projector.height_px
    along_x = [PhaseSteps("x", width / n, equal_steps(steps)) for n in PERIODS_ACROSS_X]
    along_y = [PhaseSteps("y", height / n, equal_steps(steps)) for n in PERIODS_ACROSS_Y]
    return PatternPlan(width, height, (*along_x, *(along_y if both else ())))


def board_poses(board: Board, count: int = 12, *, seed: int = 0) -> list[FloatMap]:
    """Choose poses of a board before the standard rig, tilted by 15° to 35° to all sides.

    Parameters
    ----------
    board : Board
    count : int
        Number of poses.
    seed : int
        Seed of the random part of tilts and positions.

    Returns
    -------
    list of (4, 4) arrays, T_camera_board, mm.
    """
    rng = np.random.default_rng(seed)
    from_middle = pose(np.eye(3), -board.points_mm.mean(axis=0))
    poses: list[FloatMap] = []
    for k in range(count):
        tilt = np.radians(rng.uniform(*TILT_DEG))
        side = 2.0 * np.pi * k / count + rng.uniform(-0.2, 0.2)
        turn = rotation(
            np.array([tilt * np.cos(side), tilt * np.sin(side), rng.uniform(-0.3, 0.3)])
        )
        place = [rng.uniform(-20, 20), rng.uniform(-15, 15), DISTANCE_MM + rng.uniform(-40, 50)]
        poses.append(pose(turn, np.array(place)) @ from_middle)
    return poses


def board_body(board: Board, T_camera_board: FloatMap) -> Body:
    """Make a body of a board in a pose (4, 4), mm: a sheet with the board's pattern."""
    left, top, right, bottom = board.extent_mm
    sheet = Plane(right - left, bottom - top, (0.5 * (left + right), 0.5 * (top + bottom)))
    return Body(sheet, T_camera_board, board.albedo)


def bust(T_camera_scene: FloatMap | None = None, *, albedo: float = 0.75) -> list[Body]:
    """Build a head on shoulders from simple bodies, 120 mm tall, before a wall.

    Parameters
    ----------
    T_camera_scene : (4, 4) array, optional
        Pose of the scene, mm; 500 mm straight ahead by default.
    albedo : float, 0…1
        Reflectance of the bust.
    """
    straight_ahead = pose(np.eye(3), np.array([0.0, 0.0, DISTANCE_MM]))
    T = straight_ahead if T_camera_scene is None else T_camera_scene

    def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0, 0, 0)) -> FloatMap:
        return T @ pose(rotation(np.array(turn, float)), np.array([x, y, z]))

    def eye(x: float, y: float) -> Body:
        return Body(Sphere(5.5), at(x, y, -22.5), albedo)

    return [
        Body(Sphere(30.0), at(0, -22, 5), albedo),
        Body(Sphere(26.0), at(0, -6, 1), albedo),
        Body(Cylinder(14.0, 40.0), at(0, 30, 8), albedo),
        Body(Sphere(8.0), at(0, 12, -19), albedo),
        # The nose is a cap that opens away from the camera.
        Body(Paraboloid(7.0, 14.0), at(0, -9, -23, (np.pi, 0, 0)), albedo),
        eye(-10.5, -18),
        eye(10.5, -18),
        Body(Cylinder(16.0, 110.0), at(0, 58, 14, (0, 0, np.pi / 2)), albedo),
        Body(Box((60.0, 26.0, 40.0)), at(0, 70, 18), albedo),
        Body(Plane(), at(0, 0, 60), WALL_ALBEDO),
    ]


def truth_distance(points_mm: FloatMap, measured_mm: FloatMap) -> FloatMap:
    """Return the signed error along the camera's ray, mm: positive where measured too far away.

    Parameters
    ----------
    points_mm : (..., 3) array
        True points in camera coordinates, mm.
    measured_mm : (..., 3) array
        Measured points, mm.
    """
    error = np.asarray(measured_mm, np.float64) - points_mm
    length = np.linalg.norm(points_mm, axis=-1)
    return np.asarray(np.sum(error * points_mm, axis=-1) / length)
