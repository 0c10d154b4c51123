"""From files to files in processes of their own, as a user waits for them, and their start."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.decoding import noisy
from benchmarks.harness import PeerMissing, Result, compared, peer_module, rows, work
from benchmarks.triangulation import HEIGHT, WIDTH, rig, surface
from fringeworks import PatternPlan
from fringeworks.files import write_rig, write_stack
from fringeworks.files.ply import read_ply
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig.pinhole import project

COUNTS = (1, 8, 64)
SCRIPT = Path(__file__).parent / "scripts"
"""Programs as people write them, run in processes of their own."""


def ran(*words: str | Path) -> Callable[[], None]:
    """A call that runs a program and waits for it."""

    def run() -> None:
        done = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            # Signals are negative: a program that crashes is no measure.
            said = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
            raise PeerMissing(f"{words[0]}: {said[0]}")

    return run


def ours(*words: str | Path) -> Callable[[], None]:
    return ran("-m", "fringeworks", "--quiet", *words)


def frames_of(plan: PatternPlan, seen: np.ndarray) -> list[np.ndarray]:
    """What a camera sees of a plan at the projector's columns ``seen``."""
    waves = [
        20.0 + 200.0 * block.values(seen, k)
        for block in plan.blocks
        if isinstance(block, PhaseSteps)
        for k in range(block.frames)
    ]
    return list(noisy(np.array(waves), 2.0))


def plan_of(counts: tuple[int, ...], steps: int) -> PatternPlan:
    sets = tuple(PhaseSteps("x", WIDTH / v, equal_steps(steps)) for v in counts)
    return PatternPlan(WIDTH, HEIGHT, sets)


@work
def files_to_points() -> list[Result]:
    """12 PNG of 1920 × 1200 on disk to a PLY on disk, the whole process."""
    points, pixels = surface()
    plan = plan_of(COUNTS, 4)
    with TemporaryDirectory() as folder:
        place = Path(folder)
        write_stack(place / "capture", frames_of(plan, pixels[..., 0]), plan)
        write_rig(place / "rig.toml", rig())
        np.savez(place / "rig.npz", **matrices())
        mine, theirs = place / "ours.ply", place / "theirs.ply"

        def off(path: Path) -> float:
            """Root mean square error along z where the camera sees the points, mm."""
            vertices, _ = read_ply(path)
            xyz = np.stack([vertices[name] for name in "xyz"], axis=-1).astype(float)
            u, v = np.rint(project(rig().camera, xyz)).astype(int).T
            inside = (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
            error = xyz[inside, 2] - points[v[inside], u[inside], 2]
            return float(np.sqrt(np.mean(error**2)))

        return rows(
            lambda: compared(
                f"12 PNG to PLY, {WIDTH} x {HEIGHT}, whole process",
                "script with OpenCV and NumPy, distortion of the lenses left out",
                version("numpy"),
                ours("measure", place / "capture", "--rig", place / "rig.toml", "--out", mine),
                ran(SCRIPT / "points.py", place / "capture", place / "rig.npz", theirs),
                accuracy=lambda own: off(mine if own else theirs),
                limit_seconds=0.4,
            )
        )


def matrices() -> dict[str, Any]:
    """The rig as scripts hold it."""
    known = rig()

    def camera(device: Any) -> np.ndarray:
        (fx, fy), (cx, cy) = device.focal_px, device.principal_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    return {
        "camera": camera(known.camera),
        "projector": camera(known.projector),
        "pose": known.T_projector_camera,
    }


@work
def files_to_phase() -> list[Result]:
    """3 PNG on disk to their wrapped phase on disk, the whole process."""
    _, pixels = surface()
    plan = plan_of((64,), 3)
    peer_module("cv2")
    with TemporaryDirectory() as folder:
        place = Path(folder)
        write_stack(place / "capture", frames_of(plan, pixels[..., 0]), plan)
        mine, theirs = place / "ours.npz", place / "theirs.npz"

        return rows(
            lambda: compared(
                f"3 PNG to wrapped phase, {WIDTH} x {HEIGHT}, whole process",
                "OpenCV structured_light (its unwrapping crashes and is left out)",
                version("opencv-contrib-python-headless"),
                ours("decode", place / "capture", "--steps", "3", "--out", mine),
                ran(SCRIPT / "sinusoidal.py", place / "capture", theirs),
            )
        )


@work
def start_up() -> list[Result]:
    """A fresh interpreter until the package can be used, beside those of others."""

    def started(peer: str, module: str, statement: str) -> Result:
        peer_module(module)
        return compared(
            "start: import fringeworks as fw; fw.decode",
            statement,
            version(peer),
            ran("-c", "import fringeworks as fw; fw.decode"),
            ran("-c", statement),
        )

    def alone() -> Result:
        return compared(
            "start: fringeworks --version",
            "python -c pass",
            sys.version.split()[0],
            ran("-m", "fringeworks", "--version"),
            ran("-c", "pass"),
        )

    return rows(
        lambda: started("fringes", "fringes", "import fringes"),
        lambda: started(
            "scikit-image",
            "skimage.restoration",
            "from skimage.restoration import unwrap_phase",
        ),
        alone,
    )
