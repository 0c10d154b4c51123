"""The pages of a PDF: boxes are placed from top to bottom, figures as vectors where they stand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from fringeworks.report.drawing import Figure
from fringeworks.report.page.typeset import SMALL, Box, Sheet, wrapped
from fringeworks.types import InputError

PAPERS_MM = {"A4": (210.0, 297.0), "letter": (215.9, 279.4)}
"""Papers of a report, mm: that of the world, and that of North America."""
SIDE_MM, TOP_MM, BOTTOM_MM = 18.0, 16.0, 20.0
"""Margins, mm: punched holes and thumbs need as much."""
FOOT_MM = 9.0
"""Distance of the foot's top from the paper's lower edge, mm."""
LEAST_FILLED = 0.25
"""Share of a last page from which on it is worth its paper."""
SQUEEZES = (0.95, 0.9, 0.85, 0.8)
"""Factors of figures that are tried to spare a last page of few lines."""
FITTED = (0.95, 0.9, 0.85)
"""Factors of a page's figures that are tried to place one more on it: figures of one kind then look
alike on all pages, and text of 8 points keeps 6 on a page of 172 mm."""
POINTS_PER_MM = 72.0 / 25.4
"""Points, the unit of PDF, in a millimetre."""
IMAGE_DPI = 220
"""Resolution of maps and of what is drawn as an image, dots per inch: more than a printed page
shows at reading distance."""
POINTS_PER_INCH = 72
"""Points in an inch: the resolution at which Matplotlib draws a PDF."""


def paper_mm(name: str) -> tuple[float, float]:
    """Width and height of a paper.

    Raises
    ------
    InputError for an unknown one.
    """
    found = {known.lower(): size for known, size in PAPERS_MM.items()}.get(name.lower())
    if found is None:
        raise InputError(f"paper: expected {' or '.join(PAPERS_MM)}, got {name!r}")
    return found


class Pages:
    """A PDF that is written page by page."""

    def __init__(
        self, path: Path, metadata: dict[str, Any], paper: tuple[float, float], title: str
    ) -> None:
        from matplotlib.backends import backend_pdf

        self._backend: Any = backend_pdf
        self._file = self._backend.PdfFile(str(path), metadata=metadata)
        self._paper, self._title = paper, title

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.finalize()
        self._file.close()

    @property
    def room_mm(self) -> tuple[float, float]:
        """Width and height of a page's text, mm."""
        return self._paper[0] - 2 * SIDE_MM, self._paper[1] - TOP_MM - BOTTOM_MM

    def fill(self, boxes: Iterable[Box]) -> None:
        """Place all boxes on pages, and write them."""
        given = list(boxes)
        pages = _paged(given, self.room_mm[1])
        for factor in SQUEEZES if len(pages) > 1 else ():
            if _filled(pages[-1]) > LEAST_FILLED * self.room_mm[1]:
                break
            smaller = [box.squeeze(factor) if box.squeeze else box for box in given]
            tried = _paged(smaller, self.room_mm[1])
            pages = tried if len(tried) < len(pages) else pages
        for k, filled in enumerate(pages, 1):
            self._write(filled, f"{k} / {len(pages)}")

    def _write(self, page: list[tuple[Box, float]], number: str) -> None:
        """Draw a page."""
        width, height = self._paper
        size = (width / 25.4, height / 25.4)
        sheet = Sheet(Figure(figsize=size, dpi=POINTS_PER_INCH), width, height)
        for box, down in page:
            box.draw(sheet, SIDE_MM, TOP_MM + down)
        foot = height - FOOT_MM
        title = wrapped(self._title, SMALL, 0.8 * self.room_mm[0])[0]
        sheet.text(SIDE_MM, foot, title, SMALL)
        sheet.text(width - SIDE_MM, foot, number, SMALL, right=True)
        self._file.newPage(*size)
        self._draw(sheet.figure, (0.0, 0.0), 1.0)
        for figure, x, y, across in sheet.placed:
            scale = across / (25.4 * figure.get_figwidth())
            tall = scale * 25.4 * figure.get_figheight()
            self._draw(figure, (x, height - y - tall), scale)
        self._file.endStream()

    def _draw(self, figure: Figure, corner: tuple[float, float], scale: float) -> None:
        """Draw a figure with its lower left corner at a place of the page, mm."""
        dpi, size = IMAGE_DPI * scale, figure.get_size_inches()
        figure.set_dpi(POINTS_PER_INCH)
        left, low = (POINTS_PER_MM * v for v in corner)
        self._file.output(self._backend.Op.gsave)
        self._file.output(scale, 0, 0, scale, left, low, self._backend.Op.concat_matrix)
        inner = self._backend.RendererPdf(self._file, dpi, size[1], size[0])
        renderer = self._backend.MixedModeRenderer(figure, size[0], size[1], dpi, inner)
        figure.draw(renderer)
        renderer.finalize()
        self._file.output(self._backend.Op.grestore)


Page = list[tuple[Box, float]]
"""Boxes of a page with their tops, mm."""


def _paged(boxes: Iterable[Box], room: float) -> list[Page]:
    """Boxes on as many pages as they need."""
    pages: list[list[Box]] = []
    given: list[Box] = []  # of the last page, as they were before figures were fitted
    for group in _groups(boxes):
        wanted = [*given, *group]
        fitting = _fitting(wanted, room, any(box.squeeze for box in group))
        if given and fitting is not None:
            pages[-1], given = fitting, wanted
            continue
        # A group that is higher than a page stands on one alone.
        head = group[0].head if given else None
        given = group if head is None else [head, *group]
        pages.append(given)
    return [_placed(page) for page in pages] or [[]]


def _fitting(boxes: list[Box], room: float, squeezed: bool) -> list[Box] | None:
    """The boxes as they fit on a page, their figures smaller where need be; None if they do not."""
    if _filled(_placed(boxes)) <= room:
        return boxes
    for factor in FITTED if squeezed else ():
        tried = [box.squeeze(factor) if box.squeeze else box for box in boxes]
        if _filled(_placed(tried)) <= room:
            return tried
    return None


def _placed(boxes: Iterable[Box]) -> Page:
    """Boxes below each other from the top of a page."""
    page: Page = []
    down = 0.0
    for box in boxes:
        down += box.before if page else 0.0
        page.append((box, down))
        down += box.height
    return page


def _filled(page: Page) -> float:
    """How far down a page is filled, mm."""
    box, down = page[-1]
    return down + box.height


def _groups(boxes: Iterable[Box]) -> Iterable[list[Box]]:
    """Boxes that stay together."""
    group: list[Box] = []
    for box in boxes:
        group.append(box)
        if not box.keep:
            yield group
            group = []
    if group:
        yield [*group[:-1], replace(group[-1], keep=False)]
