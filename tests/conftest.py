"""Shared scenes, and the folder of real captures."""

from __future__ import annotations

import gc
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fringeworks.files import sample_sets
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import Pair
from tests import shared
from tests.sample_sets import made

collect_ignore = ["drawings/make_block.py"]
"""Makes the drawings, with a package that the tests do not need."""

DATA_VARIABLE = "FRINGEWORKS_DATA"


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real captures; tests that want it skip, visibly, where it is not given."""
    folder = os.environ.get(DATA_VARIABLE)
    if not folder:
        pytest.skip(f"{DATA_VARIABLE} is not set: no real captures")
    path = Path(folder)
    if not path.is_dir():
        pytest.fail(f"{DATA_VARIABLE}={folder} is no folder")
    return path


@pytest.fixture(scope="session", autouse=True)
def _shared_folder(tmp_path_factory):
    """Workers of one run share what they compute, in the folder of temporary files of this run."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared.FOLDER = tmp_path_factory.getbasetemp().parent / "shared"
        shared.FOLDER.mkdir(exist_ok=True)


@pytest.fixture(scope="session")
def _sample_place(tmp_path_factory) -> Path:
    """Folder for the sample data, one for all workers of a run."""
    return shared.FOLDER or tmp_path_factory.mktemp("samples")


@pytest.fixture
def _samples(_sample_place, monkeypatch):
    """``fw.data`` without a network: sets are made when they are asked for, once in a run."""

    def sample_data(name):
        made(name, str(_sample_place))
        return sample_sets.sample_data(name)

    monkeypatch.setenv(sample_sets.VARIABLE, str(_sample_place))
    monkeypatch.setattr("fringeworks.data.sets.sample_data", sample_data)


THOROUGH = Path(__file__).with_name("thorough.txt")
"""Files, tests and cases of tests that take seconds, one a line; ``make thorough`` runs them."""


@pytest.hookimpl(tryfirst=True)
def pytest_itemcollected(item):
    """Marks what costs seconds, before ``-m`` chooses."""
    name = item.nodeid.removeprefix("tests/")
    if not _thorough().isdisjoint({name, name.partition("[")[0], name.partition("::")[0]}):
        item.add_marker("thorough")


@cache
def _thorough() -> frozenset[str]:
    return frozenset(THOROUGH.read_text(encoding="utf-8").split("\n"))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Files with slow tests go first, so that the workers of a run end together."""
    slow = {
        item.path
        for item in items
        if any(item.get_closest_marker(mark) for mark in ("statistical", "system"))
    }
    items.sort(key=lambda item: item.path not in slow)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """What collection has made stays to the end: the garbage collector need not visit it again."""
    gc.collect()
    gc.freeze()


@cache
def _scene(items: tuple[tuple[str, Any], ...]) -> Pair:
    settings = dict(items)
    scene = standard_scene(settings.pop("name"), **settings)
    for array in (scene.reference, scene.object, scene.truth_mm):
        assert array is not None
        array.setflags(write=False)
    return scene


def scene(name: str = "parabola", **settings: Any) -> Pair:
    """A standard scene, made once per set of settings; its arrays are read-only."""
    return _scene(tuple(sorted({"name": name, **settings}.items())))


def true_displacement(capture: Pair) -> np.ndarray:
    """The displacement that a simulated capture holds, px."""
    from fringeworks.pair.reference_plane import displacement_from_height

    assert capture.truth_mm is not None
    assert capture.geometry is not None
    return displacement_from_height(capture.truth_mm, capture.geometry)
