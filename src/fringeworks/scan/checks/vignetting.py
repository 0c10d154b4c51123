"""Vignetting: how the projected light falls off from the middle of the picture to its corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.scan.checks.levels import Levels
from fringeworks.scan.checks.orientation import Orientation
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import CameraNoise, Finding, FloatMap, Frozen

CELLS = 24
"""Cells along the projector's longer side. A cell's median over many camera pixels has little
noise, and a fall-off is smooth over a cell."""
MIN_PIXELS = 4
"""Smallest number of camera pixels in a cell that counts."""
MIN_COVERED_SHARE = 0.4
"""Smallest share of the projector's picture that the camera must see lit: with less, the fall-off
over the corners would be extrapolated."""
MIN_REACH = 0.6
"""Smallest distance from the middle to the farthest cells that are seen, as a share of half the
diagonal. The fall-off is stated at the reach and never extrapolated to the corners."""
REACH_QUANTILE = 0.98
"""Quantile of the cells' distances that counts as the farthest: single cells at the rim see halves
of pixels."""
MAX_UNEVEN = 0.08
"""Largest scatter of the cells about the smooth fall-off, natural logarithm of the brightness. Even
surfaces stay below 0.02; objects with albedo or shape of their own exceed 0.1."""
MAX_BENT = 0.01
"""Largest deviation of the surface from a plane, as the rms distance of the projector coordinates
from the best projective map, relative to the projector's longer side. Lens distortion stays below
0.004; a sphere of a third of the field exceeds 0.02."""
TUKEY = 4.685
"""Tukey's constant in standard deviations: weights fall to zero there, and even surfaces still use
95 % of their data."""
ROUNDS = 20
"""Rounds of reweighting; the weights settle within ten."""
MIN_SIGMA = 1e-3
"""Lower bound on the scatter that weights are scaled with, so that exact data keep their weight."""
MATTERS = 2.0
"""Predicted σ in the corners over that in the middle from which on vignetting is a finding. Cosine
fall-off and lenses of usual projectors reach 1.4."""

Judged = Literal["fall-off", "covers little", "not flat", "uneven"]
"""``fall-off``: it is that of the devices. Otherwise why it cannot be told from the surface."""
WHY_NOT: dict[Judged, str] = {
    "covers little": "the camera sees too little of the lit picture",
    "not flat": "the surface is not flat",
    "uneven": "the surface is not of one colour",
}
"""Why the fall-off cannot be judged, in words."""


@dataclass(frozen=True, eq=False, repr=False)
class Vignetting(Frozen):
    """Fall-off of the projected light over the projector's picture."""

    judged: Judged
    """Whether the fall-off is that of the devices."""
    light: FloatMap
    """Median light of the cells, (rows, columns) over the projector's picture, relative to the
    middle of the fit; NaN where the camera sees nothing of a cell."""
    fall_off: FloatMap
    """The fitted fall-off in the same cells, without the linear part; 1 in the middle."""
    covered_share: float
    """Share of the projector's picture that the camera sees lit."""
    reach: float
    """Distance of the farthest cells from the middle, as a share of half the diagonal."""
    corner_share: float
    """Light at that distance, relative to the middle; NaN where it cannot be judged."""
    sigma_ratio: float
    """Predicted σ of coordinates there, relative to the middle; NaN where it cannot be judged."""
    uneven: float
    """Scatter of the cells about the fit, natural logarithm of the brightness."""
    bent: float
    """Deviation of the surface from a plane; see ``MAX_BENT``."""
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        if self.judged != "fall-off":
            return f"cannot be judged: {WHY_NOT[self.judged]}"
        return (
            f"light at the corners is {self.corner_share:.0%} of the middle, "
            f"σ there {self.sigma_ratio:.1f} times that of the middle"
        )


def check_vignetting(
    size_px: tuple[int, int], levels: Levels, orientation: Orientation, noise: CameraNoise
) -> Vignetting:
    """Fit a smooth fall-off to the light of white over projector coordinates.

    Parameters
    ----------
    size_px : (columns, rows)
        Of the projector.
    levels : Levels
        Light of white.
    orientation : Orientation
        Projector coordinates.
    noise : CameraNoise
        For the error that the fall-off costs.

    Returns
    -------
    Vignetting

    Notes
    -----
    The model is ln I = a + b x + c y + k (x² + y²), fitted to the medians of cells with Tukey's
    weights. Tilt, light from the side and an axis that is not in the middle (lens shift) all give
    linear parts, which are therefore left out: only k is reported. A fall-off of the camera's lens,
    a surface that curves away and a colour that darkens from the middle change k as well. One
    picture cannot tell a fall-off of the camera's lens from that of the projector. The other two
    are refused where they show: by the distance of the projector coordinates from a projective map
    of the plane, and by the scatter about the fit.
    """
    light, count = _cells(size_px, levels, orientation)
    x, y = _places(size_px, light.shape)
    known = count >= MIN_PIXELS
    covered = float(known.mean())
    radius = np.hypot(x, y)
    reach = float(np.quantile(radius[known], REACH_QUANTILE)) if known.any() else 0.0
    if known.sum() < 3 * 4:
        nothing = np.full(light.shape, np.nan)
        nan = float("nan")
        return Vignetting("covers little", light, nothing, covered, reach, nan, nan, nan, nan, ())
    coefficients, uneven = _fit(x[known], y[known], np.log(light[known]))
    fall_off = np.exp(coefficients[3] * radius**2)
    bent = _bent(size_px, levels, orientation)
    judged = _judged(covered, reach, uneven, bent)
    corner = sigmas = float("nan")
    found: tuple[Finding, ...] = ()
    if judged == "fall-off":
        corner = float(np.exp(coefficients[3] * reach**2))
        sigmas = _sigma_ratio(corner, float(np.exp(coefficients[0])), noise)
        found = (_finding(corner, sigmas),) if sigmas >= MATTERS else ()
    relative = light / np.exp(coefficients[0])
    return Vignetting(
        judged, relative, fall_off, covered, reach, corner, sigmas, uneven, bent, found
    )


