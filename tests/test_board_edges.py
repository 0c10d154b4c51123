"""Boards on sheets of several sizes and grounds, by a photographer of its own, blurred to 1.5 px."""

import cv2
import numpy as np
import pytest
import scipy

from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.calibration.corners import find_board

SHAPE = (400, 480)
OVER = 3
GROUNDS = {
    "dark": lambda _: 0.02,
    "even": lambda _: 0.4,
    "cluttered": lambda at: np.where(
        np.sin(at[1] / 17 + 0.3 * np.sin(at[0] / 23)) * np.sin(at[0] / 13 + at[1] / 41) > 0.2,
        0.7,
        0.2,
    ),
}


def photograph(board, ground, margin, blur_px, seed):
    """A photograph and the true corners; the squares end in ``margin`` squares of white paper."""
    rng = np.random.default_rng(seed)
    h, w = SHAPE
    across, down = board.grid
    middle = (np.array(board.grid) - 1) / 2
    tilt, to = np.deg2rad(rng.uniform(0, 55)), rng.uniform(0, 2 * np.pi)
    R = cv2.Rodrigues(tilt * np.array([np.cos(to), np.sin(to), 0.0]))[0]
    R = R @ cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(0, 2 * np.pi)]))[0]
    focal, k1 = w * rng.uniform(1.1, 1.5), rng.uniform(-0.1, 0.1)
    far = focal * np.hypot(across + 1, down + 1) / (h * rng.uniform(0.8, 1.05))
    at = np.array([rng.uniform(-0.05, 0.05) * far, rng.uniform(-0.05, 0.05) * far, far])
    y, x = (np.mgrid[: h * OVER, : w * OVER] + 0.5) / OVER - 0.5
    p, q = (x - w / 2) / focal, (y - h / 2) / focal
    bent = np.stack((p, q))
    for _ in range(8):
        bent = np.stack((p, q)) / (1 + k1 * np.sum(bent**2, axis=0))
    ways = np.stack((*bent, np.ones_like(p)), axis=-1)
    points = ways * ((R[:, 2] @ at) / (ways @ R[:, 2]))[..., None] - at
    i, j = (points @ R[:, k] + middle[k] for k in (0, 1))
    squares = (i > -1) & (i < across) & (j > -1) & (j < down)
    paper = np.maximum(np.abs(i - middle[0]) - middle[0], np.abs(j - middle[1]) - middle[1])
    dark = squares & ((np.floor(i) + np.floor(j)) % 2 == 0)
    albedo = np.where(paper < 1 + margin, np.where(dark, 0.08, 0.85), GROUNDS[ground]((y, x)))
    light = scipy.ndimage.gaussian_filter(190 * albedo, blur_px * OVER, mode="nearest")
    light = light.reshape(h, OVER, w, OVER).mean(axis=(1, 3)) + rng.standard_normal(SHAPE)
    corners = np.stack(np.meshgrid(np.arange(across), np.arange(down)), -1).reshape(-1, 2) - middle
    seen = corners @ R[:, :2].T + at
    seen = seen[:, :2] / seen[:, 2:]
    seen *= 1 + k1 * np.sum(seen**2, axis=1, keepdims=True)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8), seen * focal + (w / 2, h / 2)


@pytest.mark.parametrize(
    ("kind", "ground", "margin", "blur_px", "seed"),
    [
        ("chessboard:9x6:20", "even", 0.0, 1.2, 0),
        ("chessboard:9x6:20", "cluttered", 0.5, 1.5, 1),
        ("chessboard:10x7:20", "dark", 0.5, 1.5, 0),
        ("chessboard:6x5:20", "cluttered", 1.0, 1.5, 6),
        ("chessboard:6x5:20", "cluttered", 1.0, 1.5, 11),
    ],
)
def test_squares_that_end_are_no_corners(kind, ground, margin, blur_px, seed):
    """Where the outer squares end, one square or two meet something even: no crossing of edges."""
    board = parse_board(kind)
    image, truth = photograph(board, ground, margin, blur_px, seed)
    view = find_board(image, board)
    errors = min(
        (np.hypot(*(view.pixels - other[view.index]).T) for other in (truth, truth[::-1])),
        key=np.max,
    )
    assert len(view.index) >= 0.95 * len(truth)
    assert errors.max() < 0.12
    assert np.sqrt(np.mean(errors**2)) < 0.03
