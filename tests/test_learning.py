"""The trials of *Learn*: the response is left as it is where this is asked for."""

from __future__ import annotations

from types import SimpleNamespace

from fringeworks.studio.learning import learn, straightens


def test_row_methods_straighten_the_response_by_default():
    assert [
        name for name in ("windowed", "fourier", "ifa", "sifa", "gsifa") if straightens(name)
    ] == [
        "ifa",
        "sifa",
        "gsifa",
    ]


def test_a_response_that_is_left_as_it_is_costs_accuracy(tmp_path):
    link = SimpleNamespace(progress=lambda *_: None)
    settings = {"gamma": 2.2, "noise": 0.0, "fringes": 20, "height_mm": 50.0, "painted": False}
    curved, straight = (
        learn(
            link,
            "two frames, ideal",
            "parabola",
            "sifa",
            {**settings, "straighten": wanted},
            str(tmp_path / "surface"),
        )
        for wanted in (False, True)
    )
    assert curved["mean"] > 2 * straight["mean"]
