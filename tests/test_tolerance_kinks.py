"""Forms that run at an angle to the pixels, and forms with kinks: their surfaces are estimated."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.tolerances.likely import _kinked, _root, _slanted, _smooth
from fringeworks.evaluate.tolerances.measure import prepared
from fringeworks.evaluate.tolerances.skins import skin
from fringeworks.evaluate.tolerances.uncertain import quantified
from tests.tolerance_bodies import Case, cylinder, grid, zone

NOISE = 0.01


def slab(height):
    """A plane of 40 × 40 mm with a form, mm."""
    u, v = grid()
    return np.stack((20.0 * u, 20.0 * v, 500.0 - height), axis=-1)


def found(points, quantity="iso_flatness", seed=5, noise=NOISE, **options):
    one = Case(zone(quantity, **options), {"part": points}, {})
    recipe = one.recipe()
    cloud = one.cloud(np.random.default_rng(seed), noise)

    def of_area(name):
        return area_points(cloud, recipe.areas[name])

    return quantified(*prepared(one.tolerance, recipe, of_area, of_area)), (one, recipe, of_area)


def slanted_ridge(size=0.1, turn=0.6):
    u, v = grid()
    across = np.cos(turn) * u + np.sin(turn) * v
    return size * np.exp(-0.5 * (across / 0.2) ** 2)


def test_a_slanted_ridge_is_known_along_it():
    _, (_, recipe, of_area) = found(slab(slanted_ridge()))
    part = skin(of_area(next(iter(recipe.areas))), "plane")
    posterior = part.unsure[0].likely
    best = np.unravel_index(np.argmax(posterior.weights), posterior.weights.shape)[0]
    # The parts of a ridge are few: of equal lengths, there are three times as many.
    assert posterior.choices[best].waves.shape[1] < 150


def test_a_roof_keeps_its_ridge():
    u, v = grid()
    height = -0.1 * np.abs(0.8 * u + 0.6 * v)
    value = found(slab(height), seed=1)[0]
    # The ridge is highest and two corners are lowest; no tilt makes that less.
    assert abs(value.value - np.ptp(height)) < 2.0 * value.sigma
    assert value.sigma < 0.4 * NOISE


def test_kernels_are_covariances():
    for alike in (_smooth, _kinked):
        root = _root(12, 0.4, alike)
        assert np.allclose((root @ root.T).diagonal(), 1.0, atol=1e-6)
        both = np.kron(root, root)
        turned = _slanted(12, (0.4, 0.4), 0.0, (alike, alike))
        assert np.allclose(both @ both.T, turned @ turned.T, atol=1e-6)


def test_lines_beside_an_edge_are_those_of_the_pixels():
    """A step of a pixel on a cylinder: no spline has it, and roundness must."""
    points = cylinder(np.random.default_rng(3))
    _, v = grid()
    outwards = points - np.array([0.0, 0.0, 510.0])
    outwards[..., 0] = 0.0
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    stepped = points + 0.1 * (v > 0.3)[..., None] * outwards
    one = Case(zone("iso_roundness", body="cylinder"), {"part": stepped}, {})
    recipe = one.recipe()
    cloud = one.cloud(np.random.default_rng(0), 0.0)

    def of_area(name):
        return area_points(cloud, recipe.areas[name])

    value, skins = prepared(one.tolerance, recipe, of_area, of_area)
    assert not skins[0].resolved
    exact = value([np.zeros(len(skins[0].foot))])
    assert exact == pytest.approx(stepped_zone(stepped), rel=0.02)


def stepped_zone(points):
    """Smallest width of the ring of each section, by a second solver."""
    from scipy.optimize import linprog

    widest = 0.0
    for section in np.swapaxes(points[:, ::8], 0, 1):
        away = section[:, 1:] - np.array([0.0, 510.0])
        far = np.linalg.norm(away, axis=1)
        for _ in range(5):
            slopes = np.column_stack((-away / far[:, None], -np.ones(len(far))))
            one = np.ones((len(far), 1))
            rows = np.vstack((np.hstack((slopes, -one)), np.hstack((-slopes, -one))))
            bounds = [(None, None)] * 3 + [(0, None)]
            best = linprog([0, 0, 0, 1], rows, np.append(-far, far), bounds=bounds).x
            away = away - best[:2]
            far = np.linalg.norm(away, axis=1)
        widest = max(widest, float(np.ptp(far)))
    return widest
