"""Preparing a pair: bad frames and masks, carrier, noise and orientation."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, Pair
from fringeworks.pair.carrier import find_carrier
from fringeworks.pair.prepared import prepare
from fringeworks.signal.noise import noise_variance
from tests.conftest import scene


def fringes(period=16.0, shape=(60, 80), axis="x", tilt=0.0):
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    t = (x + tilt * y) if axis == "x" else (y + tilt * x)
    return 100 + 50 * np.cos(2 * np.pi * t / period)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("period", [5.3, 11.7, 16.0, 23.3])
def test_carrier_is_found(axis, period):
    carrier = find_carrier(fringes(period, (120, 150), axis, tilt=0.05))
    assert carrier.axis == axis
    assert carrier.period_px == pytest.approx(period, rel=0.01)
    assert carrier.share > 0.8


def test_carrier_along_the_given_axis_only():
    with pytest.raises(InputError, match="expected fringes along y"):
        find_carrier(fringes(), "y")


@pytest.mark.parametrize(
    "frame",
    [
        np.random.default_rng(0).normal(100, 5, (80, 80)),
        np.add.outer(np.arange(80.0), np.arange(80.0)),
        np.full((80, 80), 7.0),
    ],
    ids=["noise", "ramp", "constant"],
)
def test_no_fringes(frame):
    with pytest.raises(InputError, match="expected fringes"):
        find_carrier(frame)


def test_noise_is_estimated_in_the_presence_of_fringes():
    rng = np.random.default_rng(1)
    frame = fringes(16.0, (300, 300)) + 2.5 * rng.standard_normal((300, 300))
    assert np.sqrt(noise_variance(frame, np.ones(frame.shape, bool))) == pytest.approx(
        2.5, rel=0.03
    )


BAD = {
    "sizes": ((fringes(), fringes(shape=(60, 81))), "frames: expected equal shapes"),
    "black": ((fringes(), np.zeros((60, 80))), "object frame: expected fringes, got an all-black"),
    "black reference": ((np.zeros((60, 80)), fringes()), "reference frame: .*all-black"),
    "constant": (
        (fringes(), np.full((60, 80), 9.0)),
        "object frame: expected fringes, got the constant",
    ),
    "nan": ((fringes(), np.full((60, 80), np.nan)), "object frame: expected finite values"),
    "colour": ((fringes(), np.ones((60, 80, 3))), r"object frame: expected shape \(h, w\)"),
    "complex": ((fringes(), fringes() * 1j), "integer or float"),
    "tiny": ((fringes()[:4, :4], fringes()[:4, :4]), "at least 16 px"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_frames_are_refused(case):
    (reference, object_), message = BAD[case]
    with pytest.raises(InputError, match=message):
        prepare(Pair(reference, object_))


def test_bad_masks_are_refused():
    frame = fringes()
    with pytest.raises(InputError, match="mask: expected shape"):
        prepare(Pair(frame, frame, mask=np.ones((3, 3), bool)))
    with pytest.raises(InputError, match="mask: expected at least one"):
        prepare(Pair(frame, frame, mask=np.zeros(frame.shape, bool)))


@pytest.mark.parametrize(
    ("kind", "held"),
    [
        ("u1", "f4"),
        ("u2", "f4"),
        (">u2", "f4"),
        ("i2", "f4"),
        ("f4", "f4"),
        ("u4", "f8"),
        ("i8", "f8"),
        ("f8", "f8"),
    ],
)
def test_frames_are_held_exactly(kind, held):
    frame = np.rint(fringes()).astype(kind)
    if kind == "f8":
        frame += 1e-9
    if kind == "u4":
        frame += 2**24 + 1
    prepared = prepare(Pair(frame, frame))
    assert prepared.object.dtype == prepared.reference.dtype == held
    np.testing.assert_array_equal(prepared.object, frame.astype(np.float64))


def test_pair_is_turned_and_turned_back():
    pair = scene("parabola", size=100, fringes=5, axis="y")
    prepared = prepare(pair)
    np.testing.assert_array_equal(prepared.reference, pair.reference.T)
    np.testing.assert_array_equal(prepared.to_capture(prepared.object), pair.object)
