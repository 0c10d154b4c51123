"""Two photographs of fringes, without and with the object, give a height map."""

import fringeworks as fw

# Your own: pair = fw.files.read_pair("plane.jpg", "part.jpg"), and its geometry from `calibrate-plane`.
pair = fw.simulate.standard_scene(
    "parabola", size=200, fringes=10, height_mm=50, noise=2, bits=8, seed=1
)
result = fw.reconstruct(pair, "windowed")
for note in result.notes:
    print(note)
print(f"{1 - result.surface.failed_fraction:.1%} of the pixels are measured")
fw.files.write_surface("pair.ply", result.surface)  # or .tif .npz .x3p .gsf

figure = result.plot("parabola")
fw.save_figure(figure, "pair.png")
