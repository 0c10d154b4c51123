"""axe-core in a page: what keeps people with other senses or hands from using it."""

from __future__ import annotations

from importlib import resources
from importlib.util import find_spec

import pytest

RUN = """() => axe.run(document).then((found) => found.violations.map((one) =>
  `${one.id} (${one.impact}): ` + one.nodes.map((node) => node.html.slice(0, 160)).join(" | ")))"""
"""All rules of axe-core, those called best practices as well."""


def violations(page):
    """What axe-core finds on a page, a line for each rule."""
    if find_spec("axe_playwright_python") is None:
        pytest.skip("axe-playwright-python is not installed: pages are not tried by axe-core")
    if not page.evaluate("'axe' in window"):
        page.evaluate(
            resources.files("axe_playwright_python").joinpath("axe.min.js").read_text() + ";0"
        )
    return page.evaluate(RUN)


def overflow(page):
    """Width by which a page is wider than its window, px."""
    return page.evaluate("document.documentElement.scrollWidth - innerWidth")
