"""What the epipolar errors of one scan say about a change of its rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.rig.ray_depth import inverse_depth, main_axis, projector_by_parameters
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, NORMAL_MEDIAN
from fringeworks.types import (
    BoolMap,
    Decoded,
    FloatMap,
    Frozen,
    InputError,
    Rig,
    RigMismatch,
    unmasked,
)

PIXELS = 12_000
"""Approximate number of decoded pixels that are used. Their noise then moves the modes of a drift
by less than what differs from scan to scan; more pixels only take time."""
CELLS = (16, 20)
"""Rows and columns of cells over the part of the frame that was measured. Pixels of a cell share
errors of ripple, blur and surface, so that a cell counts as one observation whose scatter is
measured."""
FEWEST_PIXELS = 12
"""Smallest number of pixels of a cell; below it, its robust scatter is not known."""
USUAL_PIXELS = 36
"""Pixels of a cell, on average over the rectangle that was measured, below which cells are larger:
three times the fewest, as for a part that fills a third of its rectangle."""
FEWEST_CELLS = 12
"""Smallest number of cells for a statement: seven modes of a drift, and as many again for their
scatter, with two to spare for each of the two variances."""
INLIER_SIGMAS = 4.0
"""Deviation from the median of a cell, in robust standard deviations, beyond which a pixel is left
out. Wrong fringe orders and mixed rims are off by more; normal errors are 1 time in 16 000."""
MOST_WEIGHT = 4.0
"""Largest weight of a pixel, over the median of its cell: no pixel decides for a cell."""
TUNING = 4.685
"""Tuning constant of Tukey's biweight for 95 % efficiency at normal errors (P. J. Huber: Robust
Statistics, Wiley 1981)."""
ITERATIONS = 12
"""Steps of the reweighted fit; the scatter of the cells changes by less than 1 % after eight."""
LARGE_BLUR_PX2 = 2.0
"""Standard deviation of the square of the blur that a scan's coordinates hold, px²: blurs to 1.4 px
and more, which boards of calibrations show."""
HIGHER_PX2 = 0.3
"""Standard deviation of what the first order of the blur's shift leaves, over that shift by a blur
of 1 px. On balls that a second simulator photographs with blurs of 0.3 to 1 px, the shift that
steep cells show is up to a third smaller than the first order of it."""
LARGEST_STEP_PX = 1.0
"""Root mean square deviation of a cell's coordinates from a quadratic surface, projector px, beyond
which it holds a step or a rim, whose blur does not follow the slopes."""
RIM_PX = 4
"""Distance from rims and shadows that is left out, camera px: three standard deviations of a blur
of 1.4 px. Closer, blur mixes what is beyond the rim into the modulation."""
USUAL_SHARE, FULL = 0.9, 0.9
"""Quantile of the shares of known pixels around pixels that stands for a place without a rim, and
the share of it from which on a pixel counts as away from rims. A straight rim at ``RIM_PX`` takes
nothing, one pixel nearer a ninth."""
LARGEST_UNITS = 100.0
"""Standard deviation of each mode in the fit that measures the scatter, in units of a drift: 5° and
10 mm, far more than rays that still meet can show."""
TINY_PX = 1e-9
"""Added to a scatter that may be 0, px: errors of frames without noise are far larger."""

ROTATION_DEG, TRANSLATION_MM, FOCUS_SHARE = 0.05, 0.1, 1e-3
"""Units of a drift: the smallest knock that matters at a field of 200 mm, and the change of a focal
length that does as much at the rim of a frame."""
MODES = (
    "rotation x",
    "rotation y",
    "rotation z",
    "translation across 1",
    "translation across 2",
    "camera focus",
    "projector focus",
)
"""Changes of a rig that epipolar errors may see. Translations are across the baseline: along it,
the rays still meet."""


@dataclass(frozen=True, eq=False, repr=False)
class EpipolarEvidence(Frozen):
    """What the epipolar errors of one scan say about the rig's 24 parameters.

    To first order the errors are J δ for a change δ of the parameters, and noise with the
    covariance W⁻¹. The evidence is JᵀWJ and JᵀW times the errors.
    """

    information: FloatMap
    """(24, 24) JᵀWJ, in units of ``RIG_PARAMETERS``."""
    score: FloatMap
    """(24,) JᵀW times the errors."""
    cells: int
    """Cells of the frame with an error."""
    pixels: int
    """Pixels that were used."""
    noise_px: float
    """Typical standard deviation of a cell's error by the noise of its pixels, projector px."""
    scatter_px: float
    """Standard deviation of the cells' errors beyond noise that no drift explains, projector px."""
    name: str = ""
    """Name of the scan."""
    date: str = ""
    """When it was measured, ISO 8601; empty where unknown."""
    sha256: str = ""
    """Fingerprint of its frames; empty where unknown."""

    def __post_init__(self) -> None:
        for name in ("information", "score"):
            object.__setattr__(self, name, unmasked(getattr(self, name), name).astype(np.float64))
        super().__post_init__()
        shapes = self.information.shape, self.score.shape
        if shapes != ((24, 24), (24,)):
            raise InputError(f"evidence: expected shapes (24, 24) and (24,), got {shapes}")
        if not (np.isfinite(self.information).all() and np.isfinite(self.score).all()):
            raise InputError("evidence: expected finite numbers, got others")


