"""Progress: a bar in a notebook, a line on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

import fringeworks as fw
from fringeworks.report import progress, progress_bar


@pytest.fixture
def notebook(monkeypatch):
    """What a notebook shows, one HTML text for each state."""
    states = []
    place = SimpleNamespace(update=states.append)

    def show(text, *, display_id):
        assert display_id is True
        states.append(text)
        return place

    display = SimpleNamespace(HTML=str, display=show)
    shell = SimpleNamespace(kernel=object())
    ipython = SimpleNamespace(get_ipython=lambda: shell, display=display)
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(progress_bar, "BAR_EVERY_S", 0.0)
    return states


def test_a_notebook_shows_a_bar(notebook):
    with progress(total=4) as show:
        for step in ("one", "<two>", "three", "four"):
            show(step)
    assert notebook[0].startswith('<progress style="width:16em"></progress>')
    assert [float(state.split('"')[1]) for state in notebook[1:5]] == [0.0, 0.25, 0.5, 0.75]
    assert "&lt;two&gt;" in notebook[2]
    assert "s left" in notebook[3]
    assert notebook[5].startswith("done in ")
    assert len(notebook) == 6


@pytest.mark.parametrize(
    ("step", "value"),
    [("scan 3 of 8", "0.250"), ("pose 1/4", "0.000"), (0.5, "0.500"), (7.0, "1.000")],
)
def test_steps_tell_the_share(notebook, step, value):
    with progress() as show:
        show(step)
    assert float(notebook[1].split('"')[1]) == float(value)


@pytest.mark.parametrize("step", ["poses …", "9 of 3", float("nan"), object()])
def test_steps_that_tell_none_move_the_bar_to_and_fro(notebook, step):
    with progress() as show:
        show(step)
    assert notebook[1].startswith('<progress style="width:16em"></progress>')


def test_a_bar_says_when_work_stops(notebook):
    with pytest.raises(KeyError), progress() as show:
        show("one")
        raise KeyError
    assert notebook[-1].startswith("stopped after ")


def test_fast_steps_are_not_all_shown(notebook, monkeypatch):
    monkeypatch.setattr(progress_bar, "BAR_EVERY_S", 1e9)
    with progress(total=1000) as show:
        for step in range(1000):
            show(str(step))
    assert len(notebook) == 4  # the empty bar, the first step, the last one, the end


def test_a_python_without_a_notebook_shows_lines(monkeypatch, capsys):
    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace())
    monkeypatch.setitem(sys.modules, "IPython", shell)  # on a terminal, without a kernel
    now = iter([0.0, 1.0, 21.0])
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: next(now))
    with progress() as show:
        show("one")
        show(0.25)
    assert capsys.readouterr().err == "25% (21 s)\n"


def test_a_terminal_shows_one_moving_line(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress(2) as show:
        show("one")
        show("two")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("total", [0, -3, 2.5, True, "4"])
def test_a_wrong_total_is_refused(total):
    with (
        pytest.raises(fw.InputError, match="total: expected a whole number of at least 1, got"),
        progress(total),
    ):
        pass
