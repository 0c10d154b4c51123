"""Leaves out what NiceGUI loads on every page and the studio never uses."""

from __future__ import annotations

import re
from pathlib import Path

import nicegui

PARTS = (
    *("banner", "breadcrumbs", "btn-dropdown", "carousel", "chip", "circular-progress"),
    *("color-picker", "date", "drawer", "editor", "expansion-item", "fab", "knob", "message"),
    *("page-sticky", "pagination", "parallax", "rating", "skeleton", "splitter", "stepper"),
    *("table", "tab", "tabs", "time", "timeline", "tree", "uploader", "video"),
)
"""Parts of Quasar that no page of the studio has; a test looks for their classes in all pages."""
OF_PARTS = re.compile(rf"\.q-(?:{'|'.join(PARTS)})(?![a-z])")
"""A selector of such a part."""
PALETTE = re.compile(r"\.(?:text|bg)-[a-z-]+-\d+")
"""A selector of a shade of Quasar's palette: the studio has its own few colours."""
RULE = re.compile(r"([^{}@;]+)\{[^{}]*\}")
"""A rule of a style; of rules within others, the inner ones."""
TEXT_ONLY = """
const escaped = (text) => {
  const element = document.createElement("p");
  element.textContent = text;
  return element.innerHTML;
};
export default { sanitize: escaped };
"""
"""Replaces DOMPurify, which makes HTML from strangers harmless. The studio shows no such HTML; this
shows it as text."""


def lean_style(style: str) -> str:
    """Return a style without the rules of parts and colours that the studio does not use.

    Examples
    --------
    >>> lean_style(".q-btn{color:red}.q-editor,.q-date a{margin:0}.bg-red-5{color:red}")
    '.q-btn{color:red}'
    """

    def kept(rule: re.Match[str]) -> str:
        selectors = rule[1].split(",")
        unused = all(OF_PARTS.search(one) or PALETTE.search(one) for one in selectors)
        return "" if unused else rule[0]

    return RULE.sub(kept, style)


def slim_files() -> dict[str, tuple[str, str]]:
    """Return content and kind of the files that take the place of NiceGUI's, by their names."""
    folder = Path(nicegui.__file__).parent / "static"
    styles = ("quasar.unimportant.prod.css", "quasar.important.prod.css")
    lean = {name: (lean_style((folder / name).read_text("utf-8")), "text/css") for name in styles}
    # Without fonts, icons are drawn as paths; Quasar speaks English without being told.
    return lean | {
        "dompurify.mjs": (TEXT_ONLY, "text/javascript"),
        "fonts.css": ("", "text/css"),
        "lang/en-US.umd.prod.js": ("", "text/javascript"),
    }
