"""What is shown of a kind of result, declared once: figures, words, picture, chapter, surface.

A type that is defined in a file such as ``stack/light_separation.py`` is described in the file of
the same name in ``kinds/``. That file is loaded when a result of the type is shown first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fringeworks.types import Finding, InputError

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure
    from fringeworks.report.page.blocks import Chapter
    from fringeworks.report.page.chapter import Context
    from fringeworks.report.sheets import Sheet
    from fringeworks.report.verdicts import Verdict

Result = TypeVar("Result")


@dataclass(frozen=True)
class Rows:
    """A table among words."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    ruled: bool = False
    """Whether lines stand between the rows, which cells of whole sentences need."""


Word = str | Rows | Finding
"""A line, a table or a finding; of several findings in a row, the printer may choose."""


@dataclass(frozen=True)
class Kind(Generic[Result]):
    """What is shown of results of one type; None for what such results do not have."""

    figures: Callable[[Result], dict[str, Any]] | None = None
    """The numerical results, ready for JSON; see ``summarise``."""
    words: Callable[[Result, dict[str, Any]], Iterator[Word]] | None = None
    """What a command prints of a result and its figures."""
    picture: Callable[[Result, str | None], Sheet | Figure] | None = None
    """The picture, with the name of the object or capture before its title; see ``plot``."""
    chapter: Callable[[Result, Context], Chapter] | None = None
    """The chapter of a report; by default figures and picture."""
    surface: Callable[[Result], Any] | None = None
    """The map or the points in the result that the viewer turns."""
    verdict: Callable[[Result], Verdict] | None = None
    """What stands on top of a report of this result alone."""
    head: Sequence[str] = ()
    """Fields of the head of a report that judges such a result; see ``HEAD_FIELDS``."""


NOTHING: Kind[Any] = Kind()
"""Kind of what is no result."""
KINDS: dict[type, Kind[Any]] = {}
"""What is shown of each type whose file was loaded."""


def describe(of: type[Result], kind: Kind[Result]) -> None:
    """Declare what is shown of results of a type, and of those of its subclasses."""
    KINDS[of] = kind


def kind_of(result: object) -> Kind[Any]:
    """What is shown of a result; ``NOTHING`` for what is no result."""
    for of in type(result).__mro__:
        _load(of.__module__.rpartition(".")[2])
        if of in KINDS:
            return KINDS[of]
    return NOTHING


@cache
def _load(file: str) -> None:
    """Load the file that describes the types of a file, if there is one."""
    name = f"{__package__}.kinds.{file}"
    if find_spec(name) is not None:
        import_module(name)


def words_of(result: object, figures: dict[str, Any]) -> Iterator[Word]:
    """What a command prints of a result.

    Parameters
    ----------
    result : any result of fringeworks
    figures : dict
        Its ``summarise``, and what the command knows besides, such as errors against the truth.

    Raises
    ------
    InputError for something that is no result.
    """
    words = kind_of(result).words
    if words is None:
        raise InputError(f"result: expected a result of fringeworks, got {type(result).__name__}")
    return words(result, figures)
