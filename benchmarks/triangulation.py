"""Coordinates to points, and stacks to points, against streaming their bytes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.harness import Result, against, compared, peak_mb, peer_module, rows, streamer, work
from fringeworks import Decoded, PatternPlan, Rig
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig import Pinhole, Triangulator
from fringeworks.rig.pinhole import look_at, project, rays, transform
from fringeworks.signal import CameraNoise
from fringeworks.simulate import look, standard_rig
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan
from fringeworks.stack import Decoder
from fringeworks.types import CoordinateMap, FloatMap

WIDTH, HEIGHT = 1920, 1200
NEVER = 10**9
"""Stacks between two judgements: what a live loop does most of the time is measured."""


def rig() -> Rig:
    """Distortion on both sides, and a covariance, as a calibration leaves them."""
    camera = Pinhole(WIDTH, HEIGHT, (4000.0, 4000.0), (960.0, 600.0), (-0.1, 0.1, 1e-4, 1e-4, 0.0))
    projector = Pinhole(1920, 1200, (4000.0, 4000.0), (960.0, 600.0), (-0.05, 0.04, 1e-4, 1e-4, 0))
    sigma = np.array([0.05, 0.05, 0.1, 0.1, *[1e-4] * 5] * 2 + [1e-6] * 3 + [1e-3] * 3)
    pose = look_at(np.array([200.0, 0.0, 0.0]), np.array([0.0, 0.0, 500.0]))
    return Rig(camera, projector, pose, np.diag(sigma**2), (0.01, 0.01))


def surface() -> tuple[FloatMap, FloatMap]:
    """Points of a wavy surface, and where the projector lights them."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    depth = 500.0 + 20.0 * np.sin(u / 100.0) + 10.0 * np.cos(v / 80.0)
    points = rays(rig().camera, np.stack((u, v), axis=-1)) * depth[..., None]
    return points, project(rig().projector, transform(rig().T_projector_camera, points))


def decoded(pixels: FloatMap, axes: str) -> Decoded:
    """Those coordinates as decoding would hand them on."""
    maps = {}
    for k, axis in enumerate("xy"):
        sigma = np.full((HEIGHT, WIDTH), 0.03, np.float32)
        found = CoordinateMap(
            pixels[..., k].astype(np.float32),
            sigma,
            sigma,
            sigma,
            np.zeros((HEIGHT, WIDTH), np.uint8),
            "x" if axis == "x" else "y",
            (30.0,),
        )
        maps[axis] = found if axis in axes else None
    return Decoded(maps["x"], maps["y"], CameraNoise(2.0))


def results(both: bool) -> list[Any]:
    """Arrays as large as a point cloud's."""
    maps = [np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(3 if both else 2)]
    points = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    return [points, *maps, np.zeros((HEIGHT, WIDTH), np.uint8)]


def judged(
    name: str,
    ours: Callable[[], Any],
    stream: Callable[[], Any],
    limit: float,
    error: float,
    repeats: int = 41,
) -> Result:
    found = compared(
        name,
        "copy in, fill out, 2 threads",
        version("numpy"),
        ours,
        stream,
        limit_ratio=1.0 / limit,
        repeats=repeats,
    )
    return replace(found, accuracy=error, peak_mb=peak_mb(ours))


@work
def triangulation() -> list[Result]:
    """One axis and both, 1920 × 1200, into memory that is there."""
    points, pixels = surface()
    found = []
    with ThreadPoolExecutor(2) as pool:
        for axes in ("x", "xy"):
            known = decoded(pixels, axes)
            prepared = Triangulator(rig())
            earlier = prepared.triangulate(known)
            error = float(np.abs(earlier.xyz_mm - points).max())
            assert error < 1e-3, error
            inputs = [
                a for m in known.maps.values() for a in (m.coordinate_px, m.sigma_px, m.reason)
            ]
            stream = streamer(inputs, results(len(axes) == 2), pool)

            def ours(known: Any = known, by: Triangulator = prepared, out: Any = earlier) -> Any:
                return by.triangulate(known, out=out)

            name = f"triangulate {axes}, {WIDTH} x {HEIGHT}"
            found.append(judged(name, ours, stream, 1.5, error))
    return found


