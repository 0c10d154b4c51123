"""Three or four frames with a range of depths: right orders, NaN outside, and the plans for it."""

from __future__ import annotations

import json
import re
from functools import lru_cache

import numpy as np
import pytest
import scipy.ndimage

import fringeworks as fw
from fringeworks.rig.calibration.parameters import moved_rig
from fringeworks.rig.depth_range import coordinates_at
from fringeworks.rig.ray_depth import inverse_depth
from fringeworks.simulate.bodies import Box, Cylinder, Paraboloid, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig, truth_distance
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import Reason
from tests.commands import run
from tests.grids import thinned
from tests.rigs import ahead

pytestmark = pytest.mark.statistical

RIG = standard_rig(scale=0.25)


def wall(z=530.0, albedo=0.6, **options):
    return ahead(Plane(), z=z, albedo=albedo, **options)


def checks(x, y):
    return 0.06 + 0.7 * (((np.floor(x / 7) + np.floor(y / 9)) % 2) > 0)


def stripes(x, _y):
    return 0.04 + 0.8 * ((np.floor(x / 3) % 2) > 0)


def blocks():
    heights = (4, 9, 15, 22, 6)
    return [
        ahead(Box((14.0, 60.0, 2.0 * h)), x=-60 + 30 * k, z=530 - h) for k, h in enumerate(heights)
    ]


def poles():
    return [ahead(Box((2.0, 90.0, 4.0)), x=-80 + 16 * k, z=495 + (k * 7) % 30) for k in range(10)]


def domes():
    return [
        ahead(Paraboloid(14.0, 22.0), x=x, y=y, z=520, turn=(np.pi, 0, 0), albedo=0.6)
        for x in (-60, -20, 20, 60)
        for y in (-40, 0, 40)
    ]


SCENES = {
    "plane": lambda: [wall(510)],
    "steep": lambda: [ahead(Plane(60, 120), z=512, turn=(0, -0.6, 0))],
    "blocks": lambda: [wall(), *blocks()],
    "bust": bust,
    "paint": lambda: [wall(515, checks, turn=(0.1, 0.08, 0))],
    "stripes": lambda: [ahead(Cylinder(70.0, 160.0), z=560, turn=(1.57, 0, 0), albedo=stripes)],
    "ball": lambda: [wall(), ahead(Sphere(22.0), x=5, y=3, z=512)],
    "dark": lambda: [wall(albedo=0.07), ahead(Sphere(20.0), x=-20, y=10, z=512, albedo=0.05)],
    "poles": lambda: [wall(), *poles()],
    "domes": lambda: [wall(520), *domes()],
}


@lru_cache
def view(name):
    return look(RIG, SCENES[name]())


def depths(seen):
    z = seen.points_mm[..., 2][seen.lit]
    return float(np.nanmin(z)) - 2.0, float(np.nanmax(z)) + 2.0


def near_edges(seen):
    """Pixels within two of a step of depth or of the edge of the light, where pixels are mixed."""
    z = np.nan_to_num(seen.points_mm[..., 2])
    steps = scipy.ndimage.maximum_filter(z, 5) - scipy.ndimage.minimum_filter(z, 5) > 4
    lit, dark = (scipy.ndimage.binary_dilation(m, iterations=2) for m in (seen.lit, ~seen.lit))
    return steps | (lit & dark)


def covariance():
    """Of a rig that is known to 0.02 px or so: a tenth of a pixel and of a milliradian."""
    steps = np.array([0.3, 0.3, 0.1, 0.1, *[1e-4] * 5] * 2 + [2e-5] * 3 + [0.02] * 3)
    return np.diag(steps**2)


def calibrated(seed):
    """The rig as a calibration could find it: off by its own covariance."""
    rng = np.random.default_rng(seed)
    off = rng.multivariate_normal(np.zeros(24), covariance())
    rig = moved_rig(RIG, off)
    return fw.Rig(rig.camera, rig.projector, rig.T_projector_camera, covariance(), (0.02, 0.02))


def stack(seen, plan, seed, **optics):
    return fw.Stack(tuple(photograph(seen, plan, Optics(seed=seed, **optics))), plan)


