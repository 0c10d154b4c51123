"""Heights of form that vary from place to place, in the posterior of likely surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from fringeworks.evaluate.tolerances.likely import _root
from fringeworks.evaluate.tolerances.local_heights import (
    LENGTH,
    _scored,
    local_heights,
    parts_of_heights,
)
from fringeworks.evaluate.tolerances.smooth import smooth

pytestmark = pytest.mark.statistical

SIDE = 9
"""Coefficients along each side of the small spline."""


def small(rng, values=120):
    """Derivatives of values by coefficients, waves, and parts of the local height."""
    design = rng.normal(size=(values, SIDE**2))
    root = _root(SIDE, LENGTH)
    parts = parts_of_heights(root, root)
    return design, np.kron(_root(SIDE, 0.4), _root(SIDE, 0.3)), parts


def test_the_evidence_is_that_of_the_values_themselves():
    """Against the density of the values under their full covariance, noise of variance 1."""
    rng = np.random.default_rng(4)
    design, waves, parts = small(rng)
    at = 0.2 * rng.normal(size=parts.shape[1])
    values = 3.0 * rng.normal(size=len(design))
    own = np.exp(parts @ at)[:, None] * waves
    covariance = np.eye(len(values)) + design @ own @ own.T @ design.T
    density = scipy.stats.multivariate_normal(cov=covariance).logpdf(values)
    noise = scipy.stats.multivariate_normal(cov=np.eye(len(values))).logpdf(values)
    normal, right = design.T @ design, design.T @ values
    found = _scored(waves, normal, right, parts, at)
    assert found.evidence == pytest.approx(density - noise, abs=1e-6)
    for k in range(0, parts.shape[1], 5):
        step = np.zeros(parts.shape[1])
        step[k] = 1e-5
        up, down = (_scored(waves, normal, right, parts, at + s * step) for s in (1.0, -1.0))
        assert found.slope[k] == pytest.approx((up.evidence - down.evidence) / 2e-5, rel=1e-4)


def test_the_information_is_the_scatter_of_the_slope():
    """Values that are drawn from the model itself; 400 draws know a variance to 7 %."""
    rng = np.random.default_rng(5)
    design, waves, parts = small(rng)
    normal, still = design.T @ design, np.zeros(parts.shape[1])
    slopes = []
    for _ in range(400):
        form = waves @ rng.normal(size=waves.shape[1])
        right = design.T @ (design @ form + rng.normal(size=len(design)))
        slopes.append(_scored(waves, normal, right, parts, still).slope)
    stated = _scored(waves, normal, right, parts, still).information
    scatter = np.var(slopes, axis=0) / np.diag(stated)
    assert np.mean(scatter) == pytest.approx(1.0, abs=0.1)
    assert np.abs(scatter - 1.0).max() < 0.35


def test_a_form_that_is_alike_everywhere_pays_for_local_heights():
    """Data of the model with one height: a course of the height explains them no better."""
    rng = np.random.default_rng(6)
    design, waves, parts = small(rng)
    normal, still = design.T @ design, np.zeros(parts.shape[1])
    worse = []
    for _ in range(10):
        form = waves @ rng.normal(size=waves.shape[1])
        right = design.T @ (design @ form + rng.normal(size=len(design)))
        local, price = local_heights(waves, normal, right, parts)
        assert np.log(local).mean() == pytest.approx(0.0, abs=1e-9)
        before = _scored(waves, normal, right, parts, still).evidence
        after = _scored(local[:, None] * waves, normal, right, parts, still).evidence
        worse.append(after + price - before)
    assert np.mean(worse) < -3.0


def dented(rng, noise):
    """A flat area of 40 × 40 values with one dent of depth 0.1 and width 0.12 sides."""
    at = np.linspace(0.0, 1.0, 40)
    places = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    far = np.sum((places - (0.55, 0.4)) ** 2, axis=1)
    true = 0.1 * np.exp(-0.5 * far / 0.12**2)
    return places, true, true + noise * rng.normal(size=len(true))


def test_a_dent_keeps_its_depth():
    """One height for all of the area makes the dent 2.3 σ too shallow on average."""
    noise, bottom, flat = 0.01, [], []
    for seed in range(12):
        rng = np.random.default_rng([seed, 9])
        places, true, values = dented(rng, noise)
        found = smooth(places, values, np.full(len(values), noise**2), stated=True)
        draws = np.array([found.likely.draw(rng).likely for _ in range(20)]).reshape(40, -1)
        deepest, corner = int(np.argmax(true)), len(true) - 1
        scatter = np.std(draws @ found.design(places[[deepest, corner]]).T, axis=0)
        error = found.at(places) - true
        bottom.append(error[deepest] / scatter[0])
        flat.append(error[corner] / scatter[1])
    # Twelve values know a mean to 0.3 σ.
    assert abs(np.mean(bottom)) < 0.9
    assert abs(np.mean(flat)) < 0.9
    assert np.sqrt(np.mean(np.square([*bottom, *flat]))) < 1.5