class _Pixels(NamedTuple):
    """Epipolar errors of pixels, and what they come from."""

    place: FloatMap
    """(n, 2) column and row, px."""
    error: FloatMap
    """(n,) projector px."""
    by_rig: FloatMap
    """(n, 24) derivative of the errors by the rig's parameters."""
    variance: FloatMap
    """(n,) px², by noise."""
    across: FloatMap
    """(n, 2) direction of the projector's frame across the epipolar line."""
    seen: FloatMap
    """(n, 3) decoded coordinates, px, and the logarithm of the modulation."""


class _Cells(NamedTuple):
    """Epipolar errors of cells."""

    error: FloatMap
    """(n,) projector px."""
    by_rig: FloatMap
    """(n, 24)"""
    by_blur: FloatMap
    """(n,) derivative by the square of the camera's blur, px per px²."""
    variance: FloatMap
    """(n,) px², by noise."""


def drift_units(rig: Rig) -> FloatMap:
    """Return the change of the 24 parameters by a unit of each of ``MODES``, (24, 7)."""
    found = np.zeros((24, len(MODES)))
    found[18:21, :3] = np.radians(ROTATION_DEG) * np.eye(3)
    along = rig.T_projector_camera[:3, 3] / rig.baseline_mm
    across = np.linalg.qr(np.column_stack((along, np.eye(3))))[0][:, 1:3]
    found[21:24, 3:5] = TRANSLATION_MM * across
    found[0:2, 5] = FOCUS_SHARE * np.array(rig.camera.focal_px)
    found[9:11, 6] = FOCUS_SHARE * np.array(rig.projector.focal_px)
    return found


