"""The accessors and the engine for xarray: the way there and back, parts of data sets, frames."""

from __future__ import annotations

import importlib
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.types import CameraNoise, CoordinateMap, Finding, Provenance, Reason
from tests.surfaces import random_cloud

xr = pytest.importorskip("xarray", reason="xarray is not installed")
pytest.importorskip("fringeworks.xarray")

ROOT = Path(__file__).parent.parent
MADE = Provenance("measure", version="0.1.0")
SEEN = (Finding("noise", "noise of 2 counts"),)


def cloud():
    """Points with all that a cloud can have."""
    found = random_cloud(4)
    map_mm = found.sigma_mm * 0.1
    colour = np.random.default_rng(5).uniform(0, 99, (*found.shape, 3))
    more = {"provenance": MADE, "findings": SEEN, "blur_mm": map_mm, "residual_px": map_mm}
    return replace(found, colour=colour, **more)


def coordinates():
    """Coordinates along both axes, with holes."""
    rng = np.random.default_rng(2)
    maps = []
    for axis in "xy":
        a, b, c, d = rng.uniform(1, 9, (4, 12, 17)).astype(np.float32)
        reason = np.zeros(a.shape, np.uint8)
        reason[3] = Reason.SHADOW
        a[3] = b[3] = np.nan
        phases = rng.random((2, 12, 17)).astype(np.float32)
        more = {"phase_rad": phases, "modulations": phases, "repeats_px": 640.0}
        maps.append(CoordinateMap(a, b, c, d, reason, axis, (16.0, 128.0), **more))
    return fw.Decoded(*maps, CameraNoise(1.5, 0.04), SEEN, provenance=MADE)


@pytest.fixture(scope="module")
def scene():
    return fw.simulate.standard_scene("parabola", size=64, fringes=6, noise=1, bits=8, seed=3)


@pytest.fixture(scope="module")
def heights(scene):
    found = fw.reconstruct(scene, "fourier").surface
    return replace(found, pupil=(30.0, 20.0, 900.0), converged=True)


def same(one, other):
    """All fields of two results are equal."""
    assert type(one) is type(other)
    for name in one.__dataclass_fields__:
        a, b = getattr(one, name), getattr(other, name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=name)
        elif hasattr(a, "__dataclass_fields__") and name != "provenance":
            same(a, b)
        elif name != "details":
            assert a == b, name


def test_results_come_back_as_they_were(heights):
    placed = cloud().transformed(np.eye(4), frame="base", covariance=np.eye(6) * 1e-6)
    for given in (heights, cloud(), placed, coordinates()):
        same(given.to_xarray().fringe.result(), given)


def test_a_part_keeps_its_place_and_scale(heights):
    whole = heights.to_xarray()
    part = whole.isel(row=slice(10, 50), column=slice(4, None)).fringe.result()
    np.testing.assert_array_equal(part.values, heights.values[10:50, 4:])
    assert part.pupil == (26.0, 10.0, 900.0)
    assert part.pitch == heights.pitch
    thinned = whole.isel(row=slice(10, None, 2), column=slice(4, None, 2)).fringe.result()
    assert thinned.pitch == pytest.approx(2.0 * heights.pitch)
    assert thinned.pupil == (13.0, 5.0, 900.0)
    turned = whole.transpose("column", "row").fringe.result()
    np.testing.assert_array_equal(turned.values, heights.values)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda d: d.isel(row=slice(None, None, 2)),
            r"same step of rows and columns, got \[1.0, 2",
        ),
        (lambda d: d.isel(row=[0, 1, 5]), "expected rows in even steps that rise, got others"),
        (lambda d: d.isel(column=slice(None, None, -1)), "columns in even steps that rise"),
        (lambda d: d.isel(row=0), "expected height along row, column, got column"),
        (lambda d: d.drop_vars("sigma"), "expected the variable sigma, got none"),
        (lambda d: d[["sigma", "reason"]], "expected xyz_mm, height, .* got sigma, reason"),
        (lambda d: d.assign(reason=d.reason + 0.5), "expected reason as whole numbers, got others"),
        (lambda d: d.assign_attrs(findings="{"), "expected findings as JSON, got others"),
    ],
)
def test_what_is_no_result_is_refused(heights, change, words):
    with pytest.raises(fw.InputError, match=words):
        change(heights.to_xarray()).fringe.result()


