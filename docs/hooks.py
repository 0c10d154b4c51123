"""What the builder of the documentation does beside Markdown: equations as MathML, and the API.

Equations stand between ``$…$`` or ``$$…$$``. They become MathML, which browsers draw themselves: no
script and no network. The pages of the API are made from ``__init__.pyi``, in its order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).parent.parent
STUB = ROOT / "src" / "fringeworks" / "__init__.pyi"
CODE = re.compile(r"^(```.*?^```|(?:^ {4,}\S[^\n]*\n?)+)|(`[^`\n]+`)", re.M | re.S)
BLOCK = re.compile(r"\$\$(.+?)\$\$", re.S)
INLINE = re.compile(r"(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<!\s)\$(?![\w$])")


def sections(stub: str) -> list[tuple[str, list[str]]]:
    """Titles of the stub's comments, and the public names below each; equal titles are joined."""
    found: dict[str, list[str]] = {}
    title = ""
    for line in stub.splitlines():
        if line.startswith("# "):
            title = re.split(r"[:.]", line[2:])[0].strip()
            found.setdefault(title, [])
        elif name := re.search(r"(\w+) as \1", line):
            found[title].append(name[1])
    return [(title, names) for title, names in found.items() if names]


def place(title: str) -> str:
    """Address of a section's page."""
    return f"api/{re.sub(r'[^a-z]+', '-', title.lower()).strip('-')}.md"


def page(title: str, names: list[str]) -> str:
    """Markdown of a section of the API."""
    return "\n".join([f"# {title}", "", *(f"::: fringeworks.{name}\n" for name in names)])


def on_config(config: Any) -> Any:
    """Add the API to the navigation's group *Reference*."""
    pages = [{title: place(title)} for title, _ in sections(STUB.read_text(encoding="utf-8"))]
    for group in config["nav"]:
        if "Reference" in group:
            group["Reference"].append({"Python API": pages})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Make the pages of the API."""
    for title, names in sections(STUB.read_text(encoding="utf-8")):
        files.append(File.generated(config, place(title), content=page(title, names)))
    return files


def with_equations(text: str) -> str:
    """Markdown whose equations are MathML; code stays as it is."""

    def equations(part: str) -> str:
        part = BLOCK.sub(lambda m: convert(m[1].strip(), display="block"), part)
        return INLINE.sub(lambda m: convert(m[1]), part)

    pieces, last = [], 0
    for code in CODE.finditer(text):
        pieces += [equations(text[last : code.start()]), code[0]]
        last = code.end()
    return "".join([*pieces, equations(text[last:])])


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Draw the equations of a page; docstrings keep theirs as text."""
    return with_equations(markdown)
