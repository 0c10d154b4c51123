"""``python -m release.sample_data --out FOLDER``: the sample data of a release, as one archive.

A set for each way to measure, made by the simulators with the faults that all of them share
switched on: a response that is no power, blur by depth in both devices, a black that is not dark,
room light, read and shot noise, 8 bits, and light between the surfaces; the pair is painted.
Colour filters, JPEG, highlights, light in the material, the grid of projector pixels and motion
are not in it.

The archive's hash goes into ``fringeworks/files/sample_sets.py``; ``--write-hash`` puts it there.
``--check`` refuses an archive with another hash, as the release does before it publishes one.
Equal machines make equal archives. Others may differ in the last count of a few pixels, so the
archive that a release has is the one whose hash it knows.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fringeworks as fw
from fringeworks.files import sample_sets as place
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate import (
    Body,
    Box,
    Cylinder,
    Optics,
    Plane,
    SCurve,
    Sphere,
    ThinLens,
    board_body,
    board_poses,
    bust,
    fringe_plan,
    look,
    photograph,
    standard_rig,
    standard_scene,
)
from fringeworks.simulate.interreflection import interreflection

SCALE = 0.3
"""Size of the frames, as a share of 1280 × 1024 px: five sets then fit into the archive."""
BOARD = "chessboard:11x8:12"
POSES, VIEWS, PARTS = 8, 4, 5
MOST_MB = 50.0
"""Largest archive, MB of 10⁶ bytes."""
TIMELESS = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the archive, the earliest that ZIP knows: equal data are equal archives."""
DEFECT_MM = 0.4
"""By how much the step of the last part of the batch is too high, mm."""


def optics(seed: int) -> Optics:
    """Everything that is wrong with both devices."""
    return Optics(
        response=SCurve(alpha=2.2, beta=1.8, offset=0.4),
        projector_lens=ThinLens(510.0, 4.0),
        camera_lens=ThinLens(505.0, 3.0),
        defocus_px=0.5,
        blur_px=0.5,
        pixel_px=0.9,
        exposure=1.1,
        ambient=0.05,
        black=0.02,
        noise=1.5,
        gain=0.03,
        seed=seed,
    )


def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    """A pose, mm and rad."""
    return pose(rotation(np.array(turn, float)), np.array([x, y, z]))


def stack(folder: Path, rig: fw.Rig, bodies: list[Body], seed: int, *, both: bool = False) -> None:
    """Frames of bodies, with their true depth. A board needs none, and lights nothing else."""
    view, plan = look(rig, bodies), fringe_plan(rig, both=both)
    light = [] if both else [interreflection(view, bodies, patch_px=16)]
    truth = None if both else {"depth_mm": view.points_mm[..., 2].astype(np.float32)}
    frames = photograph(view, plan, optics(seed), transport=light)
    fw.files.write_stack(folder, list(frames), plan, truth=truth)


def make_pair(folder: Path, scale: float) -> None:
    """Two frames over a reference plane."""
    scene = standard_scene(
        "sphere",
        size=max(64, round(1667 * scale)),
        fringes=25,
        painted=True,
        gamma=2.2,
        ambient=0.05,
        noise=1.5,
        gain=0.03,
        bits=8,
        seed=1,
    )
    fw.files.write_pair(folder / "part", scene)


def make_stack(folder: Path, scale: float) -> None:
    """A bust, and the rig."""
    rig = standard_rig(scale=scale)
    stack(folder / "bust", rig, bust(), 2)
    fw.files.write_rig(folder / "rig.toml", rig)


def make_board(folder: Path, scale: float) -> None:
    """Poses of a chessboard, to calibrate the rig from."""
    rig, board = standard_rig(scale=scale), fw.rig.parse_board(BOARD)
    for k, T in enumerate(board_poses(board, POSES, seed=3)):
        stack(folder / f"pose_{k}", rig, [board_body(board, T)], 10 + k, both=True)


def make_views(folder: Path, scale: float) -> None:
    """A part from several sides, turned on a table."""
    rig = standard_rig(scale=scale)
    for k in range(VIEWS):
        turned = at(0.0, 0.0, 510.0) @ at(0.0, 0.0, 0.0, (0.0, 2.0 * np.pi * k / VIEWS, 0.0))
        bodies = [
            Body(Box((70.0, 50.0, 30.0)), turned, 0.7),
            Body(Cylinder(14.0, 60.0), turned @ at(10.0, -35.0, 0.0), 0.6),
            Body(Sphere(16.0), turned @ at(-28.0, -35.0, 4.0), 0.8),
        ]
        stack(folder / f"view_{k}", rig, bodies, 30 + k)
    fw.files.write_rig(folder / "rig.toml", rig)


def make_batch(folder: Path, scale: float) -> None:
    """Parts with a step of 10 mm, the last one too high."""
    rig = standard_rig(scale=scale)
    for k in range(PARTS):
        high = 10.0 + 0.01 * (k - 2) + (DEFECT_MM if k == PARTS - 1 else 0.0)
        bodies = [
            Body(Plane(), at(0.0, 0.0, 520.0), 0.6),
            Body(Box((60.0, 60.0, high)), at(0.5 * k, 0.0, 520.0 - 0.5 * high), 0.75),
        ]
        stack(folder / f"part_{k}", rig, bodies, 50 + k)
    fw.files.write_rig(folder / "rig.toml", rig)


SETS: dict[str, Callable[[Path, float], None]] = {
    "pair": make_pair,
    "stack": make_stack,
    "board": make_board,
    "views": make_views,
    "batch": make_batch,
}
"""What makes each set."""


def build(folder: Path, *, scale: float = SCALE) -> None:
    """Make all sets in a folder, each in one of its own."""
    assert tuple(SETS) == place.SAMPLES
    for name, make in SETS.items():
        (folder / name).mkdir(parents=True)
        make(folder / name, scale)
        print(f"made {name}", flush=True)


def pack(folder: Path, archive: Path) -> str:
    """Put a folder into an archive; its SHA-256."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name[:1] != ".")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
        for path in files:
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), TIMELESS)
            entry.external_attr = 0o644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            made.writestr(entry, path.read_bytes())
    size = archive.stat().st_size / 1e6
    assert size <= MOST_MB, f"{size:.1f} MB"
    digest = hashlib.sha256(archive.read_bytes()).hexdigest()
    print(f"{archive}: {len(files)} files, {size:.1f} MB, sha256 {digest}")
    return digest


def main() -> int:
    """Make the archive, and store or check its hash where asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the archive")
    hashes = parser.add_mutually_exclusive_group()
    hashes.add_argument("--write-hash", action="store_true", help="store the hash in the package")
    hashes.add_argument("--check", action="store_true", help="refuse an archive of another hash")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        build(Path(folder))
        digest = pack(Path(folder), given.out / place.ARCHIVE)
    if given.write_hash:
        source = Path(place.__file__)
        text = source.read_text(encoding="utf-8")
        source.write_text(re.sub(r'(?m)^SHA256 = ".*"$', f'SHA256 = "{digest}"', text))
    if given.check and digest != place.SHA256:
        print(
            f"{place.ARCHIVE}: expected the hash {place.SHA256}, got {digest}; publish the archive "
            "that the package knows, or store the hash of this one with --write-hash"
        )
        return 1
    print(f"{given.out / place.ARCHIVE}: {digest}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
