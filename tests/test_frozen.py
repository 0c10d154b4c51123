"""Frozen types own their arrays, compare by value, print shortly."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.simulate.standard import standard_rig
from fringeworks.types import fingerprint, sealed, unsealed
from tests.conftest import scene
from tests.stacks import multi, take

PLAN = multi((1, 8), 4, (300, 40))


def results():
    """One of each public type that holds arrays."""
    pair = scene("parabola", size=64, fringes=4)
    reconstruction = fw.reconstruct(pair, "fourier")
    decoded = fw.decode(take(PLAN), PLAN)
    rig = standard_rig(scale=0.1)
    cloud = fw.PointCloud(
        *(np.zeros(s, np.float32) for s in ((4, 5, 3), (4, 5), (4, 5))), np.zeros((4, 5), np.uint8)
    )
    board = fw.rig.parse_board("chessboard:9x7:12")
    response = fw.Response("a", "b", 2.2, 3, 1.0, np.zeros((2, 256)), (100.0, 200.0), 0.01)
    some = [
        pair,
        reconstruction,
        decoded,
        rig,
        cloud,
        board,
        response,
        PLAN,
        fw.propose(640, 480, 9)[0],
    ]
    return [
        *some,
        fw.Stack(list(take(PLAN)), PLAN),
        PLAN.chain("x"),
        fw.files.Source("a.png", "00"),
    ]


@pytest.mark.parametrize("value", results(), ids=lambda v: type(v).__name__)
def test_repr_equality_and_hash(value):
    text = repr(value)
    assert text.startswith(type(value).__name__)
    assert len(text) < 1800
    assert len(text.splitlines()) <= 16
    again = pickle.loads(pickle.dumps(value))
    assert again == value
    assert hash(again) == hash(value)
    assert value != 3
    assert fingerprint(again) == fingerprint(value)


def test_arrays_are_copied_and_read_only():
    frame = np.full((20, 30), 7, np.uint8)
    pair = fw.Pair(frame, frame + 1)
    frame[:] = 0
    assert (pair.reference == 7).all()
    with pytest.raises(ValueError, match="read-only"):
        pair.object[0, 0] = 1
    # What is read-only already is kept: replacing a field copies nothing.
    assert replace(pair, axis="x").object is pair.object
    view = np.zeros((4, 4))[1:]
    assert sealed(view).base.flags.writeable is False
    unsealed(view)[0, 0] = 1


def test_a_view_of_writable_memory_is_copied():
    base = np.zeros((20, 30), np.float32)
    view = base[:]
    view.setflags(write=False)
    pair = fw.Pair(view, view)
    base[:] = 5
    assert not pair.object.any()


def test_a_rig_keeps_its_own_numbers():
    rig = standard_rig(scale=0.1)
    pose = rig.T_projector_camera.copy()
    own = replace(rig, T_projector_camera=pose)
    before = own.baseline_mm
    pose[:3, 3] *= 0.35
    assert own.baseline_mm == before
    with pytest.raises(ValueError, match="read-only"):
        own.T_projector_camera[0, 3] = 0.0


def test_values_count_not_places():
    nan = np.array([[1.0, np.nan]])
    one = fw.HeightMap(nan, nan, np.zeros((1, 2), np.uint8), "height", "mm", 1.0)
    assert one == replace(one, values=nan.copy())
    assert one != replace(one, values=nan + 1)
    assert one != replace(one, values=nan.astype(np.float32))
    assert one != replace(one, pitch=2.0)
    assert fingerprint(one) != fingerprint(replace(one, pitch=2.0))
    big = one.values.astype(">f8")
    assert fingerprint(big) == fingerprint(nan)
