"""Methods compared on one's own pairs, with a truth and without one."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.captures import short_names
from tests.commands import run
from tests.conftest import scene

pytestmark = pytest.mark.statistical

SMALL = {"size": 120, "fringes": 10.0, "height_mm": 30.0, "noise": 1.0}
METHODS = ["fourier", "windowed", "wavelet"]


def small(name="parabola", **more):
    return scene(name, **(SMALL | more))


def without_truth(pair):
    return replace(pair, truth_mm=None)


def test_each_method_is_compared_with_the_median_of_the_others():
    (found,) = fw.evaluate.compare_captures([without_truth(small())], METHODS)
    values = {m: s.values.astype(float) for m, s in found.surfaces.items()}
    middle = np.median([values["windowed"], values["wavelet"]], axis=0)
    assert np.allclose(found.difference["fourier"], values["fourier"] - middle, equal_nan=True)
    sigmas = {m: s.sigma.astype(float) for m, s in found.surfaces.items()}
    other = np.median([sigmas["windowed"], sigmas["wavelet"]], axis=0)
    both = np.sqrt(sigmas["fourier"] ** 2 + other**2)
    assert np.allclose(found.difference_sigma["fourier"], both, equal_nan=True)
    row = found.rows()[0]
    size = np.abs(found.difference["fourier"])
    known = np.isfinite(size)
    assert row["median_abs_difference"] == np.median(size[known])
    assert row["compared_fraction"] == known.mean()
    assert row["agree_within_1_sigma"] == np.mean(size[known] <= both[known])
    assert row["agree_within_2_sigma"] >= row["agree_within_1_sigma"]
    assert row["measured_fraction"] == 1.0 - found.surfaces["fourier"].failed_fraction
    assert "mean_abs_error_mm" not in row


def test_one_wrong_method_does_not_move_the_others_reference():
    """A method that is off by 100 px everywhere: it stands out, and the others hardly change."""

    @fw.method("off_by_far")
    def off_by_far(prepared):
        """Fourier, and 100 px in addition."""
        right = fw.pair.get_method("fourier").function(prepared)
        return replace(right, displacement_px=right.displacement_px + 100.0)

    pair = replace(without_truth(small()), geometry=None)
    (alone,) = fw.evaluate.compare_captures([pair], METHODS)
    (found,) = fw.evaluate.compare_captures([pair], [*METHODS, "off_by_far"])
    rows = {row["method"]: row for row in found.rows()}
    assert rows["off_by_far"]["median_abs_difference"] == pytest.approx(100.0, abs=0.5)
    assert rows["off_by_far"]["agree_within_2_sigma"] < 0.01
    before = {row["method"]: row["median_abs_difference"] for row in alone.rows()}
    assert rows["windowed"]["median_abs_difference"] < 3 * before["windowed"] + 0.01


def test_against_a_method_it_is_not_compared_with_itself():
    (found,) = fw.evaluate.compare_captures([small()], ["fourier"], against="windowed")
    one, other = found.rows()
    assert (one["method"], other["method"]) == ("fourier", "windowed")
    assert one["against"] == "windowed"
    assert np.isfinite(one["median_abs_difference"])
    assert np.isnan(other["median_abs_difference"])
    assert other["compared_fraction"] == 0.0
    assert np.isfinite(other["mean_abs_error_mm"])
    (single,) = fw.evaluate.compare_captures([small()], ["fourier"])
    assert np.isnan(single.rows()[0]["median_abs_difference"])


def test_errors_and_coverage_where_there_is_a_truth():
    pair = small()
    rows = fw.compare(captures={"known": pair, "unknown": without_truth(pair)}, methods=METHODS)
    assert [row["capture"] for row in rows] == ["known"] * 3 + ["unknown"] * 3
    result = fw.reconstruct(pair, "windowed")
    errors = fw.evaluate.errors(result.surface, pair.truth_mm)
    known = next(row for row in rows if row["method"] == "windowed")
    assert known["mean_abs_error_mm"] == errors.mean_abs_error_mm
    assert known["within_1_sigma"] == errors.within_1_sigma
    assert known["within_2_sigma"] == errors.within_2_sigma
    assert np.isnan(rows[-1]["within_1_sigma"])
    assert set(rows[0]) == set(rows[-1])
    in_px = fw.compare(captures=[replace(pair, geometry=None)], methods=["fourier"])
    assert "mean_abs_error_mm" not in in_px[0]
    assert in_px[0]["unit"] == "px"


def test_results_reach_the_caller():
    seen = []
    rows = fw.compare(
        captures=[small()], methods=METHODS, timing=True, on_result=lambda *both: seen.append(both)
    )
    assert [row["method"] for row, _ in seen] == METHODS
    assert all(row["seconds"] == result.seconds for row, result in seen)
    assert rows[0] == seen[0][0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"captures": [], "methods": ["fourier"]}, "captures: expected one or more pairs"),
        ({"captures": "part"}, "captures: expected one or more pairs in a list, got a str"),
        ({"captures": ["nowhere"]}, "nowhere: expected a capture folder"),
        ({"captures": ["a/b", "./a/b"]}, "expected every capture once, got a/b twice"),
        ({"captures": ["part"], "noises": [1.0]}, "captures cannot be combined with noises"),
        ({"captures": ["part"], "objects": ["plane"]}, "captures cannot be combined with objects"),
        ({"captures": ["part"], "methods": ["magic"]}, "magic"),
        ({"captures": ["part"], "against": "magic"}, "magic"),
        ({"against": "windowed"}, "against: expected together with captures"),
    ],
)
def test_what_cannot_be_compared(arguments, message):
    with pytest.raises(fw.InputError, match=message) as told:
        fw.compare(**arguments)
    assert "\n" not in str(told.value)


def test_a_capture_that_fails_is_named():
    pair = small()
    flat = replace(
        pair, object=np.full_like(pair.object, 7), reference=np.full_like(pair.object, 7)
    )
    with pytest.raises(fw.InputError, match=r"^flat: "):
        fw.evaluate.compare_captures({"good": pair, "flat": flat}, ["fourier"])


def test_stacks_are_refused(tmp_path):
    plan = fw.PatternPlan(64, 48, (fw.patterns.PhaseSteps("x", 32.0, fw.patterns.equal_steps(3)),))
    fw.files.write_stack(tmp_path / "shots", list(fw.encode(plan)), plan)
    with pytest.raises(fw.InputError, match="expected a pair of frames, got a stack"):
        fw.compare(captures=[tmp_path / "shots"])


def test_short_names():
    assert short_names(["x/part", "y/cup.npz"]) == ["part", "cup"]
    assert short_names(["x/a.png", "y/a.png"]) == ["x/a", "y/a"]
    assert short_names([]) == []


def test_the_picture_has_one_scale():
    (found,) = fw.evaluate.compare_captures([small()], METHODS, against="windowed")
    figure = found.plot()
    maps = {axes.get_title(): axes for axes in figure.axes if axes.get_title()}
    assert set(maps) == {
        *METHODS,
        "fourier − windowed",
        "wavelet − windowed",
        *(f"{m} − truth" for m in METHODS),
        "smallest error possible",
    }
    limits = {title: axes.images[0].get_clim() for title, axes in maps.items()}
    assert len({limits[m] for m in METHODS}) == 1
    assert limits["fourier − windowed"] == limits["wavelet − windowed"]
    assert len({limits[f"{m} − truth"] for m in METHODS}) == 1
    low, high = limits["fourier − truth"]
    assert low == -high
    assert "not which of them is right" in figure.get_suptitle()


def test_on_the_command_line(tmp_path):
    for k, name in enumerate(("a", "b")):
        fw.files.write_pair(tmp_path / name, fw.simulate.standard_scene(seed=k, bits=8, **SMALL))
    table = tmp_path / "t.json"
    shown = run(
        *("compare", tmp_path / "a", tmp_path / "b", "--method", "fourier,windowed"),
        *("--figure", tmp_path / "maps.png", "--json", table, "--csv", tmp_path / "t.csv"),
    ).stdout
    assert "agreement is not accuracy" in shown
    assert (tmp_path / "maps_1.png").stat().st_size > 10_000
    assert (tmp_path / "maps_2.png").is_file()
    rows = json.loads(table.read_text())["rows"]
    assert [(row["capture"], row["method"]) for row in rows] == [
        *(("a", "fourier"), ("a", "windowed")),
        *(("b", "fourier"), ("b", "windowed")),
    ]
    assert all(row["mean_abs_error_mm"] < 2 for row in rows)
    assert (tmp_path / "t.csv").read_text().startswith("capture,method,unit,against")


def test_two_images_on_the_command_line(tmp_path):
    pair = fw.simulate.standard_scene(bits=8, **SMALL)
    fw.files.write_frame(tmp_path / "plane.png", pair.reference)
    fw.files.write_frame(tmp_path / "cup.png", pair.object)
    images = ("--reference", tmp_path / "plane.png", "--object", tmp_path / "cup.png")
    shown = run("compare", *images, "--method", "fourier,windowed", "--against", "windowed").stdout
    assert "cup, in px\n" in shown
    assert re.search(r"^fourier +100\.0 %", shown, re.MULTILINE)
    assert "differences are from windowed" in shown
    for more, message in (
        (("--noise", "2"), "--noise: it is for artificial scenes"),
        (("--seed", "0"), "--seed: it is for artificial scenes"),
        (("--matrix",), "--matrix: it is for artificial scenes"),
        ((tmp_path,), "either captures, or --reference and --object"),
    ):
        assert message in run("compare", *images, *more, code=2).stderr
    wrong = run("compare", "--against", "windowed", "--size", "100", code=2).stderr
    assert "--against: expected together with pairs of one's own" in wrong
    assert "--reference: expected together" in run("compare", *images[:2], code=2).stderr
