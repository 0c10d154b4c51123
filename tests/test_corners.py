"""Boards are found in uneven light and with hidden corners, to hundredths of a pixel."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.rig.calibration.board import parse_board
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.pinhole import project, transform
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body
from tests.grids import quick
from tests.rigs import board, poses, rig, shoot

pytestmark = pytest.mark.statistical

FORMS = [
    "chessboard:11x8:12",
    "chessboard:8x8:15",
    "chessboard:6x9:14",
    "charuco:12x9:12:8.5",
    "charuco:12x9:12:8.5:legacy",
    "charuco:8x6:18:13:5X5_250",
    "circles:9x7:15",
    "asymmetric-circles:4x11:9",
]


@lru_cache
def _picture(text: str, *, seed: int = 1, pose: int = 1, **optics):
    target = board(text)
    T = poses(4, 3, text)[pose]
    _, _, frames = shoot([board_body(target, T)], Optics(seed=seed, **optics), both=False)
    truth = project(rig().camera, transform(T, target.points_mm))
    return np.mean([f.astype(float) for f in frames], axis=0), truth


def picture(text: str, **settings):
    """A mean frame of a board, taken once per set of settings, and its true corners."""
    image, truth = _picture(text, **settings)
    return image.copy(), truth


def rms(view, truth):
    return float(np.sqrt(np.mean((view.pixels - truth[view.index]) ** 2)))


@pytest.mark.parametrize("text", quick(FORMS, *FORMS[::2], FORMS[7]))
def test_every_kind_is_found(text):
    image, truth = picture(text)
    view = find_board(image, board(text))
    if board(text).grid == (8, 8):
        # A square board looks the same after a quarter turn, so its numbering is arbitrary.
        distance = np.linalg.norm(view.pixels[:, None] - truth, axis=2).min(axis=1)
        assert np.sqrt(np.mean(distance**2)) < 0.02
        return
    assert len(view.index) == len(truth)
    # Perspective moves the centres of gravity of circles; calibration corrects that.
    assert rms(view, truth) < (0.1 if "circles" in text else 0.02)


def test_corners_are_far_better_than_opencv_s():
    import cv2

    image, truth = picture(FORMS[0])
    view = find_board(image, board())
    start = truth.astype(np.float32)[:, None].copy()
    eight = np.clip(image * (230 / image.max()), 0, 255).astype(np.uint8)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    theirs = cv2.cornerSubPix(eight, start, (5, 5), (-1, -1), criteria)[:, 0]
    assert rms(view, truth) < 0.3 * np.sqrt(np.mean((theirs - truth) ** 2))


def test_found_in_a_strong_gradient():
    image, truth = picture(FORMS[0])
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    light = 0.15 + 0.85 * x / image.shape[1] * (0.3 + 0.7 * y / image.shape[0])
    view = find_board(image * light, board())
    assert len(view.index) == 88
    assert rms(view, truth) < 0.03


HIDDEN = [[0, 49], [38, 39], [5, 82], [24, 60], [10, 87]]


@pytest.mark.parametrize(
    "hidden", [HIDDEN[0], *(pytest.param(h, marks=pytest.mark.long) for h in HIDDEN[1:])]
)
def test_two_hidden_corners_are_left_out(hidden):
    image, truth = picture(FORMS[0])
    for k in hidden:
        x, y = truth[k].astype(int)
        image[max(y - 12, 0) : y + 12, max(x - 12, 0) : x + 12] = 20.0
    view = find_board(image, board())
    assert set(range(88)) - set(view.index.tolist()) == set(hidden)
    assert rms(view, truth) < 0.02


def test_hidden_markers_leave_the_rest():
    image, truth = picture("charuco:12x9:12:8.5")
    x, y = truth[40].astype(int)
    image[y - 40 : y + 40, x - 40 : x + 40] = 20.0
    view = find_board(image, board("charuco:12x9:12:8.5"))
    assert 60 <= len(view.index) < 88
    assert rms(view, truth) < 0.02


OTHERS = [
    ("chessboard:10x8:12", r"expected 10 × 8 inner corners, found (11 × 8|8 × 11)"),
    ("chessboard:11x7:12", r"expected 11 × 7 inner corners, found (11 × 8|8 × 11)"),
    ("chessboard:12x9:12", r"expected 12 × 9 inner corners, found (11 × 8|8 × 11)"),
    ("charuco:12x9:12:9", "corners of a ChArUco board"),
    ("circles:9x7:12", "circles, found no such grid"),
]


@pytest.mark.parametrize(
    ("text", "message"),
    quick(OTHERS, *OTHERS[2:]),
)
def test_another_board_is_named(text, message):
    image, _ = picture(FORMS[0])
    with pytest.raises(InputError, match=message):
        find_board(image, parse_board(text))


def test_nothing_is_found_in_noise():
    noise = np.random.default_rng(0).uniform(0, 255, (300, 400))
    for text in ("chessboard:9x7:10", "charuco:8x6:10:7", "circles:9x7:10"):
        with pytest.raises(InputError):
            find_board(noise, parse_board(text))
    with pytest.raises(InputError, match="grey"):
        find_board(np.zeros((5, 5, 3)), board())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "chess:9x7:10",
        "chessboard:9x7",
        "chessboard:9:10",
        "chessboard:2x7:10",
        "chessboard:9x7:0",
        "chessboard:9x7:ten",
        "charuco:8x6:10",
        "charuco:8x6:10:12",
        "charuco:8x6:10:7:NONE",
        "chessboard:9x7:10:legacy",
        "circles:9x7:nan",
    ],
)
def test_invalid_boards_are_refused(text):
    with pytest.raises(InputError, match="board: expected"):
        parse_board(text)


def test_points_of_boards():
    assert parse_board("charuco:8x6:30:22:DICT_5X5_100:legacy").legacy
    points = parse_board("asymmetric-circles:4x11:20").points_mm
    assert points.shape == (44, 3)
    np.testing.assert_allclose(points[[0, 1, 4]], [[0, 0, 0], [40, 0, 0], [20, 20, 0]])
    target = parse_board("charuco:8x6:30:22")
    theirs = target.aruco.getChessboardCorners()
    np.testing.assert_allclose(target.points_mm, theirs, atol=1e-4)


def test_false_corners_beyond_a_board_are_dropped():
    """A cross of edges where the next column would be: a clip on the sheet, or the light's edge."""
    image, truth = picture(FORMS[0])
    corners = truth.reshape(8, 11, 2)
    x, y = (2.0 * corners[3, -1] - corners[3, -2]).astype(int)
    dark, bright = np.percentile(image, (5, 95))
    along = corners[3, -1] - corners[3, -2]
    down = corners[4, -1] - corners[3, -1]
    v, u = np.mgrid[-14:15, -14:15]
    first = u * along[1] - v * along[0] > 0
    second = u * down[1] - v * down[0] > 0
    for sign in (False, True):
        spoiled = image.copy()
        spoiled[y - 14 : y + 15, x - 14 : x + 15] = np.where((first ^ second) == sign, dark, bright)
        view = find_board(spoiled, board())
        assert len(view.index) == 88
        assert rms(view, truth) < 0.1


def test_edge_of_the_light_beside_the_board():
    image, truth = picture(FORMS[0])
    corners = truth.reshape(8, 11, 2)
    step = (corners[:, -1] - corners[:, -2]).mean(axis=0)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    for squares in (0.6, 1.0, 1.4):
        x, y = corners[:, -1].mean(axis=0) + squares * step
        lit = (u - x) * step[0] + (v - y) * step[1] < 0
        view = find_board(image * np.where(lit, 1.0, 0.06), board())
        assert len(view.index) >= 84
        assert rms(view, truth) < 0.03


@pytest.mark.parametrize("text", ["circles:9x7:15", "asymmetric-circles:4x11:9"])
def test_white_circles_on_black_are_found(text):
    image, truth = picture(text)
    bright = np.percentile(image, 95)
    view = find_board(np.maximum(1.1 * bright - image, 0.0), board(text))
    assert len(view.index) == len(truth)
    assert rms(view, truth) < 0.15
