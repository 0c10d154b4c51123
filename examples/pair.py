"""Two photographs of fringes, without and with the object, give a height map."""

import fringeworks as fw

# Your own: pair = fw.files.read_pair("plane.jpg", "part.jpg").
# The command `calibrate-plane` gives its geometry.
pair = fw.read(fw.data.ball())
result = fw.reconstruct(pair, "windowed")
for note in result.notes:
    print(note)
print(f"{1 - result.surface.failed_fraction:.1%} of the pixels are measured")
fw.files.write_surface("pair.ply", result.surface)  # or .tif .npz .x3p .gsf

figure = result.plot("ball")
fw.save_figure(figure, "pair.png")
