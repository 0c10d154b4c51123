"""How long work gets on: a bar in a notebook, a moving line on a terminal, lines in a log."""

from __future__ import annotations

import html
import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite
from typing import Any

from fringeworks.types import InputError

LINE_EVERY_S = 20.0
"""Seconds between two lines of progress where stderr is no terminal: often enough to see life, rare
enough for a log."""
BAR_EVERY_S = 0.1
"""Shortest time between two states of a bar in a notebook, s: each is a message to the browser."""
COUNTED = re.compile(r"\b(\d+)(?: of |/)(\d+)\b")
"""What says how far work is, as in "scan 3 of 8": three have begun."""

Show = Callable[[object], None]
"""Function that is called with every step of the work."""


@contextmanager
def progress(total: int | None = None) -> Iterator[Show]:
    """Show how a long call gets on: what is yielded is its ``progress``.

    In a notebook it is a bar, on a terminal a moving line on stderr, elsewhere a line on stderr
    every twenty seconds.

    Parameters
    ----------
    total : int ≥ 1, optional
        Number of steps, for the share that is done. Without it, texts such as "scan 3 of 8" and
        numbers from 0 to 1 tell the share, where the work gives such.

    Raises
    ------
    InputError for a total that is no whole number of at least 1.

    Examples
    --------
    >>> from fringeworks.report import progress
    >>> with progress(2) as show:
    ...     for name in ("one", "two"):
    ...         show(name)
    """
    if total is not None and (isinstance(total, bool) or not isinstance(total, int) or total < 1):
        raise InputError(f"total: expected a whole number of at least 1, got {total!r}")
    display = _notebook()
    if display is not None:
        with _bar(total, display) as show:
            yield show
    elif sys.stderr.isatty():
        with terminal(total) as show:
            yield show
    else:
        yield lines(total, lambda line: print(line, file=sys.stderr, flush=True))


@contextmanager
def terminal(total: int | None) -> Iterator[Show]:
    """A moving line on stderr, with the time left where the number of steps is known."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns: list[ProgressColumn] = [SpinnerColumn(), TextColumn("{task.description}")]
    if total:
        columns += [BarColumn(), TextColumn("{task.completed}/{task.total}")]
        columns += [TimeRemainingColumn(), TextColumn("left")]
    else:
        columns.append(TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda step: bar.update(task, description=_text(step), advance=1)


def lines(total: int | None, write: Callable[[str], None]) -> Show:
    """Lines for logs and pipes, now and then."""
    started = last = time.monotonic()
    count = 0

    def show(step: object) -> None:
        nonlocal last, count
        count += 1
        now = time.monotonic()
        if now - last < LINE_EVERY_S:
            return
        last = now
        of = f"{count}/{total} " if total else ""
        passed = now - started
        left = f", {passed / count * (total - count):.0f} s left" if total else ""
        write(f"{of}{_text(step)} ({passed:.0f} s{left})")

    return show


def _text(step: object) -> str:
    """A step in words."""
    if isinstance(step, float):
        return f"{round(100.0 * step)}%" if isfinite(step) else ""
    return step if isinstance(step, str) else type(step).__name__


def _notebook() -> Any | None:
    """IPython's module that shows things, in the kernel of a notebook; None elsewhere."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from importlib import import_module

    return import_module("IPython.display")


@contextmanager
def _bar(total: int | None, display: Any) -> Iterator[Show]:
    """A bar in a notebook, which becomes one line of text in the end."""
    started, shown, count = time.monotonic(), -1.0, 0
    place = display.display(display.HTML(_html("", None, 0.0)), display_id=True)

    def show(step: object) -> None:
        nonlocal shown, count
        count += 1
        passed = time.monotonic() - started
        if shown < 0 or passed - shown >= BAR_EVERY_S or count == total:
            shown = passed
            place.update(display.HTML(_html(_text(step), _share(step, count, total), passed)))

    try:
        yield show
    except BaseException:
        place.update(display.HTML(f"stopped after {round(time.monotonic() - started, 1)} s"))
        raise
    place.update(display.HTML(f"done in {round(time.monotonic() - started, 1)} s"))


def _share(step: object, count: int, total: int | None) -> float | None:
    """How much is done, 0…1; None where nothing tells it. Steps are told as they begin."""
    if total:
        return min((count - 1) / total, 1.0)
    if isinstance(step, float):
        return min(max(step, 0.0), 1.0) if step == step else None
    counted = COUNTED.search(step) if isinstance(step, str) else None
    if counted is None or not 0 < int(counted[1]) <= int(counted[2]):
        return None
    return (int(counted[1]) - 1) / int(counted[2])


def _html(text: str, share: float | None, passed: float) -> str:
    """A bar, which moves to and fro where the share is unknown, and what is done."""
    value = "" if share is None else f' value="{round(share, 3)}"'
    left = ""
    if share:
        left = f", {passed / share * (1.0 - share):.0f} s left"
    said = f"{html.escape(text)} ({passed:.0f} s{left})"
    return f'<progress{value} style="width:16em"></progress> {said}'
