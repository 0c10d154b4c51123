"""Random photographs of boards with known corners: clutter, hands, edges of light, noise, JPEG."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.outliers import mapped

SIZE = (640, 480)
"""Columns and rows of a photograph."""
FINE = 2
"""Samples per pixel and direction before the picture is made smaller."""


@dataclass(frozen=True)
class Photo:
    """A photograph of a board."""

    image: np.ndarray
    board: Board
    truth: np.ndarray
    """True places of the board's points, (n, 2), px."""


def random_text(rng: np.random.Generator) -> str:
    """Description of a random board."""
    kind = rng.choice(["chessboard", "circles", "asymmetric-circles", "charuco"])
    low, high = {
        "chessboard": ((5, 4), (14, 11)),
        "circles": ((4, 4), (12, 9)),
        "asymmetric-circles": ((3, 7), (6, 13)),
        "charuco": ((5, 4), (13, 10)),
    }[str(kind)]
    across, down = rng.integers(low, high)
    return f"{kind}:{across}x{down}:10" + (":7" if kind == "charuco" else "")


def photo(seed: int, text: str | None = None, *, things: bool = True) -> Photo:
    """A random photograph; ``things`` are clutter, hands, edges of the light and white circles."""
    rng = np.random.default_rng(seed)
    board = parse_board(text or random_text(rng))
    H = _camera(board, rng)
    v, u = np.mgrid[: SIZE[1] * FINE, : SIZE[0] * FINE]
    pixels = (np.column_stack((u.ravel(), v.ravel())) + 0.5) / FINE - 0.5
    x, y = mapped(np.linalg.inv(H), pixels).T
    left, top, right, bottom = board.extent_mm
    on_sheet = ((x > left) & (x < right) & (y > top) & (y < bottom)).reshape(u.shape)
    paint = board.albedo(x, y).reshape(u.shape)
    if things and "circles" in board.kind and rng.random() < 0.35:
        paint = 0.93 - paint
    light = np.where(on_sheet, paint, _clutter(rng) if things else 0.4).astype(np.float32)
    truth = mapped(H, board.points_mm[:, :2])
    if things and rng.random() < 0.3:
        _hand(light, truth, rng)
    fine = np.stack((u, v), axis=-1) / FINE
    light *= _lamp(fine, rng) * (_edge(fine, truth, rng) if things else 1.0)
    return Photo(_taken(light, rng), board, truth)


def _camera(board: Board, rng: np.random.Generator) -> np.ndarray:
    """Homography from the board to the frame, tilted by up to 40°, all of the sheet in view."""
    width, height = SIZE
    focal = 1.3 * width
    left, top, right, bottom = board.extent_mm
    corners = np.array([[left, top], [right, top], [left, bottom], [right, bottom]])
    tilt, side = np.radians(rng.uniform(0, 40)), rng.uniform(0, 2 * np.pi)
    R = cv2.Rodrigues(tilt * np.array([np.cos(side), np.sin(side), 0.0]))[0]
    R = R @ cv2.Rodrigues(np.array([0.0, 0.0, rng.choice([0.1, np.pi]) * rng.uniform(-1, 1)]))[0]
    distance = focal * (right - left) / (rng.uniform(0.3, 0.8) * width)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    while True:
        place = np.array([*rng.uniform(-0.15, 0.15, 2) * width * distance / focal, distance])
        t = place - R[:, :2] @ corners.mean(axis=0)
        H = K @ np.column_stack((R[:, 0], R[:, 1], t))
        seen = mapped(H, corners)
        if (seen > 3).all() and (seen < np.array(SIZE) - 4).all():
            return H
        distance *= 1.05