@thinned(strength=1, name=list(SCENES), frames=[3, 4])
def test_no_order_is_wrong_and_sigma_covers(name, frames):
    seen, errors = view(name), []
    inner = ~near_edges(seen)
    for seed in range(2):
        rig, range_mm = calibrated(seed), depths(seen)
        plan = fw.patterns.propose_for_depth(rig, range_mm, frames, modulation=20)[0].plan
        assert plan.frames == frames
        found = fw.measure(stack(seen, plan, seed), rig, depth_mm=range_mm)
        x = found.decoded.x.coordinate_px
        off = np.abs(x - seen.projector_px[..., 0])[inner & np.isfinite(x)]
        assert off.size > 0.3 * np.sum(inner & seen.lit)
        assert off.max() < 0.3 * plan.blocks[0].period_px
        z = truth_distance(seen.points_mm, found.points.xyz_mm)
        errors.append((np.abs(z) / found.points.sigma_mm)[np.isfinite(z) & inner])
    ratio = np.concatenate(errors)
    if name == "stripes":
        return  # the σ of dense stripes of paint is a matter of decoding, with 12 frames as well
    assert np.mean(ratio < 1) > 0.62
    assert np.mean(ratio < 2) > 0.92


@pytest.mark.parametrize("name", ["blocks", "ball", "domes"])
def test_four_frames_and_twelve_find_the_same_points(name):
    seen, range_mm = view(name), depths(view(name))
    plan = fw.patterns.propose_for_depth(RIG, range_mm, 4, modulation=20)[0].plan
    few = fw.measure(stack(seen, plan, 1), RIG, depth_mm=range_mm).points
    many = fw.measure(stack(seen, fringe_plan(RIG, both=False), 2), RIG).points
    both = np.isfinite(few.sigma_mm) & np.isfinite(many.sigma_mm) & ~near_edges(seen)
    apart = np.linalg.norm(few.xyz_mm - many.xyz_mm, axis=-1)[both]
    sigma = np.hypot(few.noise_mm, many.noise_mm)[both]
    assert np.mean(apart < 2 * sigma) > 0.92
    assert np.mean(apart > 5 * sigma) < 1e-4
    measured = np.isfinite(few.sigma_mm)[seen.lit].mean()
    assert measured > 0.98 * np.isfinite(many.sigma_mm)[seen.lit].mean()


def test_outside_the_range_is_nan_with_its_reason():
    """A wall behind the range, near enough to be told from it."""
    seen = look(RIG, [wall(540), ahead(Box((60.0, 60.0, 20.0)), z=500)])
    range_mm = (480.0, 500.0)
    plan = fw.patterns.propose_for_depth(RIG, range_mm, 4)[0].plan
    depth = fw.rig.DepthRange(RIG, range_mm)
    nearest, farthest = depth.clear_mm("x", plan.blocks[0].period_px)
    assert nearest < 480.0 < 500.0 < farthest
    wide = fw.PatternPlan(
        plan.width_px,
        plan.height_px,
        (fw.patterns.PhaseSteps("x", 120.0, fw.patterns.equal_steps(4)),),
    )
    assert depth.clear_mm("x", 120.0)[1] > 541.0
    found = fw.measure(stack(seen, wide, 0), RIG, depth_mm=depth).decoded
    inner = ~near_edges(seen) & seen.lit
    z = seen.points_mm[..., 2]
    behind, inside = inner & (z > 530), inner & (z < 495)
    assert min(behind.sum(), inside.sum()) > 500
    assert (found.x.reason[behind] == Reason.OUTSIDE_DEPTH).all()
    assert np.isnan(found.x.coordinate_px[behind]).all()
    assert np.isfinite(found.x.coordinate_px[inside]).mean() > 0.99
    told = next(f for f in found.findings if f.kind == "depth range")
    assert told.figures["outside"] == pytest.approx(np.mean(z[seen.lit] > 530), abs=0.05)


@pytest.mark.parametrize("name", ["plane", "steep", "bust", "domes"])
@pytest.mark.parametrize("off_mm", [0.0, -40.0, -90.0])
def test_surfaces_outside_the_range_are_named_by_where_they_run_on(name, off_mm):
    seen = view(name)
    near, far = depths(seen)
    range_mm = (near + off_mm, far + off_mm)
    plan = fw.patterns.propose_for_depth(RIG, range_mm, 4, modulation=20)[0].plan
    found = fw.measure(stack(seen, plan, 3), RIG, depth_mm=range_mm)
    (told,) = (f for f in found.decoded.findings if f.kind == "depth range")
    assert (told.severity == "warning") == (off_mm != 0.0)
    assert ("run on past an end" in told.text) == (off_mm != 0.0)


