"""Options of the commands: one word has one meaning, and many are listed in panels."""

from __future__ import annotations

import re
from collections import defaultdict

import pytest

from fringeworks.cli import panels
from fringeworks.cli.commands import run
from tests.commands import COMMANDS

DIFFERENT = {"--out": "what the command writes", "--scale": "a factor of lengths"}
"""Options whose help begins differently from command to command, and what they have in common."""
SEVERAL = {"--gamma", "--noise", "--bits", "--fringes", "--object"}
"""Options that take several values in `compare`, separated by commas or repeated."""


def options(command):
    return [p for p in command.params if p.param_type_name == "option"]


LONG = [name for name, command in COMMANDS.items() if len(options(command)) >= panels.MANY - 1]


def meaning(text):
    """The beginning of a help text, which says what an option is."""
    return re.split(r"[.:;]\s", f"{text} ")[0]


def kind(option):
    """Type of an option's values, whether it may be left out or not."""
    return str(option.type_descriptor.annotation)


def test_an_option_means_the_same_in_every_command():
    said = defaultdict(set)
    for name, command in COMMANDS.items():
        for one in options(command):
            several = one.opts[0] in SEVERAL and name == "compare"
            said[one.opts[0]].add((meaning(one.help), None if several else kind(one)))
    unlike = {}
    for name, found in said.items():
        meanings = {text for text, _ in found}
        kinds = {of for _, of in found} - {None}
        if len(meanings) > 1 and name not in DIFFERENT:
            unlike[name] = meanings
        if len(kinds) > 1:
            unlike[f"{name}, type"] = kinds
    assert not unlike


def test_a_word_that_opens_a_device_is_no_name():
    """``--camera`` and ``--projector`` open devices, wherever they stand."""
    for name, command in COMMANDS.items():
        known = {p.opts[0]: p for p in options(command)}
        for role in ("camera", "projector"):
            if f"--{role}" in known:
                assert "virtual[:SCENE]" in known[f"--{role}"].help, name


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("decode shots --camera-name webcam:0", "--camera-name: expected a name such as left"),
        (
            "measure a --rig r.toml --projector-name screen:1",
            "which opens a device; --projector of",
        ),
        (
            "decode shots --camera left",
            "No such option: --camera (Possible options: --camera-name)\n",
        ),
        ("decode shots --quiet", "No such option: --quiet; options of all commands stand before"),
        (
            "calibrate board --board chessboard:9x7:20 --out r.toml --camera left",
            "--camera: expected together with --live",
        ),
        (
            "calibrate board --board chessboard:9x7:20 --out r.toml --live --setup s.toml "
            "--projector screen --camera left",
            "s.toml: could not be read",
        ),
        ("capture --projector screen --camera left --out c", "camera 'left': expected a kind of"),
    ],
)
def test_a_wrong_kind_of_word_is_refused_first(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert run(words.split()) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", LONG)
def test_many_options_are_in_panels(name, capsys, monkeypatch):
    command = COMMANDS[name]
    first = panels.FIRST[command.name].split()
    known = [one.opts[0].removeprefix("--") for one in options(command)]
    assert len(set(first)) == 5
    assert set(first) <= set(known)
    listed = [one for names in panels.PANELS.values() for one in names.split()]
    assert len(listed) == len(set(listed))
    assert set(known) <= {*listed, "help"}
    for width in (80, 120):
        monkeypatch.setenv("COLUMNS", str(width))
        assert run([*name.split(), "--help"]) == 0
        lines = capsys.readouterr().out.partition("  Example:")[0].splitlines()
        assert max(map(len, lines)) <= width
        told = [m[1] for line in lines if (m := re.match(r"  --([a-z-]+)", line))]
        assert sorted(told) == sorted([*known, "help"])
        assert told[:5] == first


def test_every_panel_and_every_name_in_it_is_used():
    used = {one.opts[0].removeprefix("--") for name in LONG for one in options(COMMANDS[name])}
    assert {name for names in panels.PANELS.values() for name in names.split()} == used - {"help"}
    assert set(panels.FIRST) == {COMMANDS[name].name for name in LONG}
