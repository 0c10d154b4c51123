"""Files beside a description that belong to it, such as the plan of a set-up.

A description and what it names cannot be replaced in one step. Where an
earlier file has other content, the new file gets another name. The description then names it, and
only after that is the earlier file deleted. A reader in between, or after the program was killed,
finds the old description with its files or the new one with its files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

DIGITS = 8
"""Hexadecimal digits of a hash in a name: 32 bits keep the two versions at hand apart."""


def name_beside(description: Path, name: str, digest: str, same: Callable[[Path], bool]) -> Path:
    """The path of a file that is about to be written for a description.

    Parameters
    ----------
    description : path
    name : str
        Name of the file, with its suffix.
    digest : str
        Hash of its content, hexadecimal.
    same : function
        Whether a file that is there already has this content.
    """
    plain = description.with_name(name)
    if not plain.exists() or same(plain):
        return plain
    return plain.with_name(f"{plain.stem}-{digest[:DIGITS]}{plain.suffix}")


def drop_earlier(description: Path, names: Iterable[str], kept: Iterable[str]) -> None:
    """Delete earlier versions of files beside a description that has just been written.

    Parameters
    ----------
    description : path
    names : str
        As for ``name_beside``.
    kept : str
        Names that the description uses.
    """
    used = set(kept)
    for name in names:
        plain = description.with_name(name)
        versions = plain.parent.glob(f"{plain.stem}-{'[0-9a-f]' * DIGITS}{plain.suffix}")
        for path in (plain, *versions):
            if path.name not in used:
                path.unlink(missing_ok=True)
