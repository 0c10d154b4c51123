"""Descriptions of files accept what pydantic accepts, with the same values."""

import copy
import math
import random
import subprocess
import sys
import tomllib
import warnings

import pytest

import fringeworks as fw
from fringeworks.files import description
from fringeworks.files.capture_writer import StackFile
from fringeworks.files.description import DescriptionFault, Field, Section
from fringeworks.files.exposures import ExposuresFile
from fringeworks.files.pair import CaptureFile
from fringeworks.files.plan import PlanFile
from fringeworks.files.recipe import RecipeFile
from fringeworks.files.rig import RigFile, format_rig
from fringeworks.simulate import standard_rig

CONTENT = {
    RigFile: tomllib.loads(format_rig(standard_rig(scale=0.2)))
    | {
        "provenance": {
            "call": "calibrate",
            "version": "1",
            "date": "2026-01-01",
            "options": {"distortion": 5, "names": ["a", "b"]},
            "inputs": [{"name": "a/b.png", "sha256": "0" * 64}],
        },
        "blur": {
            "factors_px2": [1, 0.0, 0.0, 0.0, 0.0, 0.0],
            "middle_mm": 500,
            "depth_mm": [400.0, 600.0],
            "relative_sigma": 0.1,
        },
    },
    PlanFile: {
        "kind": "plan",
        "projector": [640, 480],
        "gamma": 2,
        "mirrored": ["x"],
        "sequence": [
            {"kind": "phase", "axis": "x", "period_px": 16, "steps": 4},
            {"kind": "phase", "axis": "y", "fringes": 3.0, "shifts_deg": [0, 90.0, 180, 270]},
            {"kind": "gray", "axis": "x", "inverted": [0, 2], "inverse": True},
            {"kind": "white"},
        ],
    },
    StackFile: {
        "kind": "stack",
        "frames": ["a.png", "b.png"],
        "devices": {"camera": "left"},
        "settings": {"exposure_ms": 2.5, "region": [0, 0, 640, 480], "averaged": 4},
        "saturation": 250,
    },
    CaptureFile: {
        "kind": "pair",
        "frames": {"reference": "r.png", "object": "o.png", "black": 3},
        "axis": "x",
        "geometry": {"distance_mm": 1000, "baseline_mm": 200.0, "pitch_mm_per_px": 0.3},
    },
    ExposuresFile: {
        "kind": "exposures",
        "exposures": [{"folder": "0", "exposure_ms": 1}, {"folder": "1", "gain_db": -3.0}],
    },
    RecipeFile: {
        "kind": "recipe",
        "model": {"file": "a.stl", "align": "datum-points", "points": [[0, 0, 0, 1, 1, 1]]},
        "areas": {"a": {"box": [0, 0, 9, 9]}, "b": {"polygon": [[0, 0], [9.5, 0], [9, 9]]}},
        "tolerances": [{"name": "flat", "quantity": "flatness", "areas": ["a"], "max": 0.1}],
    },
}
"""A file of each kind, with whole numbers in the place of some floats."""
WRONG = [
    None, True, 0, 1, -1, 2.0, 0.5, math.nan, math.inf, "", "x", "2", "true", "phase", [], [1],
    ["x", "y"], {}, {"file": "a"}, 10**30, 10**399, [[0.0]], "best-fit", [True], [2.0],
]  # fmt: skip
"""What is put in the place of a value."""


def places(content, at=()):
    """Every value within tables and lists."""
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in items:
        yield (*at, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*at, key))


def spoiled(content, draw):
    """A copy with one place of another value, missing, or with an unknown key."""
    found = copy.deepcopy(content)
    *way, last = draw.choice(list(places(found)))
    within = found
    for key in way:
        within = within[key]
    kind = draw.randrange(5)
    if kind == 0:
        del within[last]
    elif kind == 1 and isinstance(within, dict):
        within["unknown"] = 1
    else:
        within[last] = copy.deepcopy(draw.choice(WRONG))
    return found


def by_pydantic(kind, content):
    try:
        found = description._model(kind).model_validate(content)
    except ValueError:
        return None
    with warnings.catch_warnings():
        # It cannot tell the tables of a union by their tag any more; the values are right.
        warnings.filterwarnings("ignore", message="Pydantic serializer warnings")
        return found.model_dump()


def plainly(kind, content):
    """What is accepted without pydantic, or None."""
    try:
        return description._table(kind, content).as_dict()
    except (description._Unfit, OverflowError):
        return None


@pytest.mark.parametrize("kind", CONTENT, ids=lambda kind: kind.__name__)
def test_a_sound_file_needs_no_pydantic(kind):
    content = CONTENT[kind]
    assert plainly(kind, content) == by_pydantic(kind, content)
    assert repr(plainly(kind, content)) == repr(by_pydantic(kind, content))  # 1 is not 1.0


@pytest.mark.parametrize("kind", CONTENT, ids=lambda kind: kind.__name__)
def test_as_pydantic_judges(kind):
    draw = random.Random(kind.__name__)
    seen = {True: 0, False: 0}
    for _ in range(400):
        content = spoiled(CONTENT[kind], draw)
        theirs, mine = by_pydantic(kind, content), plainly(kind, content)
        assert mine is None or repr(mine) == repr(theirs), content
        seen[theirs is not None] += 1
        if theirs is None:
            with pytest.raises(DescriptionFault):
                kind.checked(content)
        else:
            assert repr(kind.checked(content).as_dict()) == repr(theirs), content
    assert min(seen.values()) > 10


def test_sections():
    class Inner(Section):
        a: int = 1

    globals()["Inner"] = Inner

    class Outer(Section):
        inner: "Inner" = Inner()
        b: float | None = Field(default=None, gt=0)

    found = Outer.checked({"b": 2})
    assert found.b == 2.0
    assert found.as_dict() == {"inner": {"a": 1}, "b": 2.0}
    assert found.as_dict(given_only=True) == {"b": 2.0}
    with pytest.raises(AttributeError, match="frozen"):
        found.b = 1.0
    with pytest.raises(DescriptionFault, match="b: Input should be greater than 0, got -1"):
        Outer.checked({"b": -1})
    with pytest.raises(DescriptionFault, match=r"unknown key inner\.c"):
        Outer.checked({"inner": {"c": 1}})
    found = Outer.checked({"b": "2.5", "inner": {"a": 2.0}})
    assert found.as_dict() == Outer(b=2.5, inner=Inner(a=2)).as_dict()


@pytest.mark.system
def test_reading_loads_no_pydantic(tmp_path):
    rig = standard_rig(scale=0.2)
    fw.files.write_rig(tmp_path / "rig.toml", rig)
    script = (
        "import sys; from fringeworks.files.rig import read_rig; read_rig(sys.argv[1]); "
        "print('pydantic' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, tmp_path / "rig.toml"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["False"]
