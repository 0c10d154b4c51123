"""A flat board in several poses calibrates the camera, the projector and their places."""

import fringeworks as fw

board = fw.rig.parse_board("chessboard:11x8:12")  # inner corners, and the side of a square in mm

# Your own: found = fw.calibrate("board/", board), a folder with one stack for each pose.
found = fw.calibrate(fw.data.board(), board)
print(fw.rig.verdict(found).text)
for finding in fw.rig.diagnose(found):
    print(finding.line)
fw.files.write_rig("rig.toml", found.rig)

figure = found.plot()
fw.save_figure(figure, "calibrate.png")
