"""What the builder of the documentation does beside Markdown: equations as MathML, and the API.

Equations stand between ``$…$`` or ``$$…$$``. They become MathML, which browsers draw themselves: no
script and no network. The pages of the API are made from the stubs ``__init__.pyi``: one page for
the top level, and one for each public submodule. Pages that are tried end with a line that says
with what, from tried.toml.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).parent.parent
STUB = ROOT / "src" / "fringeworks" / "__init__.pyi"
CODE = re.compile(r"^(```.*?^```|(?:^ {4,}\S[^\n]*\n?)+)|(`[^`\n]+`)", re.M | re.S)
BLOCK = re.compile(r"\$\$(.+?)\$\$", re.S)
INLINE = re.compile(r"(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<!\s)\$(?![\w$])")


def names_in(stub: Path) -> list[str]:
    """The names that a stub imports, in its order."""
    return re.findall(r"^ +(\w+) as \1,$", stub.read_text(encoding="utf-8"), re.M)


def sections() -> list[tuple[str, list[str]]]:
    """Title of every page of the API and its public names, as users write them after ``fw.``."""
    top = names_in(STUB)
    rooms = [name for name in top if (STUB.parent / name / "__init__.pyi").exists()]
    found = [("fringeworks", [name for name in top if name not in rooms])]
    for room in rooms:
        inner = names_in(STUB.parent / room / "__init__.pyi")
        found.append((f"fringeworks.{room}", [f"{room}.{name}" for name in inner]))
    return found


def place(title: str) -> str:
    """Address of a section's page."""
    return f"api/{re.sub(r'[^a-z]+', '-', title.lower()).strip('-')}.md"


def page(title: str, names: list[str]) -> str:
    """Markdown of a section of the API."""
    return "\n".join([f"# {title}", "", *(f"::: fringeworks.{name}\n" for name in names)])


def on_config(config: Any) -> Any:
    """Add the API to the navigation's group *Reference*."""
    pages = [{title: place(title)} for title, _ in sections()]
    for group in config["nav"]:
        if "Reference" in group:
            group["Reference"].append({"Python API": pages})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Make the pages of the API."""
    for title, names in sections():
        files.append(File.generated(config, place(title), content=page(title, names)))
    return files


def with_equations(text: str) -> str:
    """Markdown whose equations are MathML; code stays as it is."""

    def equations(part: str) -> str:
        part = BLOCK.sub(lambda m: convert(m[1].strip(), display="block"), part)
        # A line that begins with <math> would be a block of HTML, which ends a list.
        return INLINE.sub(lambda m: f"<span>{convert(m[1])}</span>", part)

    pieces, last = [], 0
    for code in CODE.finditer(text):
        pieces += [equations(text[last : code.start()]), code[0]]
        last = code.end()
    return "".join([*pieces, equations(text[last:])])


def last_tried(name: str) -> str:
    """The line that says what a page was last tried with; empty for pages that are not tried."""
    found = tomllib.loads((ROOT / "docs" / "tried.toml").read_text(encoding="utf-8"))
    for one in found["tried"]:
        if name in one["pages"]:
            return (
                f"\n\n---\n\n*Last tried with fringeworks {found['version']} on {found['date']} "
                f"({found['python']}): {one['with']}.*\n"
            )
    return ""


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Draw the equations of a page; docstrings keep theirs as text. Say what it was tried with."""
    return with_equations(markdown) + as_document(page.file.src_uri) + last_tried(page.file.src_uri)


def as_document(name: str) -> str:
    """A link to the page as a document to print, where ``docs/make_theory_pdf.py`` has made it."""
    document = Path(name).with_suffix(".pdf")
    made = name == "theory.md" and (ROOT / "docs" / document).exists()
    return f"\n\n[This page as a document to print]({document})\n" if made else ""
