"""A part against its drawing: a dent of 0.1 mm is found, with its depth and σ."""

import numpy as np

import fringeworks as fw
from fringeworks.simulate import Body, Optics, fringe_plan, height_field, look, photograph
from fringeworks.simulate import standard_rig as make_rig

# A wavy part of 80 × 60 mm, and the same with a dent of 4 mm, turned before the camera.
y, x = np.mgrid[-30:30.1:0.5, -40:40.1:0.5]
drawn = 4.0 * np.cos(x / 14.0 + 0.5) * np.cos(y / 17.0) + 0.05 * x
dented = drawn - 0.1 * np.maximum(1.0 - ((x - 12.0) ** 2 + (y - 5.0) ** 2) / 2.0**2, 0.0)
T = np.array([[0.96, 0.28, 0, 0], [0.28, -0.96, 0, 0], [0, 0, -1, 510.0], [0, 0, 0, 1]])
rig = make_rig(scale=0.4)
plan = fringe_plan(rig, both=False)
view = look(rig, [Body(height_field(dented, 0.5), T, 0.75)])
stack = fw.Stack(list(photograph(view, plan, Optics(noise=1.0, seed=0))), plan)
part = fw.surface.clean_cloud(fw.measure(stack, rig).points)

# Your own: part = fw.files.read_cloud("part.npz"); model = fw.files.read_model("part.stl").
shape = height_field(drawn, 0.5)
model = fw.TriangleMesh(shape.vertices_mm, shape.faces)
found = fw.deviation(part, model, tolerance_mm=0.3)  # where it lies is searched for
for spot in fw.evaluate.find_spots(found):
    print(f"{spot.depth_mm:.3f} ± {spot.sigma_mm:.3f} mm at {np.round(spot.place_mm, 1)}")

figure = found.plot("part")
fw.save_figure(figure, "deviation.png")
