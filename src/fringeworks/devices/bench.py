"""A virtual projector and a virtual camera before a scene, by name: for trials without hardware."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from fringeworks.devices.clock import Clock
from fringeworks.devices.protocols import Projector, TriggeredCamera
from fringeworks.devices.virtual_camera import CameraModel, VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.standard import board_body, board_poses, bust, standard_rig
from fringeworks.simulate.virtual_rig import View, look
from fringeworks.types import DeviceProblem, FloatMap, Rig

SCALE = 0.3
"""Frame sizes over those of the standard rig: 576 × 360 px are shown and 384 × 307 px seen, so that
a scan takes seconds."""
MODEL = CameraModel(fps=60.0, readout_s=0.004)
"""A camera that keeps step with a projector of 60 Hz."""
BOARD = "chessboard:11x8:12"
"""The board of the scenes ``board-0``, ``board-1`` and so on."""
POSES = 12
"""Number of poses of the board: as many as a calibration asks for."""
TABLE_PREFIX = "turntable-"
"""Beginning of the names of scenes with a turntable; its angle in degrees follows."""
TABLE_ELEVATION_DEG = 25.0
"""Angle by which the camera looks down at the turntable, degrees: it then sees the part and the
table's board."""
BUST_MIDDLE_MM = 18.0
"""Depth of the middle of the bust's foot behind its own origin, mm: the table's axis."""
DISTANCE_MM = 500.0
"""Distance of the objects, mm."""
RADIUS_MM = 40.0
"""Radius of the sphere, mm."""


def _middle() -> FloatMap:
    return pose(np.eye(3), np.array([0.0, 0.0, DISTANCE_MM]))


SCENES: dict[str, Callable[[], list[Body]]] = {
    "bust": bust,
    "plane": lambda: [Body(Plane(), _middle(), albedo=0.7)],
    "sphere": lambda: [Body(Sphere(RADIUS_MM), _middle(), albedo=0.7)],
}
"""Scenes by name; ``board-0`` to ``board-11`` are poses of a calibration board, and
``turntable-ANGLE`` is the bust on a turntable."""


PAINTED = "painted"
"""Name of the scene with the bust in patches of paint."""
PATCH_MM = 14.0
"""Side of the patches, mm."""
PAINTS = ((0.85, 0.75, 0.60), (0.80, 0.30, 0.25), (0.35, 0.75, 0.40), (0.30, 0.45, 0.85))
"""Reflectance of the patches for red, green and blue, relative to the bust's albedo: ivory, red,
green and blue paint with half of its light or less outside its own colour."""


def virtual_rig() -> Rig:
    """Return the true rig of the virtual bench: camera, projector and their relative pose.

    Examples
    --------
    >>> virtual_rig().camera.shape
    (307, 384)
    """
    return standard_rig(scale=SCALE)


def virtual_bench(
    scene: str = "", *, clock: Clock | None = None, seed: int = 0
) -> tuple[Projector, TriggeredCamera]:
    """Return a virtual projector and a virtual camera that look at a scene.

    Parameters
    ----------
    scene : str
        ``bust`` (the default), ``plane``, ``sphere``, or ``painted``, the bust in patches of paint;
        ``board-0`` to ``board-11``, twelve poses
        of a calibration board ``chessboard:11x8:12``, whose squares have 12 mm; or
        ``turntable-ANGLE``, the bust on a turntable that stands at this angle in degrees.
    clock : Clock, optional
        The machine's by default, so that frames take real time.
    seed : int
        Of the camera's noise.

    Returns
    -------
    projector, camera
        The projector has 576 × 360 px, the camera 384 × 307 px. ``virtual_rig`` is their true rig.

    Raises
    ------
    DeviceProblem for an unknown scene.

    Examples
    --------
    >>> projector, camera = virtual_bench("sphere")
    >>> projector.size_px, camera.limits().width_px
    ((576, 360), 384)
    """
    rig = virtual_rig()
    view = look(rig, _bodies("bust" if scene in ("", PAINTED) else scene))
    paint = _painted(view) if scene == PAINTED else None
    model = ProjectorModel(rig.projector.width_px, rig.projector.height_px)
    projector = VirtualProjector(model, clock=clock, seed=seed)
    return projector, VirtualCamera(RigScene(view, paint=paint), projector, MODEL, seed=seed)


def _painted(view: View) -> FloatMap:
    """Reflectance of patches of paint, (h, w, 3)."""
    across, down = (np.floor(np.nan_to_num(view.points_mm[..., k]) / PATCH_MM) for k in (0, 1))
    return np.asarray(np.array(PAINTS)[(across + 2 * down).astype(int) % len(PAINTS)])


def _bodies(scene: str) -> list[Body]:
    name, _, number = scene.partition("-")
    if name == "board" and number.isdecimal() and int(number) < POSES:
        board = parse_board(BOARD)
        return [board_body(board, board_poses(board, POSES)[int(number)])]
    if scene.startswith(TABLE_PREFIX) and _is_angle(scene.removeprefix(TABLE_PREFIX)):
        return _turned(float(scene.removeprefix(TABLE_PREFIX)))
    if scene not in SCENES:
        names = ", ".join(
            [*SCENES, PAINTED, "board-0", f"… board-{POSES - 1}", f"{TABLE_PREFIX}ANGLE"]
        )
        raise DeviceProblem(f"virtual scene {scene!r}: expected one of {names}")
    return SCENES[scene]()


def _is_angle(text: str) -> bool:
    """Whether a text is a finite number of plain digits."""
    return re.fullmatch(r"-?\d{1,4}(\.\d{1,6})?", text) is not None


def _turned(angle_deg: float) -> list[Body]:
    """The bust without its wall, turned about its own axis before a camera that looks down."""
    down = rotation(np.array([np.radians(TABLE_ELEVATION_DEG), 0.0, 0.0]))
    turn = rotation(np.array([0.0, np.radians(angle_deg), 0.0]))
    foot = np.array([0.0, 0.0, BUST_MIDDLE_MM])
    place = pose(down @ turn, np.array([0.0, 0.0, DISTANCE_MM]) - down @ turn @ foot)
    return bust(place)[:-1]
