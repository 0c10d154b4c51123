"""``python -m benchmarks.hand_eye``: σ of hand–eye calibrations, and OpenCV's methods beside it.

Random set-ups with 15 poses each, robot noise of 0.05 mm and 0.01° per axis, corners of 0.02 px.
OpenCV's methods get the same poses of the board, which are fitted to all corners of a view. They
are in OpenCV 4; the bindings of 5.0 do not have them.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import pose, transform
from fringeworks.rig.robot.board_views import seen_boards
from fringeworks.rig.robot.readings import inverses
from tests.robots import BOARD, NOISE, Robot, bound, robot, the_rig

METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
"""OpenCV's, by the ends of their names."""
FIRST_SEED = 31_000
"""No seed from here on was used while the method was built."""


def opencv_transforms(made: Robot) -> list[Any]:
    """X by each of OpenCV's methods."""
    import cv2

    board = fw.rig.parse_board(BOARD)
    names = [str(k) for k in range(len(made.views))]
    M = seen_boards(made.views, board, the_rig(), names).T_camera_board
    B = made.T_base_flange if made.mount == "hand" else inverses(made.T_base_flange)
    found = []
    for name in METHODS:
        R, t = cv2.calibrateHandEye(
            list(B[:, :3, :3]),
            list(B[:, :3, 3]),
            list(M[:, :3, :3]),
            list(M[:, :3, 3]),
            method=getattr(cv2, f"CALIB_HAND_EYE_{name}"),
        )
        found.append(pose(np.asarray(R), np.ravel(t)))
    return found


def least(made: Robot) -> tuple[float, float, float]:
    """The errors (rms) that no unbiased estimate can undercut, as ``errors`` has them."""
    C = bound(made)
    total = 0.0
    for p in np.array([[x, y, 500.0] for x in (-60, 0, 60) for y in (-40, 0, 40)]):
        x, y, z = made.X[:3, :3] @ p
        J = np.hstack(([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], np.eye(3)))
        total += np.trace(J @ C @ J.T) / 9.0
    turn, shift = np.trace(C[:3, :3]), np.trace(C[3:, 3:])
    return float(np.sqrt(shift)), float(np.degrees(np.sqrt(turn))), float(np.sqrt(total))


def errors(made: Robot, T: Any) -> tuple[float, float, float]:
    """Of translation (mm), rotation (degrees), and of points 500 mm before the camera (mm)."""
    error = made.error(T)
    points = np.array([[x, y, 500.0] for x in (-60, 0, 60) for y in (-40, 0, 40)])
    off = transform(T, points) - transform(made.X, points)
    size = np.linalg.norm(error[3:]), np.degrees(np.linalg.norm(error[:3]))
    return float(size[0]), float(size[1]), float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def main() -> None:
    """Print the shares within 1 and 2 σ, and the errors beside those of OpenCV."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--setups", type=int, default=20)
    parser.add_argument("--draws", type=int, default=20, help="noise of each set-up")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    chosen = parser.parse_args()
    for mount in ("hand", "base"):
        z, ours, theirs, limits = [], [], [], []
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.setups):
            limits.append(least(robot(seed, mount=mount, noise=(0.0, 0.0), corner_px=0.0)))
            for draw in range(chosen.draws):
                made = robot(seed, mount=mount, draw=draw)
                for noise in (NOISE, None):
                    found = made.calibrated(noise=noise)
                    z.append(made.error(found.robot.T_mount_camera) / found.sigma)
                    if noise is not None:
                        ours.append(errors(made, found.robot.T_mount_camera))
                theirs.append([errors(made, T) for T in opencv_transforms(made)])
        report(mount, np.abs(z), np.array(ours), np.array(theirs), np.array(limits), chosen.draws)


def report(mount: str, z: Any, ours: Any, theirs: Any, limits: Any, draws: int) -> None:
    """Print what one kind of set-up shows."""
    for name, part in (("noise stated", z[0::2]), ("estimated", z[1::2])):
        first = part[::draws]
        print(
            f"{mount}, {name}: within 1 σ {np.mean(part < 1):.1%}, 2 σ {np.mean(part < 2):.1%} "
            f"(first draws alone {np.mean(first < 1):.1%}, {np.mean(first < 2):.1%})"
        )
    setups = len(ours) // draws
    for k, name in enumerate(("translation, mm", "rotation, °", "points at 500 mm, mm")):
        one = np.sqrt(np.mean(ours[:, k].reshape(setups, draws) ** 2, axis=1))
        other = np.sqrt(np.mean(theirs[:, :, k].reshape(setups, draws, -1) ** 2, axis=1))
        middle = np.median(other, axis=1)
        ratio, reach = middle / one, middle / limits[:, k]
        near = np.sqrt(np.mean((one / limits[:, k]) ** 2))
        single = theirs[:, :, k] >= ours[:, k, None]
        each = np.sqrt(np.mean(other**2, axis=0)).round(4).tolist()
        print(
            f"{mount}, {name}: ours {np.sqrt(np.mean(one**2)):.4f}, "
            f"{dict(zip(METHODS, each, strict=True))}; "
            f"median of the five over ours {np.median(ratio):.2f} ({ratio.min():.2f} … "
            f"{ratio.max():.2f}), over the limit of Cramér and Rao {np.median(reach):.2f}; ours "
            f"over that limit {near:.3f}; best of the five over ours, worst set-up "
            f"{(other.min(axis=1) / one).min():.2f}; ours is better in "
            f"{single.mean(axis=0).round(2).tolist()} of single draws"
        )


if __name__ == "__main__":
    main()
