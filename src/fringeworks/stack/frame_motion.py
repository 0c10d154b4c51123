"""Whether a camera that moved or other steps of the projector turned the phases of a set.

Both change the phase steps of the frames alike. A camera or a scene that moves between the frames
moves the paint of the surface as well, and wrong steps do not: what the fit of the real steps
leaves follows the slope of the brightness then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import fit_matrices, times, wave_of
from fringeworks.stack.gray_frames import GrayFrames
from fringeworks.stack.kernel_settings import PhaseFrames
from fringeworks.stack.real_frames import OUTLIERS, real_step_errors
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median, quantile
from fringeworks.types import FloatMap

PAINT_SIGMAS = 4.0
"""Slope of the brightness, in standard deviations of its noise, from which on it is paint: one of
16,000 slopes of even surfaces is larger, where edges of paint have hundreds."""
SMOOTH_RAD = 0.5
"""Change of the slope of the phase from pixel to pixel beyond which a depth step moves the fringes
as well, rad: curved surfaces have a tenth of it."""
FEWEST = 50
"""Pixels with paint for a statement."""
OF_PROJECTORS_RAD = 0.35
"""Errors of single steps, rad, from which on they are rather those of motion, where no paint tells.
Projectors show the steps of their pictures; with light of the next picture and a response that is
not linear, they err by less."""
FEWEST_PAIRS = 3
"""Bits with inverses for a statement about their motion."""
LIT = 0.3
"""Contrast over that of bright pixels from which on they count, and smallest slope of a border in
contrasts per pixel: stripes that blur makes grey have less."""
SURE = 6.0
"""Distance of a bit from its inverse, in standard errors, that is no chance: borders of one line
after another err together."""
STEADY = 0.8
"""Correlation with the number of the frame above which a change over the frames is steady."""


def steadily(changes: NDArray[np.float64]) -> bool:
    """Whether something changes steadily from frame to frame."""
    if not np.ptp(changes) > 0.0:
        return False
    return bool(abs(np.corrcoef(np.arange(len(changes)), changes)[0, 1]) > STEADY)


def by_motion(moved: float, off_rad: NDArray[np.float64]) -> bool:
    """Whether motion between the frames turned their phases, rather than the projector.

    Parameters
    ----------
    moved : float
        Of ``moved_rather``, over all sets.
    off_rad : (N,) array
        Errors of the steps of a set, rad.
    """
    if moved != 0.0:
        return moved > 0.0
    return float(np.abs(off_rad).max()) > OF_PROJECTORS_RAD and not steadily(off_rad)


def moved_rather(phases: PhaseFrames, lines: Sequence[NDArray[Any]]) -> float:
    """Compare motion between the frames of a set with other steps of the projector.

    Parameters
    ----------
    phases : PhaseFrames
        With the rows that the frames show.
    lines : (r, l) arrays, one per frame of the set, counts
        Along lines across the fringes.

    Returns
    -------
    float
        Logarithm of the likelihood of motion over that of other steps; 0 where the frames do not
        tell: without paint, of three frames, and of sharp lines, whose harmonics are left as well.

    Notes
    -----
    A frame that lies d_n further along the line shows M_n − d_n (∂ ln A/∂u) M_n of the paint, with
    M_n what the fit has of it, and a phase step that is larger by d_n ∂φ/∂u. The displacements by
    the paint are normally distributed about those by the steps if there was motion, and about zero
    if the steps are others.
    """
    frames = len(phases.frames)
    if phases.line_px is not None:
        return 0.0
    values = np.stack([_finite(line) for line in lines])
    design, solver = fit_matrices(phases.rows)
    if frames < 4 or solver is None or values.shape[2] < 3:
        return 0.0
    light, wave = wave_of(phases, lines)
    turn = np.angle(wave[:, 1:] * np.conj(wave[:, :-1]))
    slope, bend = 0.5 * (turn[:, 1:] + turn[:, :-1]), np.abs(turn[:, 1:] - turn[:, :-1])
    paint = 0.5 * (light[:, 2:] - light[:, :-2])
    across = np.linalg.qr(design, mode="complete")[0][:, 3:]
    inner = values[:, :, 1:-1]
    left = times(np.ascontiguousarray(across.T), inner.reshape(frames, -1))
    left = left.reshape(frames - 3, *inner.shape[1:])
    square = np.sum(left**2, axis=0)
    usual = median(np.abs(paint[np.isfinite(paint)])) / NORMAL_MEDIAN
    kept = (np.abs(paint) > PAINT_SIGMAS * usual) & (bend < SMOOTH_RAD)
    kept &= np.isfinite(square) & (light[:, 1:-1] > 0.0)
    if np.count_nonzero(kept) < FEWEST:
        return 0.0
    a, at = light[:, 1:-1][kept], wave[:, 1:-1][kept]
    model, share = times(design, np.stack((a, at.real, at.imag))), paint[kept] / a
    found = _displacements(across, model * share, left[:, kept])
    usual = median(slope[kept])
    if found is None or usual == 0.0:
        return 0.0
    by_steps, (by_paint, inverse) = real_step_errors(phases) / usual, found
    return float(by_steps @ inverse @ (by_paint - 0.5 * by_steps))


def _finite(line: NDArray[Any]) -> NDArray[np.float64]:
    """Counts in double precision; NaN where they are not finite."""
    values = line.astype(np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def _displacements(
    across: FloatMap, paint: FloatMap, left: FloatMap
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Displacements of the frames by their paint, camera px, and their inverse covariance; their
    mean is zero. None where the pixels do not tell them.

    ``paint`` is the slope of every frame along the line by its paint, (N, n), counts/px, and
    ``left`` what no steps explain, (N − 3, n), counts.
    """
    frames = len(paint)
    basis = np.linalg.qr(np.ones((frames, 1)), mode="complete")[0][:, 1:]
    kept = np.ones(left.shape[1], bool)
    for _ in range(2):
        rows = -np.einsum("nf,nm,np->fmp", across, basis, paint[:, kept], optimize=True)
        flat = rows.transpose(1, 0, 2).reshape(frames - 1, -1)
        normal, projected = flat @ flat.T, flat @ left[:, kept].ravel()
        shares = np.linalg.lstsq(normal, projected, rcond=None)[0]
        residual = np.full(left.shape, np.inf)
        residual[:, kept] = left[:, kept] - (shares @ flat).reshape(frames - 3, -1)
        square = np.sum(residual**2, axis=0)
        free = np.count_nonzero(kept) * (frames - 3) - (frames - 1)
        variance = float(np.sum(square[kept])) / free
        kept = square <= OUTLIERS * median(square[kept])
    if not variance > 0.0:
        return None
    return basis @ shares, basis @ (normal / variance) @ basis.T


