"""Bands of rows."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from fringeworks.signal.bands import BAND_BYTES, by_bands, row_bands


@pytest.mark.parametrize("halo", [0, 1, 9])
@pytest.mark.parametrize(("height", "rows"), [(1, 4), (7, 4), (8, 4), (9, 4), (30, 40)])
def test_bands_are_the_frame_from_top_to_bottom(height, rows, halo):
    bands = list(row_bands((height, 10), BAND_BYTES / (10 * rows), halo=halo))
    index = np.arange(height)
    np.testing.assert_array_equal(np.concatenate([index[b.rows] for b in bands]), index)
    for band in bands:
        np.testing.assert_array_equal(index[band.seen][band.inner], index[band.rows])
        assert band.seen.start == max(0, band.rows.start - halo)
        assert band.seen.stop == min(height, band.rows.stop + halo)


def test_wide_frames_have_bands_of_a_row_and_filters_as_many_as_they_ask_for():
    assert len(list(row_bands((5, 1 << 24), 8.0))) == 5
    assert len(list(row_bands((5, 1 << 24), 8.0, least=3))) == 2


def test_a_filter_with_a_halo_is_that_of_the_whole_frame():
    values = np.random.default_rng(0).standard_normal((60, 20))
    whole = scipy.ndimage.maximum_filter(values, 5)
    parts = [
        scipy.ndimage.maximum_filter(values[band.seen], 5)[band.inner]
        for band in row_bands(values.shape, BAND_BYTES / (20 * 7), halo=2)
    ]
    assert len(parts) > 5
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_a_function_of_pixels_by_bands():
    values = np.random.default_rng(0).standard_normal((60, 20))
    shapes = []

    def double(a, b):
        shapes.append(a.shape)
        return a + b

    found = by_bands(double, values, values, dtype=np.float32, bytes_per_px=BAND_BYTES / 200)
    np.testing.assert_array_equal(found, (2.0 * values).astype(np.float32))
    assert len(shapes) == 6
