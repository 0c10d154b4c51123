"""Chapters as one HTML file that needs nothing else and asks no network for anything."""

from __future__ import annotations

import base64
import io
import itertools
import json
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import resources
from itertools import groupby
from typing import Any

from jinja2 import Environment, StrictUndefined

from fringeworks.report.drawing import AxesImage, rc_context
from fringeworks.report.page.blocks import Block, Chapter, Head, Picture, Surface, Table
from fringeworks.report.page.language import spoken
from fringeworks.report.page.set_table import SHORT_CELL
from fringeworks.report.verdicts import Verdict
from fringeworks.report.viewer.page import (
    LAYERS,
    SCALES,
    TABLES,
    policy_source,
    viewer_fragment,
    viewer_script,
    viewer_style,
)
from fringeworks.types import Provenance, day
from fringeworks.types.report_head import ENGLISH

MOST_VIEWERS = 12
"""Surfaces of a page that can be turned: browsers allow 16 WebGL contexts in a page."""
WIDE_IN = 9.0
"""Width of a figure, inches, from which on it stands alone; of narrower ones two stand side by
side."""
NOTHING = "'none'"
"""No source at all, in the words of a content security policy."""
START_MAPS = """
for (const element of document.querySelectorAll(".fringe-viewer-mount")) {
  element.viewer.ready.then(() => {
    for (const surface of element.viewer.surfaces ?? []) {
      if (!surface.header.raster) continue;
      const { viewer } = element;
      const maps = new FringeMaps(element.parentElement, surface, MAP_CONSTANTS);
      if (surface !== viewer.surfaces[0]) continue;
      viewer.onPoint = (pixel) => maps.point(pixel);
      maps.onPoint = (pixel) => viewer.point(pixel, true);
    }
  });
}
"""
"""Draws the maps of every viewer when it has unpacked its surfaces."""


def page_html(
    title: str,
    chapters: Sequence[Chapter],
    origin: Provenance,
    *,
    notes: Sequence[str] = (),
    verdict: Verdict | None = None,
    head: Head | None = None,
) -> str:
    """Return the page.

    Parameters
    ----------
    title : str
        Plain text, as all other texts: markup in them is shown and not obeyed.
    chapters : sequence of Chapter
    origin : Provenance
        Of the report.
    notes : sequence of str
        Shown below the title.
    verdict : Verdict, optional
        Shown on top; None where nothing was judged.
    head : Head, optional
        Shown below the verdict.
    """
    turned = any(isinstance(block, Surface) for c in chapters for block in c.blocks)
    style = _asset("report.css") + (viewer_style() if turned else "")
    tables = [block for c in chapters for block in c.blocks if isinstance(block, Table)]
    script = _script() if turned else ""
    script += _asset("search.js") if any(table.search for table in tables) else ""
    policy = "; ".join(
        (
            f"default-src {NOTHING}",
            "img-src data:",
            # Colours of legends and bars are set as attributes.
            "style-src 'unsafe-inline'",
            f"script-src {policy_source(script) if script else NOTHING}",
        )
    )
    count = itertools.count()
    shown = [
        {"title": chapter.title, "blocks": list(_blocks(chapter, count))} for chapter in chapters
    ]
    page: str = _template().render(
        title=title,
        chapters=shown,
        notes=notes,
        verdict=verdict,
        head=head,
        say=spoken(head),
        language=ENGLISH if head is None else head.language,
        style=style,
        script=script,
        policy=policy,
        version=origin.version,
        short=SHORT_CELL,
        date=day(origin.date),
    )
    return page


def _blocks(chapter: Chapter, count: Iterator[int]) -> Iterator[tuple[str, Any]]:
    """Blocks as the template takes them; pictures that follow each other stand side by side."""
    blocks = [_turned(block, count) for block in chapter.blocks]
    for pictures, group in groupby(blocks, lambda block: isinstance(block, Picture)):
        if pictures:
            yield "Pictures", [_picture(block) for block in group if isinstance(block, Picture)]
            continue
        for block in group:
            yield type(block).__name__, _plain(block)


def _turned(block: Block, count: Iterator[int]) -> Block:
    """A surface that can be turned, or its picture where the page has too many."""
    if not isinstance(block, Surface) or next(count) < MOST_VIEWERS:
        return block
    more = f"{block.caption} A page turns {MOST_VIEWERS} surfaces at most; this is its picture."
    return Picture(block.draw(), more)


def _plain(block: Block) -> Any:
    if isinstance(block, Surface):
        return {
            "caption": block.caption,
            "fragment": viewer_fragment(*(pack() for pack in block.pack)),
        }
    return block


def _picture(picture: Picture) -> dict[str, str]:
    """A picture as SVG inside the address of an image: nothing in it can run."""
    file = io.BytesIO()
    with rc_context({"svg.hashsalt": "fringeworks"}):
        picture.figure.savefig(file, format="svg", metadata={"Date": None})
    source = base64.b64encode(file.getvalue()).decode()
    kind = "wide" if picture.figure.get_figwidth() > WIDE_IN else "small"
    if not picture.figure.findobj(lambda one: isinstance(one, AxesImage)):
        kind += " lines"
    return {
        "source": f"data:image/svg+xml;base64,{source}",
        "caption": picture.caption,
        "kind": kind,
    }


@cache
def _script() -> str:
    constants = json.dumps({"LAYERS": LAYERS, "SCALES": SCALES, "TABLES": TABLES})
    maps = f"const MAP_CONSTANTS = {constants};\n(() => {{\n{_asset('maps.js')}\n}})();\n"
    return viewer_script() + maps.replace("</", "<\\/") + START_MAPS


@cache
def _template() -> Any:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_asset("report.html.jinja"))


def _asset(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")
