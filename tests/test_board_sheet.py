"""Printed boards: exact in mm, found by our own finder, and the same bytes in every run."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from matplotlib import rc_context

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.report.board_outlines import board_ink, cells_outline
from fringeworks.report.boards import TICK_MM
from fringeworks.report.papers import PAPERS, needed_mm, paper_size, place_on_sheet
from tests.grids import quick, thinned

DPI = 300
"""Resolution of the rendered pages, dots per inch: 0.085 mm per pixel."""
WITHIN_MM = 0.02
"""Largest error of distances between corners, mm."""
BOARDS = [
    ("chessboard:11x8:15", "A4", False),
    ("charuco:11x8:15:11", "A4", False),
    ("charuco:8x6:20:14:5X5_100:legacy", "letter", False),
    ("charuco:7x5:12.5:9.25:6X6_250", "A5", False),
    ("circles:9x7:15", "A4", False),
    ("circles:7x6:18", "legal", True),
    ("asymmetric-circles:4x11:16", "A4", False),
    ("asymmetric-circles:4x10:12", "300x200", True),
]
DRAWN = quick(BOARDS, BOARDS[0], BOARDS[2], BOARDS[5], BOARDS[7])
"""Every kind of board, in black on white and in white on black, on paper of several sizes."""


def pixels(figure, dpi=DPI):
    """The page as grey pixels."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi, format="png")
    return cv2.imdecode(np.frombuffer(buffer.getvalue(), np.uint8), cv2.IMREAD_GRAYSCALE)


@lru_cache
def sheet(text, paper, white):
    """The figure of a board, and its page as grey pixels."""
    figure = fw.report.board_sheet(fw.rig.parse_board(text), paper, white_on_black=white)
    return figure, pixels(figure)


def check_distances(image, board, mm_per_px=25.4 / DPI):
    """Every corner is found, and lies where it belongs against all others."""
    view = fw.rig.find_board(image, board)
    assert len(view.index) == len(board.points_mm)
    nominal, found = board.points_mm[view.index, :2], view.pixels * mm_per_px
    distance = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (nominal, found)]
    assert np.abs(distance[0] - distance[1]).max() < WITHIN_MM


@pytest.mark.parametrize(("text", "paper", "white"), DRAWN)
def test_boards_are_exact_and_found(text, paper, white):
    board = fw.rig.parse_board(text)
    figure, image = sheet(text, paper, white)
    assert sorted(25.4 * figure.get_size_inches()) == pytest.approx(sorted(paper_size(paper)))
    check_distances(image, board)
    names = [t.get_text() for t in figure.axes[0].texts]
    assert [fw.rig.parse_board(n) for n in names if ":" in n and n.startswith(board.kind)] == [
        board
    ]


@pytest.mark.parametrize(("text", "paper", "white"), DRAWN)
def test_the_drawing_is_the_simulated_board(text, paper, white):
    """Cell by cell what the virtual rig photographs, and white beyond the board's ink."""
    board = fw.rig.parse_board(text)
    figure, image = sheet(text, paper, white)
    width, height = 25.4 * figure.get_size_inches()
    x0, y0 = place_on_sheet(board, (width, height), white)
    left, top, right, bottom = board.extent_mm
    rng = np.random.default_rng(0)
    x, y = rng.uniform(left, right, 20000), rng.uniform(top, bottom, 20000)
    dark = board.albedo(x, y) < 0.5
    # Pixels on an edge are grey.
    # The virtual rig's ChArUco boards are images of 48 px per square, whose markers are rounded.
    d = board.pitch_mm / 32.0 if board.kind == "charuco" else 0.1
    steps = [(d, d), (d, -d), (-d, d), (-d, -d)]
    inside = np.all([(board.albedo(x + a, y + b) < 0.5) == dark for a, b in steps], axis=0)
    inside &= (x > left + 0.2) & (x < right - 0.2) & (y > top + 0.2) & (y < bottom - 0.2)
    # The image's rows count from its top; the page's last part of a pixel is cut off at the top.
    column = np.floor((x0 + x) * DPI / 25.4).astype(int)
    row = np.floor(image.shape[0] - (height - y0 - y) * DPI / 25.4).astype(int)
    seen = image[row, column] < 128
    assert inside.mean() > 0.75
    np.testing.assert_array_equal(seen[inside], dark[inside] ^ white)


