"""The camera's blur over its frame and over distances, from the edges at a board's corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.pinhole import transform
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import CameraBlur, FloatMap
from fringeworks.types.camera_blur import BLUR_TERMS, blur_terms

CHOICES = ((0,), (0, 4, 5), (0, 1, 2, 3), tuple(range(BLUR_TERMS)))
"""Terms of the blur that are tried: none but the constant, those of the distance, those of the
place, all of them."""
FAR_SIGMAS = 4.0
"""Distance from the fit, in robust standard deviations, from which on a corner does not count: dirt
and highlights make some edges seem wide."""
ROUNDS = 4
"""Rounds of the fit, after each of which corners that are far off are chosen anew."""


def camera_blur(
    views: Sequence[BoardView], poses: Sequence[FloatMap], board: Board, shape: tuple[int, int]
) -> CameraBlur | None:
    """Estimate the blur of a camera from the corners of a board in several poses.

    Parameters
    ----------
    views : sequence of BoardView
    poses : sequence of (4, 4) arrays
        ``T_camera_board`` of each, mm.
    board : Board
    shape : (int, int)
        Rows and columns of the frame.

    Returns
    -------
    CameraBlur; None where the board has circles, whose edges are not fitted.

    Notes
    -----
    The variances of the blurred edges are fitted by terms of place and distance
    (``CameraBlur``). The terms are those that predict a pose best from all others, and the error of
    that prediction is the error of the blur.
    """
    seen = [
        (v.pixels, transform(T, board.points_mm[v.index])[:, 2], np.square(v.blur_px))
        for v, T in zip(views, poses, strict=True)
        if v.blur_px is not None and len(v.blur_px)
    ]
    if not seen:
        return None
    depth = np.concatenate([z for _, z, _ in seen])
    middle = float(1.0 / np.mean(1.0 / depth))
    designs = [blur_terms(shape, pixels, z, middle) for pixels, z, _ in seen]
    variances = [v for _, _, v in seen]
    errors = {terms: _predicted(designs, variances, terms) for terms in CHOICES}
    terms = min(CHOICES, key=lambda one: errors[one])
    factors = np.zeros(BLUR_TERMS)
    factors[list(terms)] = _fitted(np.concatenate(designs), np.concatenate(variances), terms)
    usual = float(np.median(np.concatenate(variances)))
    return CameraBlur(
        tuple(map(float, factors)),
        middle,
        (float(depth.min()), float(depth.max())),
        errors[terms] / usual,
    )


def _fitted(design: FloatMap, variance: FloatMap, terms: tuple[int, ...]) -> FloatMap:
    rows, used = design[:, list(terms)], np.ones(len(variance), bool)
    for _ in range(ROUNDS):
        factors = np.linalg.lstsq(rows[used], variance[used], rcond=None)[0]
        off = variance - rows @ factors
        near = np.abs(off - np.median(off)) <= FAR_SIGMAS * max(robust_sigma(off[used]), 1e-9)
        if np.count_nonzero(near) < 2 * len(terms):
            break
        used = near
    return np.asarray(factors)


def _predicted(
    designs: Sequence[FloatMap], variances: Sequence[FloatMap], terms: tuple[int, ...]
) -> float:
    """Root mean square error of the variance of each pose, predicted from all others, px²; with a
    single pose, the scatter of its corners."""
    if len(designs) == 1:
        return robust_sigma(variances[0]) if terms == (0,) else np.inf
    errors = []
    for k, (design, variance) in enumerate(zip(designs, variances, strict=True)):
        others = [np.concatenate([*a[:k], *a[k + 1 :]]) for a in (designs, variances)]
        if len(others[1]) < 2 * len(terms):
            return float(np.inf)
        factors = _fitted(others[0], others[1], terms)
        errors.append(float(np.median(variance - design[:, list(terms)] @ factors)))
    return float(np.sqrt(np.mean(np.square(errors))))
