"""Drawings as STEP and IGES: their faces, and distances from them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.ap242 import DrawnEntities
from fringeworks.files.part21 import face_names, parse_part21
from fringeworks.surface.closest import MeshDistance, sampled
from fringeworks.types import NominalFace
from fringeworks.types.nominal import face_named
from tests.commands import run

DRAWINGS = Path(__file__).parent / "drawings"
KINDS = (
    *("plane", "plane", "cylinder", "plane", "plane", "plane", "plane"),
    *("sphere", "cone", "torus", "cylinder", "plane"),
)
"""Faces of tests/drawings/block.step, in their order; make_block.py wrote it."""
SIGMA_MM = 0.02


@cache
def block() -> fw.TriangleMesh:
    pytest.importorskip("cascadio")
    return fw.read(DRAWINGS / "block.step")


@cache
def measured() -> fw.surface.Points:
    """Points of all faces, with noise across them."""
    rng = np.random.default_rng(5)
    fine = fw.files.read_model(DRAWINGS / "block.step", chord_mm=0.0005)
    points, normals = sampled(MeshDistance(fine), 6000, rng)
    points = points + rng.normal(0, SIGMA_MM, (len(points), 1)) * normals
    return fw.surface.Points(points, np.full(len(points), SIGMA_MM))


def deviated(model) -> fw.evaluate.Deviation:
    return fw.deviation(measured(), model, align=fw.evaluate.KnownPose(np.eye(4)), reach_mm=1.0)


def test_a_step_file_gives_its_faces():
    faces = block().nominal
    assert tuple(face.kind for face in faces) == KINDS
    assert [face.name for face in faces] == [f"F{k}" for k in range(1, 13)]
    assert faces[10].radius_mm == pytest.approx(6.0)
    np.testing.assert_allclose(np.abs(faces[10].axis), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(faces[7].origin_mm, (60, 18, 30), atol=1e-9)
    assert (faces[9].radius_mm, faces[9].tube_mm) == pytest.approx((9.0, 3.0))
    assert faces[8].half_angle_deg == pytest.approx(np.degrees(np.arctan(4 / 15)))
    assert not block().findings
    assert sorted(set(block().face_index)) == list(range(12))


def test_an_iges_file_gives_the_same_faces():
    block()
    found = fw.files.read_model(DRAWINGS / "block.igs")
    assert tuple(face.kind for face in found.nominal) == KINDS
    assert found.nominal[10].radius_mm == pytest.approx(6.0)
    np.testing.assert_allclose(np.ptp(found.vertices_mm, axis=0), (80, 60, 35), atol=1e-4)


def test_the_deviation_from_faces_is_that_from_a_fine_mesh(tmp_path):
    exact = deviated(block())
    fine = fw.files.read_model(DRAWINGS / "block.step", chord_mm=0.0005)
    fw.files.write_mesh(tmp_path / "fine.stl", fine)
    meshed = deviated(fw.files.read_model(tmp_path / "fine.stl"))
    assert np.nanmax(np.abs(exact.distance_mm - meshed.distance_mm)) < 0.1 * SIGMA_MM
    assert set(np.unique(exact.face)) == set(range(13))
    assert meshed.face is None


def test_distances_from_coarse_faces_are_exact():
    """Triangles that lie up to 8 µm off give the distance from the cylinder, to rounding."""
    block()
    coarse = fw.files.read_model(DRAWINGS / "block.step", chord_mm=0.2)
    angle = np.linspace(0, 6, 50)
    ring = 5.9 * np.column_stack((np.cos(angle), np.sin(angle)))
    points = np.column_stack((ring + np.array([58, 46]), np.linspace(4, 14, 50)))
    part = fw.surface.Points(points, None)
    align = fw.evaluate.KnownPose(np.eye(4))
    found = fw.deviation(part, coarse, align=align, reach_mm=1.0)
    np.testing.assert_allclose(found.distance_mm, 0.1, atol=1e-6)
    bare = replace(coarse, face_index=None, nominal=(), chord_mm=None)
    assert np.std(fw.deviation(part, bare, align=align, reach_mm=1.0).distance_mm) > 0.002


@pytest.mark.parametrize(
    ("face", "point", "distance", "gradient"),
    [
        (NominalFace(1, "plane", axis=(1.0, 0, 0)), (3, 4, 5), 3, (1, 0, 0)),
        (NominalFace(1, "sphere", radius_mm=2.0), (0, 3, 4), 3, (0, 0.6, 0.8)),
        (NominalFace(1, "cylinder", radius_mm=2.0), (3, 4, 9), 3, (0.6, 0.8, 0)),
        (
            NominalFace(1, "cone", half_angle_deg=45.0),
            (3, 0, 1),
            2**0.5,
            (0.5**0.5, 0, -(0.5**0.5)),
        ),
        (NominalFace(1, "torus", radius_mm=5.0, tube_mm=1.0), (8, 0, 4), 4, (0.6, 0, 0.8)),
    ],
)
def test_distances_from_nominal_forms(face, point, distance, gradient):
    from fringeworks.surface.nominal import nominal_distance

    found, turned = nominal_distance(face, np.array([point], float))
    assert found[0] == pytest.approx(distance)
    np.testing.assert_allclose(turned[0], gradient, atol=1e-12)


def test_faces_are_found_by_name_and_number():
    faces = (
        NominalFace(1, "plane", "top"),
        NominalFace(2, "plane"),
        NominalFace(3, "plane", "top"),
    )
    assert face_named(faces, 2).number == face_named(faces, "2").number == 2
    with pytest.raises(fw.InputError, match="faces 1, 3; give a number"):
        face_named(faces, "top")
    with pytest.raises(fw.InputError, match="it has top, face 2, top"):
        face_named(faces, "side")
    with pytest.raises(fw.InputError, match=r"a model with faces \(\.step"):
        face_named((), "side")


def test_the_text_of_a_step_file():
    text = (
        "ISO-10303-21;HEADER;ENDSEC;DATA;/* a ; b */\n"
        "#1=CLOSED_SHELL('',(#3,#2));\n#2=ADVANCED_FACE('it''s; here',(#5),#6,.T.);\n"
        "#3=ADVANCED_FACE('\\X2\\00D8\\X0\\ 12',(),#6,.F.);\n"
        "#4=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\nENDSEC;END-ISO-10303-21;"
    )
    entities = parse_part21(text)
    assert face_names(entities) == [(3, "Ø 12"), (2, "it's; here")]
    assert set(entities[4].records) == {"LENGTH_UNIT", "NAMED_UNIT", "SI_UNIT"}
    with pytest.raises(fw.FileProblem, match="ISO 10303-21"):
        parse_part21("solid a")
    with pytest.raises(fw.FileProblem, match="quotes in pairs"):
        parse_part21(text.replace("here'", "here"))
    # Doubled quotes without an end took exponential time.
    assert parse_part21("ISO-10303-21; #1=A('" + 3000 * "''" + " #2=B(') #3=C();")


def test_the_text_counts_the_faces_as_the_model_does():
    """``KINDS`` is what the geometry kernel finds; faces without a name are found by these."""
    entities = parse_part21((DRAWINGS / "block.step").read_text())
    faces = DrawnEntities(entities).faces.values()
    assert tuple(face.kind for face in faces) == KINDS
    assert [face.number for face in faces] == list(range(1, 13))


PMI = """#9001=SHAPE_ASPECT('','',#4,.T.);
#9002=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#9001,#10,#{bore});
#9003=DATUM_FEATURE('','',#4,.T.);
#9004=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#9003,#10,#17);
#9005=DATUM('','',#4,.F.,'A');
#9006=SHAPE_ASPECT_RELATIONSHIP('','',#9003,#9005);
#9007=DATUM_REFERENCE_COMPARTMENT('','',#4,.F.,#9005,$);
#9008=DATUM_SYSTEM('','',#4,.F.,(#9007));
#9009=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.1),#714);
#9010=CYLINDRICITY_TOLERANCE('','',#9009,#9001);
#9011=FLATNESS_TOLERANCE('','',#9009,#9003);
"""
"""Tolerances of the block's bore and first face, after the numbers of its entities."""


