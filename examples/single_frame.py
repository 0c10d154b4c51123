"""One photograph is enough where the background around the object is a plane."""

import fringeworks as fw

# Your own: frame, _ = fw.files.read_frame("part.jpg"), and its geometry or None, which gives px.
scene = fw.simulate.standard_scene(
    "cylinder", size=200, fringes=10, height_mm=20, noise=2, bits=8, seed=1
)
single = fw.Pair(None, scene.object, geometry=scene.geometry)
result = fw.reconstruct(single, "fourier")
print(*result.notes, sep="\n")

figure = result.plot("cylinder, from one frame")
fw.save_figure(figure, "single_frame.png")
