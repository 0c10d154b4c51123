"""Gauge studies that drive the scanner: the order of the trials, and the table that grows."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import typer

import fringeworks as fw
from fringeworks.evaluate import gauge_scans
from fringeworks.evaluate.gauge_scans import Trial, scan_trials, trials_of
from fringeworks.files.study_table import read_study
from fringeworks.simulate.standard import fringe_plan
from tests.commands import run

FLAT = fw.evaluate.PartTolerance("flat", "flatness", ("part",), None, 5.0)
RECIPE = fw.Recipe(areas={"part": fw.evaluate.Area(box=(0, 0, 9, 9))}, tolerances=(FLAT,))


def test_operators_measure_all_parts_in_another_order_each_time():
    parts = [f"P{k}" for k in range(8)]
    found = trials_of(parts, ["A", "B"], 3)
    assert found == trials_of(parts, ["A", "B"], 3)
    rounds = [found[at : at + 8] for at in range(0, 48, 8)]
    for one in rounds:
        assert {trial.part for trial in one} == set(parts)
        assert len({(trial.operator, trial.number) for trial in one}) == 1
    assert len({tuple(trial.part for trial in one) for one in rounds}) > 4
    assert trials_of(["P"], [], 2) == [Trial("P", "", 1), Trial("P", "", 2)]


@pytest.mark.parametrize(
    ("parts", "operators", "count"),
    [([], [], 3), (["P"], [], 0), (["P", "P"], [], 2), (["a/b"], [], 2), (["P"], ["A_1"], 2)],
)
def test_trials_that_make_no_study(parts, operators, count):
    with pytest.raises(fw.InputError, match="expected"):
        trials_of(parts, operators, count)


def test_an_interrupted_study_goes_on(tmp_path, monkeypatch):
    taken = []

    def inspect(folder, recipe):
        value = float("nan") if folder == "P1_2" and len(taken) < 5 else float(len(taken))
        check = SimpleNamespace(value=value, tolerance=recipe.tolerances[0], why="too dark")
        return SimpleNamespace(checks=(check,))

    def take(trial):
        taken.append(trial)
        return trial.name

    monkeypatch.setattr(gauge_scans, "inspect", inspect)
    table, trials = tmp_path / "trials.csv", trials_of(["P1", "P2"], [], 2)
    with pytest.raises(fw.InputError, match="P1_2: flat was not measured: too dark"):
        scan_trials(table, trials, RECIPE, take)
    before = table.read_text()
    assert scan_trials(table, trials, RECIPE, lambda trial: taken.append(trial) or take(trial))
    assert table.read_text().startswith(before)
    rows = read_study(table, "flat")
    assert sorted(rows.parts) == ["P1", "P1", "P2", "P2"]
    assert scan_trials(table, trials, RECIPE, None) == table  # nothing is left to take
    with pytest.raises(fw.InputError, match="name a new table"):
        other = fw.evaluate.PartTolerance("other", "flatness", ("part",), None, 5.0)
        scan_trials(table, trials, fw.Recipe(areas=RECIPE.areas, tolerances=(other,)), take)


def test_the_command_scans_the_trials_of_a_study(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(typer, "prompt", lambda text, **_: asked.append(text))
    virtual = fw.devices.virtual_rig()
    fw.files.write_rig(tmp_path / "rig.toml", virtual)
    fw.files.write_plan(tmp_path / "plan.toml", fringe_plan(virtual, both=False))
    (tmp_path / "recipe.toml").write_text(
        'kind = "recipe"\nrig = "rig.toml"\n[areas.part]\nbox = [150, 120, 190, 160]\n'
        '[[tolerances]]\nname = "flat"\nquantity = "flatness"\nareas = ["part"]\nmax = 5.0\n'
    )
    devices = ("--projector", "virtual:plane", "--camera", "virtual:plane")
    options = ("--recipe", "recipe.toml", "--capture", "scans", "--plan", "plan.toml")
    study = ("study", "trials.csv", "--quantity", "flat", "--tolerance-width", "1e6")
    scans = ("--scan-parts", "P1,P2", "--trials", "2")
    done = run(*study, *scans, *devices, *options, cwd=tmp_path)
    assert len(asked) == 4
    assert asked[0].startswith("place P")
    assert "2 parts × 2 trials" in done.stdout + done.stderr
    assert len(list((tmp_path / "scans").iterdir())) == 4
    assert len(read_study(tmp_path / "trials.csv", "flat").values) == 4
    refused = run(*study, *scans, cwd=tmp_path, code=2)
    assert "--recipe and --capture" in refused.stderr
