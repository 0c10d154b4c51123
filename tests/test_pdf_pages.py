"""Pages of a PDF hold as many figures as fit."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fringeworks.report.page.pages import FITTED, _paged
from fringeworks.report.page.typeset import Box

ROOM = 250.0


def figure(height):
    """A box that can be made smaller, as figures can."""
    return Box(height, lambda *_: None, 3.5, squeeze=lambda factor: figure(factor * height))


def line(height=4.0, **of):
    return Box(height, lambda *_: None, **of)


def heights(pages):
    return [[round(box.height, 6) for box, _ in page] for page in pages]


def test_figures_that_nearly_fit_share_a_page():
    found = heights(_paged([figure(130.0)] * 4, ROOM))
    # Two of 130 need 263.5 mm with their gap; 0.95 of them 250.5 mm, and 0.9 of them 237.5 mm.
    assert found == [[117.0, 117.0]] * 2


@pytest.mark.parametrize("height", [240.0, 170.0])
def test_figures_keep_their_text_readable(height):
    assert heights(_paged([figure(height)] * 2, ROOM)) == [[height], [height]]
    assert min(FITTED) >= 0.75


def test_text_does_not_shrink_the_figures_above_it():
    found = heights(_paged([figure(240.0), *[line()] * 5], ROOM))
    assert found == [[240.0, 4.0, 4.0], [4.0, 4.0, 4.0]]


def test_every_box_lies_within_its_page_or_alone_on_it():
    head = line(5.0)
    rows = [replace(line(6.0), head=head)] * 100
    boxes = [figure(120.0), *rows, figure(180.0), figure(80.0), line(300.0), line()]
    for page in _paged(boxes, ROOM):
        box, down = page[-1]
        assert down + box.height <= ROOM or len(page) == 1
        assert page[0][1] == 0.0
    tops = [page[0][0] for page in _paged(boxes, ROOM)][1:3]
    assert tops == [head, head]
    assert _paged([], ROOM) == [[]]
