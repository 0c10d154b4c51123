"""Albedo of a painted object, with sharp edges, from its pair of frames (theory §4, "Paint")."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.cliffs import Cliffs
from fringeworks.pair.windows import PATCH_PX, Fitted, Windows, unexplained
from fringeworks.signal.filters import box_mean, enlarged, widened
from fringeworks.types import BoolMap, FloatMap

STILL_MISFIT = 8.0
"""The same with the albedo: compression leaves more at edges than elsewhere."""
MAX_STILL_POOR = 0.15
"""Largest share of a poorly explained place that still is, up to which the albedo is used there.
Cliffs have 0.2 and more, paint up to 0.02, or 0.18 in frames of JPEG quality 75."""
PLACE_PERIODS = 1.5
"""Half the side of the surroundings that are judged where cliffs are known, periods."""
MIN_SHARE = 1e-6
"""Smallest share of a square that counts as some of it."""
FRINGE_BOX_PERIODS = 3.0
"""Side of the squares in which albedo and fringes are compared, periods."""
LEVEL_WIDTH_PERIODS = 2.0
"""Width of the Gaussian over which the level without light is averaged, periods."""
LEVEL_BLOCKS = 4
"""Blocks per period on which it is averaged."""
EDGE_PRICE = (0.01, 0.004)
"""λ per px of the period: of an edge of the first albedo, and of the next ones, which know where
edges are. Empirical choices."""
NOISE_PRICE = 3.0
"""Smallest λ, in standard deviations of what the windows leave times the mean of the reference:
less would take noise for paint. An empirical choice."""
EDGE_STEP = 0.03
"""Change of β from pixel to pixel at which the price of an edge falls to a half."""
HUBER_SLOPE = 0.003
"""Change of β from pixel to pixel up to which it is shading, not an edge."""
STIFFNESS = 0.4
"""μ of the correction of the displacement, over the mean square of the reference's slope."""
ITERATIONS = (200, 200, 100, 50)
"""Steps from the coarsest level, an eighth of the frame, to the frame itself."""
TIED = 1.0
"""Price of an edge of the albedo near a cliff, whose errors it would imitate otherwise."""
MIXED_PX = 2
"""Distance from a wall up to which a lens mixes the brightness of both sides."""
MIN_SIDE_PX = 64
"""Shortest side of a frame on which all levels are used."""
MAX_FRINGE_SHARE = 0.1
"""Largest share of the albedo's local variance that goes with the fringes. Most edges of paint have
up to 0.02; creases of a surface that an albedo has taken over have 0.15 to 0.25."""
ERROR_SHARE = 0.1
"""Error of a displacement that is due to the albedo, over what the albedo has changed. Measured on
simulated paint: 0.05 to 0.1."""
MIN_BRIGHT = 0.1
"""Smallest brightness that the albedo is compared at, in modulations."""
MIN_ALBEDO = 0.02
"""Smallest albedo; less is a shadow, whose fringes no albedo restores."""


def edge_weight(albedo: NDArray[np.float32]) -> NDArray[np.float32]:
    """Price of an edge, 0…1: small where the albedo changes from pixel to pixel."""
    square = np.zeros_like(albedo)
    square[:, :-1] += np.diff(albedo, axis=1) ** 2
    square[:-1] += np.diff(albedo, axis=0) ** 2
    return np.asarray(1.0 / (1.0 + square / np.float32(EDGE_STEP**2)))


def explained(
    windows: Windows,
    fitted: Fitted,
    misfit: NDArray[np.float32],
    albedo: NDArray[np.float32] | None,
    mixed: BoolMap | None = None,
) -> BoolMap:
    """Where windows that know the albedo, or cliffs, explain the object, (h, w).

    Parameters
    ----------
    windows : Windows
    fitted : Fitted
        What they found.
    misfit : (h, w) float32 array
        What windows left that knew nothing. Their result is as good where they left nothing.
    albedo : (h, w) float32 array, optional
    mixed : (h, w) bool array, optional
        Pixels beside cliffs, which show both sides and are not judged.

    Notes
    -----
    An albedo imitates a part of what a cliff does to the fringes, but never all of it. Each
    connected place where the windows left something is judged as a whole; where cliffs are known,
    the surroundings of every pixel. An albedo that goes with the fringes there is an error of the
    displacement or of the level.
    """
    poor = unexplained(misfit, windows.object_noise)
    still = poor & unexplained(windows.left(fitted, albedo), windows.object_noise, STILL_MISFIT)
    if mixed is None:
        places, count = scipy.ndimage.label(poor)
        sizes, left = (np.bincount(places[where], minlength=count + 1) for where in (poor, still))
        refused = (left > MAX_STILL_POOR * np.maximum(sizes, 1))[places]
    else:
        side = 2 * int(PLACE_PERIODS * windows.period_px) + 1
        around, not_yet = (
            box_mean(where.astype(np.float32), side) for where in (poor, still & ~mixed)
        )
        refused = np.asarray(not_yet > MAX_STILL_POOR * around + MIN_SHARE)
    if albedo is not None and windows.albedo is None:
        refused |= fringe_share(windows, fitted, albedo) > MAX_FRINGE_SHARE
    return ~widened(refused & poor, int(windows.period_px))


