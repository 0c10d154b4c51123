"""Reports: results with their pictures, figures, findings and origin, to hand on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import StrPath, check_target, refuse_overwrite, write_text
from fringeworks.files.limits import existing_file, is_folder
from fringeworks.files.read_write import read
from fringeworks.files.rig import read_rig
from fringeworks.report.drawing import need_plots
from fringeworks.report.kind import kind_of
from fringeworks.report.page.blocks import Chapter, Head
from fringeworks.report.page.both import compared
from fringeworks.report.page.chapter import Context, chapter_of
from fringeworks.report.page.head import head_of
from fringeworks.report.page.html import page_html
from fringeworks.report.page.language import said_chapters, said_head, said_verdict, spoken
from fringeworks.report.page.pages import paper_mm
from fringeworks.report.page.pdf import write_pdf
from fringeworks.report.page.surfaces import comparable
from fringeworks.report.page.tolerances import Tolerance, parse_tolerance
from fringeworks.report.verdicts import Verdict, verdict_of
from fringeworks.report.viewer.content import check_every
from fringeworks.types import FileProblem, InputError, Provenance, Rig, made_by
from fringeworks.types.report_head import checked_head, headline

SUFFIXES = (".html", ".pdf")
"""Formats of a report."""


@dataclass(frozen=True)
class ReportWritten:
    """What was written, and whether the results keep their tolerances."""

    paths: tuple[Path, ...]
    """The files."""
    kept: bool
    """Whether all tolerances are kept; true where there are none."""


def write_report(
    path: StrPath,
    results: Any,
    *,
    title: str = "",
    notes: Sequence[str] = (),
    tolerances: Sequence[Tolerance | str] = (),
    rig: Rig | StrPath | None = None,
    every: int = 1,
    pdf: StrPath | None = None,
    paper: str = "A4",
    head: Mapping[str, str] | None = None,
) -> ReportWritten:
    """Write a report of one or several results.

    Parameters
    ----------
    path : path
        ``.html``: one file with everything in it, which opens without a network. ``.pdf``: the
        figures as vectors and the tables as text.
    results : result, path, sequence or mapping
        Results of fringeworks, or files of them: surfaces, points, coordinates, calibrations,
        forms, set-ups, tables of ``compare``, and JSON files that commands wrote. The names of a
        mapping are the headings.
    title : str
        By default the first result's name; with a part in the head, the part and its serial number.
    notes : sequence of str
        Shown below the title.
    tolerances : sequence of Tolerance or str
        Limits on figures of every result, such as ``"median_sigma_mm<=0.05"``.
    rig : Rig or path, optional
        Of point clouds: the page is then smaller.
    every : int
        Show every k-th column and row only. Frames of more than 8 million pixels are thinned to
        what a page holds, which their captions say.
    pdf : path, optional
        A PDF beside the page.
    paper : str
        Paper of a PDF: ``A4`` or ``letter``.
    head : mapping, optional
        Fields of the head: customer, order, part, part_number, serial, drawing, revision, device,
        inspector, and the report's language (en, de, zh, ja). They add to those of the recipe of an
        inspection. A report with a verdict has lines for fields that are not given, and for dates
        and signatures.

    Returns
    -------
    ReportWritten

    Raises
    ------
    InputError for something that is no result, tolerances on figures that a result does not have,
    an ``every`` below 1, and unknown fields of the head; FileProblem for files that cannot be read
    or written.
    """
    path = Path(path)
    check_report_target(path)
    paper_mm(paper)
    check_every(every)
    if pdf is not None:
        check_target(pdf, (".pdf",))
    read = results.values() if isinstance(results, Mapping) else (results,)
    for target in (path, *(() if pdf is None else (pdf,))):
        refuse_overwrite(target, rig, *read)
    named = _named(results)
    limits = tuple(parse_tolerance(t) if isinstance(t, str) else t for t in tolerances)
    verdicts: list[str] = []
    known = rig if isinstance(rig, Rig) or rig is None else read_rig(rig)
    fields = _fields(named, head or {})
    if not title and len(named) == 1:
        named = [(headline(fields, named[0][0]), named[0][1])]
    chapters = [
        chapter_of(result, Context(name, limits, known, every, verdicts)) for name, result in named
    ]
    if comparable([result for _, result in named]):
        chapters = compared(chapters, [result for _, result in named])
    heading = title or named[0][0]
    own = None if limits or len(named) > 1 else _own_verdict(named[0][1])
    verdict = own or verdict_of(verdicts)
    origin = getattr(named[0][1], "provenance", None) if own else None
    origin = origin or made_by("write_report", options={"title": title or None, "every": every})
    targets = (path, *(() if pdf is None else (Path(pdf),)))
    top = head_of(fields, kind_of(named[0][1]).head, judged=verdict is not None)
    for target in targets:
        write_page(
            target,
            heading,
            chapters,
            origin,
            notes=notes,
            verdict=verdict,
            paper=paper,
            head=top,
        )
    return ReportWritten(targets, all(one == "pass" for one in verdicts))


def _fields(named: Sequence[tuple[str, Any]], given: Mapping[str, str]) -> dict[str, str]:
    """Fields of the head: what is given, and what the recipe of an inspection says."""
    recipe = getattr(named[0][1], "recipe", None) if len(named) == 1 else None
    return checked_head({**getattr(recipe, "head", {}), **given})


def _own_verdict(result: Any) -> Verdict | None:
    """The verdict of a result that has one of its own, as a certificate."""
    judge = kind_of(result).verdict
    return None if judge is None else judge(result)


def write_page(
    path: StrPath,
    title: str,
    chapters: list[Chapter],
    origin: Provenance,
    *,
    notes: Sequence[str] = (),
    verdict: Verdict | None = None,
    paper: str = "A4",
    head: Head | None = None,
) -> Path:
    """Write chapters as a page or, for a name that ends with ``.pdf``, as a document."""
    need_plots("a report")
    check_report_target(path)
    place, say = Path(path), spoken(head)
    chapters, verdict = said_chapters(chapters, say), said_verdict(verdict, say)
    head = said_head(head, say)
    if place.suffix.lower() == ".pdf":
        return write_pdf(place, title, chapters, origin, notes, verdict, paper, head)
    page = page_html(title, chapters, origin, notes=notes, verdict=verdict, head=head)
    return write_text(place, page)


def check_report_target(path: StrPath) -> None:
    """Refuse a file that ``write_report`` cannot write, before anything is computed for it."""
    need_plots("a report")
    check_target(path, SUFFIXES)


def _named(results: Any) -> list[tuple[str, Any]]:
    """Results with their headings; files are read."""
    if isinstance(results, Mapping):
        pairs = [(str(name), result) for name, result in results.items()]
    else:
        several = isinstance(results, list | tuple) and not _is_rows(results)
        each = list(results) if several else [results]
        pairs = [(_name(result, k, len(each)), result) for k, result in enumerate(each)]
    # A name of bytes that are no UTF-8 holds half surrogate pairs, which no page can hold.
    pairs = [(name.encode("utf-8", "replace").decode(), result) for name, result in pairs]
    if not pairs:
        raise InputError("results: expected one or more, got none")
    return [
        (name, _read(Path(result)) if isinstance(result, str | Path) else result)
        for name, result in pairs
    ]


def _read(path: Path) -> Any:
    """The result in a file."""
    if is_folder(path):
        raise FileProblem(
            f"{path}: expected a result, got a folder; measure or reconstruct a capture first"
        )
    return read(existing_file(path, "a result"))


def _is_rows(results: Sequence[Any]) -> bool:
    """Whether these are the rows of one table."""
    return bool(results) and all(isinstance(row, dict) for row in results)


def _name(result: Any, number: int, count: int) -> str:
    if isinstance(result, str | Path):
        return Path(result).name
    kind = type(result).__name__
    return kind if count == 1 else f"{kind} {number + 1}"
