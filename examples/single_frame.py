"""One photograph is enough where the background around the object is a plane."""

import numpy as np

import fringeworks as fw

# Your own: frame, _ = fw.files.read_frame("part.jpg"), and its geometry or None, which gives px.
scene = fw.simulate.standard_scene(
    "parabola", size=200, fringes=20, height_mm=20, noise=2, bits=8, seed=1
)
single = fw.Pair(None, scene.object, geometry=scene.geometry)
result = fw.reconstruct(single, "fourier")
print(*result.notes, sep="\n")
error = result.surface.values - scene.truth_mm
within = np.mean(abs(error) < 2 * result.surface.sigma)
print(f"{within:.0%} of the pixels are within 2 σ of the truth")

figure = result.plot("parabola, from one frame")
fw.save_figure(figure, "single_frame.png")
