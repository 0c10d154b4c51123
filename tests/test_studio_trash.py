"""What clicks in the studio delete or replace can be undone, and what was done is still known after a restart."""

from __future__ import annotations

import json
import os
import shutil
from datetime import UTC, datetime, timedelta

import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed")

import fringeworks as fw
from fringeworks.scan.bench import Take
from fringeworks.serving.worker import Job
from fringeworks.studio.actions import DrawBoard, Scan
from fringeworks.studio.log import CommandLog
from fringeworks.studio.notes import Notes
from fringeworks.studio.places import STEPS, Place, place_of
from fringeworks.studio.recipes import RecipeKeeper
from fringeworks.studio.state import Studio
from fringeworks.studio.trash import ENTRY_FILE, KEPT_DAYS, STAMP, Trash
from fringeworks.studio.workspace import open_workspace
from fringeworks.types import InputError


@pytest.fixture
def space(tmp_path):
    return open_workspace(tmp_path / "work")


@pytest.fixture
def trash(space):
    return Trash(space)


def capture(space, name, text="1"):
    """A folder that looks like a capture."""
    folder = space.root / name
    folder.mkdir(parents=True)
    (folder / "capture.toml").write_text(text)
    return folder


def test_a_deleted_capture_comes_back(space, trash):
    capture(space, "part")
    trash.delete("part", "delete part")
    assert space.captures() == []
    assert trash.last().what == "delete part"
    assert trash.undo() == "Undone: delete part."
    assert space.captures() == ["part"]
    assert trash.entries() == []
    with pytest.raises(InputError, match="nothing to undo"):
        trash.undo()


def test_a_file_is_never_missing_while_it_is_undone(space, trash, monkeypatch):
    """Another page reads the recipe at the moment in which it is replaced."""
    there = []
    for module, name in ((shutil, "move"), (shutil, "copy2"), (os, "replace")):
        do = getattr(module, name)

        def watched(*given, do=do):
            there.append(space.recipe.exists())
            done = do(*given)
            there.append(space.recipe.exists())
            return done

        monkeypatch.setattr(module, name, watched)
    space.recipe.write_text("one")
    trash.before((space.recipe.name,), "change it")
    space.recipe.write_text("two")
    trash.undo()
    assert space.recipe.read_text() == "one"
    assert len(there) >= 6
    assert all(there)


def test_an_older_capture_does_not_push_a_newer_one_aside(space, trash):
    capture(space, "part", "old")
    trash.delete("part", "delete part")
    capture(space, "part", "new")
    with pytest.raises(InputError, match="another 'part'"):
        trash.undo()
    assert (space.root / "part" / "capture.toml").read_text() == "new"
    assert [entry.what for entry in trash.entries()] == ["delete part"]


def test_replaced_files_come_back_and_undoing_is_undone(space, trash):
    space.setup.write_text("one")
    trash.before(("setup.toml", "setup.png"), "set up again")
    space.setup.write_text("two")
    (space.root / "setup.png").write_text("picture")
    trash.undo()
    assert space.setup.read_text() == "one"
    assert not (space.root / "setup.png").exists()
    (again,) = trash.entries()
    assert trash.last() is None, "an undoing is no step of its own"
    trash.undo(again)
    assert space.setup.read_text() == "two"
    assert (space.root / "setup.png").read_text() == "picture"


def test_a_renaming_is_undone(space, trash):
    capture(space, "part")
    capture(space, "other")
    with pytest.raises(InputError, match="already"):
        trash.rename("part", "other")
    trash.rename("part", "ball")
    assert space.captures() == ["ball", "other"]
    trash.undo()
    assert space.captures() == ["other", "part"]


def test_the_trash_outlives_the_studio_and_is_emptied_after_a_month(space, trash):
    capture(space, "old")
    capture(space, "new")
    old = trash.delete("old", "delete old")
    trash.delete("new", "delete new")
    made = datetime.now(UTC) - timedelta(days=KEPT_DAYS, minutes=1)
    aged = space.trash / f"{made.strftime(STAMP)}-0000"
    (space.trash / old.name).rename(aged)
    again = Trash(space)
    assert len(again.entries()) == 2
    again.purge()
    assert [entry.what for entry in again.entries()] == ["delete new"]
    assert not aged.exists()
    again.undo()
    assert space.captures() == ["new"]


@pytest.mark.parametrize("name", ["", ".", "..", "../out", "/etc", "board/..", "x\0"])
def test_forged_entries_are_passed_over(space, trash, name):
    folder = space.trash / f"{datetime.now(UTC).strftime(STAMP)}-0000"
    folder.mkdir(parents=True)
    given = {"what": "x", "names": [name], "kept": [name], "renamed": None, "again": False}
    (folder / ENTRY_FILE).write_text(json.dumps(given))
    assert trash.entries() == []
    (folder / ENTRY_FILE).write_text(json.dumps(given | {"names": [], "renamed": ["a", name]}))
    assert Trash(space).entries() == []


