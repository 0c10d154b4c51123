"""A flat board in several poses calibrates the camera, the projector and their places."""

import fringeworks as fw
from fringeworks.simulate import (
    board_body,
    board_poses,
    fringe_plan,
    look,
    photograph,
    standard_rig,
)

board = fw.rig.parse_board("chessboard:11x8:12")  # inner corners, and the side of a square in mm
rig = standard_rig(scale=0.3)
plan = fringe_plan(rig)
poses = {}
for number, pose in enumerate(board_poses(board, 6)):
    view = look(rig, [board_body(board, pose)])
    poses[f"pose {number}"] = fw.Stack(list(photograph(view, plan)), plan)

# Your own: found = fw.calibrate("board/", board), a folder with one stack for each pose.
found = fw.calibrate(poses.items(), board)
print(fw.rig.verdict(found).text)
for finding in fw.rig.diagnose(found):
    print(finding.line)
fw.files.write_rig("rig.toml", found.rig)

figure = found.plot()
fw.save_figure(figure, "calibrate.png")