def test_absolute_coordinates_are_only_compared_with_the_range():
    seen = look(RIG, [wall(540), ahead(Box((60.0, 60.0, 20.0)), z=500)])
    shot = stack(seen, fringe_plan(RIG, both=False), 0)
    free, confined = fw.measure(shot, RIG), fw.measure(shot, RIG, depth_mm=(480.0, 500.0))
    kept = np.isfinite(confined.points.xyz_mm[..., 2])
    np.testing.assert_array_equal(confined.points.xyz_mm[kept], free.points.xyz_mm[kept])
    z = free.points.xyz_mm[..., 2]
    assert (z[kept] < 505).all()
    assert kept[(z > 482) & (z < 498)].all()


def test_a_period_without_room_is_ambiguous_or_refused():
    depth = fw.rig.DepthRange(RIG, (480.0, 520.0))
    span = depth.period_px("x")
    seen = view("plane")
    for share, refused in ((0.97, False), (0.5, True)):
        plan = fw.PatternPlan(
            RIG.projector.width_px,
            RIG.projector.height_px,
            (fw.patterns.PhaseSteps("x", share * span, fw.patterns.equal_steps(4)),),
        )
        shot = stack(seen, plan, 0)
        if refused:
            with pytest.raises(fw.InputError, match=r"expected up to \d+ mm, or a plan with"):
                fw.measure(shot, RIG, depth_mm=depth)
        else:
            found = fw.measure(shot, RIG, depth_mm=depth).decoded.x
            off = found.coordinate_px - seen.projector_px[..., 0]
            assert np.nanmax(np.abs(off)) < 0.2 * span
    longest = depth.longest_mm("x", 0.5 * span)
    assert 480 < longest < 520
    assert fw.rig.DepthRange(RIG, (480.0, longest)).period_px("x") == pytest.approx(0.5 * span)


@pytest.mark.parametrize(
    ("range_mm", "unit"), [((48.0, 52.0), "in cm"), ((0.48, 0.52), "in m"), ((5e5, 6e5), "")]
)
def test_a_range_that_the_projector_does_not_light_is_refused_with_the_depths_that_it_does(
    range_mm, unit
):
    plan = fw.patterns.propose_for_depth(RIG, (480.0, 520.0), 4)[0].plan
    with pytest.raises(fw.InputError, match=r"the camera sees \d+ to \d+ mm lit") as refused:
        fw.measure(stack(view("plane"), plan, 0), RIG, depth_mm=range_mm)
    assert (f"given {unit}" in str(refused.value)) == bool(unit)
    assert {"noise"} <= {f.kind for f in refused.value.findings}
    depths_lit = re.search(r"sees (\d+) to (\d+) mm", str(refused.value)).groups()
    lit = fw.rig.DepthRange(RIG, [float(z) for z in depths_lit])
    assert lit.period_px("x") == pytest.approx(RIG.projector.width_px, abs=2.0)


def test_the_interval_holds_the_coordinates_of_its_depths():
    depth, pixels = (470.0, 540.0), np.array([[3.0, 5.0], [80.0, 60.0], [150.0, 110.0]])
    for axis in ("x", "y"):
        for z in depth:
            c = coordinates_at(RIG, pixels, z, axis)
            back = 1.0 / inverse_depth(RIG, pixels, c, axis)
            if axis == "x":
                np.testing.assert_allclose(back, z, rtol=1e-6)
    assert fw.rig.DepthRange(RIG, depth).period_px("x") > 10 * fw.rig.DepthRange(
        RIG, depth
    ).period_px("y")


@pytest.mark.parametrize(
    "range_mm", [(520.0, 480.0), (0.0, 500.0), (500.0,), (1.0, np.inf), (500.0, 500.0)]
)
def test_bad_ranges_are_refused(range_mm):
    with pytest.raises(fw.InputError, match="depth range: expected two depths in mm"):
        fw.rig.DepthRange(RIG, range_mm)


def test_ranges_of_other_rigs_and_sizes_are_refused():
    other = fw.rig.DepthRange(standard_rig(scale=0.5), (480.0, 520.0))
    plan = fw.patterns.propose_for_depth(RIG, (480.0, 520.0), 4)[0].plan
    shot = stack(view("plane"), plan, 0)
    with pytest.raises(fw.InputError, match="expected one for the same rig"):
        fw.measure(shot, RIG, depth_mm=other)
    with pytest.raises(fw.RigMismatch, match="it is for a camera of"):
        other.resolve(fw.decode(shot.frames, plan, absolute=False))
    with pytest.raises(fw.InputError, match="depth_mm: expected together with a rig"):
        fw.stack.Decoder(plan, RIG.camera.shape, depth_mm=(480.0, 520.0))
    with pytest.raises(fw.InputError, match="expected another period, a Gray code, or a rig"):
        fw.measure(shot, RIG)


