"""Poses of all views at once: equal to SciPy's least squares, and a table that contradicts itself."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks.rig.pinhole import inverse
from fringeworks.types import InputError
from fringeworks.views.pose_graph import _Term, solve_poses
from fringeworks.views.poses import ViewPose, from_twist
from fringeworks.views.registration import Registration
from tests.oracles.pose_graph import loss, settled_poses

NOISE = np.diag([1e-4, 2e-4, 1e-4, 0.01, 0.02, 0.03]) ** 2
COMMON = np.diag([1e-4, 1e-4, 2e-4, 0.02, 0.02, 0.01]) ** 2
MIDDLE = np.array([0.0, 0.0, 500.0])


def off_by(covariance, rng, sigmas=1.0):
    return from_twist(sigmas * rng.multivariate_normal(np.zeros(6), covariance))


def scene(n, *, seed, held=False, slides=0, wrong_sigmas=0.0):
    """True poses of views around a part, pairs of neighbours, known poses, and poses to start from."""
    rng = np.random.default_rng(seed)
    about = from_twist(np.concatenate((np.zeros(3), MIDDLE)))
    true = [
        about @ from_twist(np.array([0.1, 2 * np.pi * k / n, 0.0, 0.0, 0.0, 0.0])) @ inverse(about)
        for k in range(n)
    ]
    pairs = {}
    for i, j in [(k, (k + 1) % n) for k in range(n)]:
        T = off_by(NOISE, rng) @ inverse(true[i]) @ true[j]
        determined = np.linalg.qr(rng.normal(size=(6, 6)))[0][:, slides if i == 1 else 0 :]
        pairs[i, j] = Registration(T, NOISE, COMMON, determined, 1.0, 0.01, 1.0, True)
    if wrong_sigmas:
        T = off_by(NOISE, rng, wrong_sigmas) @ pairs[0, 1].T_target_source
        pairs[0, 1] = Registration(T, NOISE, COMMON, np.eye(6), 1.0, 0.01, 1.0, True)
    wide = 100.0 * NOISE
    known = {}
    if held:
        known = {k: ViewPose(off_by(wide, rng) @ T, wide, COMMON) for k, T in enumerate(true)}
    starts = [off_by(np.diag([0.01] * 3 + [3.0] * 3) ** 2, rng) @ T for T in true]
    starts[0] = true[0]
    return true, pairs, known, starts


SCENES = {
    "loop": {"n": 4},
    "held": {"n": 4, "held": True},
    "slides": {"n": 4, "held": True, "slides": 3},
    "wrong": {"n": 4, "held": True, "wrong_sigmas": 40.0},
    "wrong loop": {"n": 4, "wrong_sigmas": 300.0},
}


@pytest.mark.parametrize("name", SCENES)
def test_poses_are_those_of_least_squares(name):
    _, pairs, known, starts = scene(**SCENES[name], seed=3)
    found = solve_poses(len(starts), pairs, known, starts, middle_mm=MIDDLE)
    first = {0: ViewPose(starts[0], 1e-12 * np.eye(6), np.zeros((6, 6)))}
    terms = [
        _Term(None, i, p.T_part_camera, p.noise, p.common, np.eye(6))
        for i, p in (known or first).items()
    ]
    terms += [
        _Term(i, j, r.T_target_source, r.noise, r.common, r.determined)
        for (i, j), r in pairs.items()
    ]
    twins = settled_poses(terms, starts)
    ours = [view.T_part_camera for view in found]
    # The differences of the twin end the descent a little above the minimum.
    assert loss(terms, ours) <= loss(terms, twins) * (1 + 1e-9)
    assert loss(terms, ours) > loss(terms, twins) * (1 - 1e-4)
    for view, T in zip(found, twins, strict=True):
        way = (view.T_part_camera - T) @ np.append(MIDDLE, 1.0)
        assert np.linalg.norm(way) < 0.01 * np.sqrt(np.trace(NOISE[3:, 3:]))
        assert np.abs(view.T_part_camera - T)[:3, :3].max() < 0.01 * 1e-4


def test_errors_are_those_of_the_covariance():
    squares = []
    for seed in range(30):
        true, pairs, known, starts = scene(n=8, held=True, seed=seed)
        for view, T in zip(solve_poses(8, pairs, known, starts), true, strict=True):
            off = view.T_part_camera @ inverse(T)
            xi = np.append([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]], 0)
            xi = np.append(0.5 * xi[:3], off[:3, 3])
            squares.append(xi @ np.linalg.solve(view.noise, xi) / 6.0)
    assert 0.7 < np.mean(squares) < 1.4


def test_a_view_that_is_tied_to_no_other_is_refused():
    _, pairs, _, starts = scene(n=4, seed=0)
    loose = {pair: one for pair, one in pairs.items() if 2 not in pair}
    with pytest.raises(InputError, match="can move against the others"):
        solve_poses(4, loose, {}, starts)
