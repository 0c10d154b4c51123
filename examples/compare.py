"""Which method suits one's own photographs? Compare them, also where no true height is known."""

from dataclasses import replace

import fringeworks as fw

# Your own: pairs = ["part/", "cup/"], folders that `fw.files.write_pair` or you have described.
scene = fw.simulate.standard_scene(
    "sphere", size=160, fringes=10, height_mm=30, noise=2, bits=8, seed=1
)
pairs = {"sphere": replace(scene, truth_mm=None)}
found = fw.evaluate.compare_captures(pairs, ["windowed", "fourier", "wavelet"])
columns = ("method", "measured_fraction", "median_sigma", "median_abs_difference")
print(fw.report.format_table([{name: row[name] for name in columns} for row in found[0].rows()]))

figure = found[0].plot()
fw.save_figure(figure, "compare.png")
