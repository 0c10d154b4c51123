"""Work that goes on until it is stopped: the live picture, and live points."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from functools import partial
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from fringeworks.devices.opening import open_devices
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.files.rig import read_rig
from fringeworks.files.setup import read_setup
from fringeworks.patterns.plan import PatternPlan, Uniform
from fringeworks.report.viewer.pack import pack_surface
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.ray_depth import main_axis
from fringeworks.scan.aiming import Aim, Shown, aiming
from fringeworks.scan.exposure import auto_exposure
from fringeworks.scan.glance import Glance, glance
from fringeworks.scan.live import live
from fringeworks.scan.poses import REGIONS, SIDES, PoseJudgement
from fringeworks.serving.worker import Link
from fringeworks.studio.tasks import poses_of, thinning
from fringeworks.studio.workspace import Workspace
from fringeworks.types import Axis, CameraSettings, FramesContradictPlan

SHORTEST_S = 0.1
"""Shortest time between two live pictures, s."""
LIVE_PX = 960
"""Longer side of a live picture, px."""
LIVE_POINTS = 60_000
"""Pixels of a live surface: beyond this, sending and drawing take longer than
measuring."""
RED, AMBER, GREEN = (230, 0, 0), (255, 176, 0), (0, 200, 90)
"""Colours of saturated pixels, of what is missing, and of what was found."""
FONT_PX = 13
"""Height of words in a live picture, px."""
BADGE_PX = 6
"""Distance of words in a live picture from its border, px."""


def live_picture(
    link: Link,
    devices: tuple[str, str],
    shown: Shown,
    level: float,
    exposure_ms: float | None,
    poses: tuple[Workspace, str] | None,
) -> None:
    """Send live pictures until told to stop.

    ``poses`` is the studio's folder, and the board: it is then looked for.
    """
    board = None if poses is None else parse_board(poses[1])
    projector, camera = open_devices(*devices)
    with projector, camera:
        for seen in aiming(projector, camera, shown, level=level, exposure_ms=exposure_ms):
            begun = time.monotonic()
            drawn = _figures(seen)
            step = drawn["step"]
            picture = _painted(seen, step)
            if board is not None and poses is not None:
                judgement = poses_of(*poses).judgement
                found = glance(seen.brightness, board, judgement)
                drawn["board"] = "no board is seen" if found is None else str(found)
                _paint_board(picture, found, judgement, step)
            file = BytesIO()
            picture.save(file, "JPEG", quality=85)
            link.show("picture", drawn | {"jpeg": file.getvalue()})
            if link.stopped():
                return
            time.sleep(max(0.0, SHORTEST_S - (time.monotonic() - begun)))


def _figures(seen: Aim) -> dict[str, Any]:
    """What is said beside a live picture, and the values below the cursor."""
    step = max(1, -(-max(seen.brightness.shape) // LIVE_PX))
    modulation = seen.modulation
    return {
        "step": step,
        "size": list(seen.brightness[::step, ::step].shape[::-1]),
        "brightness": _bytes(seen.brightness[::step, ::step]),
        "modulation": None if modulation is None else _bytes(modulation[::step, ::step]),
        "mean_share": float(seen.brightness.mean()),
        "saturated_share": float(seen.saturated.mean()),
        "sharpness": seen.sharpness,
        "fringes": seen.contrast,
        "advice": seen.advice,
    }


def _bytes(share: NDArray[Any]) -> bytes:
    return np.clip(np.rint(255.0 * share), 0, 255).astype(np.uint8).tobytes()


def _painted(seen: Aim, step: int) -> Image.Image:
    """A live picture with the saturated pixels red."""
    grey = np.clip(255.0 * seen.brightness[::step, ::step], 0, 255).astype(np.uint8)
    picture = np.repeat(grey[..., None], 3, axis=2)
    picture[seen.saturated[::step, ::step]] = RED
    return Image.fromarray(picture)


def _paint_board(
    picture: Image.Image, found: Glance | None, judgement: PoseJudgement, step: int
) -> None:
    """Paint corners that were found, regions without corners, and tilts that are missing."""
    draw = ImageDraw.Draw(picture)
    width, height = picture.size
    if found is not None:
        for x, y in found.view.pixels / step:
            draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=GREEN)
    if not judgement.poses:
        return
    left, top, right, bottom = (v / step for v in judgement.box_px)
    across, down = (right - left) / len(REGIONS), (bottom - top) / len(REGIONS)
    for row, column in judgement.missing_regions:
        x, y = left + column * across, top + row * down
        draw.rectangle((x + 2, y + 2, x + across - 3, y + down - 3), outline=AMBER, width=2)
    middle = width / 2, height / 2
    anchors = (
        ((middle[0], BADGE_PX), "ma"),
        ((middle[0], height - BADGE_PX), "md"),
        ((BADGE_PX, middle[1]), "lm"),
        ((width - BADGE_PX, middle[1]), "rm"),
    )
    font = ImageFont.load_default(FONT_PX)
    for side in judgement.missing_sides:
        place, anchor = anchors[side]
        text = f"tilt the {SIDES[side]} towards the camera"
        box = draw.textbbox(place, text, anchor=anchor, font=font)
        draw.rectangle((box[0] - 3, box[1] - 2, box[2] + 3, box[3] + 2), fill="black")
        draw.text(place, text, fill=AMBER, anchor=anchor, font=font)


def find_exposure(link: Link, devices: tuple[str, str]) -> float | None:
    """The exposure that suits the scene, ms."""
    link.progress("looking for the exposure")
    projector, camera = open_devices(*devices)
    with projector, camera:
        return auto_exposure(projector, camera).exposure_ms


class _Stopped(Exception):
    """The page has asked to stop while the devices were waited for."""


def _opened_again(
    link: Link, devices: tuple[str, str], settings: CameraSettings
) -> tuple[Projector, Camera]:
    """Devices that had failed, with their settings."""
    if link.stopped():
        raise _Stopped
    projector, camera = open_devices(*devices)
    camera.configure(settings)
    return projector, camera


def live_points(link: Link, devices: tuple[str, str], setup: str, rig: str) -> None:
    """Measure and send points until told to stop."""
    link.progress("opening the devices")
    stored, known = read_setup(setup), read_rig(rig)
    plan = along(stored.plan, main_axis(known))
    projector, camera = open_devices(*devices)
    numbers = itertools.count(1)
    with projector, camera:
        camera.configure(stored.settings)
        link.progress("measuring")
        while True:
            try:
                clouds = live(
                    projector,
                    camera,
                    plan,
                    known,
                    delay=stored.delay,
                    reopen=partial(_opened_again, link, devices, stored.settings),
                    progress=partial(link.show, "moved"),
                )
                for cloud in clouds:
                    every = thinning(cloud.points.reason.size, LIVE_POINTS)
                    packed = pack_surface(cloud.points, camera=known, every=every, title="live")
                    number = next(numbers)
                    link.show("cloud", {"number": number, "said": str(cloud), "data": packed.data})
                    if link.stopped():
                        return
            except _Stopped:
                return
            except FramesContradictPlan as moved:
                # Something has moved between the frames; the next ones may be good.
                link.show("moved", str(moved))
                if link.stopped():
                    return


def along(plan: PatternPlan, axis: Axis) -> PatternPlan:
    """Return the part of a plan that varies along an axis: points need no more."""
    blocks = tuple(b for b in plan.blocks if isinstance(b, Uniform) or b.axis == axis)
    return plan if axis not in plan.axes else replace(plan, blocks=blocks, bits_in_turn=False)
