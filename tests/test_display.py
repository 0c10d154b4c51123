"""What the pictures of results say: units, scales, legends, gaps."""

from __future__ import annotations

import importlib
import inspect
import io
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.report import display, kinds
from fringeworks.report.display import plot
from fringeworks.report.kind import KINDS, NOTHING, kind_of
from fringeworks.report.maps import COLOURS, REASON_COLOURS, limits_of
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import Finding, Plotted, Reason, displayed
from tests.rigs import calibrated
from tests.surfaces import heights, plane_cloud

DIVERGING = {"coolwarm"}


@cache
def stack():
    rig = standard_rig(scale=0.25)
    from fringeworks.simulate.standard import bust

    plan = fringe_plan(rig)
    return rig, fw.Stack(list(photograph(look(rig, bust()), plan, Optics(seed=3))), plan)


def calibration():
    return calibrated(4)


@cache
def results():
    pair = fw.reconstruct(fw.simulate.standard_scene("parabola", size=100, fringes=8), "fourier")
    rig, frames = stack()
    decoded = fw.decode(frames)
    phase = fw.stack.wrapped_phase(frames.frames[:4], fw.patterns.equal_steps(4))
    cloud = plane_cloud()
    return {
        "pair": pair,
        "heights": pair.surface,
        "displacement": pair.displacement,
        "decoded": decoded,
        "coordinates": decoded.x,
        "phase": phase,
        "points": cloud,
        "measurement": fw.measure(frames, rig),
        "profile": cloud.profile(((0, 0), (40, 30))),
        "calibration": calibration(),
        "plan": frames.plan,
    }


def panels(figure):
    """Axes that hold a map: those with a title."""
    return [axes for axes in figure.axes if axes.get_title()]


def text_of(figure):
    parts = [figure.get_suptitle(), figure.get_supxlabel()]
    for axes in figure.axes:
        legend = axes.get_legend()
        parts += [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]
        parts += [t.get_text() for t in legend.get_texts()] if legend else []
    return "\n".join(parts)


@pytest.mark.long
def test_every_result_draws_itself_with_units():
    for name, result in results().items():
        figure = result.plot("part 7")
        assert "part 7: " in text_of(figure), name
        assert panels(figure), name
        for axes in panels(figure):
            x, y = axes.get_xlabel(), axes.get_ylabel()
            assert "/ px" in x or "/ mm" in x or "pose" in axes.get_title(), name
            assert "/ px" in y or "/ mm" in y or y == "frame", name
        for bar in (a for a in figure.axes if not a.get_title()):
            assert bar.get_ylabel(), name
        image = np.asarray(Image.open(io.BytesIO(figure._repr_png_())))
        assert image.shape[1] < 2000, name
        assert image.std() > 10, name


def test_sigma_is_sequential_and_differences_only_are_diverging():
    for kind, colours in COLOURS.items():
        assert (colours in DIVERGING) == (kind == "signed")
    for name, result in results().items():
        for axes in panels(result.plot()):
            if "σ" in axes.get_title() and axes.images:
                (picture,) = axes.images
                assert picture.get_cmap().name == COLOURS["sigma"], name
                assert picture.get_clim()[0] == 0.0, name


def test_one_scale_for_a_quantity():
    decoded = results()["decoded"]
    assert decoded.x is not None
    assert decoded.y is not None
    rough = replace(decoded.y, sigma_px=decoded.y.sigma_px * 5)
    figure = replace(decoded, y=rough).plot()
    limits = [a.images[0].get_clim() for a in panels(figure) if "σ" in a.get_title()]
    assert len(limits) == 2
    assert limits[0] == limits[1]


def test_the_legend_lists_reasons_that_occur_only():
    values = np.zeros((10, 10))
    values[0, :5] = np.nan
    text = text_of(heights(values).plot())
    assert "measured\n95.0 %" in text
    assert "shadow\n5.0 %" in text
    assert "saturated" not in text
    assert "hatched: not measured" in text
    whole = text_of(heights(np.zeros((10, 10))).plot())
    assert "shadow" not in whole
    assert "hatched" not in whole
    one = np.zeros((1000, 1000))
    one[0, 0] = np.nan
    assert "shadow\n0.0001 %" in text_of(heights(one).plot())
    assert "99.9999 % measured" in text_of(heights(one).plot())


def test_findings_are_in_the_picture():
    found = (Finding("row method", "the carrier is tilted by 12°"),) * 6
    text = text_of(replace(heights(np.zeros((10, 10))), findings=found).plot())
    assert text.count("the carrier is tilted by 12°") == 4
    assert "not shown here: 2" in text
    measured = results()["measurement"]
    first = measured.decoded.findings[0].seen
    assert first[:40] in text_of(measured.plot())
    calibrated = text_of(calibration().plot())
    assert "4 poses are few" in calibrated
    assert "good for ±" in calibrated


def test_maps_that_hold_nothing_are_drawn():
    for result in (
        heights(np.full((6, 6), np.nan)),
        heights(np.zeros((6, 6))),
        heights(np.ones((1, 3))),
    ):
        assert result.plot()._repr_png_()
    empty = plane_cloud(hole=np.ones((31, 41), bool))
    assert empty.plot()._repr_png_()
    assert empty.profile(((0, 0), (40, 30))).plot()._repr_png_()