def test_the_decoder_and_measure_agree():
    range_mm = depths(view("ball"))
    plan = fw.patterns.propose_for_depth(RIG, range_mm, 4)[0].plan
    shot = stack(view("ball"), plan, 3)
    expected = fw.measure(shot, RIG, depth_mm=range_mm).points
    decoder = fw.stack.Decoder(plan, RIG.camera.shape, rig=RIG, depth_mm=range_mm)
    for _ in range(3):
        np.testing.assert_array_equal(decoder.points(shot.frames).xyz_mm, expected.xyz_mm)


def test_the_decoder_says_what_the_scene_says_of_the_periods():
    seen = view("blocks")
    range_mm = depths(seen)
    plan = fw.patterns.propose_for_depth(RIG, range_mm, 4, modulation=20)[0].plan
    frames = stack(seen, plan, 5)
    decoder = fw.stack.Decoder(plan, RIG.camera.shape, rig=RIG, depth_mm=range_mm)
    of_measure = fw.measure(frames, RIG, depth_mm=range_mm).points.findings
    told = [f for f in of_measure if f.kind == "whole periods"]
    assert told
    for _ in range(2):  # judged, and not judged
        found = decoder.points(list(frames.frames)).findings
        assert [f for f in found if f.kind == "whole periods"] == told
        assert set(told) <= set(decoder.findings)


def test_plans_for_a_range_have_room_for_it():
    range_mm = (470.0, 540.0)
    span = fw.rig.DepthRange(RIG, range_mm).period_px("x")
    for frames in (3, 4, 6, 9, 12):
        for proposal in fw.patterns.propose_for_depth(RIG, range_mm, frames):
            assert proposal.margin >= 6.0
            assert proposal.plan.frames <= frames
            assert proposal.plan.chain("x", absolute=False).high_px + 0.5 > span
            assert "depth range of 470 to 540 mm" in proposal.reason
    with pytest.raises(fw.InputError, match="noise: expected room for 6 standard deviations"):
        fw.patterns.propose_for_depth(RIG, range_mm, 4, noise=60.0)
    with pytest.raises(fw.InputError, match="expected points that the projector lights"):
        fw.patterns.propose_for_depth(RIG, (20.0, 25.0), 4)


def test_plans_of_short_periods():
    for proposal in fw.propose(1920, 1080, 12, max_period_px=24.0):
        assert proposal.kind != "gray"
        assert max(b.period_px for b in proposal.plan.blocks) <= 24.0
        assert min(len(b.shifts_rad) for b in proposal.plan.blocks) >= 3
    robust = fw.propose(1920, 1080, 12, min_period_px=18.0, robust=True)
    assert "no period is longer than 27 px" in robust[0].reason
    for proposal in robust:
        assert max(b.period_px for b in proposal.plan.blocks) <= 27.0


def test_the_command_line_measures_with_a_range(tmp_path):
    rig, plan, shots, out = (tmp_path / n for n in ("rig.toml", "plan.toml", "shots", "p.ply"))
    fw.files.write_rig(rig, RIG)
    near, far = depths(view("ball"))
    depth = f"{near:.1f}:{far:.1f}"
    said = run("plan", "--frames", "4", "--rig", rig, "--depth", depth, "--out", plan)
    assert "the depth range of" in said.stdout + said.stderr
    made = fw.files.read_plan(plan)
    assert made.frames == 4
    drawn = run("patterns", plan, "--out", tmp_path / "pictures").stdout
    assert "coordinates along x repeat after" in drawn
    assert "wrote 4 patterns" in drawn
    fw.files.write_stack(shots, list(stack(view("ball"), made, 0).frames), made)
    figures = tmp_path / "m.json"
    run("measure", shots, "--rig", rig, "--depth", depth, "--out", out, "--json", figures)
    assert out.exists()
    assert json.loads(figures.read_text())["provenance"]["options"]["depth_mm"]
    wrong = run("measure", shots, "--rig", rig, "--depth", "near", "--out", out, code=2)
    assert "--depth: expected two depths in mm as 450:560" in wrong.stderr
