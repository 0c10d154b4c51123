"""Tolerances of QIF 3 documents: recipes that name faces of a drawing, and what is left out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import fringeworks as fw
from tests.commands import run
from tests.qif_documents import LEFT, MM, TAKEN, document

DRAWING = Path(__file__).parent / "drawings" / "tolerances.step"


@pytest.fixture
def write(tmp_path):
    (tmp_path / "part.step").write_text(DRAWING.read_text())

    def written(text, encoding="utf-8"):
        path = tmp_path / "part.qif"
        path.write_text(text, encoding=encoding)
        return path

    return written


def read(path):
    return fw.files.read_tolerances(path, model=path.with_name("part.step"))


def test_characteristics_name_faces_of_the_drawing(write):
    found = read(write(document(TAKEN)))
    assert found.left_out == ()
    taken = [
        (one.quantity, one.zone.body, one.areas, one.zone.datums, one.high)
        for one in found.recipe.tolerances
    ]
    assert taken == [(*rest, pytest.approx(value)) for *rest, value in TAKEN.values()]
    assert found.recipe.areas["bore"].face == "bore"
    assert found.recipe.datums["A"].areas == ("base",)
    assert found.recipe.model.mesh.name == "part.step"


def test_what_a_recipe_does_not_have_is_named_with_its_reason(write):
    found = read(write(document(LEFT)))
    assert not found.recipe.tolerances
    for one, why in zip(found.left_out, LEFT.values(), strict=True):
        assert why in one.text


def test_a_definition_without_a_nominal_is_named(write):
    text = document({("Flatness", 41, MM): ()})
    text = re.sub("<CharacteristicNominals.*</CharacteristicNominals>", "", text)
    (left,) = read(write(text)).left_out
    assert left.text == "flatness #100: no nominal connects it with features"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"<UnitName>mm": "<UnitName>inch"}, "has a conversion that is not its own"),
        ({"<UnitName>mm": "<UnitName>line", "<Factor>0.001": "<Factor>"}, "'line' is not known"),
        ({"meter</SIUnitName>\n    <UnitName>mm": "kelvin</SIUnitName><UnitName>mm"}, "of length"),
    ],
)
def test_a_unit_that_is_not_clear_leaves_values_out(write, change, said):
    text = document({("Flatness", 41, MM): ()})
    for old, new in change.items():
        text = text.replace(old, new, 1)
    (left,) = read(write(text)).left_out
    assert said in left.text


BOMB = f'<!DOCTYPE QIFDocument [<!ENTITY a "{"ha" * 99}"><!ENTITY b "{"&a;" * 99}">]>'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(
    "kind",
    [BOMB, '<!DOCTYPE QIFDocument SYSTEM "file:///etc/passwd">', "<!DOCTYPE QIFDocument>"],
)
def test_documents_with_entities_are_refused(write, kind, encoding):
    """In every encoding: UTF-16 hides the words from a search for bytes."""
    text = document(TAKEN).replace('<?xml version="1.0" encoding="UTF-8"?>', kind)
    with pytest.raises(fw.FileProblem, match="without a document type and entities"):
        read(write(text, encoding))


def test_damaged_and_other_documents_are_refused(write):
    text = document(TAKEN)
    for cut in range(0, len(text) - 20, 307):
        with pytest.raises(fw.FileProblem, match=r"part\.qif"):
            read(write(text[:cut]))
    with pytest.raises(fw.FileProblem, match=r"expected QIF 3, got version 2\.1"):
        read(write(text.replace('versionQIF="3.0.0"', 'versionQIF="2.1"')))
    with pytest.raises(fw.FileProblem, match="expected a QIFDocument"):
        read(write(text.replace("xsd/qif3", "xsd/qif2")))
    with pytest.raises(fw.FileProblem, match="at most 100 deep"):
        read(write(text.replace("<Product>", "<Product>" + "<A>" * 200)))
    path = write(text)
    with pytest.raises(fw.InputError, match=r"expected the drawing whose faces part\.qif names"):
        fw.files.read_tolerances(path)
    with pytest.raises(fw.InputError, match="expected none beside a drawing"):
        fw.files.read_tolerances(path.with_name("part.step"), model=path)


def test_the_command_begins_a_recipe(write):
    path = write(document(TAKEN | LEFT))
    out = path.with_name("recipe.toml")
    done = run("recipe", path, "--model", path.with_name("part.step"), "--out", out)
    assert "dimensions are not read" in done.stdout
    written = fw.files.read_recipe(out)
    assert len(written.tolerances) == len(TAKEN)
    assert written.model.mesh == path.with_name("part.step")