def test_a_data_set_says_what_was_measured():
    given = cloud()
    found = given.to_xarray().fringe
    np.testing.assert_array_equal(found.measured(), given.reason == Reason.OK)
    assert sum(found.reasons().values()) == pytest.approx(1.0)
    assert found.reasons()["ok"] == pytest.approx(float(np.mean(given.reason == Reason.OK)))
    both = coordinates()
    assert both.to_xarray().fringe.measured("y").dims == ("row", "column")
    with pytest.raises(fw.InputError, match="expected reason, got x_reason, y_reason"):
        both.to_xarray().fringe.reasons()


def test_frames_are_decoded_where_they_lie():
    plan = fw.propose(80, 64, 6)[0].plan
    shown = np.stack(list(fw.encode(plan)))
    shown = shown.astype(np.uint8)
    places = {"y": np.linspace(0.0, 1.0, 64), "time": 3.5, "frame": np.arange(len(shown))}
    frames = xr.DataArray(shown, dims=("frame", "y", "x"), coords=places)
    found = frames.fringe.decode(plan)
    alone = fw.decode(shown, plan)
    np.testing.assert_array_equal(found.x_coordinate_px, alone.x.coordinate_px)
    assert found.time.item() == 3.5
    assert found.y.dims == ("row",)
    assert "frame" not in found.coords
    same(found.fringe.result().x, alone.x)
    with pytest.raises(fw.InputError, match=r"expected 3 axes \(frame, row, column\), got 2"):
        frames[0].fringe.decode(plan)


def test_a_pair_and_a_phase_are_measured_where_they_lie(scene):
    frame = xr.DataArray(scene.object, dims=("y", "x"), coords={"x": np.arange(64.0)})
    found = frame.fringe.reconstruct(scene.reference, "fourier", geometry=scene.geometry)
    alone = fw.reconstruct(scene, "fourier", zero="rim")
    np.testing.assert_array_equal(found.height, alone.surface.values)
    assert found.x.units == "mm"  # the place on the plane, not that of the frame
    ramp = xr.DataArray(np.tile(np.linspace(0, 20, 50), (40, 1)), dims=("a", "b"), name="phase")
    whole = xr.apply_ufunc(lambda v: np.angle(np.exp(1j * v)), ramp).fringe.unwrap()
    assert (whole.dims, whole.name, whole.units) == (("a", "b"), "phase", "rad")
    np.testing.assert_allclose(np.diff(whole, axis=1), 20 / 49, atol=1e-5)
    with pytest.raises(fw.InputError, match=r"expected 2 axes \(row, column\), got 1"):
        ramp[0].fringe.unwrap()


def test_xarray_opens_files_of_results(tmp_path, heights):
    entry = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    module, _, name = entry["xarray.backends"]["fringeworks"].partition(":")
    backend = getattr(importlib.import_module(module), name)
    fw.write(tmp_path / "part.npz", heights)
    opened = xr.open_dataset(tmp_path / "part.npz", engine=backend, drop_variables="sigma")
    np.testing.assert_array_equal(opened.height, heights.values)
    assert "sigma" not in opened
    rig = fw.simulate.standard_rig()
    fw.write(tmp_path / "rig.toml", rig)
    with pytest.raises(fw.InputError, match="expected heights, points of pixels or coordinates"):
        xr.open_dataset(tmp_path / "rig.toml", engine=backend)
    assert not backend().guess_can_open(tmp_path / "part.npz")
