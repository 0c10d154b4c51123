"""Shifted fringes tell for every camera pixel which projector pixel lights it."""

import fringeworks as fw

# Your own: stack = fw.files.read_stack("shots/"), a folder of images with its plan.toml.
stack = fw.files.read_stack(fw.data.bust() / "bust")

decoded = fw.decode(stack)
print(*decoded.notes, sep="\n")
fw.files.write_coordinates("coordinates.npz", decoded)

figure = decoded.x.plot("bust")
fw.save_figure(figure, "stack.png")