def epipolar_evidence(
    decoded: Decoded, rig: Rig, *, name: str = "", date: str = ""
) -> EpipolarEvidence:
    """Collect what the epipolar errors of a scan say about a change of its rig.

    Parameters
    ----------
    decoded : Decoded
        Absolute coordinates along both axes, from the rig's camera.
    rig : Rig
    name, date : str
        Kept with the result.

    Returns
    -------
    EpipolarEvidence

    Raises
    ------
    InputError for one axis only, which has no epipolar errors, and for relative coordinates.
    RigMismatch for frames of another size, and where too little of the frame was measured.

    Notes
    -----
    The projector's point of a pixel must lie on the epipolar line of its ray (theory §8). The
    errors across that line are collected in cells of the frame by robust means. What scatters
    between cells beyond noise, when every drift is free, adds to the variance of each: the
    evidence is therefore not sharper than the errors are random. A drift does not enter this
    scatter.
    """
    if decoded.x is None or decoded.y is None:
        raise InputError(
            "decoded: expected coordinates along both axes, got one; with one axis every ray meets "
            "its column or row, so that nothing in the scan shows a drift"
        )
    for found in (decoded.x, decoded.y):
        if found.repeats_px is not None:
            raise InputError("decoded: expected absolute coordinates, got some that repeat")
        if found.coordinate_px.shape != rig.camera.shape:
            raise RigMismatch(
                f"rig: it is for frames of {rig.camera.shape[::-1]} px, got "
                f"{found.coordinate_px.shape[::-1]} px"
            )
    pixels = _pixels(decoded, rig)
    cells = _cells(pixels)
    if len(cells.error) < FEWEST_CELLS:
        raise RigMismatch(
            f"scan: expected coordinates along both axes in {FEWEST_CELLS} smooth cells of "
            f"{FEWEST_PIXELS} pixels or more, got them in {len(cells.error)}"
        )
    weight, scatter = _weights(cells, drift_units(rig))
    weighted = cells.by_rig.T * weight
    # The unknown blur of the scan is eliminated.
    of_blur = weighted @ cells.by_blur
    blurred = weight * cells.by_blur
    precision = float(blurred @ cells.by_blur) + LARGE_BLUR_PX2**-2
    error = cells.error - cells.by_blur * float(blurred @ cells.error) / precision
    information = weighted @ cells.by_rig - np.outer(of_blur, of_blur) / precision
    return EpipolarEvidence(
        information=0.5 * (information + information.T),
        score=weighted @ error,
        cells=len(cells.error),
        pixels=len(pixels.error),
        noise_px=float(np.sqrt(np.median(cells.variance))),
        scatter_px=scatter,
        name=name,
        date=date,
    )


def _pixels(decoded: Decoded, rig: Rig) -> _Pixels:
    """Some decoded pixels with their signed epipolar errors."""
    maps = decoded.maps
    coordinates = np.stack([maps[a].coordinate_px for a in ("x", "y")], -1)
    light = np.minimum(maps["x"].modulation, maps["y"].modulation)
    v, u = np.nonzero(_away_from_rims(np.isfinite(coordinates).all(axis=2) & (light > 0)))
    # Pixels are taken at random places: a regular grid could beat with the fringes.
    some = np.random.default_rng(0).permutation(len(u))[:PIXELS]
    v, u = v[some], u[some]
    goal = coordinates[v, u].astype(np.float64)
    sigma = np.stack([maps[a].sigma_px[v, u] for a in ("x", "y")], -1).astype(np.float64)
    place = np.stack((u, v), axis=-1).astype(np.float64)
    along = main_axis(rig)
    depth = inverse_depth(rig, place, goal[:, 0 if along == "x" else 1], along)
    seen, by, by_w, _ = projector_by_parameters(rig, place, np.where(depth > 0, depth, np.nan))
    with np.errstate(invalid="ignore"):
        across = np.stack((-by_w[:, 1], by_w[:, 0]), -1) / np.linalg.norm(by_w, axis=1)[:, None]
        error = np.einsum("ni,ni->n", goal - seen, across)
    by_rig = np.einsum("nij,ni->nj", by, across)
    variance = np.einsum("ni,ni->n", across**2, sigma**2)
    shown = np.column_stack((goal, np.log(light[v, u].astype(np.float64))))
    good: BoolMap = np.isfinite(error) & np.isfinite(by_rig).all(axis=1) & (variance > 0)
    found = _Pixels(place, error, by_rig, variance, across, shown)
    return _Pixels(*(part[good] for part in found))


def _away_from_rims(known: BoolMap) -> BoolMap:
    """Pixels around which about as many are known as anywhere: holes are no rims."""
    near = scipy.ndimage.uniform_filter(known.astype(np.float32), 2 * RIM_PX + 1, mode="constant")
    if not known.any():
        return known
    usual = np.quantile(near[known], USUAL_SHARE)
    return np.asarray(known & (near >= FULL * usual))


