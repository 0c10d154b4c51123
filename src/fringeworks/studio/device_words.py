"""Words that open devices, as far as a page may use them: nothing outside of the folder."""

from __future__ import annotations

from fringeworks.studio.workspace import Workspace
from fringeworks.types import InputError

MOST_LETTERS = 200
"""Characters of a field that are kept."""
FOLDERS = ("folder", "memory")
"""Kinds of devices whose words name a folder."""


def checked_words(words: str, space: Workspace) -> str:
    """Return the words that open a device, with folders as paths in the studio's folder.

    Raises
    ------
    InputError for webcams that are no number, which would read files and addresses; FileProblem
    for folders outside of the studio's.
    """
    kind, colon, which = checked_text(words, "device").partition(":")
    if kind == "webcam" and colon and not which.isdecimal():
        raise InputError(f"webcam: expected a number in the studio, got {which!r}")
    return f"{kind}:{space.inside(which)}" if kind in FOLDERS else words


def checked_text(text: object, what: str) -> str:
    """Return the content of a field.

    Raises
    ------
    InputError for anything but a text of at most 200 characters.
    """
    if not isinstance(text, str) or len(text) > MOST_LETTERS:
        got = f"{len(text)} characters" if isinstance(text, str) else type(text).__name__
        raise InputError(f"{what}: expected a text of at most {MOST_LETTERS} characters, got {got}")
    return text


class Words:
    """A field of the studio that a page sets: only texts of usual length are kept."""

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember where the text is kept."""
        self._place = f"_{name}"

    def __get__(self, instance: object, owner: type) -> str:
        """Return the text."""
        return str(getattr(instance, self._place, ""))

    def __set__(self, instance: object, text: object) -> None:
        """Keep a text; anything else is ignored, because the studio's own page never sends it."""
        if isinstance(text, str) and len(text) <= MOST_LETTERS:
            setattr(instance, self._place, text)