def test_a_profile_has_gaps_a_band_and_reasons():
    values = np.tile(np.linspace(0, 3, 40), (3, 1))
    values[:, 10:20] = np.nan
    figure = heights(values).profile(((0, 1), (39, 1))).plot()
    (axes,) = figure.axes
    curve = axes.lines[0].get_ydata()
    assert np.isnan(curve[10:20]).all()
    assert np.isfinite(curve[:10]).all()
    assert "shadow" in text_of(figure)
    assert "±2σ" in text_of(figure)
    (band,) = [c for c in axes.collections if "σ" in c.get_label()]
    reach = np.concatenate([path.vertices[:, 0] for path in band.get_paths()])
    assert not ((reach > 18.5) & (reach < 39.5)).any()
    assert axes.get_xlabel() == "distance along the line / mm"


def test_a_plan_shows_every_frame_along_its_axis():
    steps, code = (
        fw.patterns.PhaseSteps("x", 32.0, fw.patterns.equal_steps(3)),
        fw.patterns.GrayCode("y", 8.0, 48),
    )
    plan = fw.PatternPlan(64, 48, (steps, code, fw.patterns.Uniform("white")))
    across, down = plan.plot().axes
    assert [len(axes.get_yticks()) for axes in (across, down)] == [4, code.frames]
    light = across.images[0].get_array()
    pictures = list(fw.encode(plan))
    assert np.abs(light[0] * 255 - pictures[0][0]).max() < 0.51
    assert (light[3] == 1.0).all()
    assert across.get_yticklabels()[3].get_text() == f"{plan.frames}: white"
    assert np.array_equal(down.images[0].get_array()[0] * 255, pictures[3][:, 0])


def test_depth_grows_downwards():
    (axes,) = plane_cloud().profile(((0, 0), (40, 30))).plot().axes
    low, high = axes.get_ylim()
    assert low > high


def test_every_reason_has_a_colour_of_its_own():
    assert set(REASON_COLOURS) == set(Reason)
    assert len(set(REASON_COLOURS.values())) == len(Reason)


def test_outliers_do_not_flatten_a_map():
    values = np.random.default_rng(0).normal(0, 1, (100, 100))
    values[0, 0] = 1e6
    low, high = limits_of("values", [values])
    assert high < 10
    assert low > -10


def test_only_results_are_drawn_and_pictures_are_figures():
    from matplotlib.figure import Figure

    with pytest.raises(fw.InputError, match="expected a result of fringeworks, got int"):
        plot(3)
    figure = heights(np.zeros((6, 6))).plot()
    assert isinstance(figure, Figure)
    again = pickle.loads(pickle.dumps(figure))
    assert again._repr_png_() == figure._repr_png_()


def test_maps_of_an_overview_have_one_scale_per_line():
    from fringeworks.report.figures import overview

    rng = np.random.default_rng(0)
    one, other = rng.normal(0, 1, (20, 20)), rng.normal(0, 3, (20, 20))
    figure = overview("t", [[("a", one, "height"), ("b", other, "height"), ("c", one, "error")]])
    limits = [axes.images[0].get_clim() for axes in panels(figure)]
    assert limits[0] == limits[1]
    assert limits[2][0] == -limits[2][1]


def test_every_file_of_kinds_describes_the_types_of_files_of_its_name():
    names = {path.stem for path in Path(kinds.__file__).parent.glob("*.py")} - {"__init__"}
    for name in names:
        importlib.import_module(f"fringeworks.report.kinds.{name}")
    described = {of.__module__.rpartition(".")[2] for of in KINDS}
    assert described == names
    assert kind_of(object()) is NOTHING
    drawn = {of for of, one in KINDS.items() if one.picture}
    assert {of for of in subclasses(Plotted) if of.__module__.startswith("fringeworks")} <= drawn


def subclasses(of):
    """Types that results have, which are subclasses of a type and have none themselves."""
    found = [one for child in of.__subclasses__() for one in subclasses(child)]
    return found or [of]


def test_the_module_that_shows_results_has_what_types_expect_of_it():
    for name, expected in vars(displayed.Display).items():
        if inspect.isfunction(expected) and not name.startswith("_"):
            found = list(inspect.signature(getattr(display, name)).parameters)
            assert found == list(inspect.signature(expected).parameters)[1:], name


def test_single_untitled_panels_for_papers(tmp_path):
    scene = fw.simulate.standard_scene("parabola", size=100, fringes=8)
    surface = fw.reconstruct(scene, "fourier").surface
    one = surface.plot("a name", panel="height")
    assert [axes.get_title() for axes in one.axes if axes.images] == ["height"]
    bare = surface.plot("a name", panel="sigma", title=False)
    assert not any(axes.get_title() for axes in bare.axes)
    assert bare._suptitle is None
    labels = [axes.get_ylabel() for axes in bare.axes[0].child_axes]
    assert labels == ["standard deviation σ / mm"]
    for kind in ("pdf", "svg"):
        fw.save_figure(bare, tmp_path / f"p.{kind}")
    content = (tmp_path / "p.pdf").read_bytes()
    assert b"/FontFile2" in content
    assert b"/Type3" not in content
    with pytest.raises(fw.InputError, match="expected one of height, sigma, reasons, got 'albedo'"):
        surface.plot(panel="albedo")


def test_the_command_draws_one_panel(tmp_path, capsys):
    fw.files.write_pair(tmp_path / "pair", fw.simulate.standard_scene("parabola", size=100))
    words = ["reconstruct", str(tmp_path / "pair"), "--panel", "height", "--no-title"]
    assert run([*words, "--figure", str(tmp_path / "p.pdf")]) == 0
    assert (tmp_path / "p.pdf").stat().st_size > 5000
    assert run(words) == 2
    assert "together with --figure" in capsys.readouterr().err
