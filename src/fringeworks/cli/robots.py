"""``fringeworks hand-eye``: where the camera is on a robot; options of points in its base."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import JsonFile, PlanFile, items

if TYPE_CHECKING:
    from fringeworks.rig import RobotPoses

SECTION = "Stacks and rigs"
POSES_AS = (
    "How the robot writes its poses: ur, kuka, abb, fanuc, yaskawa, staubli, ros …, or words such "
    "as zyx:deg:mm. What is left out is found by the board views, or refused."
)
"""Help of the option, which has one meaning everywhere."""


class MountName(StrEnum):
    """Where the camera is."""

    hand = "hand"
    base = "base"


class FrameName(StrEnum):
    """Coordinates of points."""

    camera = "camera"
    robot = "robot"


@dataclass(frozen=True)
class RobotOptions:
    """In which coordinates points are written."""

    frame: Annotated[
        FrameName,
        typer.Option("--in", help="Coordinates of the points: camera, or robot for its base."),
    ] = FrameName.camera
    robot_pose: Annotated[
        str | None,
        typer.Option(
            help="Pose of the flange with the camera in the hand: its numbers separated by "
            "commas, or a file in which the capture's name or a single pose stands."
        ),
    ] = None
    poses_as: Annotated[str, typer.Option(help=f"{POSES_AS} For one pose: as at `hand-eye`.")] = ""

    def check(self) -> None:
        """Refuse options that have nothing to act on."""
        if self.frame == FrameName.camera and (self.robot_pose is not None or self.poses_as):
            raise fw.InputError("--robot-pose, --poses-as: expected together with --in robot")
        if self.robot_pose is None and self.poses_as:
            raise fw.InputError("--poses-as: expected together with --robot-pose")

    def check_before(self, rig: fw.Rig, name: str) -> None:
        """Refuse before frames are taken what ``placed`` refuses afterwards."""
        from fringeworks.rig.robot.base import base_camera

        self.check()
        if self.frame == FrameName.robot:
            base_camera(rig, self._given(name))

    def placed(self, found: Any, rig: fw.Rig, name: str) -> Any:
        """A measurement or its points in the coordinates that were asked for."""
        if self.frame == FrameName.camera:
            return found
        pose = self._given(name)
        if isinstance(found, fw.PointCloud):
            return fw.rig.in_base(found, rig, pose)
        return replace(found, points=fw.rig.in_base(found.points, rig, pose))

    def _given(self, name: str) -> RobotPoses | None:
        return None if self.robot_pose is None else self._pose(self.robot_pose, name)

    def _pose(self, given: str, name: str) -> RobotPoses:
        if not output.is_there(given):
            return fw.files.parse_robot_pose(given, self.poses_as)
        poses = fw.files.read_robot_poses(given, self.poses_as)
        if len(poses) == 1:
            return poses
        names = [one for one in (name, Path(name).stem) if one in poses.names]
        if not names:
            raise fw.InputError(
                f"--robot-pose: expected one pose or one with the name {name}, got {len(poses)}"
            )
        if poses.names.count(names[0]) > 1:
            raise fw.InputError(
                f"--robot-pose: expected one pose with the name {names[0]}, got "
                f"{poses.names.count(names[0])}"
            )
        return poses.at([poses.names.index(names[0])])


@app.command(
    "hand-eye",
    rich_help_panel=SECTION,
    epilog="Example: fringeworks hand-eye shots/ --robot-poses poses.csv --rig rig.toml "
    "--board chessboard:11x8:12 --mount hand --out robot.toml",
)
def hand_eye(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder with a capture, or a photograph, of the board in each pose."),
    ],
    poses: Annotated[
        Path,
        typer.Option(
            "--robot-poses",
            help="Poses of the robot, with the names of the captures or in their order: .csv, "
            ".txt, .json, or a robot's program.",
        ),
    ],
    rig_file: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    board: Annotated[str, typer.Option(help="Board: as for `calibrate`.")],
    mount: Annotated[
        MountName,
        typer.Option(help="hand: the camera moves with the flange; base: it stands beside it."),
    ],
    out: Annotated[Path, typer.Option("--out", help="Rig file with the camera's place (.toml).")],
    poses_as: Annotated[str, typer.Option(help=POSES_AS)] = "",
    robot_noise: Annotated[
        str | None,
        typer.Option(
            help="Standard deviations of the robot's poses, mm and degrees, as 0.05,0.01; by "
            "default from the residuals."
        ),
    ] = None,
    plan: PlanFile = None,
    json_file: JsonFile = None,
) -> None:
    """Calibrate where the camera is on a robot, from poses in which it sees a board."""
    words = output.Output(out, json_file)
    output.check(out, "rig")
    noise = None if robot_noise is None else _noise(robot_noise)
    rig = fw.files.read_rig(rig_file)
    known = fw.files.read_robot_poses(poses, poses_as)
    with output.progress() as progress:
        found = fw.rig.hand_eye(
            known, folder, board, rig, mount=mount.value, noise=noise, plan=plan, progress=progress
        )
    with output.target(out, ".toml") as place:
        fw.files.write_rig(place, replace(rig, robot=found.robot))
    figures = fw.report.summarise(found)
    output.write_json(json_file, figures)
    words.tell(found, figures)
    words.wrote(out)


def _noise(text: str) -> tuple[float, float]:
    values = items(float, text, "robot-noise")
    if len(values) != 2:
        raise fw.InputError(
            f"--robot-noise: expected mm and degrees, as 0.05,0.01, got {len(values)} values"
        )
    return values[0], values[1]
