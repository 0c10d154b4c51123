"""Light between surfaces: plans of short periods in a groove, and direct and indirect light apart."""

from __future__ import annotations

import json
from functools import lru_cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.patterns.plan import Uniform
from fringeworks.simulate.bodies import Plane
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.interreflection import interreflection
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.grids import quick
from tests.rigs import ahead, groove

pytestmark = pytest.mark.statistical

RIG = standard_rig(scale=0.5)
SHORTEST_PX = 12.0


@lru_cache
def scene():
    seen = look(RIG, groove())
    return seen, interreflection(seen, groove(), patch_px=8)


def plans(**options):
    width, height = RIG.projector.width_px, RIG.projector.height_px
    return fw.propose(width, height, 12, min_period_px=SHORTEST_PX, **options)


def coordinates(plan, transport, seed):
    seen, _ = scene()
    frames = list(photograph(seen, plan, Optics(seed=seed, noise=1.0), transport=transport))
    return np.where(seen.lit, fw.decode(frames, plan).x.coordinate_px, np.nan)


@pytest.mark.parametrize("kind", quick(["number-theoretic", "heterodyne"], "heterodyne"))
def test_robust_plans_measure_a_groove_without_the_help_of_regions(kind):
    seen, bounce = scene()
    robust = next(p.plan for p in plans(robust=True) if p.kind == kind)
    assert max(b.period_px for b in robust.blocks) <= 1.5 * SHORTEST_PX
    free, lit = (coordinates(robust, transport, 1) for transport in ((), (bounce,)))
    assert np.isfinite(lit)[seen.lit].mean() > 0.95
    bias = lit - free
    assert np.sqrt(np.nanmean(bias**2)) < 0.05
    hierarchical = next(p.plan for p in plans() if p.kind == "hierarchical")
    plain, bent = (coordinates(hierarchical, transport, 1) for transport in ((), (bounce,)))
    assert np.isfinite(plain)[seen.lit].mean() > 0.9
    # Light from the other side bends its long periods, by more than the orders of single pixels
    # have room for: regions of the finest fringes tell them.
    assert np.isfinite(bent)[seen.lit].mean() > 0.9
    assert np.nanmax(np.abs(bent - plain)) < 2.0


def bent_px(period_px):
    """Shift of the phase by the bounce, as a coordinate, px rms."""
    seen, bounce = scene()
    steps = fw.patterns.PhaseSteps("x", period_px, fw.patterns.equal_steps(4))
    plan = fw.PatternPlan(RIG.projector.width_px, RIG.projector.height_px, (steps,))
    phases = []
    for transport in ((), (bounce,)):
        frames = list(photograph(seen, plan, Optics(seed=2, noise=0.3), transport=transport))
        phases.append(
            fw.stack.wrapped_phase(frames, steps.shifts_rad, estimate_steps=False).phase_rad
        )
    turned = np.angle(np.exp(1j * (phases[1] - phases[0])))[seen.lit]
    return float(np.sqrt(np.nanmean(turned**2))) * period_px / (2 * np.pi)


def test_short_periods_bend_less():
    short, middle, long = (bent_px(p) for p in (SHORTEST_PX, 60.0, 480.0))
    assert short < middle / 3 < long / 9


def separated(transport, *, black=True, seed=0, **optics):
    seen, _ = scene()
    blocks = (
        fw.patterns.PhaseSteps("x", SHORTEST_PX, fw.patterns.equal_steps(6)),
        *([Uniform("black")] * black),
    )
    plan = fw.PatternPlan(RIG.projector.width_px, RIG.projector.height_px, blocks)
    light = Optics(seed=seed, noise=1.0, **optics)
    return fw.stack.separate_light(
        list(photograph(seen, plan, light, transport=transport)), plan, contrast=contrast()
    )


@lru_cache
def contrast():
    """Of the fringes on a flat sheet."""
    seen = look(RIG, [ahead_plane()])
    steps = fw.patterns.PhaseSteps("x", SHORTEST_PX, fw.patterns.equal_steps(6))
    plan = fw.PatternPlan(
        RIG.projector.width_px, RIG.projector.height_px, (steps, Uniform("black"))
    )
    frames = list(photograph(seen, plan, Optics(seed=9, noise=1.0)))
    found = fw.stack.separate_light(frames, plan)
    ok = np.isfinite(found.direct)
    return float(found.direct[ok].sum() / (found.direct + found.indirect)[ok].sum())


def ahead_plane():
    return ahead(Plane(150, 120), z=480.0)


def whites(transport):
    """Light of a white and a black frame, without noise."""
    seen, _ = scene()
    steps = fw.patterns.PhaseSteps("x", SHORTEST_PX, fw.patterns.equal_steps(3))
    plan = fw.PatternPlan(
        RIG.projector.width_px, RIG.projector.height_px, (Uniform("white"), Uniform("black"), steps)
    )
    optics = Optics(noise=0.0, bits=16)
    frames = photograph(seen, plan, optics, transport=transport)
    white, black = (next(frames).astype(float) for _ in range(2))
    return (white - black) / 257.0


