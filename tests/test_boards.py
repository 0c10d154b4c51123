"""Boards in photographs like real ones: what OpenCV finds is found, and no corner is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import BoardNotFound
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.chessboard import _Lattice
from fringeworks.rig.calibration.circles import _without_wrong, numbered
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.calibration.outliers import mapped, off_board
from tests.board_photos import opencv_finds, orders, photo

WRONG_PX = 1.0
"""Error from which on a corner is wrong, px."""


def errors(view, taken):
    """Distance of every corner from its true place, px, for the numbering that fits best."""
    found = [
        np.linalg.norm(view.pixels - taken.truth[order[view.index]], axis=1)
        for order in orders(taken.board)
    ]
    return min(found, key=lambda e: float(np.median(e)))


@pytest.mark.parametrize(
    "first",
    [0, *(pytest.param(k, marks=pytest.mark.long) for k in (12, 24, 36))],
)
def test_random_photographs(first):
    missed, wrong = [], []
    for seed in range(first, first + 12):
        taken = photo(seed)
        try:
            view = find_board(taken.image, taken.board)
        except BoardNotFound as error:
            if opencv_finds(taken.image, taken.board):
                missed.append((seed, str(error)))
            continue
        wrong += [(seed, float(e)) for e in errors(view, taken) if e > WRONG_PX]
    assert not missed
    assert not wrong


@pytest.mark.parametrize("rows", [7, 8, 10, 12])
def test_asymmetric_grids_with_even_rows_are_numbered_right(rows):
    """OpenCV swaps neighbouring rows of these grids."""
    taken = photo(rows, f"asymmetric-circles:4x{rows}:10", things=False)
    view = find_board(taken.image, taken.board)
    assert len(view.index) == 4 * rows
    assert errors(view, taken).max() < 0.5


@pytest.mark.parametrize("seed", range(4))
def test_square_grids_of_circles_are_not_mirrored(seed):
    taken = photo(seed, "circles:5x5:10", things=False)
    view = find_board(taken.image, taken.board)
    assert len(view.index) == 25
    assert errors(view, taken).max() < 0.5


def test_circles_that_are_no_image_of_the_board_are_refused():
    board = parse_board("circles:6x4:10")
    right = 3.0 * board.points_mm[:, :2] + 50.0
    np.testing.assert_array_equal(numbered(right, board), right)
    np.testing.assert_array_equal(numbered(right[::-1], board), right)
    shuffled = np.random.default_rng(0).permutation(right)
    assert numbered(shuffled, board) is None


@pytest.mark.parametrize("degree", [0, 2, 3])
def test_wrong_corners_are_told_from_bent_boards(degree):
    rng = np.random.default_rng(degree)
    y, x = (a.ravel().astype(float) for a in np.mgrid[:8, :11])
    H = np.array([[28.0, 2.0, 60.0], [-3.0, 26.0, 40.0], [4e-3, -3e-3, 1.0]])
    pixels = mapped(H, np.column_stack((x, y)))
    if degree:
        pixels += 1.5 * ((pixels - pixels.mean(axis=0)) / 100.0) ** degree
    pixels += rng.normal(0, 0.03, pixels.shape)
    places = np.column_stack((x, y))
    assert not off_board(places, pixels).any()
    for k in (0, 10, 40, 87):  # corners of the board have the largest leverage
        moved = pixels.copy()
        moved[k] += (0.9, -0.9)
        assert np.flatnonzero(off_board(places, moved)).tolist() == [k]
    assert not off_board(places[:7], rng.normal(0, 5, (7, 2))).any()


@pytest.mark.parametrize("text", ["chessboard:9x6:10", "circles:9x6:10"])
def test_a_displaced_corner_is_left_out(text):
    """Something covers a part of one place and looks like a corner or circle beside it."""
    taken = photo(5, text, things=False)
    x, y = np.rint(taken.truth[10]).astype(int)
    image = taken.image.copy()
    image[y - 9 : y + 10, x - 9 : x + 10] = np.roll(
        image[y - 9 : y + 10, x - 9 : x + 10], 3, axis=1
    )
    view = find_board(image, taken.board)
    assert len(view.index) >= len(taken.truth) - 3
    assert errors(view, taken).max() < WRONG_PX


def test_a_board_whose_last_row_is_dark_is_found():
    """OpenCV sees the whole board, and one row of it is too dark to be measured."""
    taken = photo(1, "chessboard:9x6:10", things=False)
    last = taken.truth.reshape(6, 9, 2)[-2:]
    along, between = last[0, -1] - last[0, 0], last.mean(axis=(0, 1))
    v, u = np.mgrid[: taken.image.shape[0], : taken.image.shape[1]]
    side = along[0] * (v - between[1]) - along[1] * (u - between[0])
    image = np.where(side < 0, taken.image, 0.07 * taken.image)
    image += np.random.default_rng(0).normal(0, 3.0, image.shape)
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    view = find_board(image, taken.board)
    assert len(view.index) == 45
    assert errors(view, taken).max() < WRONG_PX


def test_half_lit_circles_are_told_by_their_areas():
    """The edge of the light moves an outer row as a whole, which a smooth map may follow."""
    board = parse_board("asymmetric-circles:3x8:10")
    H = np.array([[4.0, 0.3, 60.0], [-0.3, 3.8, 40.0], [4e-4, -3e-4, 1.0]])
    pixels = mapped(H, board.points_mm[:, :2])
    ink = 300.0 / (1.0 + board.points_mm[:, :2] @ H[2, :2]) ** 3
    view = BoardView(np.arange(24), pixels, ink_px=ink)
    assert len(_without_wrong(view, board).index) == 24
    ink[[21, 22, 23]] *= (1.15, 0.7, 1.4)
    view = BoardView(np.arange(24), pixels, ink_px=ink)
    assert _without_wrong(view, board).index.tolist() == list(range(21))


def test_a_smaller_board_that_grew_does_not_end_the_search():
    """False corners around a board of 5 × 4 corners once made it 27 corners of 5 × 6."""
    board = parse_board("chessboard:5x6:10")
    lattice = object.__new__(_Lattice)
    lattice.corners = {(i, j): np.zeros(2) for i in range(5) for j in range(6) if i + j < 8}
    lattice.part, lattice.whole = (5, 4), False
    assert len(lattice.corners) == 27
    assert lattice.rank(board) == (True, 27)
    assert not lattice.is_nearly_complete(board)
    lattice.part, lattice.whole = (5, 6), True
    assert lattice.is_nearly_complete(board)
