"""What is shown of a hand–eye calibration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.summary import origin
from fringeworks.rig.robot.hand_eye import HandEye
from fringeworks.types.numbers import number, sigma_text


def figures(found: HandEye) -> dict[str, Any]:
    """The transform with its standard deviations, and how well every pose agrees."""
    robot, noise = found.robot, found.robot.noise
    return {
        "text": found.text,
        "mount": robot.mount,
        "poses_as": robot.poses_as,
        robot.name: robot.T_mount_camera.tolist(),
        "rotation_sigma_deg": np.degrees(found.sigma[:3]).tolist(),
        "translation_sigma_mm": found.sigma[3:].tolist(),
        "board_sigma_mm": found.board_sigma_mm,
        "distance_mm": found.distance_mm,
        "T_base_board" if robot.mount == "hand" else "T_flange_board": (
            found.T_other_board.tolist()
        ),
        "robot_noise_mm": None if noise is None else noise.translation_mm,
        "robot_noise_deg": None if noise is None else noise.rotation_deg,
        "robot_noise_estimated": found.noise_estimated,
        "corner_px": found.corner_px,
        "converged": found.converged,
        "poses": [
            {
                "name": name,
                "used": bool(used),
                "left_out_mm": float(off),
                "left_out_sigma_mm": float(sigma),
            }
            for name, used, off, sigma in zip(
                found.names, found.used, found.left_out_mm, found.left_out_sigma_mm, strict=True
            )
        ],
        "findings": findings_as_dicts(found.findings),
        **origin(found.provenance),
    }


def words(found: HandEye, _: dict[str, Any]) -> Iterator[Word]:
    """The transform, every pose as the others predict it, and what was found."""
    yield found.text
    rows = [
        [name, number(off, sigma), sigma_text(sigma), "" if used else "left out"]
        for name, off, sigma, used in zip(
            found.names, found.left_out_mm, found.left_out_sigma_mm, found.used, strict=True
        )
    ]
    yield Rows(["pose", "predicted by the others, off by mm", "expected, mm", ""], rows)
    yield from found.findings


describe(HandEye, Kind(figures, words))
