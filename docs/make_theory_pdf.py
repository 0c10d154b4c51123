"""``python docs/make_theory_pdf.py``: the theory as a document to print, ``docs/theory.pdf``.

Equations become MathML as on the site, and Chromium draws the pages. The file is made for the site
and for releases; it is not kept in the repository.
"""

from __future__ import annotations

import html
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import markdown

DOCS = Path(__file__).parent
PAGE = DOCS / "theory.md"
PDF = DOCS / "theory.pdf"
SITE = "https://github.com/fringeworks/fringeworks/blob/main/docs/"
"""Where links to other pages lead: a document has no pages beside it."""
STYLE = """
@page { size: A4; margin: 22mm 20mm; }
body { font: 10.5pt/1.45 "DejaVu Serif", serif; }
h1 { font-size: 20pt; } h2 { font-size: 14pt; break-after: avoid; }
table { border-collapse: collapse; break-inside: avoid; margin: 1em 0; }
td, th { border-top: 0.5pt solid #999; padding: 2pt 6pt; text-align: left; vertical-align: top; }
code { font-size: 9pt; } pre { white-space: pre-wrap; }
math[display=block] { margin: 0.8em 0; }
a { color: inherit; }
"""
"""Print: black on white, headings stay with their text, tables stay whole."""
EXTENSIONS = ("tables", "fenced_code", "toc")
"""Those of the site that the page uses."""


def hooks() -> Any:
    """The module that turns equations into MathML for the site."""
    place = importlib.util.spec_from_file_location("hooks", DOCS / "hooks.py")
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


def page(text: str, version: str) -> str:
    """The theory as one page of HTML."""
    body = markdown.markdown(hooks().with_equations(text), extensions=list(EXTENSIONS))
    body = re.sub(r'href="(?![a-z]+:|#)', f'href="{SITE}', body)
    title = html.escape(f"Theory of fringeworks {version}")
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>'


def write_pdf(text: str, version: str, target: Path) -> None:
    """Print the theory into a file.

    Raises
    ------
    SystemExit where there is no Chromium, or where it fails.
    """
    names = ("chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, names)), None)
    if program is None:
        raise SystemExit(f"theory.pdf: expected one of {', '.join(names)}, got none")
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "theory.html"
        source.write_text(page(text, version), encoding="utf-8")
        flags = ["--headless", "--disable-gpu", "--no-pdf-header-footer", "--no-first-run"]
        flags += ["--disable-background-networking", f"--user-data-dir={folder}/profile"]
        flags += ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
        command = [program, *flags, f"--print-to-pdf={target}", source.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    if done.returncode or not target.exists():
        raise SystemExit(f"theory.pdf: {Path(program).name} failed: {done.stderr.strip()[-300:]}")


def main() -> int:
    import fringeworks as fw

    write_pdf(PAGE.read_text(encoding="utf-8"), fw.__version__, PDF)
    print(f"wrote {PDF.name}, {PDF.stat().st_size / 2**20:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