@pytest.mark.parametrize("named", [True, False])
def test_a_recipe_of_a_drawing_names_the_faces_of_its_model(tmp_path, named):
    block()
    text = (DRAWINGS / "block.step").read_text()
    bore = re.search(r"#(\d+) = ADVANCED_FACE\('F11'", text)[1]
    text = text.replace("ENDSEC;\nEND-ISO", PMI.replace("{bore}", bore) + "ENDSEC;\nEND-ISO")
    text = text if named else re.sub(r"ADVANCED_FACE\('F\d+'", "ADVANCED_FACE(''", text)
    (tmp_path / "part.step").write_text(text)
    drawn = fw.files.read_tolerances(tmp_path / "part.step")
    assert not drawn.left_out
    fw.files.write_recipe(tmp_path / "recipe.toml", drawn.recipe)
    recipe = fw.files.read_recipe(tmp_path / "recipe.toml")
    model = fw.files.read_model(recipe.model.mesh)
    faces = {
        one.quantity: face_named(model.nominal, recipe.areas[one.areas[0]].face)
        for one in recipe.tolerances
    }
    assert faces["iso_cylindricity"].radius_mm == pytest.approx(6.0)
    assert faces["iso_flatness"].number == 1


def test_damaged_drawings_are_refused(tmp_path):
    block()
    content = (DRAWINGS / "block.step").read_bytes()
    for name, bad in (("empty", b""), ("text", b"x" * 500), ("half", content[: len(content) // 2])):
        path = tmp_path / f"{name}.step"
        path.write_bytes(bad)
        with pytest.raises(fw.FileProblem, match=name):
            fw.files.read_model(path)
    with pytest.raises(fw.InputError, match="chord_mm"):
        fw.files.read_model(DRAWINGS / "block.step", chord_mm=0.0)
    with pytest.raises(fw.InputError, match="expected a drawing"):
        fw.files.read_model("part.stl", chord_mm=0.1)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr("fringeworks.files.cad.util.find_spec", lambda _: None)
    with pytest.raises(
        fw.MissingPackage, match=r"cascadio, got none; pip install 'fringeworks\[cad\]'"
    ):
        fw.files.read_model(DRAWINGS / "block.step")


def steps() -> tuple[fw.PointCloud, fw.TriangleMesh]:
    """Two planes at 500 and 490 mm as a camera sees them, and their model with two faces."""
    rows, columns = np.mgrid[:60, :80].astype(float)
    low = columns < 40
    z = np.where(low, 500.0, 490.0)
    rng = np.random.default_rng(11)
    z += np.where(low, 0.05, 0.0) + rng.normal(0, SIGMA_MM, z.shape)
    ray = np.stack(((columns - 39.5) / 500, (rows - 29.5) / 500, np.ones_like(z)), axis=-1)
    sigma = np.full(z.shape, SIGMA_MM)
    cloud = fw.PointCloud(ray * z[..., None], sigma, sigma, np.zeros(z.shape, np.uint8))
    corners = [
        (x, y, z)
        for z, x0 in ((500.0, -60.0), (490.0, 0.0))
        for x in (x0, x0 + 60)
        for y in (-50.0, 50.0)
    ]
    faces = np.array([(0, 1, 2), (1, 3, 2), (4, 5, 6), (5, 7, 6)], np.uint32)
    nominal = (
        NominalFace(1, "plane", "low", (0, 0, 500), (0, 0, -1)),
        NominalFace(2, "plane", "", (0, 0, 490), (0, 0, -1)),
    )
    index = np.array([0, 0, 1, 1], np.int32)
    model = fw.TriangleMesh(
        np.array(corners), faces, face_index=index, nominal=nominal, chord_mm=0.001
    )
    return cloud, model


def of_faces(model, **areas):
    return fw.Recipe(
        areas={name: fw.evaluate.Area(face=face) for name, face in areas.items()},
        model=fw.evaluate.PartModel(model, fw.evaluate.KnownPose(np.eye(4)), 5.0),
        tolerances=(
            fw.evaluate.PartTolerance("mean", "deviation_mean", ("a",), -0.2, 0.2),
            fw.evaluate.PartTolerance("step", "step_height", ("b", "a"), 10.0, 10.2),
        ),
    )


def test_a_recipe_addresses_faces_by_name_and_number():
    cloud, model = steps()
    found = fw.inspect(cloud, of_faces(model, a="low", b="2"))
    mean, step = found.checks
    assert mean.value == pytest.approx(-0.05, abs=0.01)
    assert step.value == pytest.approx(10.05, abs=0.02)
    assert found.pixels("a")[:, :35].all()
    assert not found.pixels("a")[:, 41:].any()
    assert found.pixels("b")[:, 45:].all()
    with pytest.raises(fw.InputError, match="it has low, face 2"):
        fw.inspect(cloud, of_faces(model, a="low", b="side"))


def test_recipes_with_faces_are_read_and_written(tmp_path):
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    text = 'kind = "recipe"\n[model]\nfile = "part.step"\n[areas.a]\nface = "bore"\n[areas.b]\nface = 3\n'
    (tmp_path / "r.toml").write_text(text)
    recipe = fw.files.read_recipe(tmp_path / "r.toml")
    assert (recipe.areas["a"].face, recipe.areas["b"].face) == ("bore", "3")
    fw.files.write_recipe(tmp_path / "r.toml", recipe)
    assert fw.files.read_recipe(tmp_path / "r.toml") == recipe
    for bad, said in (
        (text.replace("[model]\n", "[model]\nfit = 'a'\n"), "for the alignment"),
        ('within = "a"\n' + text, "within: expected pixels"),
        ('kind = "recipe"\n[areas.a]\nface = 1\n', "with a model"),
    ):
        (tmp_path / "r.toml").write_text(bad)
        with pytest.raises(fw.InputError, match=said):
            fw.files.read_recipe(tmp_path / "r.toml")


def test_the_figures_of_a_deviation_have_a_row_for_each_face():
    cloud, model = steps()
    found = fw.deviation(cloud, model, align=fw.evaluate.KnownPose(np.eye(4)), reach_mm=5.0)
    low, high = found.figures()["faces"]
    assert (low["name"], low["kind"], high["number"]) == ("low", "plane", 2)
    assert low["mean_mm"] == pytest.approx(-0.05, abs=0.01)
    assert high["rms_mm"] == pytest.approx(SIGMA_MM, rel=0.1)
    assert "faces" in fw.report.summarise(found)


def test_the_deviation_of_named_faces_is_that_of_their_points_only():
    """Distances, σ and figures are those of the whole part at points of the faces."""
    cloud, model = steps()
    align = fw.evaluate.KnownPose(np.eye(4))
    whole = fw.deviation(cloud, model, align=align, reach_mm=5.0)
    found = fw.deviation(cloud, model, align=align, reach_mm=5.0, faces=("low", "low"))
    on = whole.face == 1
    np.testing.assert_array_equal(found.reason[on], whole.reason[on])
    assert (found.reason[~on] == fw.Reason.MASKED).all()
    np.testing.assert_array_equal(found.distance_mm[on], whole.distance_mm[on])
    np.testing.assert_array_equal(found.sigma_mm[on], whole.sigma_mm[on])
    assert np.isnan(found.distance_mm[~on]).all()
    assert np.isnan(found.sigma_mm[~on]).all()
    figures = found.figures()
    assert [row["name"] for row in figures["faces"]] == ["low"]
    assert figures["only"] == ["low"]
    assert figures["points"] == np.count_nonzero(on)
    assert figures["share_of_points"] == pytest.approx(on.mean())
    assert figures["mean_mm"] == pytest.approx(float(np.mean(whole.distance_mm[on])), abs=1e-7)
    both = fw.deviation(cloud, model, align=align, reach_mm=5.0, faces=("low", 2))
    assert both.figures()["points"] == np.count_nonzero(whole.face)
    assert both.only == ("low", "face 2")
    with pytest.raises(fw.InputError, match="expected one of the model's, got none; it has low, f"):
        fw.deviation(cloud, model, align=align, faces=("side",))
    with pytest.raises(fw.InputError, match="expected a sequence of names, got the text 'low'"):
        fw.deviation(cloud, model, align=align, faces="low")
    far = fw.surface.Points(np.array([[30.0, 0, 490]]), None)
    with pytest.raises(fw.InputError, match="faces: expected points on low away from"):
        fw.deviation(far, model, align=align, reach_mm=5.0, faces=("low",))
    plain = fw.TriangleMesh(model.vertices_mm, model.faces)
    with pytest.raises(fw.InputError, match="a model with faces"):
        fw.deviation(cloud, plain, align=align, faces=("low",))


def test_the_command_takes_faces(tmp_path):
    """Points of the bore are 0.1 mm inside the material's surface, and those of the ball on it."""
    block()
    angle = np.linspace(0, 6, 60)
    ring = np.column_stack((np.cos(angle), np.sin(angle), np.linspace(-2, 2, 60)))
    bore = np.array([58, 46, 9]) + ring * (5.9, 5.9, 1)
    ball = fw.files.read_model(DRAWINGS / "block.step").nominal[7]
    up = np.array(ball.origin_mm) + ball.radius_mm * np.array([0, 0.6, -0.8])
    fw.write(tmp_path / "part.ply", fw.surface.Points(np.vstack((bore, up[None])), None))
    given = ("deviation", tmp_path / "part.ply", "--model", DRAWINGS / "block.step")
    given += ("--align", "none", "--reach-mm", "1")
    saved, report = tmp_path / "f.json", tmp_path / "r.html"
    done = run(*given, "--face", "F11", "--face", "8", "--json", saved, "--report", report)
    rows = json.loads(saved.read_text())["faces"]
    assert [row["number"] for row in rows] == [8, 11]
    assert [row["mean_mm"] for row in rows] == pytest.approx([0.0, 0.1], abs=1e-5)
    assert "only points of the faces F11, F8" in done.stdout
    assert "F11, F8" in report.read_text()
    bad = run(*given, "--face", "bore", code=2)
    assert "it has F1, F2, F3" in bad.stderr
