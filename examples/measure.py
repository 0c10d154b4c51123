"""A stack of frames and a calibrated rig give points in millimetres."""

import fringeworks as fw
from fringeworks.simulate import Optics, bust, fringe_plan, look, photograph, standard_rig

# Your own: rig = fw.files.read_rig("rig.toml"); stack = fw.files.read_stack("part/").
rig = standard_rig(scale=0.2)
plan = fringe_plan(rig, both=False)
stack = fw.Stack(list(photograph(look(rig, bust()), plan, Optics(noise=1.0, seed=1))), plan)

found = fw.measure(stack, rig)
print(*found.notes, sep="\n")
fw.files.write_points("bust.ply", found.points, kind="mesh")  # or .xyz .npz

figure = found.plot("bust")
fw.save_figure(figure, "measure.png")
