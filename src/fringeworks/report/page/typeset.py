"""Text of a PDF: lines of a measured width, and the boxes that pages are filled with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any

from fringeworks.report.drawing import Figure, FontProperties

FAMILY = "DejaVu Sans"
"""Typeface of all text: it comes with Matplotlib, so that every machine sets the same pages."""
FURTHER = (
    "Noto Sans CJK SC",
    "Noto Sans CJK JP",
    "Source Han Sans SC",
    "Source Han Sans JP",
    "Noto Sans SC",
    "Noto Sans JP",
    "Microsoft YaHei",
    "SimHei",
    "PingFang SC",
    "Hiragino Sans",
    "Yu Gothic",
    "MS Gothic",
    "WenQuanYi Micro Hei",
    "WenQuanYi Zen Hei",
    "IPAexGothic",
    "Droid Sans Fallback",
)
"""Typefaces with Chinese and Japanese letters that systems bring. Those that are installed set what
the first one lacks, also names of parts and customers in other languages."""
POINT_MM = 25.4 / 72.0
"""A point, mm."""
LEADING = 1.35
"""Distance of lines over the size of the type."""
ASCENT = 0.93
"""Distance of the baseline from the top of a line, in sizes of the type."""
INK, QUIET, RULE = "#1b1f24", "#525a65", "#c9ced6"
"""Colours of text, of what is said beside it, and of lines, as on the page."""


@dataclass(frozen=True)
class Type:
    """A kind of text."""

    points: float
    bold: bool = False
    colour: str = INK

    @property
    def line_mm(self) -> float:
        """Height of a line, mm."""
        return LEADING * self.points * POINT_MM


TITLE = Type(17.0, bold=True)
"""Title of a document; twice the body, as on a screen."""
HEADING = Type(12.5, bold=True)
"""Heading of a chapter: one and a half times the body."""
VERDICT = Type(12.0, bold=True)
"""Verdict on top."""
BODY = Type(8.5)
"""Running text: 100 letters fit on a line of A4, the most that are easily read."""
LABEL = replace(BODY, colour=QUIET)
"""Names of values, and captions of tables."""
STRONG = replace(BODY, bold=True)
"""Headings within a chapter."""
SMALL = Type(7.0, colour=QUIET)
"""Captions, hashes and feet: the smallest type that is read without effort."""


@dataclass
class Sheet:
    """A page while it is filled: its text and lines, and the figures that stand on it."""

    figure: Figure
    width: float
    """mm."""
    height: float
    placed: list[tuple[Figure, float, float, float]] = field(default_factory=list)
    """Figures, with left and top of their place and their width, mm."""

    def text(self, x: float, y: float, words: str, kind: Type, *, right: bool = False) -> None:
        """Write a line whose top is at y, mm from the top."""
        base = y + ASCENT * kind.points * POINT_MM
        self.figure.text(
            x / self.width,
            1.0 - base / self.height,
            words,
            fontproperties=_font(kind),
            color=kind.colour,
            ha="right" if right else "left",
            va="baseline",
            parse_math=False,  # a dollar sign would begin a formula
        )

    def rule(self, x: float, y: float, length: float, colour: str = RULE, mm: float = 0.2) -> None:
        """Draw a horizontal line."""
        self._patch(x, y, length, mm, colour)

    def plate(self, x: float, y: float, width: float, height: float, colour: str) -> None:
        """Fill a box."""
        self._patch(x, y, width, height, colour)

    def _patch(self, x: float, y: float, width: float, height: float, colour: str) -> None:
        from fringeworks.report.drawing import Rectangle

        place = (x / self.width, 1.0 - (y + height) / self.height)
        size = (width / self.width, height / self.height)
        self.figure.add_artist(
            Rectangle(place, *size, facecolor=colour, edgecolor="none", linewidth=0)
        )


Draw = Callable[[Sheet, float, float], None]
"""Draws a box on a page; its left edge and its top, mm."""


@dataclass(frozen=True)
class Box:
    """Something of a fixed height that is not divided between pages."""

    height: float
    """mm."""
    draw: Draw
    before: float = 0.0
    """Distance from what stands above, mm; none at the top of a page."""
    keep: bool = False
    """Whether it stays on the page of the next box."""
    head: Box | None = None
    """What is repeated above it where it is the first on its page: the head of a table."""
    squeeze: Callable[[float], Box] | None = None
    """The same smaller, by a factor below 1: of figures, where few lines would fill a last page."""


@cache
def typefaces() -> tuple[str, ...]:
    """Return the typeface of all text, and those that are installed for letters it lacks."""
    from matplotlib.font_manager import fontManager

    installed = {one.name for one in fontManager.ttflist}
    return FAMILY, *(name for name in FURTHER if name in installed)


def has_letters(letters: str) -> bool:
    """Whether a typeface is there for each of some letters."""
    from matplotlib.font_manager import findfont, get_font

    fonts = [get_font(findfont(FontProperties(family=name))) for name in typefaces()]
    return all(any(ord(one) in font.get_charmap() for font in fonts) for one in letters)


def _font(kind: Type) -> FontProperties:
    weight = "bold" if kind.bold else "normal"
    return FontProperties(family=list(typefaces()), size=kind.points, weight=weight)


@lru_cache(maxsize=20_000)
def width_mm(words: str, kind: Type) -> float:
    """The width of text, mm."""
    from matplotlib.textpath import text_to_path

    width: Any = text_to_path.get_text_width_height_descent(words, _font(kind), ismath=False)[0]
    return float(width) * POINT_MM


def wrapped(words: str, kind: Type, room: float) -> list[str]:
    """Divide text into lines of a width; words that are longer are divided where they must."""
    lines: list[str] = []
    for part in words.split("\n"):
        line = ""
        for word in part.split(" "):
            longer = f"{line} {word}" if line else word
            if width_mm(longer, kind) <= room:
                line = longer
                continue
            if line:
                lines.append(line)
            *full, line = _divided(word, kind, room)
            lines += full
        lines.append(line)
    return lines


def _divided(word: str, kind: Type, room: float) -> list[str]:
    """Pieces of a word that fit into a width."""
    pieces = []
    while width_mm(word, kind) > room and len(word) > 1:
        count = max(1, int(len(word) * room / width_mm(word, kind)))
        while count > 1 and width_mm(word[:count], kind) > room:
            count -= 1
        pieces.append(word[:count])
        word = word[count:]
    return [*pieces, word]


def paragraph(
    words: str, kind: Type, room: float, *, before: float = 0.0, indent: float = 0.0
) -> list[Box]:
    """Lines of text; the first two and the last two stay together."""
    lines = wrapped(words, kind, room - indent)
    boxes = []
    for k, line in enumerate(lines):
        keep = len(lines) > 1 and k in (0, len(lines) - 2)
        boxes.append(Box(kind.line_mm, _line(line, kind, indent), before if k == 0 else 0.0, keep))
    return boxes


def _line(words: str, kind: Type, indent: float) -> Draw:
    return lambda sheet, x, y: sheet.text(x + indent, y, words, kind)


def together(boxes: Sequence[Box]) -> list[Box]:
    """Boxes that stay on one page."""
    return [replace(box, keep=True) for box in boxes[:-1]] + list(boxes[-1:])