@pytest.mark.parametrize(("paper", "across", "up"), [("A4", 100, 100), ("100x140", 70, 100)])
def test_rulers_have_their_length(paper, across, up):
    figure = fw.report.board_sheet("chessboard:3x3:10", paper, landscape=False)
    texts = [t.get_text() for t in figure.axes[0].texts]
    assert f"{across} mm across, {up} mm up" in texts[-1]
    image = pixels(figure).astype(float)
    h = image.shape[0]
    px = DPI / 25.4
    # The last third of the longest marks, beyond the shorter ones.
    y = h - (24.0 - 2.5 - 0.5 * (TICK_MM[1] + TICK_MM[2])) * px
    marks = 255.0 - image[round(y), :]
    assert length_of(marks, px) == pytest.approx(across, abs=0.01)
    x = (15.0 - 2.5 - 0.5 * (TICK_MM[1] + TICK_MM[2])) * px
    assert length_of(255.0 - image[: round(h - 23.0 * px), round(x)], px) == pytest.approx(
        up, abs=0.01
    )


def length_of(marks, px):
    """Distance of the first mark from the last, mm, by their centres of gravity."""
    dark = np.flatnonzero(marks > 2)
    groups = np.split(dark, np.flatnonzero(np.diff(dark) > 2) + 1)
    first, last = (np.average(g, weights=marks[g]) for g in (groups[0], groups[-1]))
    return (last - first) / px


@pytest.mark.parametrize("suffix", ["pdf", "svg", "png"])
def test_equal_runs_write_equal_bytes(tmp_path, suffix):
    a, b = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    fw.report.write_board(a, "charuco:7x5:20:15", dpi=100)
    with rc_context({"savefig.bbox": "tight", "svg.fonttype": "none", "pdf.fonttype": 42}):
        fw.report.write_board(b, "charuco:7x5:20:15", dpi=100)
    assert a.read_bytes() == b.read_bytes()
    content = a.read_bytes()
    assert b"charuco:7x5:20:15" in content
    assert b"CreationDate" not in content
    assert b"dc:date" not in content


def test_vector_files_have_the_size_of_the_paper(tmp_path):
    fw.report.write_board(tmp_path / "b.pdf", "chessboard:11x8:15", "A4", landscape=True)
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", (tmp_path / "b.pdf").read_bytes())
    assert [float(v) * 25.4 / 72 for v in box.groups()] == pytest.approx([297, 210], abs=1e-4)
    fw.report.write_board(tmp_path / "b.svg", "chessboard:11x8:15", "A4", landscape=True)
    found = re.search(r'width="([\d.]+)pt"', (tmp_path / "b.svg").read_text())
    assert float(found[1]) * 25.4 / 72 == pytest.approx(297, abs=1e-4)


@pytest.mark.parametrize(("text", "paper", "white"), DRAWN)
def test_lines_of_the_vectors_are_exact(tmp_path, text, paper, white):
    """The outline in the SVG, which has the same vectors as the PDF, in mm."""
    board = fw.rig.parse_board(text)
    fw.report.write_board(tmp_path / "b.svg", board, paper, white_on_black=white)
    group = (tmp_path / "b.svg").read_text().partition('<g id="board">')[2]
    numbers = re.search(r'd="([^"]+)"', group)[1]
    found = np.array([float(v) for v in re.findall(r"-?\d+\.?\d*", numbers)]).reshape(-1, 2)
    vertices = found * 25.4 / 72
    ink = board_ink(board)
    expected = ink.vertices[ink.codes != ink.CLOSEPOLY]
    size = np.ptp(expected, axis=0)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), size, atol=1e-4)


@pytest.mark.system
@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="pdftoppm (poppler) is not installed")
@pytest.mark.parametrize(("text", "paper", "white"), DRAWN)
def test_another_program_draws_the_same(tmp_path, text, paper, white):
    board = fw.rig.parse_board(text)
    fw.report.write_board(tmp_path / "b.pdf", board, paper, white_on_black=white)
    # Poppler places edges to a third of a pixel.
    command = ["pdftoppm", "-r", str(2 * DPI), "-gray", "-png", "-singlefile", "b.pdf", "b"]
    subprocess.run(command, cwd=tmp_path, check=True)
    image = cv2.imread(str(tmp_path / "b.png"), cv2.IMREAD_GRAYSCALE)
    check_distances(image, board, 25.4 / (2 * DPI))