def test_areas_and_tolerances_come_back(space, trash):
    recipes = RecipeKeeper(space, trash)
    recipes.set_area("face", fw.evaluate.Area(box=(1, 2, 30, 40)))
    recipes.add_tolerance(fw.evaluate.PartTolerance("flat", "flatness", ("face",), None, 0.1))
    before = recipes.read()
    recipes.remove_area("face")
    assert not recipes.read().areas
    assert not recipes.read().tolerances
    assert trash.undo() == "Undone: delete face."
    assert recipes.read() == before
    for _ in range(2):
        trash.undo()
    assert not space.recipe.exists()


def test_a_studio_deletes_renames_and_undoes(space):
    capture(space, "part")
    (space.root / "cloud.npz").write_bytes(b"")
    studio = Studio(space.root)
    try:
        one = studio.session("one")
        studio.notes.judged("part", {"verdict": "fail"})
        assert studio.rename(one, "part", "ball") == "ball"
        assert studio.notes.of("ball").verdict == "fail"
        assert studio.rename(one, "cloud.npz", "points") == "points.npz"
        studio.delete(one, "ball")
        for name in ("ball", "setup.toml", "../out", ""):
            with pytest.raises(InputError):
                studio.delete(one, name)
        with pytest.raises(InputError, match="1 to 60 letters"):
            studio.rename(one, "points.npz", "a/b")
        assert studio.undo(one) == "Undone: delete ball."
        assert studio.workspace.captures() == ["ball"]
    finally:
        studio.close()
    assert Notes(space).of("ball").verdict == "fail"


def finished(result=None):
    job = Job("work", state="done")
    job.result = result
    return job


def test_what_was_done_is_known_after_a_restart(space):
    log = CommandLog(space)
    log.note(finished(), Scan("part", Take(average=2), {"camera": "virtual:bust"}))
    running = Job("drawing")
    log.note(running, DrawBoard("chessboard:11x8:12"))
    failed = Job("scan", state="failed")
    log.note(failed, Scan("other", Take(), {}))
    assert len(log.done) == 1
    running.finish("board.pdf")
    assert len(log.done) == 2
    again = CommandLog(space)
    assert again.done == log.done
    assert [one.when for one in again.everything] == sorted(one.when for one in again.everything)


def test_forged_histories_hold_no_commands(space):
    """The commands are made from data: a folder cannot bring one of its own to be copied."""
    log = CommandLog(space)
    log.note(finished(), Scan("part", Take(), {"camera": "x; rm -rf ~"}))
    assert "'x; rm -rf ~'" in CommandLog(space).done[0].shell
    line = json.loads(space.history.read_text())
    wrong = [
        {},
        line | {"action": "Popen"},
        line | {"given": {"name": "part"}},
        line | {"when": "yesterday"},
        [],
        7,
    ]
    space.history.write_text("\n".join([*map(json.dumps, wrong), "{", "\0"]))
    assert CommandLog(space).done == []
    space.history.unlink()
    os.symlink("/etc/hostname", space.history)
    assert CommandLog(space).done == []


@pytest.mark.parametrize(
    "place",
    [
        *map(Place, STEPS),
        Place("look", "a b/ü"),
        Place("look", "pair", "fourier", {"sigma": 2, "paint": False, "mode": "a&b=c"}),
    ],
    ids=str,
)
def test_every_place_has_an_address(place):
    assert place_of(place.address) == place


@pytest.mark.parametrize(
    "address", ["/nothing", "/scan/part", "//evil.example/look", "/" + 3000 * "a", "/look/../..", 7]
)
def test_other_addresses_have_no_place(address):
    found = place_of(address)
    assert found is None or found.step == "look"


def test_a_folder_that_cannot_be_written_to_is_looked_at(space, monkeypatch):
    """Every user can be root in a container: the system is asked as it would answer others."""
    fw.files.write_pair(
        space.root / "pair", fw.simulate.standard_scene("parabola", size=64, fringes=6, bits=8)
    )
    monkeypatch.setattr(os, "access", lambda _, mode: not mode & os.W_OK)
    studio = Studio(space.root)
    try:
        one = studio.session("one")
        assert studio.workspace.captures() == ["pair"]
        assert studio.look(one, "pair", "windowed", {}).open
        for refused in (studio.run_setup, studio.print_board, studio.start_tour):
            with pytest.raises(InputError, match="read-only"):
                refused(one)
        with pytest.raises(InputError, match="read-only"):
            studio.delete(one, "pair")
    finally:
        studio.close()


def test_exports_are_numbered_and_replace_nothing(space):
    (space.root / "part.ply").write_text("mine")
    assert space.free("part", ".ply") == "part-2"
    assert space.free("part", ".stl") == "part"
    with pytest.raises(InputError):
        space.free("../part", ".ply")
