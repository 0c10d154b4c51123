"""Two cameras and a projector above them, by the ray caster: captures of any plan, and boards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy
from PIL import Image

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.patterns.encode import encode
from fringeworks.rig import MultiRig, camera_pair
from fringeworks.rig.pinhole import look_at, rotation
from fringeworks.types import Pinhole
from tests.ray_caster import Ball, Photographs, Sheet, Tube, _rays

MIDDLE = np.array([0.0, 0.0, 500.0])
NX, NY, SQUARE_MM = 9, 6, 14.0
BOARD = f"chessboard:{NX}x{NY}:{SQUARE_MM:g}"


def rig_of_two(scale: float = 0.2, *, angle_deg: float = 25.0, up_deg: float = 10.0) -> MultiRig:
    """Cameras of unlike frames and lenses; the projector is not on their baseline."""
    w, h, f = int(1280 * scale), int(1024 * scale), 2150 * scale
    one = Pinhole(w, h, (f, f * 1.001), (w / 2 + 3.3, h / 2 - 2.7), (-0.10, 0.12, 4e-4, -3e-4, 0.0))
    other = Pinhole(
        w + 16,
        h - 8,
        (f * 1.06, f * 1.059),
        (w / 2 - 4.1, h / 2 + 5.2),
        (-0.08, 0.06, -2e-4, 5e-4, 0.0),
    )
    projector = Pinhole(
        int(512 * scale) * 2,
        int(768 * scale),
        (1500 * scale, 1502 * scale),
        (520 * scale, 600 * scale),
        (-0.05, 0.03, 2e-4, -4e-4, 0.0),
    )
    a, b = np.radians(angle_deg), np.radians(up_deg)
    eye = MIDDLE + 500 * np.array([np.sin(a), 0.02, -np.cos(a)])
    lamp = np.array([np.sin(a / 2) * np.cos(b), -np.sin(b), -np.cos(a / 2) * np.cos(b)])
    poses = np.stack([np.eye(4), look_at(eye, MIDDLE)])
    return MultiRig((one, other), projector, look_at(MIDDLE + 520 * lamp, MIDDLE), poses)


def alone(rig: MultiRig) -> MultiRig:
    """The cameras, and a projector of which nothing is known."""
    return replace(rig, projector=None, T_projector_camera=None)


def scene_of(seed: int):
    """A sheet with a ball and two tubes before it: each hides other parts from each camera."""
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.array([0.0, np.radians(rng.uniform(5, 20)), 0.0]))
    pose[2, 3] = 540 + rng.uniform(-10, 10)
    place = (rng.uniform(-25, 5), rng.uniform(-20, 20), 480 + rng.uniform(-10, 10))
    return [
        Sheet(pose),
        Ball(place, rng.uniform(18, 30), 0.85),
        Tube((rng.uniform(30, 45), 0, 500), (0.2, 1, 0.1), rng.uniform(6, 10), 0.6),
        Tube((0, rng.uniform(35, 45), 490), (1, 0.1, 0.05), rng.uniform(4, 7), 0.7),
    ]


def plan_of(rig: MultiRig, kind: str) -> fw.PatternPlan:
    """Fringes along both axes, along one, or with a Gray code along both."""
    w, h = rig.projector.width_px, rig.projector.height_px
    if kind == "gray":
        blocks = [Uniform("white"), Uniform("black")]
        for axis, size in (("x", w), ("y", h)):
            blocks += [PhaseSteps(axis, 16.0, equal_steps(4)), GrayCode(axis, 8.0, size)]
        return fw.PatternPlan(w, h, tuple(blocks))
    return fw.simulate.fringe_plan(camera_pair(rig, 0), both=kind == "both")


def _moved(body, T):
    R, t = T[:3, :3], T[:3, 3]
    if isinstance(body, Ball):
        return replace(body, centre_mm=tuple(R @ np.array(body.centre_mm) + t))
    if isinstance(body, Tube):
        place = tuple(R @ np.array(body.point_mm) + t)
        return replace(body, point_mm=place, axis=tuple(R @ np.array(body.axis)))
    return replace(body, pose=T @ body.pose)


def captures(rig, bodies, plan, *, seed, blur_px=0.5, noise=1.0, gains=(1.0, 0.65), over=2):
    """A stack for every camera, of unequal exposure, and the bodies before each."""
    pictures = [scipy.ndimage.gaussian_filter(p / 255.0, 0.6, mode="nearest") for p in encode(plan)]
    stacks, seen = [], []
    for k, gain in enumerate(gains):
        own = [_moved(body, rig.T_camera_first[k]) for body in bodies]
        light = Photographs(camera_pair(rig, k), own, over=over)
        rng = np.random.default_rng(10 * seed + k)
        even, (u, v) = light._seen(light.ambient, blur_px), np.moveaxis(light.projected, -1, 0)
        frames = []
        for picture in pictures:
            shown = scipy.ndimage.map_coordinates(picture, [v, u], order=1, mode="nearest")
            clean = gain * (even + 3.0 + light._seen(light.light * shown, blur_px))
            counts = np.rint(clean + noise * rng.standard_normal(clean.shape))
            frames.append(np.clip(counts, 0, 255).astype(np.uint8))
        stacks.append(fw.Stack(frames, plan))
        seen.append(own)
    return stacks, seen


def errors_mm(cloud: fw.PointCloud, camera: Pinhole, bodies) -> np.ndarray:
    """Distance of points from the truth along their rays; a pixel on a rim shows either surface."""
    h, w = camera.shape
    pixels = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1).astype(float)

    def depth(at):
        ways = _rays(camera, at)
        return np.min([body.hit(np.zeros(3), ways) for body in bodies], axis=0)

    far, middle = np.linalg.norm(cloud.xyz_mm.astype(float), axis=-1), depth(pixels)
    error = far - middle
    for offset in np.ndindex(3, 3):
        other = depth(pixels + 0.9 * (np.array(offset) - 1.0))
        rim = (np.abs(other - middle) > 5.0) & (np.abs(far - other) < np.abs(error))
        error = np.where(rim, far - other, error)
    return error


def write_boards(rig: MultiRig, folder: Path, *, seed: int, poses: int) -> None:
    """Photographs of a board, left01.png and right01.png, as OpenCV's samples name them."""
    rng = np.random.default_rng(seed)
    for pose in range(1, poses + 1):
        tilt, side = np.radians(rng.uniform(12, 32)), rng.uniform(0, 2 * np.pi)
        turn = np.array([tilt * np.cos(side), tilt * np.sin(side), rng.uniform(-0.3, 0.3)])
        T = np.eye(4)
        T[:3, :3] = rotation(turn) @ rotation(np.array([0.0, -np.radians(12.0), 0.0]))
        half = np.array([(NX - 1) * SQUARE_MM / 2, (NY - 1) * SQUARE_MM / 2, 0.0])
        off = np.array([rng.uniform(-18, 18), rng.uniform(-14, 14), rng.uniform(-40, 40)])
        T[:3, 3] = MIDDLE + off - T[:3, :3] @ half
        for camera, first, name in zip(
            rig.cameras, rig.T_camera_first, ("left", "right"), strict=True
        ):
            (folder / name).mkdir(parents=True, exist_ok=True)
            image = _board(camera, first @ T, rng)
            Image.fromarray(image).save(folder / name / f"{name}{pose:02d}.png")


def _board(camera: Pinhole, T, rng, *, over: int = 3):
    h, w = camera.shape
    y, x = ((np.arange(n * over) + 0.5) / over - 0.5 for n in (h, w))
    ways = _rays(camera, np.stack(np.meshgrid(x, y), axis=-1))
    along = (T[:3, 3] @ T[:3, 2]) / (ways @ T[:3, 2])
    place = (along[..., None] * ways - T[:3, 3]) @ T[:3, :3] / SQUARE_MM
    i, j = np.floor(place[..., 0]), np.floor(place[..., 1])
    printed = (i >= -1) & (i < NX) & (j >= -1) & (j < NY) & ((i + j) % 2 == 0)
    paper = (i >= -2) & (i <= NX) & (j >= -2) & (j <= NY)
    light = scipy.ndimage.gaussian_filter(
        np.where(printed, 18.0, np.where(paper, 170.0, 60.0)), 0.5 * over
    )
    seen = light.reshape(h, over, w, over).mean(axis=(1, 3))
    return np.clip(np.rint(seen + rng.standard_normal(seen.shape)), 0, 255).astype(np.uint8)
