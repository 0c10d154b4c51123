"""Acceptance tests after VDI/VDE 2634: planned positions, quality parameters, decisions."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate import (
    AcceptanceTest,
    BallBar,
    PlaneArtefact,
    TestScan,
    TestVolume,
    certify,
    check_positions,
    plan_positions,
)
from fringeworks.evaluate.acceptance.certify import artefact_sigma
from fringeworks.evaluate.acceptance.positions import artefact_faults
from fringeworks.simulate.standard import standard_rig
from fringeworks.types import Points
from tests import commands

VOLUME = TestVolume((0.0, 0.0, 510.0), (150.0, 110.0, 60.0))
BAR = BallBar(70.0, (24.0, 20.0), 0.001, 0.0005, 0.001, 0.0003)
PLANE = PlaneArtefact((80.0, 50.0), 0.001, 0.0005)
LIMITS = {"PF": 0.03, "PS": 0.02, "SD": 0.02, "F": 0.03}


def acceptance(**more):
    return AcceptanceTest(VOLUME, BAR, PLANE, LIMITS, **more)


def cap(centre, radius, rng, sigma, count=3000):
    """Points of the half of a ball that faces the camera."""
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways[:, 2] = -np.abs(ways[:, 2])
    return centre + (radius + rng.normal(0.0, sigma, count))[:, None] * ways


def scan(one, seed, *, scale=1.0, bump=0.0, sigma=0.002):
    """Points of an artefact in a position, as a scanner with an error of the scale sees them."""
    rng = np.random.default_rng([48, seed])
    if one.artefact == "ball bar":
        sizes = zip(one.marks_mm, BAR.diameters_mm, strict=True)
        points = np.concatenate([cap(c, 0.5 * d, rng, sigma) for c, d in sizes])
    else:
        x = one.marks_mm[2] - one.marks_mm[0]
        x = x / np.linalg.norm(x)
        y = np.cross(one.direction, x)
        u, v = rng.uniform(-40, 40, 4000), rng.uniform(-25, 25, 4000)
        height = rng.normal(0.0, sigma, 4000) + bump * (u / 40.0) ** 2
        points = one.marks_mm[0] + u[:, None] * x + v[:, None] * y
        points = points + height[:, None] * one.direction
    return TestScan(one.artefact, Points(points * scale, None), f"{one.name} {one.artefact}")


def scans(**how):
    return tuple(scan(one, k, **how) for k, one in enumerate(plan_positions(acceptance())))


def test_planned_positions_fill_the_volume_and_are_told_apart():
    planned = plan_positions(acceptance(), standard_rig(scale=0.3))
    assert [one.artefact for one in planned] == ["ball bar"] * 7 + ["plane"] * 6
    assert all(one.seen for one in planned)
    half = 0.5 * np.array(VOLUME.size_mm)
    for one in planned[:7]:
        assert np.linalg.norm(one.marks_mm[1] - one.marks_mm[0]) == pytest.approx(70.0)
        assert (np.abs(one.marks_mm - VOLUME.centre_mm) + 12.0 <= half + 1e-9).all()
    # Every planned position finds itself, in any order and either way round.
    turned = [
        replace(one, marks_mm=one.marks_mm[::-1]) if one.artefact == "ball bar" else one
        for one in planned
    ]
    found = check_positions(acceptance(), planned, turned[::-1])
    assert found.taken == tuple(range(12, -1, -1))
    assert not found.missing
    assert not found.outside
    assert not found.same
    far = fw.evaluate.TestVolume((200.0, 0.0, 510.0), VOLUME.size_mm)
    there = plan_positions(replace(acceptance(), volume=far), standard_rig(scale=0.3))
    assert not any(one.seen for one in there)


def test_positions_that_are_missing_outside_or_twice_are_named():
    planned = plan_positions(acceptance())
    moved = replace(planned[2], marks_mm=planned[2].marks_mm + np.array([60.0, 0.0, 0.0]))
    taken = [planned[0], replace(planned[0], name="again"), moved, *planned[3:]]
    found = check_positions(acceptance(), planned, taken)
    assert {one.name for one in found.missing} == {planned[1].name, planned[2].name}
    assert found.outside == (2,)
    assert found.same == ((1, 0),)


def test_artefacts_of_other_sizes_are_named():
    assert artefact_faults(acceptance()) == []
    short = replace(BAR, length_mm=40.0, diameters_mm=(60.0, 20.0))
    small = PlaneArtefact((30.0, 20.0))
    faults = artefact_faults(replace(acceptance(), ball_bar=short, plane=small))
    assert len(faults) == 3
    with pytest.raises(fw.InputError, match="fits into the volume"):
        plan_positions(replace(acceptance(), ball_bar=replace(BAR, length_mm=160.0)))


def test_a_good_scanner_passes_with_its_true_errors():
    found = certify(acceptance(scans=scans()))
    assert found.verdict == "pass", found.faults
    assert found.faults == ()
    values = {one.parameter: one for one in found.parameters}
    assert [len(values[name].values_mm) for name in ("PF", "PS", "SD", "F")] == [14, 14, 7, 6]
    # Ranges of 3,000 normal values without 0.3 % are about 6 of their standard deviations.
    assert values["PF"].largest_mm == pytest.approx(0.012, rel=0.15)
    assert values["F"].largest_mm == pytest.approx(0.012, rel=0.15)
    assert abs(values["PS"].largest_mm) < 0.001
    assert abs(values["SD"].largest_mm) < 0.001
    assert len(found.provenance.inputs) == 13
    assert len({source.sha256 for source in found.provenance.inputs}) == 13


def test_an_error_of_the_scale_fails_by_size_and_spacing():
    found = certify(acceptance(scans=scans(scale=1.0005)))
    values = {one.parameter: one for one in found.parameters}
    assert values["SD"].largest_mm == pytest.approx(0.0005 * 70.0, abs=0.001)
    assert values["SD"].verdict == "fail"
    assert values["PS"].largest_mm == pytest.approx(0.0005 * 24.0, abs=0.001)
    assert values["PS"].verdict == "pass"
    assert found.verdict == "fail"


def test_a_bend_of_the_field_fails_by_flatness():
    found = certify(acceptance(scans=scans(bump=0.04)))
    values = {one.parameter: one for one in found.parameters}
    assert values["F"].largest_mm == pytest.approx(0.045, abs=0.01)
    assert values["F"].verdict == "fail"


def test_decisions_keep_the_guard_band_of_the_artefact():
    every = scans(scale=1.0005)
    for limit, verdict in ((0.0450, "pass"), (0.0352, "undecided"), (0.0300, "fail")):
        bar = replace(BAR, length_sigma_mm=0.002)
        test = replace(acceptance(scans=every), ball_bar=bar, limits_mm={"SD": limit})
        spacing = next(one for one in certify(test).parameters if one.parameter == "SD")
        assert spacing.test_sigma_mm == 0.002
        assert spacing.verdict == verdict, limit


def test_uncertainty_of_the_test_holds_the_artefact_alone():
    test = replace(acceptance(), expansion_per_k=1e-5, temperature_k=3.0)
    warm = 1e-5 * 3.0 / 3**0.5
    assert artefact_sigma("SD", test) == pytest.approx(np.hypot(0.001, 70.0 * warm))
    assert artefact_sigma("PS", test) == pytest.approx(np.hypot(0.0005, 24.0 * warm))
    assert artefact_sigma("PF", test) == pytest.approx(np.hypot(0.0005, 0.0003))
    assert artefact_sigma("F", test) == pytest.approx(np.hypot(0.0005, 0.0005))


def test_an_incomplete_test_is_undecided():
    found = certify(acceptance(scans=scans()[:-2]))
    assert found.verdict == "undecided"
    assert any("tilted down" in fault for fault in found.faults)


def test_scans_of_something_else_are_refused():
    planned = plan_positions(acceptance())
    wrong = replace(acceptance(), ball_bar=replace(BAR, diameters_mm=(30.0, 20.0)))
    with pytest.raises(fw.InputError, match="across, top front.*expected balls"):
        certify(replace(wrong, scans=(scan(planned[0], 0),)))
    with pytest.raises(fw.InputError, match="got none"):
        certify(acceptance())
    for bad in ({"part": 4}, {"risk": 0.9}, {"temperature_k": -1.0}):
        with pytest.raises(fw.InputError):
            acceptance(**bad)
    with pytest.raises(fw.InputError, match="limits"):
        AcceptanceTest(VOLUME, BAR, None, {"F": 0.1})
    with pytest.raises(fw.InputError, match="neither"):
        AcceptanceTest(VOLUME)


TOML = """
kind = "acceptance-test"
[volume]
centre_mm = [0, 0, 510]
size_mm = [150, 110, 60]
[ball_bar]
length_mm = 70.0
diameters_mm = [24.0, 20.0]
length_expanded_mm = 0.002
[limits_mm]
SD = 0.02
"""


def test_the_command_plans_and_certifies(tmp_path):
    file = tmp_path / "test.toml"
    file.write_text(TOML, encoding="utf-8")
    known = fw.files.read_acceptance_test(file)
    assert known.ball_bar.length_sigma_mm == 0.001
    done = commands.run("certificate", file, "--positions")
    assert "space diagonal" in done.stdout + done.stderr
    lines = [TOML]
    for k, one in enumerate(plan_positions(known)):
        points = scan(one, k).scan
        fw.write(tmp_path / f"s{k}.ply", points)
        lines.append(f'[[scans]]\nartefact = "ball bar"\nscan = "s{k}.ply"\nname = "bar {k}"\n')
    file.write_text("".join(lines), encoding="utf-8")
    page, out = tmp_path / "c.html", tmp_path / "c.json"
    done = commands.run("certificate", file, "--report", page, "--json", out)
    text = page.read_text("utf-8")
    assert "all limits are kept" in text
    assert "sha256" in text
    assert json.loads(out.read_text())["verdict"] == "pass"
    commands.run("certificate", file, "--report", tmp_path / "c.pdf", "--paper", "letter")
    assert (tmp_path / "c.pdf").read_bytes().startswith(b"%PDF")
    file.write_text("".join(lines[:-1]), encoding="utf-8")
    commands.run("certificate", file, code=4)
    file.write_text(TOML.replace("[150, 110, 60]", "[150, 110, 0]"), encoding="utf-8")
    commands.run("certificate", file, code=2)
