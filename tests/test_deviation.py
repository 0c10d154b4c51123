"""A part of the virtual rig against its model: distances, their σ, dents, recipes, the command."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate.inspect import judge_deviation
from fringeworks.evaluate.quantities import area_deviation, deviation_mean
from fringeworks.rig.pinhole import inverse, transform
from fringeworks.surface.closest import MeshDistance
from fringeworks.views.poses import carried, twist
from tests import parts

pytestmark = pytest.mark.statistical

TURNS = ((6.0, -5.0, 12.0), (-8.0, 3.0, 70.0), (2.0, 12.0, -30.0))
"""Rotations of the part before the camera, degrees."""


@cache
def seen(seed=0, dent=parts.DENT_MM[0]):
    """The cloud that a calibrated rig makes of the part, its true pose, and that rig."""
    used = parts.drawn(seed)
    cloud, T = parts.measured(used, dent=dent, seed=seed, turn_deg=TURNS[seed % 3])
    return cloud, T, used


@cache
def deviated(seed=0, dent=parts.DENT_MM[0]):
    """Its deviation, aligned from a start that is off by some mm and degrees."""
    cloud, T, used = seen(seed, dent)
    off = parts.placed((2.0, -1.0, 3.0)) @ inverse(parts.placed())
    return fw.deviation(
        cloud, parts.model(), align=fw.evaluate.BestFit(start=inverse(T) @ off), rig=used
    )


def flat(found):
    """Points of the part away from the dent."""
    away = np.linalg.norm(found.points_mm[..., :2] - parts.PLACE_MM, axis=-1) > 3.0
    return (found.reason == fw.Reason.OK) & away


LONG = [pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 9)]


@pytest.mark.parametrize("seed", [0, *LONG])
def test_a_dent_is_found_at_its_place_with_its_depth(seed):
    spots = fw.evaluate.find_spots(deviated(seed))
    dents = [s for s in spots if np.linalg.norm(s.place_mm[:2] - parts.PLACE_MM) < 0.5]
    assert len(dents) == 1
    dent = dents[0]
    assert abs(dent.depth_mm + parts.DENT_MM[0]) < 2.0 * dent.sigma_mm
    assert dent.sigma_mm < 0.02
    assert abs(dent.place_mm[2] - 10.0) < 0.1
    # The paraboloid of 0.1 mm has an area of 12.6 mm²; its rim is below the noise.
    assert 3.0 < dent.area_mm2 < 14.0


@pytest.mark.parametrize("seed", [0, *LONG])
def test_sigma_covers_the_distances_of_a_part_without_a_dent(seed):
    """Each seed is another noise, another calibration, and one of three poses."""
    found = deviated(seed)
    ok = flat(found)
    off = np.abs(found.distance_mm[ok]) / found.sigma_mm[ok]
    assert 0.60 <= np.mean(off < 1.0) <= 0.80
    assert 0.90 <= np.mean(off < 2.0) <= 0.98
    assert found.alignment.converged
    assert found.alignment.slides == 0


@pytest.mark.long
def test_the_pose_is_off_by_what_its_covariance_says():
    squares = []
    for seed in range(9):
        _, T, _ = seen(seed)
        alignment = deviated(seed).alignment
        middle = np.eye(4)
        middle[:3, 3] = -np.array([40.0, 30.0, 10.0])
        e = twist(middle @ alignment.T_model_part @ T @ inverse(middle))
        C = carried(middle, alignment.covariance)
        squares.append(float(e @ np.linalg.solve(C, e)) / 6.0)
    assert 0.2 < np.mean(squares) < 3.0


@pytest.mark.long
def test_a_part_that_is_turned_by_40_degrees_needs_no_start():
    cloud, T, used = seen()
    known = deviated()
    turned = parts.placed((0.0, 0.0, 40.0)) @ inverse(parts.placed())
    model = parts.model()
    other = replace(
        model, vertices_mm=transform(inverse(T) @ turned @ T, np.asarray(model.vertices_mm))
    )
    found = fw.deviation(cloud, other, rig=used)
    assert not found.alignment.findings
    np.testing.assert_allclose(
        found.distance_mm, known.distance_mm, atol=0.2 * np.nanmedian(known.sigma_mm)
    )


def test_a_known_pose_keeps_all_errors_of_the_calibration():
    cloud, T, used = seen()
    found = fw.deviation(cloud, parts.model(), align=fw.evaluate.KnownPose(inverse(T)), rig=used)
    assert np.nanmedian(found.sigma_mm) > np.nanmedian(deviated().sigma_mm)
    assert found.mean_sigma_mm > 5.0 * deviated().mean_sigma_mm
    assert abs(found.figures()["mean_mm"]) < 3.0 * found.mean_sigma_mm


def test_without_a_rig_sigma_is_larger_and_that_is_said():
    cloud, T, _ = seen()
    found = fw.deviation(cloud, parts.model(), align=fw.evaluate.BestFit(start=inverse(T)))
    assert np.nanmedian(found.sigma_mm) > np.nanmedian(deviated().sigma_mm)
    assert any("no rig" in note for note in found.notes)


def areas():
    """Areas of the frame by where their points lie on the model."""
    p = deviated().points_mm
    x, y, z = np.moveaxis(np.nan_to_num(p), -1, 0)
    return {
        "top": fw.evaluate.Area(mask=(np.abs(x - 16) < 8) & (np.abs(y - 44) < 8) & (z > 15)),
        "base": fw.evaluate.Area(
            mask=(x > 42) & (x < 52) & (y > 5) & (y < 24) & (np.abs(z - 10) < 1)
        ),
        "dent": fw.evaluate.Area(mask=np.linalg.norm(p[..., :2] - parts.PLACE_MM, axis=-1) < 4.0),
    }


def test_a_recipe_judges_the_deviation(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    del trimesh
    cloud, T, used = seen()
    fw.files.write_mesh(tmp_path / "part.stl", parts.model())
    fw.files.write_rig(tmp_path / "rig.toml", used)
    on_part = np.array([[0, 0, 10], [80, 0, 10], [80, 60, 10.0]])
    start = fw.evaluate.DatumPoints(np.round(transform(T, on_part), 1), on_part)
    recipe = fw.Recipe(
        rig=tmp_path / "rig.toml",
        areas=areas(),
        model=fw.evaluate.PartModel(tmp_path / "part.stl", fw.evaluate.BestFit(start=start)),
        tolerances=(
            fw.evaluate.PartTolerance("mean", "deviation_mean", ("top",), -0.03, 0.03),
            fw.evaluate.PartTolerance("rms", "deviation_rms", ("base",), None, 0.05),
            fw.evaluate.PartTolerance("dent", "deviation_max", ("dent",), None, 0.02),
            fw.evaluate.PartTolerance("good", "deviation_max", ("base",), None, 0.2),
        ),
    )
    fw.files.write_recipe(tmp_path / "recipe.toml", recipe)
    assert fw.files.read_recipe(tmp_path / "recipe.toml") == recipe
    checks = fw.evaluate.judge_part(cloud, fw.files.read_recipe(tmp_path / "recipe.toml"))
    assert [check.verdict for check in checks] == ["pass", "pass", "fail", "pass"]
    assert checks[2].value == pytest.approx(0.1, abs=0.06)
    heights = fw.HeightMap(cloud.xyz_mm[..., 2], cloud.sigma_mm, cloud.reason, "height", "mm", 0.3)
    assert fw.evaluate.judge_part(heights, recipe)[0].verdict == "undecided"
    near = replace(
        recipe, model=replace(recipe.model, reach_mm=0.02, align=fw.evaluate.KnownPose(np.eye(4)))
    )
    assert all(check.verdict == "undecided" for check in fw.evaluate.judge_part(cloud, near))


def test_the_mean_of_an_area_is_within_its_sigma():
    _, _, used = seen()
    for name in ("top", "base"):
        one = deviation_mean(area_deviation(deviated(), areas()[name], used))
        assert abs(one.value) < 3.5 * one.sigma
        assert 0.0 < one.sigma < 0.02


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[model]\nfile = "none.stl"', "no such file"),
        ('[model]\nfile = "../a.stl"', "outside"),
        ('[model]\nfile = "a.stl"\nalign = "datum-points"', "missing key model.datum-points.points"),
        ('[model]\nfile = "a.stl"\nalign = "datum-planes"', "missing key model.datum-planes.planes"),
        ('[model]\nfile = "a.stl"\nfit = "b"', "areas"),
        ('[model]\nfile = "a.stl"\nalign = "none"\npoints = [[0,0,0,0,0,0],[1,0,0,1,0,0],[0,1,0,0,1,0]]',
         "unknown key model.none.points"),
        ('[model]\nfile = "a.stl"\nalign = "best"', "model: expected align = best-fit"),
        ('[model]\nfile = "a.stl"\nreach_mm = -1', "reach"),
        ('[areas.a]\nbox=[0,0,5,5]\n[[tolerances]]\nname = "t"\nquantity = "deviation_max"\n'
         'areas = ["a"]\nmax = 1', "with a model"),
    ],
)  # fmt: skip
def test_models_of_recipes_that_cannot_be_used(tmp_path, text, said):
    (tmp_path / "a.stl").write_text("solid")
    (tmp_path / "r.toml").write_text(f'kind = "recipe"\n{text}')
    with pytest.raises(fw.InputError, match=said):
        fw.files.read_recipe(tmp_path / "r.toml")


def test_the_command_writes_picture_report_and_figures(tmp_path, capsys):
    pytest.importorskip("trimesh")
    cloud, T, used = seen()
    fw.files.write_points(tmp_path / "part.npz", cloud)
    fw.files.write_mesh(tmp_path / "part.stl", parts.model())
    fw.files.write_rig(tmp_path / "rig.toml", used)
    on_part = np.array([[0, 0, 10], [80, 0, 10], [80, 60, 10.0]])
    pairs = np.hstack((np.round(transform(T, on_part), 1), on_part))
    words = ["deviation", str(tmp_path / "part.npz"), "--model", str(tmp_path / "part.stl")]
    words += ["--rig", str(tmp_path / "rig.toml"), "--tolerance-mm", "0.05"]
    for pair in pairs:
        words += ["--datum-point", ":".join(f"{v:g}" for v in pair)]
    for name in ("figure d.png", "report d.html", "json d.json"):
        option, file = name.split()
        words += [f"--{option}", str(tmp_path / file)]
    assert run(words) == 3
    said = capsys.readouterr().out
    assert "outside the tolerance" in said
    assert "fail: a dent of 0." in said
    assert re.search(r"−0\.(09|10)", said)
    figures = json.loads((tmp_path / "d.json").read_text())
    assert figures["alignment"]["converged"] is True
    assert 0.6 < figures["within_1_sigma"] < 0.8
    assert figures["outside_share"] > figures["surely_outside_share"] > 0.0
    assert "Dents and bumps" in (tmp_path / "d.html").read_text()
    assert (tmp_path / "d.png").stat().st_size > 10_000
    assert run([*words[:4], "--align", "none", "--datum-point", "1:2:3:4:5:6"]) == 2
    assert "cannot be combined" in capsys.readouterr().err
    assert run([*words[:4], "--align", "datum-points", "--datum-point", "1:2:3"]) == 2
    assert "6 numbers" in capsys.readouterr().err


def test_points_and_meshes_are_compared_as_well():
    cloud, T, _ = seen()
    mesh = fw.surface.cloud_mesh(cloud)
    align = fw.evaluate.BestFit(start=inverse(T))
    found = fw.deviation(mesh, parts.model(), align=align)
    assert found.distance_mm.shape == (len(mesh.vertices_mm),)
    assert np.median(np.abs(found.measured)) < 0.03
    bare = fw.surface.Points(np.asarray(cloud.xyz_mm[cloud.reason == 0], float), None)
    plain = fw.deviation(bare, parts.model(), align=align)
    assert np.isnan(plain.sigma_mm).all()
    assert plain.figures()["within_1_sigma"] is None
    assert any("no σ" in note for note in plain.notes)
    with pytest.raises(fw.InputError, match="with σ"):
        fw.evaluate.find_spots(plain)
    titles = [axes.get_title() for axes in plain.plot().axes if axes.get_title()]
    assert [title.partition(";")[0] for title in titles] == ["deviation, positive outside"]
    assert fw.report.summarise(found)["alignment"]["by"] == "best fit"


def test_figures_are_those_of_the_distances():
    plate = fw.TriangleMesh(
        np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    z = np.array([0.3, -0.1, 0.1, -0.1])
    xyz = np.column_stack((np.full(4, 4.0), np.arange(4) + 2.0, z))
    points = fw.surface.Points(xyz, np.full(4, 0.1), np.full(4, 0.1))
    found = fw.deviation(points, plate, align=fw.evaluate.KnownPose(np.eye(4)), reach_mm=0.25)
    assert found.reason.tolist() == [fw.Reason.OUTSIDE, 0, 0, 0]
    figures = found.figures(0.05)
    assert figures["points"] == 3
    assert figures["share_of_points"] == 0.75
    assert figures["mean_mm"] == pytest.approx(-0.1 / 3)
    assert figures["mean_sigma_mm"] == pytest.approx(0.1 / np.sqrt(3))
    assert (figures["outside_share"], figures["surely_outside_share"]) == (1.0, 0.0)
    with pytest.raises(fw.InputError, match="tolerance"):
        found.figures(0.0)
    assert MeshDistance(plate).nearest(xyz, 1.0).distance_mm[0] == pytest.approx(0.3)


def test_a_tolerance_is_judged_and_sets_the_scale(tmp_path):
    """A dent of 0.1 mm breaks ±0.05 mm, keeps ±0.5 mm, and is flagged; outliers stretch no map."""
    cloud, T, used = seen()
    align = fw.evaluate.BestFit(start=inverse(T))
    tight = fw.deviation(cloud, parts.model(), align=align, rig=used, tolerance_mm=0.05)
    wide = replace(tight, tolerance_mm=0.9)
    check = judge_deviation(tight, used)
    assert check.verdict == "fail"
    assert check.why.startswith("a dent of 0.")
    assert judge_deviation(wide, used).verdict == "pass"
    assert judge_deviation(replace(tight, tolerance_mm=None), used) is None
    far = tight.distance_mm.copy()
    far[np.nonzero(tight.reason == 0)[0][0], np.nonzero(tight.reason == 0)[1][0]] = 40.0
    free = replace(tight, distance_mm=far, tolerance_mm=None)
    for found, end in ((tight, 0.05), (free, None)):
        axes = found.plot("part").axes[0]
        low, high = axes.images[0].get_clim()
        assert low == -high
        assert high == (end or pytest.approx(0.08, rel=0.4))
        assert "beyond" in axes.get_title()
        # Cropped to the part, which fills an eighth of the frame.
        assert abs(np.diff(axes.get_xlim())[0]) < 0.6 * cloud.shape[1]
    fw.write_report(tmp_path / "d.html", {"part": tight}, rig=used)
    page = (tmp_path / "d.html").read_text("utf-8")
    assert '<p class="verdict fail">FAIL: the tolerance is not kept.</p>' in page
    packed = re.search(r"x-fringeworks-surface\">([^<]*)<", page)[1]
    data = base64.b64decode(packed)
    size = int.from_bytes(data[8:12], "little")
    header = json.loads(data[12 : 12 + size])
    assert header["first"] == "deviation"
    (layer,) = (one for one in header["layers"] if one["name"] == "deviation")
    assert layer["range"] == [-0.05, 0.05]
    assert header["model"]["faces"][2] == 12 * len(parts.model().faces)
    ((pixel, text),) = header["flags"]
    assert re.fullmatch(r"−0\.(09|10)\d* mm", text)
    row, column = divmod(pixel, cloud.shape[1])
    assert np.linalg.norm(tight.points_mm[row, column, :2] - parts.PLACE_MM) < 1.0
