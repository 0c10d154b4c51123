"""A stack of frames and a calibrated rig give points in millimetres."""

import fringeworks as fw

# Your own: rig = fw.files.read_rig("rig.toml"); stack = fw.files.read_stack("part/").
folder = fw.data.bust()
rig = fw.files.read_rig(folder / "rig.toml")
stack = fw.files.read_stack(folder / "bust")

found = fw.measure(stack, rig)
print(*found.notes, sep="\n")
fw.files.write_points("bust.ply", found.points, kind="mesh")  # or .xyz .npz

figure = found.plot("bust")
fw.save_figure(figure, "measure.png")
