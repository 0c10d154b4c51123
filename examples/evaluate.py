"""How good is a measurement? A calibrated ball tells, in the terms of VDI/VDE 2634."""

import numpy as np

import fringeworks as fw
from fringeworks.simulate import Body, Optics, Sphere, fringe_plan, look, photograph, standard_rig

ball = np.eye(4)
ball[:3, 3] = (5.0, 3.0, 500.0)  # its centre before the camera, mm
rig = standard_rig(scale=0.3)
plan = fringe_plan(rig, both=False)
frames = list(photograph(look(rig, [Body(Sphere(25.0), ball)]), plan, Optics(seed=1)))
points = fw.measure(fw.Stack(frames, plan), rig).points

# Your own: fw.fit("ball.ply", "sphere", diameter_mm=50.0) with your ball's diameter.
found = fw.fit(points, "sphere", diameter_mm=50.0)
print(found.figures["bodies"][0])

figure = points.profile(((150, 155), (255, 155)), level=True).plot("ball of 50 mm")
fw.save_figure(figure, "evaluate.png")
