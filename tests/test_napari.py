"""The plug-in of napari: layers of results, its manifest, and the widget where napari is installed."""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

import fringeworks as fw
from fringeworks.napari import layers, widget
from fringeworks.types import CameraNoise, CoordinateMap
from tests.surfaces import height_map, random_cloud

MANIFEST = Path(layers.__file__).with_name("napari.yaml")


class Shown:
    """What the widget needs of a layer."""

    def __init__(self, data, name):
        self.data, self.name = data, name


@pytest.fixture(scope="module")
def frames():
    return fw.simulate.standard_scene("parabola", size=120, fringes=8, noise=1, bits=8, seed=2)


def test_heights_are_images_with_sigma_and_reasons(tmp_path):
    surface = height_map()
    path = str(fw.write(tmp_path / "part.npz", surface))
    values, sigma, reasons = layers.reader_of(path)(path)
    assert [kind for _, _, kind in (values, sigma, reasons)] == ["image", "image", "labels"]
    assert values[1]["name"] == "part height / mm"
    assert values[1]["scale"] == (surface.pitch, surface.pitch)
    np.testing.assert_allclose(values[0], surface.values, rtol=1e-6)
    np.testing.assert_allclose(sigma[0], surface.sigma, rtol=1e-6)
    assert np.array_equal(reasons[0], surface.reason)


def test_points_are_coloured_by_sigma(tmp_path):
    cloud = random_cloud(4)
    path = str(fw.write(tmp_path / "c.npz", cloud))
    points, *_, reasons = layers.reader_of([path])([path])
    measured = cloud.reason == 0
    assert points[2] == "points"
    np.testing.assert_allclose(points[0][:, ::-1], cloud.xyz_mm[measured], rtol=1e-6)
    np.testing.assert_allclose(points[1]["features"]["sigma_mm"], cloud.sigma_mm[measured])
    assert points[1]["face_color"] == "sigma_mm"
    assert np.array_equal(reasons[0], cloud.reason)


def test_many_points_are_thinned(monkeypatch):
    monkeypatch.setattr(layers, "MOST_POINTS", 10)
    made = layers.layers_of(fw.surface.Points(np.eye(3)[np.arange(99) % 3], np.ones(99)))
    assert len(made[0][0]) == len(made[0][1]["features"]["sigma_mm"]) == 10


def test_coordinates():
    flat = np.ones((4, 5), np.float32)
    one = CoordinateMap(flat, flat, flat, flat, np.zeros((4, 5), np.uint8), "x", (8.0,))
    made = layers.layers_of(fw.Decoded(one, None, CameraNoise(1.0)))
    assert [entry[1]["name"] for entry in made] == ["x / px", "σ of x / px", "reasons of x"]


def test_files_of_something_else_are_left_to_others(tmp_path):
    path = tmp_path / "other.npz"
    np.savez(path, a=np.ones(3))
    assert layers.reader_of(str(path)) is None
    assert layers.reader_of(str(tmp_path / "missing.npz")) is None
    with pytest.raises(fw.InputError, match="expected heights, points or coordinates, got dict"):
        layers.layers_of({})


def test_the_manifest_names_what_there_is():
    manifest = yaml.safe_load(MANIFEST.read_text(encoding="utf-8"))
    assert manifest["name"] == "fringeworks"
    for command in manifest["contributions"]["commands"]:
        module, _, name = command["python_name"].partition(":")
        assert callable(getattr(import_module(module), name))


def test_two_layers_are_measured_with_options(frames):
    shown = Shown(frames.reference, "plane"), Shown(frames.object, "cup")
    values, *_ = widget.measured_layers(*shown, "fourier", "")
    assert values[1]["name"] == "cup displacement / px"
    other = widget.measured_layers(*shown, "windowed", "iterations=2")
    assert other[0][0].shape == (120, 120)
    with pytest.raises(fw.InputError, match="reference: expected a layer"):
        widget.measured_layers(None, shown[1], "fourier", "")
    with pytest.raises(fw.InputError, match="iterations=3, paint=False, got 'window:3'"):
        widget.options_of("window:3")
    with pytest.raises(fw.InputError):
        widget.measured_layers(*shown, "fourier", "nothing=3")


# What napari and Qt warn of is theirs.
@pytest.mark.filterwarnings("ignore")
def test_the_widget_in_napari_itself(frames):
    """Qt's platform without a screen has no OpenGL: under xvfb-run this runs."""
    napari = pytest.importorskip("napari")
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        pytest.skip("no screen: run it under xvfb-run")
    viewer = napari.Viewer(show=False)
    plane = viewer.add_image(frames.reference, name="plane")
    cup = viewer.add_image(frames.object, name="cup")
    made = widget.pair_widget()
    viewer.window.add_dock_widget(made)
    made.reference.value, made.object_.value, made.method.value = plane, cup, "fourier"
    found = made()
    assert len(found) == 3
    for layer in found:
        viewer.add_layer(napari.layers.Layer.create(*layer))
    assert json.dumps([layer.name for layer in viewer.layers])
    viewer.close()


def test_without_napari_the_widget_says_so(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "magicgui", None)
    with pytest.raises(fw.MissingPackage, match=r"fringeworks\[napari\]"):
        widget.pair_widget()