def _cells(
    size_px: tuple[int, int], levels: Levels, orientation: Orientation
) -> tuple[FloatMap, NDArray[np.int64]]:
    """Median light and number of the pixels that see each cell of the projector's picture."""
    pitch = max(size_px) / CELLS
    columns, rows = (max(1, round(n / pitch)) for n in size_px)
    used = _used(levels, orientation)
    x, y = orientation.x_px[used] + 0.5, orientation.y_px[used] + 0.5
    column = np.clip((x / size_px[0] * columns).astype(int), 0, columns - 1)
    row = np.clip((y / size_px[1] * rows).astype(int), 0, rows - 1)
    cell = row * columns + column
    order = np.argsort(cell, kind="stable")
    count = np.bincount(cell, minlength=rows * columns)
    parts = np.split(levels.white[used][order], np.cumsum(count)[:-1])
    light = np.array([np.median(p) if len(p) >= MIN_PIXELS else np.nan for p in parts], float)
    return light.reshape(rows, columns), count.reshape(rows, columns)


def _used(levels: Levels, orientation: Orientation) -> NDArray[np.bool_]:
    return np.asarray(levels.lit & np.isfinite(orientation.x_px) & np.isfinite(orientation.y_px))


def _places(size_px: tuple[int, int], shape: tuple[int, ...]) -> tuple[FloatMap, FloatMap]:
    """Middles of the cells from the middle of the picture, in half diagonals."""
    half = 0.5 * float(np.hypot(*size_px))
    rows, columns = shape
    x = (np.arange(columns) + 0.5) / columns - 0.5
    y = (np.arange(rows) + 0.5) / rows - 0.5
    grid = np.meshgrid(x * size_px[0] / half, y * size_px[1] / half)
    return grid[0], grid[1]


def _fit(x: FloatMap, y: FloatMap, value: FloatMap) -> tuple[FloatMap, float]:
    """Robust coefficients of 1, x, y and x² + y², and the scatter about them."""
    design = np.column_stack((np.ones_like(x), x, y, x**2 + y**2))
    weight = np.ones_like(value)
    for _ in range(ROUNDS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], value * root, rcond=None)[0]
        off = value - design @ found
        sigma = max(robust_sigma(off), MIN_SIGMA)
        weight = np.maximum(1.0 - (off / (TUKEY * sigma)) ** 2, 0.0) ** 2
    return found, float(np.std(off))


def _bent(size_px: tuple[int, int], levels: Levels, orientation: Orientation) -> float:
    """Rms distance of projector coordinates from a projective map, over the longer side."""
    used = _used(levels, orientation)
    rows, columns = np.nonzero(used)
    step = max(1, len(rows) // 4000)
    scale = max(used.shape)
    u, v = columns[::step] / scale - 0.5, rows[::step] / scale - 0.5
    x, y = (m[used][::step] / max(size_px) - 0.5 for m in (orientation.x_px, orientation.y_px))
    zero, one = np.zeros_like(u), np.ones_like(u)
    # Direct linear transformation: x (g u + h v + 1) = a u + b v + c, and the same for y.
    top = np.column_stack((u, v, one, zero, zero, zero, -x * u, -x * v))
    low = np.column_stack((zero, zero, zero, u, v, one, -y * u, -y * v))
    design, value = np.concatenate((top, low)), np.concatenate((x, y))
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    scaled = 1.0 + found[6] * u + found[7] * v
    off = (design @ found - value) / np.concatenate((scaled, scaled))
    return float(np.sqrt(2.0 * np.mean(off**2)))


def _judged(covered: float, reach: float, uneven: float, bent: float) -> Judged:
    if covered < MIN_COVERED_SHARE or reach < MIN_REACH:
        return "covers little"
    if bent > MAX_BENT:
        return "not flat"
    return "uneven" if uneven > MAX_UNEVEN else "fall-off"


def _sigma_ratio(corner: float, middle: float, noise: CameraNoise) -> float:
    """σ of a coordinate in the corners over that in the middle; ``middle`` is its light, counts.

    Fringes of full contrast have half of the light of white as modulation and as mean.
    """
    sigma = [
        float(np.sqrt(noise.variance(0.5 * light))) / light for light in (corner * middle, middle)
    ]
    return sigma[0] / sigma[1]


def _finding(corner: float, sigmas: float) -> Finding:
    return Finding(
        "vignetting",
        f"the projected light falls to {corner:.0%} towards the corners of the picture, where the "
        f"modulation falls alike and σ is {sigmas:.1f} times that of the middle",
        (
            "vignetting of the projector's lens or light source",
            "vignetting of the camera's lens",
            "a surface that darkens or curves away from the middle",
        ),
        "place objects in the middle of the picture, stop the camera's lens down, or use several "
        "exposures; to tell the devices from the surface, repeat before a white wall",
        figures={"corner_share": corner, "sigma_ratio": sigmas},
    )
