"""Whichever package brings OpenCV serves; packages that overwrite each other are named."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from fringeworks import MissingPackage
from fringeworks.types import packages
from fringeworks.types.packages import need_opencv, opencv_conflict


@pytest.fixture
def installed(monkeypatch):
    """Set which distributions of OpenCV are installed."""

    def these(**versions):
        named = {name.replace("_", "-"): version for name, version in versions.items()}
        monkeypatch.setattr(packages, "_version", named.get)

    return these


class Refuses:
    """An import that fails for a reason of the loader, as with libraries of two versions."""

    def find_spec(self, name, *_):
        if name == "cv2":
            raise ImportError("undefined symbol")


@pytest.mark.parametrize("name", packages.OPENCV_PACKAGES)
def test_any_one_package_is_accepted(installed, name):
    installed(**{name.replace("-", "_"): "5.0"})
    need_opencv("a calibration")
    assert opencv_conflict() is None


def test_two_packages_are_named_with_what_to_do(installed):
    installed(opencv_contrib_python="4.12", opencv_python_headless="5.0")
    assert opencv_conflict() == (
        "opencv-python-headless 5.0 and opencv-contrib-python 4.12 are installed and overwrite each "
        "other's module cv2; keep one: pip uninstall opencv-python-headless opencv-contrib-python, "
        "then pip install opencv-contrib-python"
    )


def test_two_packages_that_work_are_no_refusal(installed):
    """Which of them counts is not known, but what is needed is there."""
    installed(opencv_contrib_python="4.12", opencv_python_headless="5.0")
    need_opencv("a calibration")


def test_what_an_uninstalled_package_left_is_named(installed, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", ModuleType("cv2"))
    installed(opencv_contrib_python="4.12")
    with pytest.raises(MissingPackage, match="--force-reinstall --no-deps opencv-contrib-python$"):
        need_opencv("a calibration")
    installed(opencv_contrib_python="4.12", opencv_python_headless="5.0")
    with pytest.raises(MissingPackage, match="a calibration: opencv-python-headless 5.0 and"):
        need_opencv("a calibration")


def test_a_module_that_cannot_be_loaded_is_told_with_its_reason(installed, monkeypatch):
    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Refuses(), *sys.meta_path])
    installed(opencv_python="5.0")
    with pytest.raises(MissingPackage, match="cannot be loaded: undefined symbol"):
        need_opencv("a calibration")
    installed(opencv_python="5.0", opencv_contrib_python="5.0")
    with pytest.raises(MissingPackage, match="overwrite each other"):
        need_opencv("a calibration")