def albedo_error(before: Fitted, after: Fitted, period_px: float) -> NDArray[np.float32]:
    """Variance of the displacement by errors of the albedo, (h, w), px².

    It is taken from what the albedo has changed within about a period.
    """
    change = after.displacement_px - before.displacement_px
    square = np.where(np.isfinite(change), change**2, np.float32(0))
    side = 2 * int(period_px) + 1
    return np.asarray(np.float32(ERROR_SHARE**2) * box_mean(square, side))


def fringe_share(
    windows: Windows, fitted: Fitted, albedo: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Share of the albedo's local variance that goes with the fringes, (h, w), 0…1.

    Notes
    -----
    With d = β (c + s(x − u)), an error δ of u changes log β by −δ s′/(c + s), and one of c by
    1/(c + s) times the error. Both are fitted in squares of three periods.
    """
    u = fitted.displacement_px
    value, slope, known = windows.warp(np.where(np.isfinite(u), u, np.float32(0)))
    bright = np.maximum(value + light_level(fitted, windows.period_px), np.float32(MIN_BRIGHT))
    side = 2 * int(FRINGE_BOX_PERIODS * windows.period_px / 2) + 1

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return box_mean(values, side)

    def centred(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.where(known > 0, values - mean(values), np.float32(0))

    paint = centred(np.log(albedo))
    tiny = np.finfo(np.float32).tiny
    total = np.maximum(mean(paint**2), tiny)
    parts = (centred(slope / bright), centred(1 / bright))
    shares = [mean(paint * part) ** 2 / np.maximum(mean(part**2), tiny) / total for part in parts]
    return np.asarray(np.sum(shares, axis=0))


def light_level(fitted: Fitted, period_px: float) -> NDArray[np.float32]:
    """Level of the object without light over its gain, c, (h, w), smooth.

    Ambient light, the camera's black level and blur change it, paint does not.
    """
    a, b = fitted.offset, fitted.modulation_ratio
    known = np.isfinite(a) & np.isfinite(b)
    h, w = a.shape
    size = min(max(1, int(period_px / LEVEL_BLOCKS)), h, w)
    rows, columns = -(-h // size), -(-w // size)

    def smooth(values: FloatMap) -> FloatMap:
        padded = np.pad(np.where(known, values, 0), ((0, rows * size - h), (0, columns * size - w)))
        blocks = padded.reshape(rows, size, columns, size).sum(axis=(1, 3))
        width = LEVEL_WIDTH_PERIODS * period_px / size
        return np.asarray(
            scipy.ndimage.gaussian_filter(blocks, width, mode="nearest", truncate=3.0)
        )

    square = smooth(b * b)
    level = np.where(square > 0, smooth(a * b) / np.where(square > 0, square, 1), 0)
    whole = enlarged(level, (rows * size, columns * size))
    return np.ascontiguousarray(whole[:h, :w])


def next_albedo(
    windows: Windows,
    found: Fitted,
    u: NDArray[np.float32],
    before: NDArray[np.float32] | None,
    scatter: float,
    cliffs: Cliffs | None = None,
) -> NDArray[np.float32]:
    """The albedo from the displacement of windows that know the last one.

    Parameters
    ----------
    windows : Windows
        Above dark.
    found : Fitted
        What they found.
    u : (h, w) float32 array
        Displacement, px; finite.
    before : (h, w) float32 array or None
        The last albedo.
    scatter : float
        Standard deviation of what windows leave of most pixels, in modulations.
    cliffs : Cliffs, optional
        Where the correction of the displacement may jump; mixed pixels there are not used.

    Returns
    -------
    (h, w) float32 array > 0
    """
    value, slope, known = windows.warp(u)
    lit = known > 0
    weight = np.ones_like(value) if before is None else edge_weight(before)
    walls = np.zeros(value.shape, np.uint8)
    if cliffs is not None:
        lit &= ~widened(cliffs.walls, MIXED_PX)
        slope = np.where(lit, slope, np.float32(0))
        weight = np.where(cliffs.near, np.float32(TIED), weight)
        walls = cliffs.walls.astype(np.uint8)
    model = np.where(lit, value + light_level(found, windows.period_px), 0).astype(np.float32)
    steep = float(np.sqrt(np.mean(slope[lit] ** 2))) if lit.any() else 1.0
    price = EDGE_PRICE[0 if before is None else 1] * windows.period_px
    bright = float(np.sqrt(np.mean(model[lit] ** 2))) if lit.any() else 1.0
    price = max(price, NOISE_PRICE * scatter * bright)
    levels = len(ITERATIONS) if min(value.shape) >= MIN_SIDE_PX else 1
    albedo, _ = _core.joint_albedo(
        {
            "value": model,
            "slope": slope / np.float32(steep)
            if before is None
            else before * slope / np.float32(steep),
            "object": np.where(lit, windows.object, 0).astype(np.float32),
            "edge_weight": np.float32(price) * weight,
            "cliff": walls,
        },
        stiffness=STIFFNESS / steep**2,
        huber=0.0 if before is None else HUBER_SLOPE,
        iterations=ITERATIONS[-levels:],
    )
    return np.maximum(albedo, np.float32(MIN_ALBEDO))


def paint_edges(albedo: FloatMap) -> BoolMap:
    """Pixels at hard edges of paint, (h, w)."""
    return edge_weight(albedo) < 0.5


def change(before: FloatMap, albedo: FloatMap) -> float:
    """Rms change of the albedo around its edges."""
    near = widened(paint_edges(albedo), PATCH_PX // 2)
    return float(np.sqrt(np.mean((albedo - before)[near] ** 2))) if near.any() else 0.0
