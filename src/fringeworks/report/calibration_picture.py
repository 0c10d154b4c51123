"""The picture of a calibration: where the board has been, residuals, and every pose's share."""

from __future__ import annotations

import numpy as np

from fringeworks.report.drawing import Axes
from fringeworks.report.maps import SMALL_INCH, Picture, small_print
from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.rig.calibration.diagnosis import coverage, diagnose, pose_figures
from fringeworks.rig.calibration.verdict import verdict
from fringeworks.types import BoolMap, FloatMap
from fringeworks.types.numbers import percent

SIZE_INCH = (13.0, 9.2)
"""Width and height of the picture without its small print, inches."""
ARROW_SHARE = 0.03
"""Length of a long residual's arrow over the frame's width: it is seen, and apart from the next."""
LONG_PERCENTILE = 95.0
"""Percentile of the residuals that has this length: one bad corner does not shrink the others."""
CORNER = "#56b4e9"
"""Colour of corners: light blue."""
ARROW = "#222255"
"""Colour of residuals: dark blue."""
LEFT_OUT = "#d55e00"
"""Colour of corners that were left out: red."""
LEGEND_ROOM = 1.25
"""Height of the bars' axes over the highest bar, so that the legend lies above all bars."""
SERIES = {
    "camera_rms_px": ("camera", "#0072b2"),
    "projector_rms_px": ("projector", "#e69f00"),
    "predicted_rms_px": ("projector, predicted without this pose", "#999999"),
}
"""Bars of every pose: figure, label and colour."""


def calibration_picture(title: str, calibration: Calibration) -> Picture:
    """Draw the corners and residuals in both devices, and the residuals of every pose.

    Parameters
    ----------
    title : str
    calibration : Calibration

    Returns
    -------
    Picture, with the verdict below the title, and what was found at its foot.
    """
    small = small_print([found.text for found in diagnose(calibration)], SIZE_INCH[0])
    width, height = SIZE_INCH
    figure = Picture(figsize=(width, height + SMALL_INCH * small.count("\n")), layout="constrained")
    poses = len(calibration.observations)
    facts = f"{verdict(calibration).text}   ·   {poses} poses of the {calibration.board.kind}"
    figure.suptitle(f"{title}\n{facts}", fontsize=12)
    if small:
        figure.supxlabel(small, x=0.01, ha="left", fontsize=9)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.5, 1.0))
    shares = coverage(calibration)
    adjusted, observations = calibration.adjusted, calibration.observations
    lit = [np.isfinite(o.found.projector_px).all(axis=1) for o in observations]
    used = np.concatenate(adjusted.used)
    _frame(
        figure.add_subplot(grid[0, 0]),
        f"camera: corners span {percent(shares[0])} of the frame",
        observations[0].camera_size,
        np.concatenate([o.view.pixels[seen] for o, seen in zip(observations, lit, strict=True)]),
        np.concatenate(adjusted.camera_residual_px),
        used,
    )
    _frame(
        figure.add_subplot(grid[0, 1]),
        f"projector: corners span {percent(shares[1])} of the frame",
        observations[0].projector_size,
        np.concatenate([o.found.projector_px[m] for o, m in zip(observations, lit, strict=True)]),
        np.concatenate(adjusted.projector_residual_px),
        used,
    )
    _bars(figure.add_subplot(grid[1, :]), calibration)
    return figure


def _frame(
    axes: Axes,
    title: str,
    size: tuple[int, int],
    places: FloatMap,
    residual: FloatMap,
    used: BoolMap,
) -> None:
    """Corners of all poses in a device's frame, with their residuals enlarged."""
    length = np.linalg.norm(residual[used], axis=1)
    long = float(np.percentile(length, LONG_PERCENTILE)) if length.size else 0.0
    factor = _round(ARROW_SHARE * size[0] / long) if long > 0 else 1.0
    axes.plot(*places[used].T, ".", color=CORNER, markersize=3)
    axes.quiver(
        *places[used].T,
        *(factor * residual[used].T),
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color=ARROW,
        width=0.0015,
    )
    words = f"dots: corners; arrows: residuals, {factor:g} times enlarged"
    if not used.all():
        axes.plot(*places[~used].T, "x", color=LEFT_OUT, markersize=6)
        words += f"; crosses: {int((~used).sum())} corners left out"
    axes.set_title(f"{title}\n{words}", fontsize=10)
    axes.set_xlim(-0.5, size[0] - 0.5)
    axes.set_ylim(size[1] - 0.5, -0.5)
    axes.set_aspect("equal", anchor="N")
    axes.set_xlabel("x / px")
    axes.set_ylabel("y / px")


def _round(factor: float) -> float:
    """The next smaller 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(max(step for step in (1, 2, 5) if step * power <= factor) * power)


def _bars(axes: Axes, calibration: Calibration) -> None:
    """Root mean square residuals of every pose."""
    rows = pose_figures(calibration)
    shown = {key: s for key, s in SERIES.items() if rows[0][key] is not None}
    width = 0.8 / len(shown)
    for k, (key, (label, colour)) in enumerate(shown.items()):
        place = np.arange(len(rows)) + (k - 0.5 * (len(shown) - 1)) * width
        axes.bar(place, [row[key] for row in rows], width, label=label, color=colour)
    axes.set_title("root mean square residual of every pose", fontsize=11)
    axes.set_xticks(np.arange(len(rows)), [row["pose"] for row in rows])
    if sum(len(row["pose"]) for row in rows) > 90:
        axes.tick_params(axis="x", rotation=30)
    axes.set_ylabel("residual / px")
    highest = max((row[key] for row in rows for key in shown), default=1.0)
    axes.set_ylim(0.0, LEGEND_ROOM * highest)
    axes.legend(loc="upper center", ncols=len(shown), fontsize=9, frameon=False)
