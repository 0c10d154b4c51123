"""What a report consists of, whether it becomes a page or a PDF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure
    from fringeworks.report.viewer.pack import PackedSurface


@dataclass(frozen=True)
class Facts:
    """Names and values, a line each."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Head:
    """The head of a report: fields, and lines to sign on."""

    rows: tuple[tuple[str, str], ...]
    """Names and texts; an empty text is a line to fill in by hand."""
    inspector: str | None = None
    """Who inspects, "" for a line to fill in; None where nobody signs."""
    language: str = "en"
    """Of the whole report, as in ISO 639."""


@dataclass(frozen=True)
class Table:
    """A table; all rows have the length of the columns."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    bad: tuple[int, ...] = ()
    """Rows that are marked as failed."""
    doubtful: tuple[int, ...] = ()
    """Rows that are marked as undecided."""
    links: tuple[str, ...] = ()
    """Page behind the first cell of every row; none by default, and where it is empty."""
    search: bool = False
    """Whether a page offers to search the rows."""

    @classmethod
    def judged(
        cls,
        columns: tuple[str, ...],
        rows: tuple[tuple[str, ...], ...],
        caption: str,
        verdicts: Sequence[str | None],
    ) -> Table:
        """A table with a verdict for each row, None for none: "fail" and "undecided" are marked."""
        bad, doubtful = (
            tuple(k for k, verdict in enumerate(verdicts) if verdict == marked)
            for marked in ("fail", "undecided")
        )
        return cls(columns, rows, caption, bad, doubtful)


@dataclass(frozen=True)
class Picture:
    """A figure with the text for those who do not see it."""

    figure: Figure
    caption: str


@dataclass(frozen=True)
class Surface:
    """A surface to turn, and its maps; two surfaces can be compared."""

    pack: tuple[Callable[[], PackedSurface], ...]
    """Pack the surfaces; a PDF, and a page with too many surfaces, never do."""
    caption: str
    draw: Callable[[], Figure]
    """Draws what is shown where a surface cannot be turned: in a PDF."""


@dataclass(frozen=True)
class Findings:
    """Findings: severity, kind, what was seen, causes, what to do."""

    rows: tuple[tuple[str, str, str, str, str], ...]
    hidden: int = 0
    """Number of further findings that are not listed."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Origin:
    """What is needed to compute a result again: names and values."""

    rows: tuple[tuple[str, str], ...]


Block = Facts | Origin | Table | Picture | Surface | Findings | Text
"""A part of a chapter."""


@dataclass(frozen=True)
class Chapter:
    """A part of a report with a heading."""

    title: str
    blocks: tuple[Block, ...]