def _cells(pixels: _Pixels) -> _Cells:
    """Robust means of the errors over cells of the part of the frame that was measured."""
    place = pixels.place
    low = place.min(axis=0, initial=np.inf)
    filled = len(place) / (USUAL_PIXELS * CELLS[0] * CELLS[1])
    counts = np.maximum(np.array(CELLS[::-1]) * min(1.0, np.sqrt(filled)), 1.0).astype(int)
    size = counts / (place.max(axis=0, initial=-np.inf) - low + 1.0)
    column, row = ((place - low) * size).astype(int).T
    number = row * counts[0] + column
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
    all_cells = [_cell(pixels, group) for group in groups if len(group) >= FEWEST_PIXELS]
    found = [one for one in all_cells if one is not None]
    if not found:
        return _Cells(np.zeros(0), np.zeros((0, 24)), np.zeros(0), np.zeros(0))
    cells = _Cells(*(np.array(part) for part in zip(*found, strict=True)))
    return cells._replace(variance=cells.variance + (HIGHER_PX2 * cells.by_blur) ** 2)


def _cell(pixels: _Pixels, group: NDArray[np.intp]) -> tuple[float, FloatMap, float, float] | None:
    """Mean error of a cell's pixels without outliers, its derivatives and its variance.

    None for a cell with a step of the surface or few pixels.
    """
    error = pixels.error[group]
    apart = np.abs(error - np.median(error))
    typical = MAD_TO_SIGMA * float(np.median(apart))
    kept = group[apart <= INLIER_SIGMAS * typical]
    if len(kept) < FEWEST_PIXELS:
        return None
    shift, left = _blur_shift(pixels.place[kept], pixels.seen[kept])
    if left > LARGEST_STEP_PX:
        return None
    variance = pixels.variance[kept]
    weight = np.minimum(1.0 / variance, MOST_WEIGHT / float(np.median(variance)))
    weight /= weight.sum()
    # Where the pixels scatter by more than their σ, that counts.
    single = max(typical**2, float(np.median(variance)))
    return (
        float(weight @ pixels.error[kept]),
        weight @ pixels.by_rig[kept],
        float((weight @ pixels.across[kept]) @ shift),
        single * float(np.sum(weight**2)),
    )


def _blur_shift(place: FloatMap, seen: FloatMap) -> tuple[FloatMap, float]:
    """Shift of the coordinates of a cell by blur, (2,), px per px²; and what its fit leaves, px.

    A blur with the variance s² averages the fringes' phasors over the surface. To first order the
    coordinate u moves by s² (∇u · ∇ln B + ½ ∇²u) where the modulation B and u change.
    """
    middle = place.mean(axis=0)
    x, y = ((place - middle) / max(float(np.abs(place - middle).max()), 1.0)).T
    reach = max(float(np.abs(place - middle).max()), 1.0)
    powers = np.stack((np.ones(len(x)), x, y, x * x, x * y, y * y), axis=1)
    fit = np.linalg.lstsq(powers, seen, rcond=None)[0]
    left = float(np.sqrt(np.mean((seen[:, :2] - powers @ fit[:, :2]) ** 2)))
    slope = fit[1:3] / reach
    curve = 2.0 * (fit[3] + fit[5])[:2] / reach**2
    return slope[:, :2].T @ slope[:, 2] + 0.5 * curve, left


def _weights(cells: _Cells, units: FloatMap) -> tuple[FloatMap, float]:
    """Weights of the cells, and their scatter beyond noise, px, with every drift free."""
    design = np.column_stack((cells.by_rig @ units, LARGE_BLUR_PX2 * cells.by_blur))
    loose = np.append(np.full(units.shape[1], LARGEST_UNITS**-2), 1.0)
    apart = np.abs(cells.error - np.median(cells.error))
    # A first fit by about the sum of magnitudes: cells with wrong orders do not lead it astray.
    robust, scatter = 1.0 / np.maximum(apart, np.median(apart) + TINY_PX), 0.0
    for _ in range(ITERATIONS):
        weight = robust / (cells.variance + scatter)
        weighted = design.T * weight
        change = np.linalg.solve(weighted @ design + np.diag(loose), weighted @ cells.error)
        left = cells.error - design @ change
        spread = float(np.median(left**2)) / NORMAL_MEDIAN**2
        scatter = max(spread - float(np.median(cells.variance)), 0.0)
        off = left / (TUNING * np.sqrt(cells.variance + scatter))
        robust = np.maximum(1.0 - off**2, 0.0) ** 2
    return robust / (cells.variance + scatter), float(np.sqrt(scatter))