def test_direct_and_indirect_light_are_those_of_the_scene():
    seen, bounce = scene()
    found = separated((bounce,))
    truth = whites(())
    other = whites((bounce,)) - truth
    inner = seen.lit & np.isfinite(found.direct)
    assert inner.sum() > 0.9 * seen.lit.sum()
    assert np.median(np.abs(found.direct - truth)[inner] / truth[inner]) < 0.04
    # The groove's sides light each other with a fifth of their light or more.
    assert np.median(other[inner] / truth[inner]) > 0.1
    assert np.corrcoef(found.indirect[inner], other[inner])[0, 1] > 0.8
    assert np.median(np.abs(found.indirect - other)[inner]) < 0.04 * np.median(truth[inner])
    assert found.indirect_share == pytest.approx(
        other[inner].sum() / (truth + other)[inner].sum(), abs=0.03
    )
    assert found.has_black
    assert found.period_px == SHORTEST_PX


def test_sigma_is_the_scatter_over_captures():
    runs = [separated((), seed=seed) for seed in range(6)]
    everywhere = scene()[0].lit & np.all([np.isfinite(run.direct) for run in runs], axis=0)
    assert everywhere.sum() > 0.9 * scene()[0].lit.sum()
    for name in ("direct", "indirect"):
        values = np.array([getattr(run, name)[everywhere] for run in runs])
        scatter = np.sqrt(np.mean(np.var(values, axis=0, ddof=1)))
        stated = np.sqrt(np.mean(getattr(runs[0], f"{name}_sigma")[everywhere] ** 2))
        assert stated == pytest.approx(scatter, rel=0.15)


def test_without_a_black_frame_the_room_counts_as_indirect():
    without = separated((), black=False)
    assert not without.has_black
    (finding,) = [one for one in without.findings if one.kind == "room light"]
    assert "no black frame" in finding.seen
    assert "room light" not in {one.kind for one in separated(()).findings}
    bright = separated((), black=False, ambient=0.1)
    assert bright.indirect_share > separated((), ambient=0.1).indirect_share + 0.05


def test_what_cannot_be_separated_is_refused():
    plan = fw.PatternPlan(
        64, 48, (fw.patterns.GrayCode("x", 8.0, 64), Uniform("white"), Uniform("black"))
    )
    with pytest.raises(fw.InputError, match="expected a set of phase steps"):
        fw.stack.separate_light([np.zeros((4, 4))] * plan.frames, plan)
    steps = fw.PatternPlan(64, 48, (fw.patterns.PhaseSteps("x", 8.0, fw.patterns.equal_steps(3)),))
    with pytest.raises(fw.InputError, match="contrast: expected above 0 and up to 1, got 0"):
        fw.stack.separate_light([np.zeros((4, 4))] * 3, steps, contrast=0.0)
    with pytest.raises(fw.InputError, match="the plan has 3, got 2; missing: x-phase-8px-2"):
        fw.stack.separate_light([np.zeros((4, 4))] * 2, steps)


def test_the_command_writes_light_picture_report_and_numbers(tmp_path, capsys):
    seen, bounce = scene()
    blocks = (
        fw.patterns.PhaseSteps("x", SHORTEST_PX, fw.patterns.equal_steps(4)),
        Uniform("black"),
    )
    plan = fw.PatternPlan(RIG.projector.width_px, RIG.projector.height_px, blocks)
    frames = list(photograph(seen, plan, Optics(seed=3, noise=1.0), transport=(bounce,)))
    fw.files.write_stack(tmp_path / "groove", frames, plan)
    out, figure, report, numbers = (
        tmp_path / name for name in ("light.npz", "light.png", "light.html", "light.json")
    )
    arguments = ["light", str(tmp_path / "groove"), "--contrast", "0.8", "--out", str(out)]
    arguments += ["--figure", str(figure), "--report", str(report), "--json", str(numbers)]
    assert run(arguments) == 0
    expected = fw.stack.separate_light(frames, plan, contrast=0.8)
    found = fw.files.read_light(out)
    for name in ("direct", "direct_sigma", "indirect", "indirect_sigma", "reason"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert (found.period_px, found.contrast, found.has_black) == (SHORTEST_PX, 0.8, True)
    assert found.provenance is not None
    said = json.loads(numbers.read_text())
    assert said["indirect_share"] == pytest.approx(expected.indirect_share)
    assert "indirect light:" in capsys.readouterr().out
    assert figure.stat().st_size > 10_000
    assert "indirect share" in report.read_text()
    assert type(fw.read(out)) is fw.stack.LightSeparation


def test_the_command_refuses_what_it_cannot_do(tmp_path, capsys):
    assert run(["light", str(tmp_path / "none"), "--out", str(tmp_path / "light.csv")]) == 2
    assert "expected .npz" in capsys.readouterr().err
    plan = fw.PatternPlan(64, 48, (fw.patterns.PhaseSteps("x", 8.0, fw.patterns.equal_steps(3)),))
    fw.files.write_stack(tmp_path / "dark", np.zeros((3, 48, 64), np.uint8), plan)
    assert run(["light", str(tmp_path / "dark"), "--min-modulation", "3"]) == 2
    assert "leave it out" in capsys.readouterr().err
