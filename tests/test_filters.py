"""Filters of images, against NumPy's and SciPy's, and against OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fringeworks import _core
from fringeworks.signal import filters
from tests.oracles import filters as oracle

RNG = np.random.default_rng(7)
SHAPES = [(1, 1), (1, 300), (300, 1), (3, 2), (131, 257), (640, 90)]
BORDERS = {
    "edge": cv2.BORDER_REPLICATE,
    "mirror": cv2.BORDER_REFLECT_101,
    "zero": cv2.BORDER_CONSTANT,
}


def random(shape, kind=np.float32):
    return (100.0 * RNG.standard_normal(shape)).astype(kind)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("kind", "tolerance"), [(np.float32, 4e-5), (np.float64, 1e-10)])
@pytest.mark.parametrize("shape", SHAPES)
def test_box_means(shape, kind, tolerance, border):
    values = random(shape, kind)
    for side in (1, 3, 7, 51, 901):
        found = _core.box_means(values, side=side, border=border)
        assert found.dtype == kind
        np.testing.assert_allclose(
            found, oracle.box_means(values, side, border), rtol=0, atol=tolerance
        )


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("shape", SHAPES)
def test_weighted_sums(shape, border):
    values = random(shape)
    even = np.exp(-0.5 * (np.arange(-40, 41) / 15.0) ** 2)
    even /= even.sum()
    odd = even * np.arange(-40, 41) / 15.0
    for weights_y, weights_x in ((even, even), (even, odd), (odd, [1.0]), ([1.0], [3.0, 2.0, 0.0])):
        for step in (1, 4, 400):
            found = _core.weighted_sums(
                values, weights_y=weights_y, weights_x=weights_x, border=border, step=step
            )
            expected = oracle.weighted_sums(values, weights_y, weights_x, border, step)
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4)


@pytest.mark.parametrize("shape", SHAPES)
def test_medians(shape):
    values = random(shape)
    np.testing.assert_array_equal(_core.median_of_nine(values), oracle.median_of_nine(values))


def test_a_median_with_nan_is_nan():
    values = random((70, 90))
    values[RNG.random(values.shape) < 0.01] = np.nan
    values[0, 0] = values[69, 89] = np.nan
    values[40, :30] = np.inf
    found = _core.median_of_nine(values)
    np.testing.assert_array_equal(found, oracle.median_of_nine(values))


@pytest.mark.parametrize("shape", SHAPES)
def test_widened_marks(shape):
    marks = RNG.random(shape) < 0.01
    for reach in (0, 1, 2, 6, 45, 700):
        found = _core.widen(marks, reach=reach)
        assert found.dtype == bool
        np.testing.assert_array_equal(found, oracle.widen(marks, reach))


def test_opened_marks_are_those_of_opencv():
    marks = RNG.random((200, 150)) < 0.9
    square = np.ones((5, 5), np.uint8)
    expected = cv2.morphologyEx(marks.astype(np.uint8), cv2.MORPH_OPEN, square)
    np.testing.assert_array_equal(filters.opened(marks, 5), expected.astype(bool))


@pytest.mark.parametrize("size", [(131, 257), (65, 128), (50, 257), (3, 2), (1, 1)])
def test_area_means(size):
    values = random((131, 257))
    found = _core.area_means(values, rows=size[0], columns=size[1])
    np.testing.assert_allclose(found, oracle.area_means(values, *size), rtol=0, atol=2e-4)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("shape", SHAPES)
def test_linear_interpolation(shape, kind):
    values = random(shape, kind)
    rows, columns = (RNG.uniform(-3, n + 3, 70) for n in shape)
    rows[:3], columns[:3] = (0.0, shape[0] - 1.0, 1e300), (-1e300, shape[1] - 1.0, 0.5)
    found = _core.interpolate_linear(values, rows=rows, columns=columns)
    assert found.dtype == kind
    expected = oracle.interpolate_linear(values, rows, columns)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 if kind == np.float32 else 1e-10)
    assert np.isnan(
        _core.interpolate_linear(values, rows=np.full(1, np.nan), columns=columns)
    ).all()


def test_filters_agree_with_those_of_opencv():
    """The methods were tuned with OpenCV's filters: sizes, borders and places are the same."""
    values = random((203, 302))
    for border, code in BORDERS.items():
        if border != "zero":
            np.testing.assert_allclose(
                filters.box_mean(values, 13, border),
                cv2.blur(values, (13, 13), borderType=code),
                atol=2e-5,
            )
        np.testing.assert_allclose(
            filters.gaussian(values, 5.0, 15, border),
            cv2.GaussianBlur(values, (31, 31), 5.0, borderType=code),
            atol=5e-5,
        )
    for size in ((67, 100), (50, 75), (203, 302)):
        small = filters.reduced(values, size)
        expected = cv2.resize(values, size[::-1], interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(small, expected, atol=1e-4)
        expected = cv2.resize(small, (302, 203), interpolation=cv2.INTER_LINEAR)
        np.testing.assert_allclose(filters.enlarged(small, (203, 302)), expected, atol=2e-4)
    np.testing.assert_array_equal(filters.median_of_nine(values), cv2.medianBlur(values, 3))


def test_maps_of_any_layout_and_type():
    values = RNG.integers(0, 255, (60, 80)).astype(np.uint8)
    plain = values.astype(np.float64)
    np.testing.assert_array_equal(filters.box_mean(values, 5), filters.box_mean(plain, 5))
    turned = np.asfortranarray(plain)
    np.testing.assert_array_equal(filters.box_mean(turned, 5), filters.box_mean(plain, 5))
    np.testing.assert_array_equal(filters.median_of_nine(turned), filters.median_of_nine(plain))
    np.testing.assert_array_equal(
        filters.widened((turned > 250).T, 2).T, filters.widened(plain > 250, 2)
    )


def test_filters_refuse_what_has_no_meaning():
    values = np.zeros((5, 6), np.float32)
    with pytest.raises(ValueError, match=r"side: expected an odd number below 10\^6, got 4"):
        _core.box_means(values, side=4)
    with pytest.raises(ValueError, match='border: expected "edge", "mirror" or "zero", got "wrap"'):
        _core.box_means(values, side=3, border="wrap")
    with pytest.raises(ValueError, match="weights_x: expected an odd number, got 2"):
        _core.weighted_sums(values, weights_y=[1.0], weights_x=[1.0, 1.0])
    with pytest.raises(ValueError, match="size: expected at least 1 px, at most that of the map"):
        _core.area_means(values, rows=6, columns=6)
    with pytest.raises(ValueError, match="step: expected at least 1 px, got 0"):
        _core.weighted_sums(values, weights_y=[1.0], weights_x=[1.0], step=0)
