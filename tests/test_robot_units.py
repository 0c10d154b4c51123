"""Units of robot poses: what a reading with another unit would look like is not believed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import inverse, pose, rotation
from fringeworks.rig.robot.base import base_camera
from fringeworks.rig.robot.readings import CONVENTIONS, readings_of
from tests.robots import board_places, robot, written

RADIANS = ("ur", "ros-rpy", "xyz:rad:m")
TURNS = np.linspace(-0.5, 0.5, 8)
"""Angles of a board about one axis, rad."""


def reading(word):
    """The first reading of a maker's name or of words."""
    return CONVENTIONS.get(word) or readings_of(word, ("xyz",))[0]


@pytest.mark.parametrize("mount", ["hand", "base"])
@pytest.mark.parametrize("word", RADIANS)
def test_radians_of_a_few_poses_are_no_motion_without_turns(word, mount):
    """As degrees, the turns of five poses are as small as the noise."""
    made = robot(935, 5, mount)
    numbers = written(made.T_base_flange, reading(word))
    found = made.calibrated(fw.rig.robot_poses(numbers))
    assert found.robot.poses_as == reading(word).spec
    assert (np.abs(made.error(found.robot.T_mount_camera)) < 5.0 * found.sigma).all()
    with pytest.raises(fw.InputError, match=f"they fit as {reading(word).spec}"):
        made.calibrated(fw.rig.robot_poses(numbers, "deg"))


@pytest.mark.parametrize("mount", ["hand", "base"])
def test_the_axis_that_is_named_is_that_of_the_right_side(mount):
    """Wrong readings turn as far about another axis: none is named then."""
    rng = np.random.default_rng(937)
    first, axis = board_places(rng, 1)[0], np.array([0.6, 0.0, 0.8])
    middle = pose(np.eye(3), np.array([0.0, 0.0, 500.0]))
    turns = [middle @ pose(rotation(a * axis), np.zeros(3)) @ inverse(middle) for a in TURNS]
    made = robot(937, mount=mount, places=[turn @ first for turn in turns], noise=(0.0, 0.0))
    there = made.X[:3, :3] @ axis
    for word in ("kuka", "ros", "ur"):
        written_as = written(made.T_base_flange, CONVENTIONS[word])
        with pytest.raises(fw.InputError, match=r"about one axis only \(by \d"):
            made.calibrated(fw.rig.robot_poses(written_as))
        numbers = fw.rig.robot_poses(written_as, word)
        with pytest.raises(fw.InputError, match="about one axis only") as said:
            made.calibrated(numbers)
        found = [float(n) for n in re.findall(r"[+-]\d\.\d\d", str(said.value))]
        assert abs(np.dot(found, there)) == pytest.approx(1.0, abs=0.02), word


def test_a_pose_in_the_other_unit_is_asked_about(tmp_path):
    """Numbers in mm at a robot that was calibrated in m, and the other way round."""
    made = robot(936)
    rig = fw.simulate.standard_rig()
    for length, other in (("mm", "m"), ("m", "mm")):
        here = replace(CONVENTIONS["ur"], length=length)
        found = made.calibrated(fw.rig.robot_poses(written(made.T_base_flange, here)))
        away = np.linalg.norm(made.T_base_flange[:, :3, 3], axis=1)
        assert found.robot.reach_mm == pytest.approx(np.median(away))
        fw.files.write_rig(tmp_path / "rig.toml", replace(rig, robot=found.robot))
        known = fw.files.read_rig(tmp_path / "rig.toml")
        assert known.robot.reach_mm == pytest.approx(found.robot.reach_mm, abs=1e-3)
        one = made.T_base_flange[:1]
        right = fw.rig.robot_poses(written(one, here))
        T, _ = base_camera(known, right)
        np.testing.assert_allclose(T, one[0] @ known.robot.T_mount_camera, atol=1e-6)
        wrong = written(one, replace(here, length=other))
        with pytest.raises(fw.InputError, match=rf"if the numbers are in {other}; at the calib"):
            base_camera(known, fw.rig.robot_poses(wrong))
        # A unit that is stated is taken.
        base_camera(known, fw.rig.robot_poses(wrong, length))


def test_a_reach_that_is_none_is_refused():
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(fw.InputError, match="reach_mm: expected mm > 0"):
            fw.rig.RobotFrame("hand", np.eye(4), reach_mm=wrong)


@pytest.mark.parametrize("mount", ["hand", "base"])
def test_a_wrong_unit_or_board_is_told_by_its_size(mount):
    """Matrices in m, and a board of another size, agree with the views but for one factor."""
    made = robot(938, 10, mount)
    metres = made.T_base_flange.copy()
    metres[:, :3, 3] /= 1000.0
    with pytest.raises(fw.InputError, match=r"the board has 0\.\d+ ± .* % of its stated"):
        made.calibrated(metres)
    large = "chessboard:11x8:24"
    for poses in (
        made.T_base_flange,
        fw.rig.robot_poses(written(made.T_base_flange, CONVENTIONS["kuka"]), "kuka"),
        fw.rig.robot_poses(written(made.T_base_flange, CONVENTIONS["ros"])),
    ):
        with pytest.raises(fw.InputError, match=r"the board has (50|49\.9).* ± .* % of"):
            made.calibrated(poses, board=large)
    with pytest.raises(fw.InputError, match="same order as the views, of the same moments"):
        made.calibrated(made.T_base_flange[::-1])
