"""Every public name is on a page for users, and in an example that runs."""

from __future__ import annotations

import ast
import doctest
import re
from functools import cache
from pathlib import Path

from tests.page_code import ELSEWHERE, PYTHON, blocks
from tests.public import public_names, submodules
from tests.walk import PAGES, ROOT

LISTS = {"reference.md", "CHANGELOG.md"}
"""Pages that list names, and so explain none."""
SOURCES = sorted((ROOT / "src").rglob("*.py"))
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def roots(tree: ast.AST) -> dict[str, str]:
    """What names of a piece of code stand for, as dotted names of the package."""
    found = {"fw": "fringeworks", "fringeworks": "fringeworks"}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("fringeworks"):
            found |= {a.asname or a.name: f"{node.module}.{a.name}" for a in node.names}
    return found


def dotted(node: ast.expr, known: dict[str, str]) -> str:
    """The dotted name of an expression such as ``fw.rig.observe``; empty for another one."""
    if isinstance(node, ast.Name):
        return known.get(node.id, "")
    if isinstance(node, ast.Attribute):
        first = dotted(node.value, known)
        return first and f"{first}.{node.attr}"
    return ""


def names_in(code: str) -> set[str]:
    """Public names that a piece of code uses: with its room before the dot, or imported from it.

    >>> sorted(names_in("from fringeworks.simulate import look; fw.rig.observe; fuse"))
    ['rig', 'rig.observe', 'simulate.look']
    """
    tree = ast.parse(code)
    known = roots(tree)
    used = {dotted(node, known) for node in ast.walk(tree) if isinstance(node, ast.expr)}
    return {
        name.removeprefix("fringeworks.")
        for name in used | set(known.values())
        if name.startswith("fringeworks.")
    }


def doctests(path: Path) -> str:
    """The code of all docstring examples of a file; they run with the tests."""
    text = path.read_text(encoding="utf-8")
    if ">>>" not in text:
        return ""
    docs = [
        ast.get_docstring(node) or ""
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    ]
    parser = doctest.DocTestParser()
    return "".join(e.source for doc in docs for e in parser.get_examples(doc, str(path)))


@cache
def named() -> set[str]:
    """Dotted names of all pages for users, in text and in code."""
    found: set[str] = set()
    for page in PAGES:
        if page.name in LISTS:
            continue
        text = page.read_text(encoding="utf-8")
        found |= set(re.findall(r"\b(?:fw|fringeworks)\.(\w+(?:\.\w+)?)", text))
        for code in PYTHON.findall(text):
            found |= names_in(code)
    return found


@cache
def run() -> set[str]:
    """Public names in code that tests run: blocks of pages, examples, docstrings."""
    pages = ["".join(blocks(page)) for page in PAGES if page.name not in ELSEWHERE]
    examples = [path.read_text(encoding="utf-8") for path in EXAMPLES]
    return set().union(*map(names_in, [*pages, *examples, *map(doctests, SOURCES)]))


def test_every_public_name_is_on_a_page_for_users():
    missing = [name for name in public_names() if name not in named()]
    assert not missing, "name it with its room, such as fw.rig.observe, on a page"


def test_every_public_name_is_in_an_example_that_runs():
    missing = [name for name in public_names() if name not in run()]
    assert not missing, "use it in a block of a page, an example or a docstring"


def test_every_room_has_a_page():
    pages = {page.stem for page in (ROOT / "docs" / "python").glob("*.md")}
    assert pages == {"fw"} | {f"fw-{room}" for room in submodules()}


def test_a_name_without_its_room_does_not_count():
    assert "stack.fuse" not in names_in("fuse = 1; wire.fuse")
    assert "stack.fuse" in names_in("import fringeworks as fw; fw.stack.fuse([])")
    assert "stack.fuse" in names_in("from fringeworks import stack; stack.fuse([])")
