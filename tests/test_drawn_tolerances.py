"""Tolerances of STEP AP242 drawings: recipes that name faces, and what is left out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import fringeworks as fw
from tests.commands import run

DRAWINGS = Path(__file__).parent / "drawings"
TAKEN = {
    "Flatness.1": ("iso_flatness", "plane", ("top",), (), 0.05),
    "cylindricity of bore": ("iso_cylindricity", "cylinder", ("bore",), (), 0.02),
    "roundness of face 4": ("iso_roundness", "cylinder", ("face 4",), (), 0.05),
    "straightness of face 4": ("iso_straightness", "cylinder", ("face 4",), (), 0.05),
    "surface profile of wall": ("iso_surface_profile", "plane", ("wall",), (), 0.05),
    "parallelism of top": ("iso_parallelism", "plane", ("top",), ("A",), 0.05),
    "perpendicularity of face 4": (
        "iso_perpendicularity",
        "cylinder",
        ("face 4",),
        ("A", "B"),
        0.05,
    ),
    "coaxiality of face 4": ("iso_coaxiality", "cylinder", ("face 4",), ("B",), 0.05),
    "total runout of face 4": ("iso_total_run_out", "cylinder", ("face 4",), ("B",), 0.05),
}
"""Tolerances of tests/drawings/tolerances.step that a recipe has, with their values in mm."""
LEFT = {
    100: "'whole': it belongs to PRODUCT_DEFINITION_SHAPE, not to faces",
    101: "expected a plane, got a cylinder",
    102: "its value is 0 mm, where one above 0",
    103: "its value #73 is not a length with a unit",
    104: "it names #999, which the file does not have",
    105: "expected 1 face, got 2",
    106: "the direction of its lines is not read",
    107: "it has GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT, which",
    108: "'hole': it has GEOMETRIC_TOLERANCE_WITH_MODIFIERS, which",
    109: "its exact place in the frame of the datums is not read",
    110: "its zone is of a width, which recipes do not have for a cylinder here",
    111: "its datum #59 has modifiers",
    112: "its datum A-B is a cylinder and a plane",
    113: "recipes take no datum for it, got 1",
    114: "it has no value",
    115: "it names #998, which the file does not have",
    116: "its datum A is a plane, where a cylinder is expected",
    117: "expected a cylinder, got a sphere",
    119: "it has PROJECTED_ZONE_DEFINITION, which",
    121: "it belongs to DIMENSIONAL_SIZE, not to faces",
    118: "'diameter': dimensions are not read",
}
"""Those that it does not have, and why."""


def test_tolerances_of_a_drawing_name_its_faces():
    found = fw.files.read_tolerances(DRAWINGS / "tolerances.step")
    taken = {
        one.name: (one.quantity, one.zone.body, one.areas, one.zone.datums, one.high)
        for one in found.recipe.tolerances
    }
    assert taken == {name: (*rest, pytest.approx(value)) for name, (*rest, value) in TAKEN.items()}
    faces = {name: area.face for name, area in found.recipe.areas.items()}
    assert faces == {
        "top": "top", "base": "base", "bore": "bore", "face 4": "4", "wall": "wall"
    }  # fmt: skip
    datums = {name: (one.areas, one.body) for name, one in found.recipe.datums.items()}
    assert datums == {"A": (("base",), "plane"), "B": (("bore",), "cylinder")}


def test_what_a_recipe_does_not_have_is_named_with_its_reason():
    found = fw.files.read_tolerances(DRAWINGS / "tolerances.step").left_out
    told = {int(re.search(r"#(\d+)", one.text)[1]): one.text for one in found}
    assert told.keys() == LEFT.keys()
    for number, why in LEFT.items():
        assert why in told[number]


def test_inches_and_datums_of_older_files():
    recipe = fw.files.read_tolerances(DRAWINGS / "inch.step").recipe
    flat, parallel = recipe.tolerances
    assert flat.high == parallel.high == 0.0508
    assert recipe.areas["face 2"].face == "2"
    assert recipe.datums["A"].areas == ("face 1",)


def test_a_drawing_without_tolerances_gives_none():
    found = fw.files.read_tolerances(DRAWINGS / "block.step")
    assert (found.recipe.tolerances, dict(found.recipe.areas), found.left_out) == ((), {}, ())


def test_damaged_files_are_refused_or_lose_what_is_damaged(tmp_path):
    text = (DRAWINGS / "tolerances.step").read_text()
    path = tmp_path / "bad.step"
    for cut in range(0, len(text) - 20, 301):
        path.write_text(text[:cut])
        with pytest.raises(fw.FileProblem, match=r"bad\.step"):
            fw.files.read_tolerances(path)
    path.write_text(text.replace("#2=(LENGTH", "#2=(LENGHT").replace("#4=(CONV", "#4=(C"))
    found = fw.files.read_tolerances(path)
    assert "cylindricity #81: its unit #2 is not one of length" in {f.text for f in found.left_out}
    path.write_text(
        text.replace("#2=", "#2=(LENGTH_UNIT() CONVERSION_BASED_UNIT('X',#71));\n#200=")
    )
    found = fw.files.read_tolerances(path)
    assert any("cylindricity #81: its unit #2" in f.text for f in found.left_out)
    path.write_text(
        text.replace("(#33,#38)", "(#33,#38)").replace(
            "#43=", "#143=SHAPE_ASPECT_RELATIONSHIP('','',#33,#33);\n#43="
        )
    )
    assert len(fw.files.read_tolerances(path).recipe.tolerances) == len(TAKEN)
    with pytest.raises(fw.InputError, match=r"expected \.step or \.stp, got part\.igs"):
        fw.files.read_tolerances("part.igs")


def test_the_name_of_one_face_is_not_the_number_of_another(tmp_path):
    text = (DRAWINGS / "tolerances.step").read_text()
    path = tmp_path / "names.step"
    for word in ("4", "face 4"):
        path.write_text(text.replace("'ball'", f"'{word}'"))
        left = [one.text for one in fw.files.read_tolerances(path).left_out]
        assert "roundness #82: face 4 has no name, and another face is called so" in left
    path.write_text(text.replace("'base'", "'top'"))
    left = [one.text for one in fw.files.read_tolerances(path).left_out]
    assert "flatness #80 'Flatness.1': several faces have the name 'top'" in left


def test_the_command_begins_a_recipe(tmp_path):
    (tmp_path / "part.step").write_text((DRAWINGS / "tolerances.step").read_text())
    out = tmp_path / "recipe.toml"
    done = run("recipe", tmp_path / "part.step", "--out", out)
    for name, line in (("coaxiality of face 4", "B"), ("hole", "MODIFIERS"), ("#118", "dimension")):
        assert re.search(f"{name}.*{line}", done.stdout)
    written = fw.files.read_recipe(out)
    assert {one.name for one in written.tolerances} == TAKEN.keys()
    assert written.model.mesh == tmp_path / "part.step"
    (tmp_path / "block.step").write_bytes((DRAWINGS / "block.step").read_bytes())
    assert "has no tolerance" in run("recipe", tmp_path / "block.step", "--out", out).stdout