def _clutter(rng: np.random.Generator) -> np.ndarray:
    """What lies behind the board: bars, discs and other chessboards."""
    width, height = SIZE[0] * FINE, SIZE[1] * FINE
    behind = np.full((height, width), rng.uniform(0.1, 0.7), np.float32)
    for _ in range(rng.integers(0, 25)):
        x, y = (int(k) for k in rng.integers(0, (width, height)))
        shade = float(rng.uniform(0.03, 0.95))
        what, side = rng.integers(3), int(rng.integers(15, 90))
        if what == 0:
            end = tuple(int(k) for k in rng.integers(0, (width, height)))
            cv2.line(behind, (x, y), end, shade, side // 2)
        elif what == 1:
            cv2.circle(behind, (x, y), side, shade, -1)
        else:
            for i, j in np.ndindex(6, 5):
                square = (x + i * side, y + j * side, side, side)
                cv2.rectangle(behind, square, 0.05 if (i + j) % 2 else 0.85, -1)
    return behind


def _hand(light: np.ndarray, truth: np.ndarray, rng: np.random.Generator) -> None:
    """A hand with three fingers over one of the outer corners."""
    corner = truth[rng.choice([0, -1])] + rng.normal(0, 15, 2)
    shade, size = float(rng.uniform(0.3, 0.6)), int(rng.uniform(15, 60))
    middle = tuple(int(k * FINE) for k in corner)
    cv2.ellipse(light, middle, (size * FINE, size), float(rng.uniform(0, 360)), 0, 360, shade, -1)
    for reach in rng.uniform(0.05, 0.25, 3):
        tip = corner + reach * (truth.mean(axis=0) - corner) + rng.normal(0, 0.3 * size, 2)
        cv2.line(light, middle, tuple(int(k * FINE) for k in tip), shade, max(size // 2, 2))


def _lamp(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Uneven light."""
    angle, least = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.0)
    along = (pixels / SIZE - 0.5) @ [np.cos(angle), np.sin(angle)] + 0.5
    return least + (1.0 - least) * np.clip(along, 0, 1)


def _edge(pixels: np.ndarray, truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The edge of the projector's light beside the outermost corners, in a third of the pictures."""
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle)])
    beyond = (truth @ normal).max() + rng.uniform(-5, 50)
    ambient = rng.uniform(0.02, 0.35) if rng.random() < 0.35 else 1.0
    return np.where(pixels @ normal < beyond, 1.0, ambient)


def _taken(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Blur, noise, rounding and, in a third of the pictures, JPEG."""
    small = cv2.resize(light, SIZE, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), rng.uniform(0.4, 1.1))
    counts = small * rng.uniform(90, 250) / np.percentile(small, 99.5)
    counts += rng.normal(0, rng.choice([0.7, 2.0, 5.0]), counts.shape)
    image = np.clip(np.rint(counts), 0, 255).astype(np.uint8)
    if rng.random() < 0.35:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(50, 95))]
        image = cv2.imdecode(cv2.imencode(".jpg", image, quality)[1], cv2.IMREAD_GRAYSCALE)
    return image


def orders(board: Board) -> list[np.ndarray]:
    """Numberings that show the same board: as it is, and turned where it looks the same."""
    across, down = board.grid
    number = np.arange(across * down).reshape(down, across)
    turned = [number, number[::-1, ::-1]]
    if across == down:
        turned += [np.rot90(number), np.rot90(number, 3)]
    return [order.ravel() for order in turned]


def opencv_finds(image: np.ndarray, board: Board) -> bool:
    """Whether one of OpenCV's detectors finds the whole board."""
    if board.kind == "chessboard":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE
        return bool(
            cv2.findChessboardCornersSB(image, board.grid, flags=flags)[0]
            or cv2.findChessboardCorners(image, board.grid)[0]
        )
    if board.kind == "charuco":
        index = cv2.aruco.CharucoDetector(board.aruco).detectBoard(image)[1]
        return index is not None and len(index) == len(board.points_mm)
    symmetric = board.kind == "circles"
    grid = cv2.CALIB_CB_SYMMETRIC_GRID if symmetric else cv2.CALIB_CB_ASYMMETRIC_GRID
    return any(cv2.findCirclesGrid(i, board.grid, flags=grid)[0] for i in (image, 255 - image))
