"""Draw the pictures of docs/concepts.md: ``make gallery`` runs it."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import fringeworks as fw
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look

PICTURES = Path(__file__).parent / "images" / "concepts"
SCALE = 0.4
"""Size of the frames over 1280 × 1024 px: pictures are small."""


def two_frames() -> Figure:
    """A reference row and an object row, and what their distance makes."""
    scene = fw.simulate.standard_scene(
        "parabola", size=400, fringes=12, height_mm=60, noise=1, bits=8
    )
    found = fw.reconstruct(scene, "windowed").surface
    figure, (frames, rows, heights) = plt.subplots(1, 3, figsize=(9, 2.8), layout="constrained")
    frames.imshow(scene.object, cmap="gray")
    frames.axhline(200, color="tab:red")
    frames.set(title="object under fringes", xticks=[], yticks=[])
    rows.plot(scene.reference[200, 100:300], label="reference s(x)")
    rows.plot(scene.object[200, 100:300], label="object d(x) = s(x − u)")
    rows.set(title="the red row, columns 100 to 300", xlabel="column / px", ylabel="counts")
    rows.legend(fontsize=7, loc="lower left")
    heights.plot(found.values[200])
    heights.set(title="height of the row", xlabel="column / px", ylabel="mm")
    return figure


def stack() -> fw.Decoded:
    """A bust before the virtual rig, decoded with all of its phases."""
    rig = standard_rig(scale=SCALE)
    plan = fringe_plan(rig, both=False)
    frames = list(photograph(look(rig, bust()), plan, Optics(noise=1.0)))
    return fw.decode(frames, plan, keep_phases=True)


def orders() -> Figure:
    """Phases of three sets, their beat, and the coordinate without jumps."""
    found = stack()
    row = found.x.phase_rad.shape[1] // 2
    figure, axes = plt.subplots(1, 3, figsize=(9, 2.8), layout="constrained")
    phases = np.where(found.x.reason[row] == 0, found.x.phase_rad[:, row], np.nan)
    axes[0].plot(np.arange(400, 450), phases[0, 400:450], ".-", linewidth=0.5, markersize=3)
    axes[0].set(title="phase of one set: it repeats", xlabel="column / px", ylabel="rad")
    beat = np.angle(np.exp(1j * (phases[1] - phases[0] - (phases[2] - phases[1]))))
    axes[1].plot(beat, ".", markersize=1.5, color="tab:orange")
    axes[1].set(title="beat of three sets: once", xlabel="column / px", ylabel="rad")
    axes[2].plot(found.x.coordinate_px[row], ".", markersize=1.5, color="tab:green")
    axes[2].set(title="projector coordinate", xlabel="column / px", ylabel="px")
    return figure


def ripple() -> Figure:
    """Error of the phase under γ = 2.2 for three numbers of steps."""
    phase = np.linspace(-np.pi, np.pi, 400)[None, :]
    figure, axis = plt.subplots(figsize=(6, 2.8), layout="constrained")
    for steps in (3, 4, 7):
        shifts = fw.patterns.equal_steps(steps)
        frames = [200.0 * (0.5 + 0.5 * np.cos(phase - s)) ** 2.2 + 20 for s in shifts]
        frames = [np.repeat(frame, 8, axis=0) for frame in frames]
        found = fw.stack.wrapped_phase(frames, shifts).phase_rad[0]
        axis.plot(phase[0], np.angle(np.exp(1j * (found - phase[0]))), label=f"{steps} steps")
    axis.set(title="error of the phase at γ = 2.2", xlabel="phase / rad", ylabel="rad")
    axis.legend(fontsize=8, loc="upper right")
    return figure


def coverage() -> Figure:
    """Errors over their stated σ, beside the normal distribution."""
    rig = standard_rig(scale=SCALE)
    plan, view = fringe_plan(rig, both=False), look(rig, bust())
    figure, axis = plt.subplots(figsize=(6, 2.8), layout="constrained")
    for noise in (1.0, 3.0):
        found = fw.decode(list(photograph(view, plan, Optics(noise=noise))), plan).x
        ratio = (found.coordinate_px - view.projector_px[..., 0]) / found.sigma_px
        share = np.mean(np.abs(ratio[np.isfinite(ratio)]) <= 1)
        label = f"noise of {noise:g} counts: {share:.1%} within 1 σ"
        axis.hist(ratio.ravel(), 81, range=(-4, 4), density=True, histtype="step", label=label)
    t = np.linspace(-4, 4, 200)
    axis.plot(t, np.exp(-0.5 * t * t) / np.sqrt(2 * np.pi), "k:", label="normal")
    axis.set(title="errors over their stated σ", xlabel="error / σ", yticks=[])
    axis.legend(fontsize=7, loc="upper left")
    return figure


FIGURES = {"two_frames": two_frames, "orders": orders, "ripple": ripple, "coverage": coverage}
"""Pictures by the names of their files."""


def main() -> None:
    """Draw all pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, draw in FIGURES.items():
        figure = draw()
        figure.savefig(PICTURES / f"{name}.png", dpi=90, metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
