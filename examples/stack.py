"""Shifted fringes tell for every camera pixel which projector pixel lights it."""

import fringeworks as fw
from fringeworks.simulate import Optics, bust, fringe_plan, look, photograph, standard_rig

# Your own: stack = fw.files.read_stack("shots/"), a folder of images with its plan.toml.
rig = standard_rig(scale=0.2)
plan = fringe_plan(rig)
stack = fw.Stack(list(photograph(look(rig, bust()), plan, Optics(noise=1.0, seed=1))), plan)

decoded = fw.decode(stack)
print(*decoded.notes, sep="\n")
fw.files.write_coordinates("coordinates.npz", decoded)

figure = decoded.x.plot("bust")
fw.save_figure(figure, "stack.png")
