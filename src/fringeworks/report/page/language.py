"""Reports in other languages: words and sentences that a table has, the others as they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType

from fringeworks.report.page.blocks import (
    Block,
    Chapter,
    Facts,
    Head,
    Picture,
    Surface,
    Table,
    Text,
)
from fringeworks.report.verdicts import Verdict
from fringeworks.types.report_head import ENGLISH, LANGUAGES

TABLE = "words.tsv"
"""Words in all languages. ``{0}`` stands for any text, ``{0:w}`` for one that the table has."""
PLACE = re.compile(r"\{(\d)(:w)?\}")
"""Places for other texts in a sentence."""

Say = Callable[[str], str]
"""Gives a text in the language of a report."""


@dataclass(frozen=True)
class Sentence:
    """A sentence with places for other texts."""

    pattern: re.Pattern[str]
    said: str
    """The same in the other language, with numbered places."""
    known: tuple[bool, ...]
    """Which of the places hold words that the table has."""


@dataclass(frozen=True)
class Language:
    """A language of reports."""

    words: MappingProxyType[str, str]
    sentences: tuple[Sentence, ...]

    def say(self, text: str) -> str:
        """Return a text in this language; what the table does not have stays English."""
        if text in self.words:
            return self.words[text]
        for one in self.sentences:
            found = one.pattern.fullmatch(text)
            if found is None:
                continue
            places = [
                self.say(place) if known else place
                for place, known in zip(found.groups(), one.known, strict=True)
            ]
            if all(a != b for a, b, w in zip(places, found.groups(), one.known, strict=True) if w):
                return one.said.format(*places)
        return text


@cache
def language(code: str) -> Language:
    """Return a language of ``LANGUAGES``."""
    table = (resources.files(__package__) / TABLE).read_text(encoding="utf-8")
    head, *rows = (line.split("\t") for line in table.splitlines())
    words, sentences = {}, []
    if code != ENGLISH:
        column = head.index(code)
        for row in rows:
            if PLACE.search(row[0]):
                sentences.append(_sentence(row[0], row[column]))
            else:
                words[row[0]] = row[column]
    # Longer sentences say more of a text than those that nearly any text is.
    sentences.sort(key=lambda one: -len(one.pattern.pattern))
    return Language(MappingProxyType(words), tuple(sentences))


def _sentence(english: str, said: str) -> Sentence:
    """A sentence; its places are numbered in the order of the English one."""
    known = tuple(bool(found[2]) for found in PLACE.finditer(english))
    texts = PLACE.split(english)[::3]
    return Sentence(re.compile("(.+?)".join(map(re.escape, texts)), re.DOTALL), said, known)


def said_verdict(verdict: Verdict | None, say: Say) -> Verdict | None:
    """Return a verdict in another language."""
    return None if verdict is None else replace(verdict, text=say(verdict.text))


def said_head(head: Head | None, say: Say) -> Head | None:
    """Return a head with its fields in another language; what they hold stays as it is."""
    if head is None:
        return None
    return replace(head, rows=tuple((say(name), value) for name, value in head.rows))


def said_chapters(chapters: Sequence[Chapter], say: Say) -> list[Chapter]:
    """Return chapters in another language, as far as the table has their words."""
    return [
        Chapter(say(one.title), tuple(_block(block, say) for block in one.blocks))
        for one in chapters
    ]


def _block(block: Block, say: Say) -> Block:
    """A block in another language; the pictures keep theirs, and findings their sentences."""
    if isinstance(block, Facts):
        return Facts(tuple((say(name), say(value)) for name, value in block.rows))
    if isinstance(block, Table):
        return _table(block, say)
    if isinstance(block, Picture | Surface):
        return replace(block, caption=say(block.caption))
    return Text(say(block.text)) if isinstance(block, Text) else block


def _table(table: Table, say: Say) -> Table:
    """A table; the first column has names that people gave."""
    rows = tuple((row[0], *map(say, row[1:])) if row else row for row in table.rows)
    columns = tuple(map(say, table.columns))
    return replace(table, columns=columns, rows=rows, caption=say(table.caption))


def spoken(head: Head | None) -> Say:
    """Return what says texts in the language of a head."""
    code = ENGLISH if head is None else head.language
    assert code in LANGUAGES
    return language(code).say
