"""Empirical mode decomposition against its oracle, and what denoising removes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import fringeworks as fw
from fringeworks import InputError, reconstruct
from fringeworks.signal.denoise import (
    DENOISERS,
    decompose_frame,
    decompose_rows,
    denoise,
)
from tests.conftest import scene
from tests.oracles.denoise import emd


def rows(n=300, noise=0.3, seed=0):
    rng = np.random.default_rng(seed)
    x = np.arange(n)
    wave = np.cos(0.4 * x + 0.002 * x * np.sin(0.01 * x)) + 3.0 * np.cos(0.05 * x) + 0.01 * x
    return wave + noise * rng.standard_normal((4, n))


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_kernel_agrees_with_its_oracle(noise, seed):
    frame = rows(noise=noise, seed=seed)
    found = decompose_rows(frame, flat=0.1)
    for k, row in enumerate(frame):
        imfs, residue = emd(row, 0.1)
        assert found.counts[k] == len(imfs)
        np.testing.assert_allclose(found.imfs[k, : len(imfs)], imfs, atol=1e-8)
        np.testing.assert_allclose(found.residue[k], residue, atol=1e-8)


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 4), st.integers(1, 60)),
        elements=st.floats(-1e6, 1e6, width=32),
    )
)
def test_any_frame_is_the_sum_of_its_parts(frame):
    for found, axis in ((decompose_rows(frame), 1), (decompose_frame(frame), 0)):
        total = found.imfs.sum(axis=axis) + found.residue
        assert np.abs(total - frame).max() <= 1e-12 * max(np.abs(frame).max(), 1e-300)


def test_imfs_keep_both_criteria():
    found = decompose_rows(rows(), flat=0.1, max_sifts=500)
    assert found.unfinished == 0
    for row, count in zip(found.imfs, found.counts, strict=True):
        for imf in row[:count]:
            steps = np.sign(np.diff(imf))
            turns = np.count_nonzero(np.diff(steps[steps != 0]))
            crossings = np.count_nonzero(np.diff(np.signbit(imf)))
            assert abs(turns - crossings) <= 2  # a mode may touch zero at a sample
    turns = np.count_nonzero(np.diff(np.sign(np.diff(found.residue, axis=1)), axis=1), axis=1)
    assert (turns <= 2).all()


def test_sifting_is_bounded():
    found = decompose_rows(rows(), flat=1e-9, max_sifts=3, max_imfs=2)
    assert found.imfs.shape[1] == 2
    assert found.unfinished > 0


def test_patience_gives_up_the_first_criterion_only():
    strict, quick = (decompose_rows(rows(), patience=p) for p in (100, 0))
    assert strict.unfinished == 0
    assert quick.unfinished > 0
    for found in (strict, quick):
        np.testing.assert_allclose(found.imfs.sum(axis=1) + found.residue, rows(), atol=1e-12)


@pytest.mark.parametrize("method", DENOISERS)
def test_noise_is_removed_and_fringes_are_kept(method):
    clean = scene("parabola", size=300, fringes=5, height_mm=30.0)
    noisy = scene("parabola", size=300, fringes=5, height_mm=30.0, noise=3.0, seed=2)
    before = (noisy.object - clean.object).std()
    assert (denoise(noisy.object, method) - clean.object).std() < 0.75 * before
    np.testing.assert_array_equal(denoise(clean.object, method), clean.object)


@pytest.mark.parametrize("method", DENOISERS)
def test_denoising_reduces_the_error(method):
    capture = scene("parabola", size=300, fringes=5, height_mm=30.0, noise=3.0, bits=8, seed=2)
    errors = []
    for kind in (None, method):
        surface = reconstruct(capture, "exact", denoise=kind).surface
        errors.append(np.nanmean(np.abs(surface.values - capture.truth_mm)))
    assert errors[1] < 0.85 * errors[0]


def test_planar_modes_separate_fine_and_coarse_waves():
    y, x = np.mgrid[:200, :200]
    fine = np.cos(0.9 * x) * np.cos(0.8 * y)
    coarse = 4.0 * np.cos(0.12 * x + 0.05 * y)
    found = decompose_frame(fine + coarse)
    inner = (slice(30, -30), slice(30, -30))
    assert np.corrcoef(found.imfs[0][inner].ravel(), fine[inner].ravel())[0, 1] > 0.95
    rest = found.imfs[1:].sum(axis=0) + found.residue
    assert np.corrcoef(rest[inner].ravel(), coarse[inner].ravel())[0, 1] > 0.98


def test_bad_input():
    for bad, words in (
        (np.ones(5), "expected shape"),
        (np.full((3, 9), np.nan), "finite values"),
        (np.full((3, 9), np.inf), "finite values"),
        (np.ones((3, 9), complex), "real numbers"),
    ):
        for function in (decompose_rows, decompose_frame, denoise):
            with pytest.raises(InputError, match=words):
                function(bad)
    frame = np.ones((3, 9))
    for options in ({"max_imfs": 0}, {"max_sifts": 0}, {"flat": 0.0}, {"patience": -1}):
        with pytest.raises(InputError, match=next(iter(options))):
            decompose_rows(frame, **options)
    with pytest.raises(InputError, match="denoise: expected one of"):
        denoise(frame, "magic")
    with pytest.raises(InputError, match="noise: expected"):
        denoise(frame, noise=-1.0)
    assert denoise(np.ones((20, 1))).shape == (20, 1)


@pytest.mark.parametrize("by_rows", [True, False])
def test_modes_are_drawn(by_rows):
    frame = fw.simulate.standard_scene("parabola", size=48, fringes=6, noise=4, bits=8).object
    split = fw.signal.decompose_rows if by_rows else fw.signal.decompose_frame
    modes = split(frame, max_imfs=2)
    figure = modes.plot("cone")
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["mode 1", "mode 2", "residue"]
    assert "48 × 48 px" in figure.get_suptitle()