@work
def frames_to_points() -> list[Result]:
    """Twelve frames, decoded and triangulated."""
    points, pixels = surface()
    plan = PatternPlan(
        1920, 1200, tuple(PhaseSteps("x", 1920 / v, equal_steps(4)) for v in (1, 8, 64))
    )
    rng = np.random.default_rng(0)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = 20.0 + 200.0 * block.values(pixels[..., 0], k)
            frames.append(np.rint(light + 2.0 * rng.standard_normal(light.shape)).astype(np.uint8))
    live = Decoder(plan, (HEIGHT, WIDTH), rig=rig(), judge_every=NEVER)
    two = Decoder(plan, (HEIGHT, WIDTH), judge_every=NEVER)
    prepared = Triangulator(rig())
    live.points(frames)
    cloud = prepared.triangulate(two.decode(frames))
    off = np.linalg.norm(cloud.xyz_mm - points, axis=-1) / np.linalg.norm(points, axis=-1) * 500
    with ThreadPoolExecutor(2) as pool:
        stream = streamer(frames, results(False), pool)
        error = float(np.nanmedian(off))
        name = f"12 frames to points, {WIDTH} x {HEIGHT}"
        return [
            judged(f"{name}, one call", lambda: live.points(frames), stream, 2.5, error),
            judged(
                f"{name}, two calls",
                lambda: prepared.triangulate(two.decode(frames), out=cloud),
                stream,
                3.0,
                error,
            ),
        ]


@work
def noisy_frames_to_points() -> list[Result]:
    """Twelve frames of a bust between two judgements, noisy ones against nearly clean ones.

    Noise of 2 counts leaves a quarter of the fringe orders ambiguous, on which neighbours vote.
    """
    bench = standard_rig()
    plan = fringe_plan(bench, both=False)
    view = look(bench, bust())

    def live(noise: float) -> Callable[[], Any]:
        frames = list(photograph(view, plan, Optics(noise=noise, seed=5)))
        decoder = Decoder(plan, frames[0].shape, frames[0].dtype, rig=bench, judge_every=NEVER)
        decoder.points(frames)
        return lambda: decoder.points(frames)

    found = compared(
        "12 frames to points of a bust, noise of 2 counts, 1280 x 1024",
        "own, noise of 0.5 counts",
        version("fringeworks"),
        live(2.0),
        live(0.5),
        limit_ratio=1.0 / 12.0,
        repeats=21,
    )
    return [replace(found, limit_seconds=0.1)]


@work
def triangulation_opencv() -> list[Result]:
    """Both axes, against OpenCV's undistortion and linear triangulation."""
    points, pixels = surface()
    known = decoded(pixels, "xy")
    prepared = Triangulator(rig())
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    left, right = (np.ascontiguousarray(p.reshape(-1, 1, 2)) for p in (np.dstack((u, v)), pixels))
    cv2 = peer_module("cv2")

    def matrix(device: Pinhole) -> FloatMap:
        (fx, fy), (cx, cy) = device.focal_px, device.principal_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def theirs() -> FloatMap:
        camera, projector = rig().camera, rig().projector
        one = cv2.undistortPoints(left, matrix(camera), np.array(camera.distortion))
        two = cv2.undistortPoints(right, matrix(projector), np.array(projector.distortion))
        pose = rig().T_projector_camera[:3]
        found = cv2.triangulatePoints(np.eye(3, 4), pose, one[:, 0].T, two[:, 0].T)
        return np.asarray((found[:3] / found[3]).T.reshape(HEIGHT, WIDTH, 3))

    return rows(
        lambda: against(
            f"triangulate xy, {WIDTH} x {HEIGHT}, with standard deviations",
            "OpenCV undistortPoints and triangulatePoints, without",
            version("opencv-contrib-python-headless"),
            lambda: prepared.triangulate(known).xyz_mm,
            theirs,
            lambda xyz: float(np.sqrt(np.nanmean((xyz - points) ** 2))),
            repeats=3,
        )
    )