def test_no_text_inside_the_board():
    for text, paper, white in BOARDS:
        board = fw.rig.parse_board(text)
        figure = fw.report.board_sheet(board, paper, white_on_black=white)
        width, height = 25.4 * figure.get_size_inches()
        x, y = place_on_sheet(board, (width, height), white)
        left, top, right, bottom = board.extent_mm
        figure.canvas.draw()
        axes = figure.axes[0]
        others = [p for p in axes.patches if p.get_gid().startswith("ruler")]
        for thing in (*axes.texts, *others):
            box = thing.get_window_extent().transformed(axes.transData.inverted())
            assert box.x1 < x + left or box.y0 > y + bottom
            assert box.x0 > 4.0
            assert box.x1 < width - 4.0
            assert box.y1 < height - 4.0
        assert x + right <= width
        assert y + top >= 0


def test_huge_boards_are_refused_at_once():
    with pytest.raises(fw.InputError, match="largest that fits: "):
        fw.report.board_sheet("chessboard:100000x100000:1", "A0")
    with pytest.raises(fw.InputError, match="at most 10000 squares or circles"):
        fw.report.board_sheet("circles:1000x1000:0.1", "A4")
    with pytest.raises(fw.InputError, match="at most 250 markers, .* 30 × 20 squares with 300"):
        fw.rig.parse_board("charuco:30x20:20:15")


def test_outlines_of_cells():
    ring = np.ones((3, 3), bool)
    ring[1, 1] = False
    assert len(cells_outline(ring).to_polygons()) == 2
    assert len(cells_outline(np.eye(3, dtype=bool)).to_polygons()) == 3
    assert len(cells_outline(np.ones((2, 5), bool)).vertices) == 5


TOO_LARGE = (
    "chessboard:11x8:150",
    "charuco:24x20:50.5:40",
    "circles:30x30:60",
    "asymmetric-circles:20x30:40",
)


@thinned(strength=1, paper=list(PAPERS), text=TOO_LARGE)
def test_boards_that_do_not_fit_are_refused_with_those_that_do(paper, text):
    with pytest.raises(fw.InputError, match="largest that fits: ") as caught:
        fw.report.board_sheet(text, paper)
    for name in str(caught.value).partition("largest that fits: ")[2].split(" or "):
        board = fw.rig.parse_board(name)
        fw.report.board_sheet(board, paper)
        more = board.pitch_mm + 0.1 if name.split(":")[1] == text.split(":")[1] else None
        if more is not None:
            width, height = sorted(needed_mm(replace(board, pitch_mm=more)))
            assert width > min(PAPERS[paper]) or height > max(PAPERS[paper])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: fw.report.board_sheet("chessboard:11x8:15", "B4"),
            "expected A5, A4, .* or width x height",
        ),
        (lambda: fw.report.board_sheet("chessboard:11x8:15", "20x30"), "60…5000 mm"),
        (lambda: fw.report.board_sheet("chessboard:11x8:15", "nanxinf"), "60…5000 mm"),
        (lambda: fw.report.board_sheet("board:11x8:15"), "expected chessboard:9x7:75"),
        (
            lambda: fw.report.board_sheet("chessboard:11x8:15", white_on_black=True),
            "grid of circles",
        ),
        (
            lambda: fw.report.board_sheet("chessboard:11x8:16", "A4", landscape=False),
            "fits: chessboard:11x8:15 or chessboard:10x8:16",
        ),
        (lambda: fw.report.write_board("b.jpg", "chessboard:11x8:15"), "one of .png, .pdf, .svg"),
        (lambda: fw.report.write_board("b.png", "chessboard:11x8:15", dpi=10), "72…2400"),
        (
            lambda: fw.report.write_board("b.png", "chessboard:11x8:15", "A0", dpi=600),
            "at most 439",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(call, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(fw.InputError, match=message):
        call()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text",
    [
        "chessboard:9x7:75",
        "charuco:8x6:30.125:22:5X5_100:legacy",
        "circles:9x7:0.1",
        "charuco:8x6:30:22",
    ],
)
def test_names_read_back(text):
    assert fw.rig.parse_board(text).name == text


def test_the_command(tmp_path, capsys):
    out = tmp_path / "board.pdf"
    assert run(["board", "charuco:11x8:15:11", "--paper", "A4", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    assert "--board charuco:11x8:15:11" in capsys.readouterr().out
    assert run(["board", "chessboard:11x8:50", "--out", str(out)]) == 2
    assert "largest that fits: chessboard:11x8:18.6" in capsys.readouterr().err