def pairs_apart(gray: GrayFrames, lines: dict[int, NDArray[Any]]) -> float:
    """How far the bits of a Gray code and their inverses lie apart, by the borders of its cells.

    Parameters
    ----------
    gray : GrayFrames
    lines : dict of (r, l) arrays, counts
        Along lines across the stripes, by the frame of the plan.

    Returns
    -------
    float
        Half of the distances, rms over the pairs, camera px; 0 where they are chance, or unknown.

    Notes
    -----
    On a border, bit and inverse are g (u − d_1) and −g (u − d_2) beside half of the light. Half
    their difference tells the place of the border with the error (d_1 + d_2) / 2. Their mean is
    off half of the light by g (d_2 − d_1) / 2, which has the same variance if each frame moved by
    itself. Borders that rise and those that fall count alike, as light of the room raises both.
    """
    pairs = [
        (_finite(lines[bit]), _finite(lines[other]))
        for bit, other in zip(gray.bits, gray.inverse, strict=False)
    ]
    if len(pairs) < FEWEST_PAIRS or not np.isfinite(sum(map(sum, pairs))).any():
        return 0.0
    light = np.median([0.5 * (bit + other) for bit, other in pairs], axis=0)[:, 1:-1]
    contrast = np.max([0.5 * np.abs(bit - other) for bit, other in pairs], axis=0)[:, 1:-1]
    lit = contrast > LIT * quantile(contrast[np.isfinite(contrast)], 0.95)
    squares = []
    for bit, other in pairs:
        half, mean = 0.5 * (bit - other), 0.5 * (bit + other)[:, 1:-1]
        slope = 0.5 * (half[:, 2:] - half[:, :-2])
        # A border that the camera resolves, and no stripe that blur makes grey.
        border = lit & (half[:, 2:] * half[:, :-2] < 0.0) & (np.abs(slope) > LIT * contrast)
        apart, rises = (mean - light)[border] / slope[border], slope[border] > 0.0
        sides = apart[rises], apart[~rises]
        if min(side.size for side in sides) < FEWEST:
            continue
        middles = [median(side) for side in sides]
        errors = [
            median(np.abs(side - middle)) / NORMAL_MEDIAN / side.size**0.5
            for side, middle in zip(sides, middles, strict=True)
        ]
        clear = abs(sum(middles)) > SURE * float(np.hypot(*errors))
        squares.append((0.5 * sum(middles)) ** 2 if clear else 0.0)
    return float(np.mean(squares)) ** 0.5 if len(squares) >= FEWEST_PAIRS else 0.0
