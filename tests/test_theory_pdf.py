"""The theory as a document to print: equations are drawn, links lead somewhere."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

ROOT = Path(__file__).parent.parent
pytest.importorskip("markdown", reason="markdown is not installed")


def maker():
    place = importlib.util.spec_from_file_location("made", ROOT / "docs" / "make_theory_pdf.py")
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


def test_equations_and_links_are_those_of_the_site():
    made = maker()
    page = made.page(
        "# T\n\n$$a = b$$\n\n[there](stacks.md#x) [here](#t) [away](https://a.b)", "1.2"
    )
    assert "<math" in page
    assert "$$" not in page
    assert f'href="{made.SITE}stacks.md#x"' in page
    assert 'href="#t"' in page
    assert 'href="https://a.b"' in page
    assert "<title>Theory of fringeworks 1.2</title>" in page


def test_without_a_browser_it_says_so(tmp_path, monkeypatch):
    made = maker()
    monkeypatch.setattr(made.shutil, "which", lambda _: None)
    with pytest.raises(SystemExit, match="expected one of chromium, .* got none"):
        made.write_pdf("# T", "1.2", tmp_path / "t.pdf")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium")
def test_the_theory_is_printed(tmp_path):
    made = maker()
    made.write_pdf(made.PAGE.read_text(encoding="utf-8"), "1.2", tmp_path / "t.pdf")
    content = (tmp_path / "t.pdf").read_bytes()
    assert content.startswith(b"%PDF-")
    assert len(content) > 100_000
